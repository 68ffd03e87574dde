// Which fragments of each pixel are kept: the nearest, up to a number of layers or until little shows through.
#include "common/wide.cl"

#if BLENDED
#define OPACITY(at) opacity[at]
#define OPACITY_PARAMETER , __global const int *opacity
#define OPACITY_ARGUMENT , opacity
#else
#define OPACITY(at) 255
#define OPACITY_PARAMETER
#define OPACITY_ARGUMENT
#endif

// The next fragment to keep from `at` on, or `end`: invisible ones are passed over.
INLINE int next_kept(int at, const int end OPACITY_PARAMETER)
{
#if BLENDED
    while (at < end && opacity[at] == 0)
        at++;
#endif
    return at;
}

// Whether nothing more is wanted behind a fragment that is kept, after which the share `through` of light passes.
INLINE int is_last(const int kept, const int layers, const float through, const float threshold)
{
    return kept >= layers || 1.0f - through >= threshold;
}

// spans: in each row, the first pixel that keeps any, and the one behind the last.
__kernel void count_kept(const int pixels, const int width, __global const int *offsets, __global const int2 *spans,
                         const int layers, const float threshold, __global int *counts OPACITY_PARAMETER)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    const int row = pixel / width, column = pixel - row * width;
    const int2 span = spans[row];
    const int end = column >= span.x && column < span.y ? offsets[pixel + 1] : 0;
    int kept = 0;
    float through = 1.0f;
    for (int at = next_kept(offsets[pixel], end OPACITY_ARGUMENT); at < end;
         at = next_kept(at + 1, end OPACITY_ARGUMENT)) {
        through *= 1.0f - OPACITY(at) * (1.0f / 255.0f);
        kept++;
        if (is_last(kept, layers, through, threshold))
            break;
    }
    counts[pixel] = kept;
}

// source[to]: which fragment becomes fragment `to`.
__kernel void list_kept(const int pixels, __global const int *offsets, __global const int *kept_offsets,
                        __global int *source OPACITY_PARAMETER)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    const int end = offsets[pixel + 1], last = kept_offsets[pixel + 1];
    int at = offsets[pixel];
    for (int to = kept_offsets[pixel]; to < last; to++) {
        at = next_kept(at, end OPACITY_ARGUMENT);
        source[to] = at++;
    }
}

__kernel void copy_kept(const int count, __global const int *source, __global const int *triangle,
                        __global const int *pixel, __global const float *bary1, __global const float *bary2,
                        __global const float *footprint, __global const float *depth, __global int *to_triangle,
                        __global int *to_pixel, __global float *to_bary1, __global float *to_bary2,
                        __global float *to_footprint, __global float *to_depth)
{
    const int to = get_global_id(0);
    if (to >= count)
        return;
    const int from = source[to];
    to_triangle[to] = triangle[from];
    to_pixel[to] = pixel[from];
    to_bary1[to] = bary1[from];
    to_bary2[to] = bary2[from];
    to_footprint[to] = footprint[from];
    to_depth[to] = depth[from];
}

// values[source[i]] of any list of ints.
__kernel void pick(const int count, __global const int *source, __global const int *values, __global int *picked)
{
    const int to = get_global_id(0);
    if (to < count)
        picked[to] = values[source[to]];
}
