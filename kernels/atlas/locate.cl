#include "common/wide.cl"

// Where in the atlas surface points lie, 8 per step.

// CORNER floats per corner: column and row, or, homogeneous, column times w, row times w, and w.
__kernel void locate(int count, int room, __global const int *triangle, __global const float *bary1,
                     __global const float *bary2, __global const float *corners, __global float *places)
{
    const int first = 8 * get_global_id(0);
    if (first >= count)
        return;
    float8 c[3 * CORNER];
    for (int k = 0; k < 8; k++) {
        __global const float *corner = corners + 3 * CORNER * triangle[MIN(first + k, count - 1)];
        for (int j = 0; j < 3 * CORNER; j++)
            ((float *)&c[j])[k] = corner[j];
    }
    const float8 b1 = *(__global const loose_float8 *)(bary1 + first);
    const float8 b2 = *(__global const loose_float8 *)(bary2 + first);
#define INTERPOLATED(j) (c[j] + b1 * (c[CORNER + (j)] - c[j]) + b2 * (c[2 * CORNER + (j)] - c[j]))
    float8 x = INTERPOLATED(0), y = INTERPOLATED(1);
#if CORNER == 3
    const float8 inverse = 1.0f / INTERPOLATED(2);
    x *= inverse;
    y *= inverse;
#endif
    *(__global loose_float8 *)(places + first) = x - 0.5f;
    *(__global loose_float8 *)(places + room + first) = y - 0.5f;
}
