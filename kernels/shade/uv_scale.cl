// How much finer a texture is than its triangle: the largest singular value of d UV / d P.
#include "common/elementary.cl"

// e1, e2: the triangle's sides from its first corner in space; t1, t2: in texture space. 0 for a triangle without area.
// With e and t as matrices, the squares of the singular values are the eigenvalues of (e.e)^-1 (t.t), of which only
// trace and determinant are needed.
INLINE float uv_scale(const float3 e1, const float3 e2, const float2 t1, const float2 t2)
{
    const float3 area = cross3(e1, e2);
    const float det = dot3(area, area);
    const float trace = dot2(t1, t1) * dot3(e2, e2) - 2.0f * dot2(t1, t2) * dot3(e1, e2) + dot2(t2, t2) * dot3(e1, e1);
    const float turn = t1.x * t2.y - t1.y * t2.x;
    const float half_trace = 0.5f * trace / det;
    const float rest = half_trace * half_trace - turn * turn / det;
    const float scale = sqrt(half_trace + sqrt(rest > 0.0f ? rest : 0.0f));
    return det > 0.0f && scale < 1e30f ? scale : 0.0f;
}
