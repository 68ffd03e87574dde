#include "atlas/bilinear.cl"

// A client's picture from its atlas, 8 pixels per step.

// A sample's triangle counts through the client's list; `ids` are the scene's. Pixels of triangles without a place stay
// as they are.
__kernel void look_up(int count, __global const int *triangle, __global const float *bary1,
                      __global const float *bary2, __global const int *texel, __global const float *corners,
                      __global const int *ids, __global const int *plane, int width, int height, __global uint *rgb,
                      __global int *drawn) {
    const int first = 8 * get_global_id(0);
    if (first >= count) return;
    const int lanes = LESSER(8, count - first);
    float8 c[6];
    for (int k = 0; k < 8; k++) {
        __global const float *corner = corners + 6 * triangle[LESSER(first + k, count - 1)];
        for (int j = 0; j < 6; j++) ((float *)&c[j])[k] = corner[j];
    }
    const float8 b1 = *(__global const loose_float8 *)(bary1 + first);
    const float8 b2 = *(__global const loose_float8 *)(bary2 + first);
    float8 x = c[0] + b1 * (c[2] - c[0]) + b2 * (c[4] - c[0]) - 0.5f;
    float8 y = c[1] + b1 * (c[3] - c[1]) + b2 * (c[5] - c[1]) - 0.5f;
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
