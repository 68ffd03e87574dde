#include "shade/colour.cl"

// The sky behind a picture: one work-item per 8 pixels of a row. `rays` holds, in world space, the direction through
// the centre of pixel (0, 0) and its steps per column and row.
__kernel void paint_sky(const int width, const int height, __global const float *rays,
                        __global const float *environment, __global int *target)
{
    const int groups = (width + 7) / 8;
    const int id = get_global_id(0);
    if (id >= groups * height)
        return;
    const int row = id / groups, column = id % groups * 8;
    const float8 x = convert_float8((int8)(0, 1, 2, 3, 4, 5, 6, 7) + column);
    const float8 dx = rays[0] + rays[3] * x + rays[6] * row;
    const float8 dy = rays[1] + rays[4] * x + rays[7] * row;
    const float8 dz = rays[2] + rays[5] * x + rays[8] * row;
    const float8 up = dy * inverse_sqrt8(dx * dx + dy * dy + dz * dz);
    const float exposure = environment[EXPOSURE];
    int pixels[8];
    STORE_INT8(packed8(encode8(exposure * sky_radiance8(environment, 0, up)),
                       encode8(exposure * sky_radiance8(environment, 1, up)),
                       encode8(exposure * sky_radiance8(environment, 2, up))),
               pixels);
    for (int i = 0; i < MIN(8, width - column); i++)
        target[row * width + column + i] = pixels[i];
}
