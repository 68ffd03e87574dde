#include "raster/runs.cl"

// One item per row. Items that mark the same triangle store the same byte, whole and without touching its neighbours,
// as every OpenCL from 1.1 on does: it does not matter which is last, and nobody reads it meanwhile.
__kernel void mark_visible(const int height, const int width, __global const int *triangles, __global uchar *flags)
{
    const int y = get_global_id(0);
    if (y >= height)
        return;
    __global const int *row = triangles + (size_t)y * width;
    for (int x = 0; x < width; x += 8) {
        if (x > 0 && x + 8 <= width && !begins_run(row + x))
            continue;
        int before = -1;
        for (int i = x; i < MIN(x + 8, width); i++) {
            if (row[i] != before && row[i] >= 0)
                flags[row[i]] = 1;
            before = row[i];
        }
    }
}
