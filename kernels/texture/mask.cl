// Alpha tests of masked triangles, one pixel at a time. Tables: texture/mask.py. VERTEX_ALPHA is 1 where vertices have
// an alpha that counts.
#include "common/elementary.cl"

#if VERTEX_ALPHA
#define FADE_PARAMETER , __global const float *mask_fades, __global const float *mask_thresholds
#define FADE_ARGUMENT , mask_fades, mask_thresholds
#else
#define FADE_PARAMETER
#define FADE_ARGUMENT
#endif
#define MASK_PARAMETERS                                                                                  \
    __global const int *mask_slots, __global const float *mask_corners, __global const int *mask_chains, \
        __global const int *mask_levels, __global const uchar *mask_alphas FADE_PARAMETER
#define MASK_ARGUMENTS mask_slots, mask_corners, mask_chains, mask_levels, mask_alphas FADE_ARGUMENT

// The row of the level table to test a masked triangle with, where `pixels` is its whole area on screen: one texel per
// pixel, rounded to the sharper level at up to half a level.
INLINE int mask_level(const int triangle, const float pixels, MASK_PARAMETERS)
{
    const float8 corner = vload8(mask_slots[triangle], mask_corners);
    const int2 chain = vload2(as_int(corner.s6), mask_chains);
    const float level = corner.s7 - 0.5f * log2_1(pixels > 1e-6f ? pixels : 1e-6f) + 0.5f;
    return chain.x + (level > 0.0f ? (level < (float)chain.y ? (int)level : chain.y) : 0);
}

// A coordinate wrapped into 0..1 (0: repeat, 1: clamp, 2: mirror); what is not a number or beyond 1e6 counts as 0.
INLINE float mask_wrapped(const float coordinate, const int mode)
{
    const float u = coordinate > -1e6f && coordinate < 1e6f ? coordinate : 0.0f;
    const float half_turn = u * 0.5f;
    const float sawtooth = (half_turn - floor(half_turn)) * 2.0f;
    const float mirrored = sawtooth > 1.0f ? 2.0f - sawtooth : sawtooth;
    const float inside = mode == 0 ? u - floor(u) : mode == 1 ? (u > 0.0f ? (u < 1.0f ? u : 1.0f) : 0.0f) : mirrored;
    return inside;
}

#if VERTEX_ALPHA
#define FADED 8 // thresholds of a level

// A level's threshold where vertices have an alpha: the cutoff of the finest level is `cutoff` / alpha there. Beyond
// 255 nothing reaches it.
INLINE float faded_threshold(__global const float *thresholds, const float cutoff, const float alpha)
{
    const float wanted = cutoff / (alpha > 1e-6f ? (alpha < 1.0f ? alpha : 1.0f) : 1e-6f);
    const float share = (wanted - cutoff) / (cutoff < 255.0f ? 255.0f - cutoff : 1.0f);
    const float step = (share > 0.0f ? (share < 1.0f ? share : 1.0f) : 0.0f) * (FADED - 1);
    const int first = step < FADED - 2 ? (int)step : FADED - 2;
    const float low = thresholds[first], high = thresholds[first + 1];
    return wanted > 255.0f ? wanted : low + (step - first) * (high - low);
}
#endif

// Whether a masked triangle is there at weights b1, b2 of its corners 1 and 2: bilinear alpha reaches the threshold of
// the level, a row given by mask_level.
INLINE int mask_keeps(const int triangle, const float b1, const float b2, const int level, MASK_PARAMETERS)
{
    const int slot = mask_slots[triangle];
    const float8 corner = vload8(slot, mask_corners);
    const int8 row = vload8(level, mask_levels);
#if VERTEX_ALPHA
    const float4 fade = vload4(slot, mask_fades);
    const float alpha = fade.s0 + b1 * fade.s1 + b2 * fade.s2;
    const float threshold = faded_threshold(mask_thresholds + level * FADED, as_float(row.s6), alpha);
#else
    const float threshold = as_float(row.s3);
#endif
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
    return upper + (y - top) * (lower - upper) >= threshold;
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
