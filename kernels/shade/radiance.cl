#include "shade/shade.cl"

// Radiance of samples, linear and before exposure: one work-item per 8 of them, RGB one sample after the other.
__kernel void shade_radiance(const int count, __global const int *triangles, __global const float *barys1,
                             __global const float *barys2, __global const float *footprints, __global float *radiances,
                             const float eye_x, const float eye_y, const float eye_z, SURFACE_PARAMETERS)
{
    const int first = 8 * get_global_id(0);
    if (first >= count)
        return;
    const int8 used = first + (int8)(0, 1, 2, 3, 4, 5, 6, 7) < count;
    const int8 ids = *(__global const loose_int8 *)(triangles + first);
    int triangle[8];
    float bary1[8], bary2[8], red[8], green[8], blue[8];
    STORE_INT8(used ? ids : (int8)ids.s0, triangle);
    STORE8(*(__global const loose_float8 *)(barys1 + first), bary1);
    STORE8(*(__global const loose_float8 *)(barys2 + first), bary2);
    const float8 footprint = *(__global const loose_float8 *)(footprints + first);
    const float3 eye = (float3)(eye_x, eye_y, eye_z);
    const vector8 c = shade8(triangle, bary1, bary2, footprint, eye, SURFACE_ARGUMENTS);
    STORE8(c.x, red);
    STORE8(c.y, green);
    STORE8(c.z, blue);
    for (int lane = 0; lane < MIN(8, count - first); lane++) {
        radiances[3 * (first + lane)] = red[lane];
        radiances[3 * (first + lane) + 1] = green[lane];
        radiances[3 * (first + lane) + 2] = blue[lane];
    }
}
