#include "sas/layout.cl"

// How many superblocks the request of a frame needs at each allocation bias.

#define KINDS 3  // patches of one, two and three triangles

// Inclusive sums along each row, then along each column, in place: entry (kind, h, w) becomes the number of patches of at
// most that height and width.
__kernel void sum_rows(__global int *histogram) {
    const int row = get_global_id(0);
    if (row >= KINDS * SIZES) return;
    for (int k = 1; k < SIZES; k++) histogram[SIZES * row + k] += histogram[SIZES * row + k - 1];
}

__kernel void sum_columns(__global int *histogram) {
    const int column = get_global_id(0) % SIZES, kind = get_global_id(0) / SIZES;
    if (kind >= KINDS) return;
    __global int *sums = histogram + SIZES * SIZES * kind;
    for (int k = 1; k < SIZES; k++) sums[SIZES * k + column] += sums[SIZES * (k - 1) + column];
}

// Largest size that falls into `level` at `bias` (both -1 below the first level).
static inline int largest_size(int level, int bias, int top) {
    return level < 0 ? -1 : level == top ? SIZES - 1 : min(SIZES - 1, STEPS * level + bias);
}

static inline int below(__global const int *sums, int w, int h) { return w < 0 || h < 0 ? 0 : sums[SIZES * h + w]; }

// Patches of the given sums whose sides ask for levels w and h; with `least`, for at least the level 1.
static inline int asking(__global const int *sums, int w, int h, int bias, int top, int least) {
    if (min(w, h) < least) return 0;
    const int w0 = w > least ? largest_size(w - 1, bias, top) : -1, w1 = largest_size(w, bias, top);
    const int h0 = h > least ? largest_size(h - 1, bias, top) : -1, h1 = largest_size(h, bias, top);
    return below(sums, w1, h1) - below(sums, w0, h1) - below(sums, w1, h0) + below(sums, w0, h0);
}

// As levels_of in layout.cl says.
__kernel void needed_superblocks(__global const int *sums, int top, __global int *needed) {
    const int bias = get_global_id(0);
    if (bias > SIZES) return;
    const int least = bias < SIZES ? min(1, top) : 0;
    __global const int *pairs = sums + SIZES * SIZES, *fans = pairs + SIZES * SIZES;
    const int tiny_pairs = asking(pairs, 0, 0, bias, top, 0);
    int total = 0;
    for (int h = 0; h <= top; h++)
        for (int w = 0; w <= top; w++) {
            int blocks = asking(sums, w, h, bias, top, 0) + asking(pairs, w, h, bias, top, 0);
            blocks += asking(fans, w, h, bias, top, least);
            if (h == 0 && w == 0) blocks -= tiny_pairs;
            if (h == 0 && w == least) blocks += tiny_pairs;
            const int shift = 2 * top - w - h;
            total += (blocks + (1 << shift) - 1) >> shift;
        }
    needed[bias] = total;
}
