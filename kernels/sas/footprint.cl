#include "common/types.cl"

// How large the sides of a patch's rectangle appear from the eye.

#define STEPS 8  // sizes are logarithms to base 2 in steps of 1/8
#define SIZES 128

// Position of vertex `vertex` (of another vertex where it is -1), seen from the eye.
inline float3 seen(__global const float *positions, int vertex, int instead, float3 eye_high, float3 eye_low) {
    return vload3(vertex >= 0 ? vertex : instead, positions) - eye_high - eye_low;
}

// Sizes in pixels of the angles between eight pairs of directions. Spherical: the pixels per radian are those of the
// image centre everywhere.
inline float8 subtended(float8 ax, float8 ay, float8 az, float8 bx, float8 by, float8 bz, float pixels) {
    const float8 cx = ay * bz - az * by, cy = az * bx - ax * bz, cz = ax * by - ay * bx;
    return pixels * atan2(sqrt(cx * cx + cy * cy + cz * cz), ax * bx + ay * by + az * bz);
}

// sizes: width in steps | height in steps << 8. histogram (SIZES, SIZES): patches by height and width, counts only, so
// that the order of the additions changes nothing.
__kernel void measure_sides(int count, __global const int *patches, __global const int *points,
                            __global const float *positions, float eye_x, float eye_y, float eye_z, float low_x,
                            float low_y, float low_z, float pixels, __global int *sizes, __global int *histogram) {
    const int i = get_global_id(0);
    if (i >= count) return;
    __global const int *v = points + 5 * patches[i];
    const float3 eye = (float3)(eye_x, eye_y, eye_z), low = (float3)(low_x, low_y, low_z);
    const float3 a = seen(positions, v[0], v[0], eye, low), b = seen(positions, v[1], v[0], eye, low);
    const float3 c = seen(positions, v[2], v[0], eye, low), d = seen(positions, v[3], v[0], eye, low);
    const bool fan = v[4] >= 0, quad = v[2] >= 0;
    const float3 apex = seen(positions, v[4], v[0], eye, low);
    const float3 middle = 0.5f * (c + d);
    // Sides, in this order: top left, top right, bottom, left, right, apex to the bottom's middle.
    const float8 size = subtended(
        (float8)(a.x, apex.x, d.x, a.x, b.x, apex.x, 0, 0), (float8)(a.y, apex.y, d.y, a.y, b.y, apex.y, 0, 0),
        (float8)(a.z, apex.z, d.z, a.z, b.z, apex.z, 0, 0),
        fan ? (float8)(apex.x, b.x, c.x, d.x, c.x, middle.x, 0, 0) : (float8)(b.x, apex.x, c.x, d.x, c.x, apex.x, 0, 0),
        fan ? (float8)(apex.y, b.y, c.y, d.y, c.y, middle.y, 0, 0) : (float8)(b.y, apex.y, c.y, d.y, c.y, apex.y, 0, 0),
        fan ? (float8)(apex.z, b.z, c.z, d.z, c.z, middle.z, 0, 0) : (float8)(b.z, apex.z, c.z, d.z, c.z, apex.z, 0, 0),
        pixels);
    const float top = fan ? size.s0 + size.s1 : size.s0;
    const float width = quad ? fmax(top, size.s2) : top;
    const float upright = quad ? fmax(size.s3, size.s4) : size.s3;
    const float height = fan ? fmax(upright, size.s5) : upright;
    const float2 steps = ceil(STEPS * log2(fmax((float2)(width, height), 1.0f)));
    const int2 size_steps = clamp(convert_int2_sat(steps), 0, SIZES - 1);
    sizes[i] = size_steps.x | size_steps.y << 8;
    atomic_inc(&histogram[SIZES * size_steps.y + size_steps.x]);
}
