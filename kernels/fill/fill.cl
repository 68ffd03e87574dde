// Push-pull: colours for texels that nothing owns, from means of owned ones at the finest scale that has any.
// Texels are 32-bit words (red lowest); alpha 0 marks those without a colour. Work-items are 16 texels of a row.
#include "common/wide.cl"

#define PIECE 16

// 16 texels from `column` on; outside the plane there are none (0).
INLINE uint16 load_texels(__global const uint *plane, const int width, const int height, const int row,
                          const int column)
{
    if (row >= height)
        return (uint16)(0);
    __global const uint *texels = plane + (size_t)row * width;
    if (column + PIECE <= width)
        return vload16(0, texels + column);
    uint lanes[PIECE];
    for (int i = 0; i < PIECE; i++)
        lanes[i] = column + i < width ? texels[column + i] : 0u;
    return vload16(0, lanes);
}

INLINE void store_texels(__global uint *plane, const int width, const int row, const int column, const uint16 values)
{
    __global uint *texels = plane + (size_t)row * width;
    if (column + PIECE <= width) {
        vstore16(values, 0, texels + column);
        return;
    }
    uint lanes[PIECE];
    vstore16(values, 0, lanes);
    for (int i = 0; column + i < width; i++)
        texels[column + i] = lanes[i];
}

// The rounded mean of one channel over the owned ones of 4 texels. reciprocal: 65536 / count, rounded up.
INLINE uint16 mean_channel(const uint16 a, const uint16 b, const uint16 c, const uint16 d, const int number,
                           const uint16 half_count, const uint16 reciprocal)
{
    const uint shift = 8 * number;
    const uint16 sum = ((a >> shift) & 255u) + ((b >> shift) & 255u) + ((c >> shift) & 255u) + ((d >> shift) & 255u);
    return (((sum + half_count) * reciprocal) >> 16u) << shift;
}

// Each coarse texel is the mean of the owned ones of its 2x2, and has no colour where none is owned.
__kernel void pull(const int width, const int height, const int coarse_width, const int coarse_height,
                   __global const uint *fine, __global uint *coarse)
{
    const int pieces = (coarse_width + PIECE - 1) / PIECE;
    const int row = get_global_id(0) / pieces;
    if (row >= coarse_height)
        return;
    const int column = (get_global_id(0) % pieces) * PIECE;
    const uint16 nothing = 0;
    uint16 quad[4];
    for (int k = 0; k < 2; k++) {
        const uint16 low = load_texels(fine, width, height, 2 * row + k, 2 * column);
        const uint16 high = load_texels(fine, width, height, 2 * row + k, 2 * column + PIECE);
        const uint16 even = (uint16)(low.even, high.even), odd = (uint16)(low.odd, high.odd);
        quad[2 * k] = (even >> 24u) != 0u ? even : nothing;
        quad[2 * k + 1] = (odd >> 24u) != 0u ? odd : nothing;
    }
    uint16 count = 0;
    for (int k = 0; k < 4; k++)
        count += (quad[k] >> 24u) != 0u ? (uint16)(1u) : nothing;
    const uint16 reciprocal = count == 3u ? (uint16)(21846u) : (uint16)(65536u) >> (count >> 1u);
    uint16 mean = count > 0u ? (uint16)(0xff000000u) : nothing;
    for (int c = 0; c < 3; c++)
        mean |= mean_channel(quad[0], quad[1], quad[2], quad[3], c, count >> 1u, reciprocal);
    store_texels(coarse, coarse_width, row, column, mean);
}

INLINE uint16 parents(const int coarse_width, const int coarse_height, __global const uint *coarse, const int row,
                      const int column)
{
    const uint8 p = load_texels(coarse, coarse_width, coarse_height, row / 2, column / 2).lo;
    return p.s0011223344556677;
}

// Texels without a colour take that of their coarse texel.
__kernel void push(const int width, const int height, const int coarse_width, const int coarse_height,
                   __global const uint *coarse, __global uint *fine)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int row = get_global_id(0) / pieces;
    if (row >= height)
        return;
    const int column = (get_global_id(0) % pieces) * PIECE;
    const uint16 here = load_texels(fine, width, height, row, column);
    const uint16 parent = parents(coarse_width, coarse_height, coarse, row, column);
    store_texels(fine, width, row, column, (here >> 24u) != 0u ? here : parent);
}

// The filled plane, in place of the last one; alpha stays as it was. Texels that were not owned before either keep the
// colour they had, so that the blocks of a video they lie in need not be coded again.
__kernel void finish(const int width, const int height, const int coarse_width, const int coarse_height,
                     __global const uint *coarse, __global const uint *atlas, __global uint *filled)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int row = get_global_id(0) / pieces;
    if (row >= height)
        return;
    const int column = (get_global_id(0) % pieces) * PIECE;
    const uint16 here = load_texels(atlas, width, height, row, column);
    const uint16 old = load_texels(filled, width, height, row, column);
    const uint16 parent = parents(coarse_width, coarse_height, coarse, row, column) & 0x00ffffffu;
    const uint16 fill = (old >> 24u) != 0u ? parent : old;
    store_texels(filled, width, row, column, (here >> 24u) != 0u ? here : fill);
}
