#include "common/wide.cl"

// A client's picture from its atlas: bilinear lookups, 8 pixels per step.

#define MAGIC 12582912.0f  // 1.5 * 2^23: a float of up to 22 bits added to it is rounded to a whole number
#define MAGIC_BITS 0x4B400000

// Channel `shift / 8` of packed texels as a float, exactly.
#define CHANNEL(texels, shift) (as_float8(((texels) >> (shift) & 0xFF) | MAGIC_BITS) - MAGIC)

#define BLEND(a, b, c, d) ((a) + fx * ((b) - (a)) + fy * ((c) + fx * ((d) - (c)) - ((a) + fx * ((b) - (a)))))

INLINE int8 clamped(int8 value, int largest) {
    const int8 upper = LESSER(value, (int8)(largest));
    return GREATER(upper, (int8)(0));
}

INLINE int8 fetch(__global const int *plane, int8 at) {
    int8 texels;
    for (int k = 0; k < 8; k++) ((int *)&texels)[k] = plane[((int *)&at)[k]];
    return texels;
}

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
    for (int k = 0; k < lanes; k++)
        if (((int *)&placed)[k]) {
            const int pixel = texel[first + k];
            rgb[pixel] = ((uint *)&colour)[k];
            drawn[pixel] = ids[triangle[first + k]];
        }
}
