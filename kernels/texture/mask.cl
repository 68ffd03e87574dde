// Alpha tests of masked triangles, one pixel at a time. Tables: texture/mask.py.
#include "common/elementary.cl"

#define MASK_PARAMETERS                                                                                                \
    __global const int *mask_slots, __global const float *mask_corners, __global const int *mask_chains,               \
        __global const int *mask_levels, __global const uchar *mask_alphas
#define MASK_ARGUMENTS mask_slots, mask_corners, mask_chains, mask_levels, mask_alphas

// The row of the level table to test a masked triangle with, where `pixels` is its whole area on screen: one texel per
// pixel, rounded to the sharper level at up to half a level.
static inline int mask_level(const int triangle, const float pixels, MASK_PARAMETERS)
{
    const float8 corner = vload8(mask_slots[triangle], mask_corners);
    const int2 chain = vload2(as_int(corner.s6), mask_chains);
    const float level = corner.s7 - 0.5f * log2_1(pixels > 1e-6f ? pixels : 1e-6f) + 0.5f;
    return chain.x + (level > 0.0f ? (level < (float)chain.y ? (int)level : chain.y) : 0);
}

// A coordinate wrapped into 0..1 (0: repeat, 1: clamp, 2: mirror); what is not a number or beyond 1e6 counts as 0.
static inline float mask_wrapped(const float coordinate, const int mode)
{
    const float u = coordinate > -1e6f && coordinate < 1e6f ? coordinate : 0.0f;
    const float half_turn = u * 0.5f;
    const float sawtooth = (half_turn - floor(half_turn)) * 2.0f;
    const float mirrored = sawtooth > 1.0f ? 2.0f - sawtooth : sawtooth;
    const float inside = mode == 0 ? u - floor(u) : mode == 1 ? (u > 0.0f ? (u < 1.0f ? u : 1.0f) : 0.0f) : mirrored;
    return inside;
}

// Whether a masked triangle is there at weights b1, b2 of its corners 1 and 2: bilinear alpha reaches the threshold of
// the level, a row given by mask_level.
static inline int mask_keeps(const int triangle, const float b1, const float b2, const int level, MASK_PARAMETERS)
{
    const float8 corner = vload8(mask_slots[triangle], mask_corners);
    const int8 row = vload8(level, mask_levels);
    const int width = row.s1, height = row.s2, mode_s = row.s4, mode_t = row.s5;
    const float x = mask_wrapped(corner.s0 + b1 * corner.s2 + b2 * corner.s4, mode_s) * width - 0.5f;
    const float y = mask_wrapped(corner.s1 + b1 * corner.s3 + b2 * corner.s5, mode_t) * height - 0.5f;
    const float left = floor(x), top = floor(y);
    int x0 = (int)left, x1 = x0 + 1, y0 = (int)top, y1 = y0 + 1;
    x0 = x0 < 0 ? (mode_s == 0 ? width - 1 : 0) : x0;
    x1 = x1 >= width ? (mode_s == 0 ? 0 : width - 1) : x1;
    y0 = y0 < 0 ? (mode_t == 0 ? height - 1 : 0) : y0;
    y1 = y1 >= height ? (mode_t == 0 ? 0 : height - 1) : y1;
    __global const uchar *near = mask_alphas + row.s0 + y0 * width, *far = mask_alphas + row.s0 + y1 * width;
    const float upper = near[x0] + (x - left) * (float)(near[x1] - near[x0]);
    const float lower = far[x0] + (x - left) * (float)(far[x1] - far[x0]);
    return upper + (y - top) * (lower - upper) >= as_float(row.s3);
}

// Tests a list of points, for checking against the twin.
__kernel void alpha_test(const int count, __global const int *triangles, __global const float *b1,
                          __global const float *b2, __global const float *pixels, __global int *kept, MASK_PARAMETERS)
{
    const int id = get_global_id(0);
    if (id >= count)
        return;
    const int level = mask_level(triangles[id], pixels[id], MASK_ARGUMENTS);
    kept[id] = mask_keeps(triangles[id], b1[id], b2[id], level, MASK_ARGUMENTS);
}
