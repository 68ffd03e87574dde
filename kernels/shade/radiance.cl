#include "shade/shade.cl"

// Radiance of samples, linear and before exposure: one work-item per LANES of them, RGB one sample after the other.
__kernel void shade_radiance(const int count, __global const int *triangles, __global const float *barys1,
                             __global const float *barys2, __global const float *footprints, __global float *radiances,
                             const float eye_x, const float eye_y, const float eye_z, SURFACE_PARAMETERS)
{
    const int first = LANES * get_global_id(0);
    if (first >= count)
        return;
    const intN used = first + LANE_NUMBERS < count;
    const intN ids = *(__global const loose_intN *)(triangles + first);
    int triangle[LANES];
    float bary1[LANES], bary2[LANES], red[LANES], green[LANES], blue[LANES];
    STORE_INTN(used ? ids : (intN)ids.s0, triangle);
    STOREN(*(__global const loose_floatN *)(barys1 + first), bary1);
    STOREN(*(__global const loose_floatN *)(barys2 + first), bary2);
    const floatN footprint = *(__global const loose_floatN *)(footprints + first);
    const float3 eye = (float3)(eye_x, eye_y, eye_z);
    const vectorN c = shadeN(triangle, bary1, bary2, footprint, eye, SURFACE_ARGUMENTS);
    STOREN(c.x, red);
    STOREN(c.y, green);
    STOREN(c.z, blue);
    for (int lane = 0; lane < MIN(LANES, count - first); lane++) {
        radiances[3 * (first + lane)] = red[lane];
        radiances[3 * (first + lane) + 1] = green[lane];
        radiances[3 * (first + lane) + 2] = blue[lane];
    }
}
