// An atlas from the list of its samples, and which of these are looked at one by one.

// Of texels without a sample: one row of the plane, which has a border of one texel around.
__kernel void clear_plane(const int width, const int height, __global int *plane)
{
    const int row = get_global_id(0);
    if (row >= height + 2)
        return;
    __global int *texels = plane + (size_t)row * (width + 2);
    const int without = row == 0 || row == height + 1 ? BORDER : UNOWNED;
    for (int i = 0; i < width + 2; i++)
        texels[i] = without;
    texels[0] = texels[width + 1] = BORDER;
}

// counts: samples outside the plane, and those marked FAR.
__kernel void place_samples(const int count, const int width, const int height, const int turn, const int turns,
                            __global const long *texel, __global const int *triangle, __global const float *bary,
                            __global int *plane, __global uchar *marks, __global int *counts)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const long at = texel[i];
    if (at < 0 || at >= (long)width * height)
        atomic_inc(counts);
    else
        plane[at + 2 * ((int)at / width) + width + 3] = i;
    const float b1 = bary[2 * i], b2 = bary[2 * i + 1];
    const int far = !(b1 >= -1.0f && b2 >= -1.0f && 1.0f - b1 - b2 >= -1.0f); // also NaN
    const int inside = b1 >= -1e-4f && b2 >= -1e-4f && b1 + b2 <= 1.0001f;
    if (far)
        atomic_inc(counts + 1);
    marks[i] = (far ? FAR : 0) | (inside && triangle[i] % turns == turn ? CHOSEN : 0);
}
