// What a camera is to the raster kernels: eye (float32 high and low parts) and the rows of projection * rotation.
//
// eye: xyz = high part in .s012, low part in .s456. rows: x in .s0123, y in .s4567, z in .s89ab, w in .scdef, each
// three factors for (p - eye) and a constant. The x and y rows are scaled to sub-pixels (1/256 pixel) right of and
// below the image's centre, so x / w and y / w only need rounding; z / w is the depth (1 at the near plane, towards 0).

#define SUBPIXELS 256
// Vertices farther than this from the image's centre (in sub-pixels; 16383 pixels) are clipped: edge steps then fit
// int32 inside a tile, and rounding by a large float is exact.
#define GUARD 4194048.0f

inline float3 from_eye(const float3 p, const float8 eye) { return (p - eye.s012) - eye.s456; }

inline float4 project(const float3 d, const float16 rows)
{
    return (float4)(((rows.s0 * d.x + rows.s1 * d.y) + rows.s2 * d.z) + rows.s3,
                    ((rows.s4 * d.x + rows.s5 * d.y) + rows.s6 * d.z) + rows.s7,
                    ((rows.s8 * d.x + rows.s9 * d.y) + rows.sa * d.z) + rows.sb,
                    ((rows.sc * d.x + rows.sd * d.y) + rows.se * d.z) + rows.sf);
}
