#include "layout.cl"

// How many superblocks the request of a frame needs at each allocation bias.

// Inclusive sums along each row, then along each column, in place: entry (h, w) becomes the number of patches of at
// most that height and width.
__kernel void sum_rows(__global int *histogram)
{
    const int row = get_global_id(0);
    if (row >= SIZES)
        return;
    for (int k = 1; k < SIZES; k++)
        histogram[SIZES * row + k] += histogram[SIZES * row + k - 1];
}

__kernel void sum_columns(__global int *histogram)
{
    const int column = get_global_id(0);
    if (column >= SIZES)
        return;
    for (int k = 1; k < SIZES; k++)
        histogram[SIZES * k + column] += histogram[SIZES * (k - 1) + column];
}

// Largest size that falls into `level` at `bias` (both -1 below the first level).
INLINE int largest_size(int level, int bias, int top)
{
    return level < 0 ? -1 : level == top ? SIZES - 1 : min(SIZES - 1, STEPS * level + bias);
}

INLINE int below(__global const int *sums, int w, int h)
{
    return w < 0 || h < 0 ? 0 : sums[SIZES * h + w];
}

__kernel void needed_superblocks(__global const int *sums, int top, __global int *needed)
{
    const int bias = get_global_id(0);
    if (bias >= SIZES)
        return;
    int total = 0;
    for (int h = 0; h <= top; h++) {
        const int h0 = largest_size(h - 1, bias, top), h1 = largest_size(h, bias, top);
        for (int w = 0; w <= top; w++) {
            const int w0 = largest_size(w - 1, bias, top), w1 = largest_size(w, bias, top);
            const int blocks = below(sums, w1, h1) - below(sums, w0, h1) - below(sums, w1, h0) + below(sums, w0, h0);
            const int shift = 2 * top - w - h;
            total += (blocks + (1 << shift) - 1) >> shift;
        }
    }
    needed[bias] = total;
}
