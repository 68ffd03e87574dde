// Stretch (Sander et al. 2001) per visible pixel: how many pixels one texel covers, from the Jacobian of the map from
// pixels to texels, by differences within one triangle.

#include "metrics/wide.cl"

typedef struct {
    int16 triangle;
    float16 u, v;
} wide_texels;

// 16 pixels from `column` on; columns outside the row repeat its first or last pixel.
INLINE wide_texels load_texels(const int width, const int row, const int column, __global const int *triangle,
                               __global const float *texels)
{
    const size_t first = (size_t)row * width;
    __global const int *ids = triangle + first;
    __global const float *uv = texels + 2 * first;
    if (column >= 0 && column + PIECE <= width) {
        const float16 low = vload16(0, uv + 2 * column), high = vload16(1, uv + 2 * column);
        return (wide_texels){vload16(0, ids + column), (float16)(low.even, high.even), (float16)(low.odd, high.odd)};
    }
    int id[PIECE];
    float u[PIECE], v[PIECE];
    for (int i = 0; i < PIECE; i++) {
        const int x = clamp(column + i, 0, width - 1);
        id[i] = ids[x];
        u[i] = uv[2 * x];
        v[i] = uv[2 * x + 1];
    }
    return (wide_texels){vload16(0, id), vload16(0, u), vload16(0, v)};
}

// Whether a neighbour, if there is one, belongs to the same triangle and has a texel.
INLINE int16 usable(const wide_texels here, const wide_texels there, const int16 exists)
{
    return exists && here.triangle == there.triangle && there.u == there.u && there.v == there.v;
}

// The derivative from the neighbours before and after: the shorter difference, or the one there is. Where the map is
// cut or made of parts, one neighbour may lie anywhere in the atlas; both do only where a part is narrower than a
// pixel.
INLINE void derivative(const wide_texels before, const wide_texels here, const wide_texels after,
                       const int16 has_before, const int16 has_after, float16 *u, float16 *v)
{
    const float16 back_u = here.u - before.u, back_v = here.v - before.v;
    const float16 on_u = after.u - here.u, on_v = after.v - here.v;
    const int16 shorter = back_u * back_u + back_v * back_v <= on_u * on_u + on_v * on_v;
    const int16 back = has_before && (!has_after || shorter);
    *u = back ? back_u : on_u;
    *v = back ? back_v : on_v;
}

// Per piece: the sum of L2 squared and the largest Linf squared, and counts (2) of valid and degenerate pixels.
__kernel void stretch(const int width, const int height, __global const int *triangle, __global const float *texels,
                      const float degenerate, __global float *sums, __global int *counts)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int id = get_global_id(0);
    const int row = id / pieces;
    if (row >= height)
        return;
    const int column = (id % pieces) * PIECE;
    const wide_texels here = load_texels(width, row, column, triangle, texels);
    const wide_texels left = load_texels(width, row, column - 1, triangle, texels);
    const wide_texels right = load_texels(width, row, column + 1, triangle, texels);
    const wide_texels above = load_texels(width, max(row - 1, 0), column, triangle, texels);
    const wide_texels below = load_texels(width, min(row + 1, height - 1), column, triangle, texels);

    const int16 x = convert_int16(lane_numbers()) + column;
    const int16 all = -1;
    const int16 has_left = usable(here, left, x > 0), has_right = usable(here, right, x < width - 1);
    const int16 has_above = usable(here, above, row > 0 ? all : ~all);
    const int16 has_below = usable(here, below, row < height - 1 ? all : ~all);
    const int16 measured = x < width && here.triangle >= 0 && here.u == here.u && here.v == here.v &&
                           (has_left || has_right) && (has_above || has_below);

    float16 ux, vx, uy, vy;
    derivative(left, here, right, has_left, has_right, &ux, &vx);
    derivative(above, here, below, has_above, has_below, &uy, &vy);
    // Singular values s1 <= s2: s1 s2 = |det|, s1^2 + s2^2 = the sum of squares.
    const float16 a = ux * ux + vx * vx, b = ux * uy + vx * vy, c = uy * uy + vy * vy;
    const float16 det = fabs(ux * vy - uy * vx);
    const float16 squares = a + c;
    const int16 valid = measured && det > degenerate * squares;
    const float16 inverse = 1.0f / (valid ? det : (float16)(1.0f));
    const float16 largest = 0.5f * (squares + sqrt((a - c) * (a - c) + 4.0f * b * b));
    const float16 l2 = valid ? 0.5f * squares * inverse * inverse : (float16)(0.0f);
    const float16 linf = valid ? largest * inverse * inverse : (float16)(0.0f);

    const float8 m8 = linf.lo > linf.hi ? linf.lo : linf.hi;
    const float4 m4 = m8.lo > m8.hi ? m8.lo : m8.hi;
    sums[2 * id] = sum_of_lanes(l2);
    sums[2 * id + 1] = max(max(m4.x, m4.y), max(m4.z, m4.w));
    counts[2 * id] = convert_int(sum_of_lanes(valid ? (float16)(1.0f) : (float16)(0.0f)));
    counts[2 * id + 1] = convert_int(sum_of_lanes(measured && !valid ? (float16)(1.0f) : (float16)(0.0f)));
}
