// Fragments as the rows of words that are kept and sent: colour and depth, or colour, normal and position.
#include "common/elementary.cl"

#if BLENDED
#define COVERED(colour, at) (((colour) & 0xffffff) | ((uint)opacity[at] << 24))
#define OPACITY_PARAMETER , __global const int *opacity
#else
#define COVERED(colour, at) (colour)
#define OPACITY_PARAMETER
#endif

__kernel void colour_rows(const int count, __global const uint *colours, __global const float *depth,
                          __global uint2 *rows OPACITY_PARAMETER)
{
    const int i = get_global_id(0);
    if (i < count)
        rows[i] = (uint2)(COVERED(colours[i], i), as_uint(depth[i]));
}

// Eye-space x and y and the distance along the view axis; the normal as azimuth and inclination, half floats (eq. 2.1).
// 8 fragments per item, because that takes hardly longer than one.
__kernel void normal_rows(const int count, __global const uint *colours, __global const float *depth,
                          __global const int *pixel, const int width, const float4 rays, const float near,
                          __global const int *triangle, __global const float *bary1, __global const float *bary2,
                          __global const int *indices, __global const float8 *vertices,
                          __global uint *rows OPACITY_PARAMETER)
{
    const int first = get_global_id(0) * 8;
    if (first >= count)
        return;
    float8 normal[3];
    for (int lane = 0; lane < 8; lane++) {
        const int i = MIN(first + lane, count - 1), id = 3 * triangle[i];
        const float4 a = vertices[indices[id]].s3456, b = vertices[indices[id + 1]].s3456;
        const float4 c = vertices[indices[id + 2]].s3456;
        const float4 n = a + bary1[i] * (b - a) + bary2[i] * (c - a);
        ((float *)&normal[0])[lane] = n.x;
        ((float *)&normal[1])[lane] = n.y;
        ((float *)&normal[2])[lane] = n.z;
    }
    const float8 x = normal[0], y = normal[1], z = normal[2];
    ushort azimuth[8], inclination[8];
    vstore_half8(atan2_8(y, x), 0, (half *)azimuth);
    vstore_half8(atan2_8(sqrt(x * x + y * y), z), 0, (half *)inclination);
    for (int lane = 0; lane < MIN(count - first, 8); lane++) {
        const int i = first + lane, line = pixel[i] / width, column = pixel[i] - line * width;
        const float distance = near / depth[i];
        __global uint *row = rows + 5 * (size_t)i;
        row[0] = COVERED(colours[i], i);
        row[1] = azimuth[lane] | (uint)inclination[lane] << 16;
        row[2] = as_uint((rays.x * column + rays.y) * distance);
        row[3] = as_uint((rays.z * line + rays.w) * distance);
        row[4] = as_uint(distance);
    }
}
