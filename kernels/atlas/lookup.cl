#include "atlas/bilinear.cl"

// A client's picture from its atlas, 8 pixels per step.

// A sample's triangle counts through the client's list; `ids` are the scene's. Pixels of triangles without a place,
// whose places are NaN, stay as they are. `room`, where the places' y begin, is a multiple of 8.
__kernel void look_up(int count, int room, __global const int *triangle, __global const int *texel,
                      __global const float *places, __global const int *ids, __global const int *plane, int width,
                      int height, __global uint *rgb, __global int *drawn)
{
    const int first = 8 * get_global_id(0);
    if (first >= count)
        return;
    const int lanes = MIN(8, count - first);
    const float8 x = *(__global const loose_float8 *)(places + first);
    const float8 y = *(__global const loose_float8 *)(places + room + first);
    const int8 placed = x == x;
    const int8 colour = bilinear(plane, width, height, x, y);
    for (int k = 0; k < lanes; k++)
        if (((int *)&placed)[k]) {
            const int pixel = texel[first + k];
            rgb[pixel] = ((uint *)&colour)[k];
            drawn[pixel] = ids[triangle[first + k]];
        }
}
