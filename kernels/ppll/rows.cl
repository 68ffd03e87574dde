// Fragments as the rows of words that are kept and sent: colour and depth, or colour, normal and position.

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
__kernel void normal_rows(const int count, __global const uint *colours, __global const float *depth,
                          __global const int *pixel, const int width, const float4 rays, const float near,
                          __global const int *triangle, __global const float *bary1, __global const float *bary2,
                          __global const int *indices, __global const float8 *vertices,
                          __global uint *rows OPACITY_PARAMETER)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int id = 3 * triangle[i], y = pixel[i] / width, x = pixel[i] - y * width;
    const float3 a = vertices[indices[id]].s345, b = vertices[indices[id + 1]].s345;
    const float3 c = vertices[indices[id + 2]].s345;
    const float3 n = a + bary1[i] * (b - a) + bary2[i] * (c - a);
    const float distance = near / depth[i];
    __global uint *row = rows + 5 * (size_t)i;
    row[0] = COVERED(colours[i], i);
    vstore_half(atan2(n.y, n.x), 0, (__global half *)(row + 1));
    vstore_half(atan2(sqrt(n.x * n.x + n.y * n.y), n.z), 1, (__global half *)(row + 1));
    row[2] = as_uint((rays.x * x + rays.y) * distance);
    row[3] = as_uint((rays.z * y + rays.w) * distance);
    row[4] = as_uint(distance);
}
