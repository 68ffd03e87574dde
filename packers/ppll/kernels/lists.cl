// Lists of fragments per pixel: cut out of, and spliced into, other lists.
#include "common/wide.cl"

// The first fragments of each pixel, as many as it has room for; transparent ones where there are not so many.
__kernel void cut_lists(const int pixels, const int words, __global const int *offsets, __global const uint *rows,
                        __global const int *cut_offsets, __global uint *cut_rows)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    const size_t from = offsets[pixel], first = cut_offsets[pixel], end = cut_offsets[pixel + 1];
    const size_t given = (offsets[pixel + 1] - from) * words;
    for (size_t i = 0; i < (end - first) * words; i++)
        cut_rows[first * words + i] = i < given ? rows[from * words + i] : 0;
}

// How many of each run of fragments are transparent.
__kernel void count_deleted(const int count, const int run, const int words, __global const uint *rows,
                            __global int *sums)
{
    const int id = get_global_id(0);
    if (id > (count - 1) / run)
        return;
    const int end = MIN((id + 1) * run, count);
    int sum = 0;
    for (int i = id * run; i < end; i++)
        sum += rows[(size_t)i * words] >> 24 == 0;
    sums[id] = sum;
}

// A pixel's list is the new one where that holds anything, else the one held.
__kernel void count_spliced(const int pixels, __global const int *held, __global const int *fresh, __global int *counts)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    const int count = fresh[pixel + 1] - fresh[pixel];
    counts[pixel] = count ? count : held[pixel + 1] - held[pixel];
}

__kernel void splice_lists(const int pixels, const int words, __global const int *held, __global const uint *held_rows,
                           __global const int *fresh, __global const uint *fresh_rows, __global const int *offsets,
                           __global uint *rows)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    const int changed = fresh[pixel + 1] > fresh[pixel];
    __global const uint *from =
        changed ? fresh_rows + (size_t)fresh[pixel] * words : held_rows + (size_t)held[pixel] * words;
    const size_t to = (size_t)offsets[pixel] * words, count = (size_t)(offsets[pixel + 1] - offsets[pixel]) * words;
    for (size_t i = 0; i < count; i++)
        rows[to + i] = from[i];
}

INLINE int differs(const uint a, const uint b, const int tolerance)
{
    int most = 0;
    for (int shift = 0; shift < 32; shift += 8) {
        const int difference = abs_diff((a >> shift) & 255, (b >> shift) & 255);
        most = difference > most ? difference : most;
    }
    return most > tolerance;
}

// How many fragments a pixel sends: its list where the blended colour changed, one transparent one if that is empty.
// What is shown becomes what is shown then.
__kernel void count_changed_colours(const int pixels, const int tolerance, __global uint *shown,
                                    __global const uint *now, __global const int *offsets, __global int *counts)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    const int count = offsets[pixel + 1] - offsets[pixel];
    const int changed = differs(shown[pixel], now[pixel], tolerance);
    counts[pixel] = changed ? (count ? count : 1) : 0;
    if (changed)
        shown[pixel] = now[pixel];
}

// The same where any fragment's colour changed, or its depth by more than a share.
__kernel void count_changed_lists(const int pixels, const int tolerance, const float share, __global const int *held,
                                  __global const uint2 *held_rows, __global const int *offsets,
                                  __global const uint2 *rows, __global int *counts)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    const int first = offsets[pixel], count = offsets[pixel + 1] - first, before = held[pixel];
    int held_count = held[pixel + 1] - before;
    if (held_count == 1 && held_rows[before].x >> 24 == 0)
        held_count = 0; // a deleted list
    int changed = held_count != count;
    for (int i = 0; i < count && !changed; i++) {
        const uint2 a = held_rows[before + i], b = rows[first + i];
        const float z = as_float(b.y), moved = fabs(as_float(a.y) - z);
        changed = differs(a.x, b.x, tolerance) || moved > share * z;
    }
    counts[pixel] = changed ? (count ? count : 1) : 0;
}
