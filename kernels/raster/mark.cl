__kernel void mark_visible(const int pixels, __global const int *triangles, __global uchar *flags)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    const int triangle = triangles[pixel];
    if (triangle >= 0 && (pixel == 0 || triangles[pixel - 1] != triangle))
        flags[triangle] = 1;
}
