#include "common/wide.cl"

// The shading samples of square cells: of each cell the upper left half, which is what lookups in a triangle touch.

// levels, columns, rows: of each triangle's cell. first: the number of its first sample. lengths: of its longest edge
// on the surface. A sample for each texel, row by row.
__kernel void emit_samples(int count, int width, __global const int *ids, __global const int *levels,
                           __global const int *columns, __global const int *rows, __global const int *first,
                           __global const float *lengths, __global int *triangle, __global float *bary1,
                           __global float *bary2, __global float *footprint, __global int *texel)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int side = 1 << levels[i];
    const float last = (float)GREATER(side - 1, 1);
    int sample = first[i];
    for (int row = 0; row < side; row++) {
        for (int column = 0; column < LESSER(side, side - row + 1); column++, sample++) {
            triangle[sample] = ids[i];
            bary1[sample] = (float)column / last;
            bary2[sample] = (float)row / last;
            footprint[sample] = lengths[i] / (float)side;
            texel[sample] = (rows[i] + row) * width + columns[i] + column;
        }
    }
}
