// Colour as the metrics need it: 16 sRGB pixels to linear RGB, XYZ relative to white (D65), CIELAB and luma.

#include "metrics/wide.cl"

typedef struct {
    float16 x, y, z;
} wide3;

// 16 pixels from `column` on, as 32-bit words; columns outside the row repeat its first or last pixel.
INLINE uint16 load_pixels(__global const uint *image, const int width, const int row, const int column)
{
    __global const uint *pixels = image + (size_t)row * width;
    if (column >= 0 && column + PIECE <= width)
        return vload16(0, pixels + column);
    uint lanes[PIECE];
    for (int i = 0; i < PIECE; i++)
        lanes[i] = pixels[clamp(column + i, 0, width - 1)];
    return vload16(0, lanes);
}

INLINE float16 channel(const uint16 pixels, const int number)
{
    return convert_float16((pixels >> (uint)(8 * number)) & 255u);
}

// BT.601 luma of the sRGB values, 0..255: the grey picture that SSIM and IW-SSIM are defined on.
INLINE float16 luma(const uint16 pixels)
{
    return 0.299f * channel(pixels, 0) + 0.587f * channel(pixels, 1) + 0.114f * channel(pixels, 2);
}

INLINE float16 linear_channel(const uint16 pixels, const int number, __global const float *linear)
{
    const uint16 c = (pixels >> (uint)(8 * number)) & 255u;
    return (float16)(linear[c.s0], linear[c.s1], linear[c.s2], linear[c.s3], linear[c.s4], linear[c.s5], linear[c.s6],
                     linear[c.s7], linear[c.s8], linear[c.s9], linear[c.sa], linear[c.sb], linear[c.sc], linear[c.sd],
                     linear[c.se], linear[c.sf]);
}

// `linear`: the 256 linear values of an sRGB byte.
INLINE wide3 linear_rgb(const uint16 pixels, __global const float *linear)
{
    return (wide3){linear_channel(pixels, 0, linear), linear_channel(pixels, 1, linear),
                   linear_channel(pixels, 2, linear)};
}

// Row-major 3x3 `m` times v.
INLINE wide3 transform(__global const float *m, const wide3 v)
{
    return (wide3){m[0] * v.x + m[1] * v.y + m[2] * v.z, m[3] * v.x + m[4] * v.y + m[5] * v.z,
                   m[6] * v.x + m[7] * v.y + m[8] * v.z};
}

INLINE float16 lab_curve(const float16 t)
{
    const float16 bend = 216.0f / 24389.0f;
    return t > bend ? cube_root(larger(t, bend)) : t * (841.0f / 108.0f) + 4.0f / 29.0f;
}

// CIELAB of tristimulus values relative to white.
INLINE wide3 lab_of(const wide3 xyz)
{
    const float16 fx = lab_curve(xyz.x), fy = lab_curve(xyz.y), fz = lab_curve(xyz.z);
    return (wide3){116.0f * fy - 16.0f, 500.0f * (fx - fy), 200.0f * (fy - fz)};
}
