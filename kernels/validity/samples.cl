// An atlas from the list of its samples, and which of these are looked at one by one.

// has_turn: by triangle. chosen: of samples inside a triangle that has. far: of those with a weight below -1 or not a
// number. counts: samples outside the plane, and those that are far.
__kernel void place_samples(const int count, const int texels, __global const long *texel, __global const int *triangle,
                            __global const float *bary, __global const uchar *has_turn, __global int *plane,
                            __global uchar *chosen, __global uchar *far, __global int *counts)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const long at = texel[i];
    if (at >= 0 && at < texels)
        plane[at] = i;
    else
        atomic_inc(counts);
    const float b1 = bary[2 * i], b2 = bary[2 * i + 1];
    const int is_far = !(b1 >= -1.0f && b2 >= -1.0f && 1.0f - b1 - b2 >= -1.0f); // also NaN
    const int inside = b1 >= -1e-4f && b2 >= -1e-4f && b1 + b2 <= 1.0001f;
    if (is_far)
        atomic_inc(counts + 1);
    far[i] = is_far;
    chosen[i] = inside && has_turn[triangle[i]];
}
