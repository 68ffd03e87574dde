#include "common/wide.cl"

// Bilinear lookups in an atlas of 8-bit texels, 8 at a time.

#define MAGIC 12582912.0f // 1.5 * 2^23: a float of up to 22 bits added to it is rounded to a whole number
#define FAR 4e6f          // texels
#define MAGIC_BITS 0x4B400000

// Channel `shift / 8` of packed texels as a float, exactly.
#define CHANNEL(texels, shift) (as_float8(((texels) >> (shift) & 0xFF) | MAGIC_BITS) - MAGIC)

#define BLEND(a, b, c, d) ((a) + fx * ((b) - (a)) + fy * ((c) + fx * ((d) - (c)) - ((a) + fx * ((b) - (a)))))

INLINE int8 clamped(int8 value, int largest)
{
    const int8 upper = MIN(value, (int8)(largest));
    return MAX(upper, (int8)(0));
}

INLINE int8 fetch(__global const int *plane, int8 at)
{
    int8 texels;
    for (int k = 0; k < 8; k++)
        ((int *)&texels)[k] = plane[((int *)&at)[k]];
    return texels;
}

// x; far outside any plane, and for what is no number, a place that shows the border: MAGIC rounds only up to 2^22.
INLINE float8 bounded(float8 x)
{
    const float8 before = MIN(x, FAR);
    return MAX(before, -FAR);
}

// Packed colours, alpha 255, at x, y in texels where (0, 0) is the centre of the first texel; beyond the plane, those
// of its border.
INLINE int8 bilinear(__global const int *plane, int width, int height, float8 x, float8 y)
{
    x = bounded(x);
    y = bounded(y);
    // Rounding x - 0.5 is flooring x, or at whole numbers one less with a fraction of 1, which blends to the same.
    const float8 left = x - 0.5f + MAGIC, above = y - 0.5f + MAGIC;
    const float8 fx = x - (left - MAGIC), fy = y - (above - MAGIC);
    const int8 column = as_int8(left) - MAGIC_BITS, row = as_int8(above) - MAGIC_BITS;
    const int8 column0 = clamped(column, width - 1), column1 = clamped(column + 1, width - 1);
    const int8 row0 = clamped(row, height - 1) * width, row1 = clamped(row + 1, height - 1) * width;
    const int8 a = fetch(plane, row0 + column0), b = fetch(plane, row0 + column1);
    const int8 d = fetch(plane, row1 + column0), e = fetch(plane, row1 + column1);
    int8 colour = (int8)(0xFF << 24);
    for (int shift = 0; shift < 24; shift += 8) {
        const float8 value = BLEND(CHANNEL(a, shift), CHANNEL(b, shift), CHANNEL(d, shift), CHANNEL(e, shift));
        colour |= (as_int8(value + MAGIC) - MAGIC_BITS) << shift;
    }
    return colour;
}
