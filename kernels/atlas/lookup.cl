#include "atlas/bilinear.cl"

// A client's picture from its atlas, 8 pixels per step.

// CORNER floats per corner: column and row, or, homogeneous, column times w, row times w, and w.
// A sample's triangle counts through the client's list; `ids` are the scene's. Pixels of triangles without a place stay
// as they are.
__kernel void look_up(int count, __global const int *triangle, __global const float *bary1,
                      __global const float *bary2, __global const int *texel, __global const float *corners,
                      __global const int *ids, __global const int *plane, int width, int height, __global uint *rgb,
                      __global int *drawn) {
    const int first = 8 * get_global_id(0);
    if (first >= count) return;
    const int lanes = LESSER(8, count - first);
    float8 c[3 * CORNER];
    for (int k = 0; k < 8; k++) {
        __global const float *corner = corners + 3 * CORNER * triangle[LESSER(first + k, count - 1)];
        for (int j = 0; j < 3 * CORNER; j++) ((float *)&c[j])[k] = corner[j];
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
    x -= 0.5f;
    y -= 0.5f;
    const int8 placed = x == x;  // corners without a place are NaN
    x = placed ? x : (float8)(0.0f);
    y = placed ? y : (float8)(0.0f);
    const int8 colour = bilinear(plane, width, height, x, y);
    for (int k = 0; k < lanes; k++)
        if (((int *)&placed)[k]) {
            const int pixel = texel[first + k];
            rgb[pixel] = ((uint *)&colour)[k];
            drawn[pixel] = ids[triangle[first + k]];
        }
}
