#include "common/elementary.cl"
// Per triangle: its material, and its UV scale: the largest singular value of d UV / d P, in 1 / scene unit.
// With e the sides in space and d in texture space, the squares of the singular values are the eigenvalues of
// (e.e)^-1 (d.d), of which only trace and determinant are needed.
__kernel void uv_scales(const int count, __global const float *vertices, __global const int *indices,
                        __global const int *materials, __global int *faces)
{
    const int id = get_global_id(0);
    if (id >= count)
        return;
    const int3 corner = vload3(id, indices);
    const float8 v0 = vload8(corner.x, vertices);
    const float8 d1 = vload8(corner.y, vertices) - v0, d2 = vload8(corner.z, vertices) - v0;
    const float3 e1 = d1.s012, e2 = d2.s012;
    const float3 area = cross3(e1, e2);
    const float det = dot3(area, area);
    const float2 t1 = d1.s67, t2 = d2.s67;
    const float trace = dot2(t1, t1) * dot3(e2, e2) - 2.0f * dot2(t1, t2) * dot3(e1, e2) + dot2(t2, t2) * dot3(e1, e1);
    const float turn = t1.x * t2.y - t1.y * t2.x;
    const float half_trace = 0.5f * trace / det;
    const float rest = half_trace * half_trace - turn * turn / det;
    const float scale = sqrt(half_trace + sqrt(rest > 0.0f ? rest : 0.0f));
    const int usable = det > 0.0f && scale < 1e30f;
    vstore2((int2)(materials[id], as_int(usable ? scale : 0.0f)), id, faces);
}
