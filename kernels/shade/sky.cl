#include "shade/colour.cl"

// The sky behind a picture: one work-item per LANES pixels of a row. `rays` holds, in world space, the direction
// through the centre of pixel (0, 0) and its steps per column and row.
__kernel void paint_sky(const int width, const int height, __global const float *rays,
                        __global const float *environment, __global int *target)
{
    const int groups = (width + LANES - 1) / LANES;
    const int id = get_global_id(0);
    if (id >= groups * height)
        return;
    const int row = id / groups, column = id % groups * LANES;
    const floatN x = convert_floatN(LANE_NUMBERS + column);
    const floatN dx = rays[0] + rays[3] * x + rays[6] * row;
    const floatN dy = rays[1] + rays[4] * x + rays[7] * row;
    const floatN dz = rays[2] + rays[5] * x + rays[8] * row;
    const floatN up = dy * inverse_sqrtN(dx * dx + dy * dy + dz * dz);
    const float exposure = environment[EXPOSURE];
    int pixels[LANES];
    STORE_INTN(packedN(encodeN(exposure * sky_radianceN(environment, 0, up)),
                       encodeN(exposure * sky_radianceN(environment, 1, up)),
                       encodeN(exposure * sky_radianceN(environment, 2, up))),
               pixels);
    for (int i = 0; i < MIN(LANES, width - column); i++)
        target[row * width + column + i] = pixels[i];
}
