// Whether fragment lists are sound, and what is nearest in each pixel; RUN pixels per item.

#include "common/wide.cl"

// nearest: the depth of each pixel's first visible fragment, or 0. counts: visible fragments, and what breaks a rule: a
// list that ends before it begins or beyond the fragments, a visible fragment without a depth, or before a nearer one.
__kernel void walk_lists(const int pixels, const int fragments, __global const long *offsets,
                         __global const uchar *rgba, __global const float *depths, __global float *nearest,
                         __global int *counts)
{
    const int start = RUN * get_global_id(0), end = MIN(start + RUN, pixels);
    int visible = 0, broken = 0;
    for (int pixel = start; pixel < end; pixel++) {
        const long first = offsets[pixel], last = offsets[pixel + 1];
        float before = 0;
        nearest[pixel] = 0;
        if (first < 0 || last < first || last > fragments) {
            broken++;
            continue;
        }
        int found = 0;
        for (int i = first; i < last; i++) {
            if (!rgba[4 * i + 3])
                continue;
            const float depth = depths[i];
            broken += !(depth > 0 && depth < INFINITY);
            if (found)
                broken += depth > before;
            else
                nearest[pixel] = depth;
            before = depth;
            found++;
        }
        visible += found;
    }
    if (visible)
        atomic_add(counts, visible);
    if (broken)
        atomic_add(counts + 1, broken);
}

// counts: pixels of the view's own whose surface is known, and whose nearest fragment lies elsewhere.
__kernel void compare_nearest(const int pixels, const float tolerance, __global const float *surfaces,
                              __global const int *triangles, __global const uchar *known, __global const uchar *owned,
                              __global const float *nearest, __global int *counts)
{
    const int start = RUN * get_global_id(0), end = MIN(start + RUN, pixels);
    int wrong = 0;
    for (int pixel = start; pixel < end; pixel++) {
        const int triangle = triangles[pixel];
        const float off = nearest[pixel] - surfaces[pixel], most = tolerance * surfaces[pixel];
        wrong += owned[pixel] && triangle >= 0 && known[triangle] && (off > most || -off > most);
    }
    if (wrong)
        atomic_add(counts, wrong);
}
