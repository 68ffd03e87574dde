#include "bins.cl"

// Which bins are used, by how many triangles, and how wide these are. Sums and maxima of whole numbers only, so that
// the order of the atomics changes nothing.

// used: a bit per bin. widest: two per bin, lengths before and after the height's foot, in 1/8 texel.
__kernel void count_bins(int count, __global const int *triangles, __global const int *bins,
                         __global const ushort4 *lengths, __global int *counts, __global int *widest,
                         __global uint *used)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int triangle = triangles[i], bin = bins[triangle];
    const ushort4 length = lengths[triangle];
    atomic_inc(&counts[bin]);
    atomic_max(&widest[2 * bin], (int)length.x);
    atomic_max(&widest[2 * bin + 1], (int)length.y);
    atomic_or(&used[bin >> 5], 1u << (bin & 31));
}

__kernel void forget_bins(int count, __global const int *list, __global int *counts, __global int *widest,
                          __global uint *used)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int bin = list[i];
    counts[bin] = widest[2 * bin] = widest[2 * bin + 1] = 0;
    atomic_and(&used[bin >> 5], ~(1u << (bin & 31)));
}

__kernel void count_bits(int words, __global const uint *bits, __global int *counts)
{
    const int i = get_global_id(0);
    if (i < words)
        counts[i] = popcount(bits[i]);
}

__kernel void list_bits(int words, __global const uint *bits, __global const int *offsets, __global int *list)
{
    const int i = get_global_id(0);
    if (i >= words)
        return;
    int at = offsets[i];
    for (uint rest = bits[i]; rest; rest &= rest - 1)
        list[at++] = 32 * i + 31 - clz(rest & -rest);
}
