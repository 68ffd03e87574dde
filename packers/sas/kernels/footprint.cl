#include "common/wide.cl"
#include "sizes.cl"

// How large the sides of a patch's rectangle appear from the eye; 8 patches per step.

#define MAGIC 12582912.0f // 1.5 * 2^23: adding and subtracting it rounds to a whole number
#define HALF_PI 1.57079633f

typedef struct {
    float8 x, y, z;
} Points8;

// atan on 0..1 within 2e-6, relative error 3e-5 near 0 (the polynomial is from Hastings 1955).
INLINE float8 small_atan(float8 t)
{
    const float8 s = t * t;
    return t * (0.99997726f +
                s * (-0.33262347f + s * (0.19354346f + s * (-0.11643287f + s * (0.05265332f + s * -0.01172120f)))));
}

// The angle between two directions, from its sine and cosine, which stays exact for small and for flat angles.
INLINE float8 subtended(Points8 a, Points8 b)
{
    const float8 cx = a.y * b.z - a.z * b.y, cy = a.z * b.x - a.x * b.z, cz = a.x * b.y - a.y * b.x;
    const float8 sine = sqrt(cx * cx + cy * cy + cz * cz), cosine = a.x * b.x + a.y * b.y + a.z * b.z;
    const float8 size = cosine < 0.0f ? -cosine : cosine;
    const float8 low = MIN(sine, size), high = MAX(sine, size);
    const float8 acute = small_atan(low / (high > 0.0f ? high : (float8)(1.0f)));
    const float8 from_axis = sine > size ? HALF_PI - acute : acute;
    return cosine < 0.0f ? 2.0f * HALF_PI - from_axis : from_axis;
}

// log2 of values from 1 on, exact at powers of two, within 1e-6 elsewhere: the series of the inverse hyperbolic
// tangent.
INLINE float8 log2_of(float8 value)
{
    const int8 bits = as_int8(value);
    const float8 mantissa = as_float8((bits & 0x7FFFFF) | 0x3F800000);
    const int8 upper = mantissa > 1.41421356f;
    const float8 m = upper ? 0.5f * mantissa : mantissa;
    const int8 exponent = (bits >> 23) - 127 - upper;
    const float8 f = (m - 1.0f) / (m + 1.0f), s = f * f;
    const float8 series = f * (2.88539008f + s * (0.96179669f + s * (0.57707802f + s * 0.41219858f)));
    return (as_float8(exponent + 0x4B400000) - MAGIC) + series;
}

INLINE int8 size_steps(float8 pixels)
{
    const float8 steps = STEPS * log2_of(MAX(pixels, (float8)(1.0f)));
    const float8 rounded = (steps + MAGIC) - MAGIC;
    const int8 up = (as_int8(rounded + MAGIC) - 0x4B400000) - (rounded < steps);
    return MIN(up, (int8)(SIZES - 1));
}

// sizes: width in steps | height in steps << 8. histogram (SIZES, SIZES): patches by height and width, counts only, so
// that the order of the additions changes nothing.
__kernel void measure_sides(int count, __global const int *patches, __global const int *points,
                            __global const float *positions, float eye_x, float eye_y, float eye_z, float low_x,
                            float low_y, float low_z, float pixels, __global int *sizes, __global int *histogram)
{
    const int first = 8 * get_global_id(0);
    if (first >= count)
        return;
    Points8 p[5];
    int8 quad, fan;
    for (int k = 0; k < 8; k++) {
        __global const int *v = points + 5 * patches[MIN(first + k, count - 1)];
        ((int *)&quad)[k] = v[2] >= 0 ? -1 : 0;
        ((int *)&fan)[k] = v[4] >= 0 ? -1 : 0;
        for (int j = 0; j < 5; j++) {
            __global const float *position = positions + 3 * (size_t)(v[j] >= 0 ? v[j] : v[0]);
            ((float *)&p[j].x)[k] = position[0];
            ((float *)&p[j].y)[k] = position[1];
            ((float *)&p[j].z)[k] = position[2];
        }
    }
    for (int j = 0; j < 5; j++) {
        p[j].x = (p[j].x - eye_x) - low_x;
        p[j].y = (p[j].y - eye_y) - low_y;
        p[j].z = (p[j].z - eye_z) - low_z;
    }
    const Points8 middle = {0.5f * (p[2].x + p[3].x), 0.5f * (p[2].y + p[3].y), 0.5f * (p[2].z + p[3].z)};
    const float8 top = fan ? subtended(p[0], p[4]) + subtended(p[4], p[1]) : subtended(p[0], p[1]);
    const float8 bottom = subtended(p[3], p[2]), left = subtended(p[0], p[3]), right = subtended(p[1], p[2]);
    const float8 height2 = quad ? MAX(left, right) : left, height3 = subtended(p[4], middle);
    int8 width = size_steps(pixels * (quad ? MAX(top, bottom) : top));
    int8 height = size_steps(pixels * (fan ? MAX(height2, height3) : height2));
    // The first step is the second texel of a side, and of no side under any bias.
    width = quad && (fan || height == 0) ? MAX(width, (int8)(1)) : width;
    height = fan && width <= STEPS ? MAX(height, (int8)(1)) : height;
    for (int k = 0; k < 8 && first + k < count; k++) {
        const int w = ((int *)&width)[k], h = ((int *)&height)[k];
        sizes[first + k] = w | h << 8;
        atomic_inc(&histogram[SIZES * h + w]);
    }
}
