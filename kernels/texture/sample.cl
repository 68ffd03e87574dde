// Trilinear lookups of 8 samples at a time in the mip chains of texture/buffers.py. Coordinates and filter weights are
// computed 8 wide; texels are fetched lane by lane, because there is no gather.

#include "shade/wide_math.cl"

#define TEXTURE_PARAMETERS __global const int4 *textures, __global const int4 *levels, __global const ushort4 *texels
#define TEXTURE_ARGUMENTS textures, levels, texels
#define TEXEL_SCALE (1.0f / 65535.0f)
#define CLAMP_MODE 1
#define MIRROR_MODE 2

// A coordinate wrapped into 0..1; what is not a number or beyond 1e6 counts as 0.
INLINE float8 wrapped8(float8 u, int8 mode)
{
    u = (u > -1e6f && u < 1e6f) ? u : (float8)0.0f; // farther out float32 has no texels left
    float8 inside = u - floor8(u);
#if WRAP_MODES
    const float8 half_turn = u * 0.5f;
    const float8 sawtooth = (half_turn - floor8(half_turn)) * 2.0f;
    inside = (mode == MIRROR_MODE) ? ((sawtooth > 1.0f) ? 2.0f - sawtooth : sawtooth) : inside;
    const float8 clamped = (u > 0.0f) ? ((u < 1.0f) ? u : (float8)1.0f) : (float8)0.0f;
    inside = (mode == CLAMP_MODE) ? clamped : inside;
#endif
    return inside;
}

// The two texels that a lookup at `u` (wrapped, 0..1) blends along one axis, and the weight of the second.
INLINE float8 neighbours8(float8 u, int8 size, int8 mode, int8 *first, int8 *second)
{
    const float8 x = u * convert_float8(size) - 0.5f;
    const float8 low = floor8(x);
    int8 a = convert_int8(low);
    int8 b = a + 1;
#if WRAP_MODES
    const int8 cyclic = mode == 0;
    a = (a < 0) ? (cyclic ? size - 1 : (int8)0) : a;
    b = (b >= size) ? (cyclic ? (int8)0 : size - 1) : b;
#else
    a = (a < 0) ? size - 1 : a;
    b = (b >= size) ? (int8)0 : b;
#endif
    *first = a;
    *second = b;
    return x - low;
}

// Bilinear lookup of one level per lane (rows of the level table); u, v wrapped. Results scaled by 65535, per lane.
INLINE void bilinear8(const int *level, float8 u, float8 v, int8 mode_s, int8 mode_t, float4 *result,
                      TEXTURE_PARAMETERS)
{
    int offsets[8], widths[8], heights[8];
    for (int lane = 0; lane < 8; lane++) {
        const int4 row = levels[level[lane]];
        offsets[lane] = row.x;
        widths[lane] = row.y;
        heights[lane] = row.z;
    }
    const int8 width = LOAD_INT8(widths);
    int8 x0, x1, y0, y1;
    float weight_x[8], weight_y[8];
    int near_x[8], far_x[8], near_y[8], far_y[8];
    STORE8(neighbours8(u, width, mode_s, &x0, &x1), weight_x);
    STORE8(neighbours8(v, LOAD_INT8(heights), mode_t, &y0, &y1), weight_y);
    const int8 offset = LOAD_INT8(offsets);
    STORE_INT8(offset + y0 * width, near_y);
    STORE_INT8(offset + y1 * width, far_y);
    STORE_INT8(x0, near_x);
    STORE_INT8(x1, far_x);
    for (int lane = 0; lane < 8; lane++) {
        const float4 a = convert_float4(texels[near_y[lane] + near_x[lane]]);
        const float4 b = convert_float4(texels[near_y[lane] + far_x[lane]]);
        const float4 c = convert_float4(texels[far_y[lane] + near_x[lane]]);
        const float4 d = convert_float4(texels[far_y[lane] + far_x[lane]]);
        const float4 top = a + (b - a) * weight_x[lane];
        const float4 bottom = c + (d - c) * weight_x[lane];
        result[lane] = top + (bottom - top) * weight_y[lane];
    }
}

// Trilinear lookup: linear RGB (0..1) of `texture` (entries of the texture table) at u, v; `footprint` is the side of
// the sample in texture space (1 = the whole texture).
INLINE void texture8(const int *texture, float8 u, float8 v, float8 footprint, float8 *r, float8 *g, float8 *b,
                     TEXTURE_PARAMETERS)
{
    int first[8], last[8], mode[8], size[8];
    for (int lane = 0; lane < 8; lane++) {
        const int4 row = textures[texture[lane]];
        first[lane] = row.x;
        last[lane] = row.y;
        mode[lane] = row.z;
        size[lane] = row.w;
    }
    const float8 texels_across = footprint * convert_float8(LOAD_INT8(size));
    const float8 highest = convert_float8(LOAD_INT8(last));
    float8 level = (texels_across > 1.0f) ? log2_8(texels_across) : (float8)0.0f;
    level = (level < highest) ? level : highest;
    const float8 base = floor8(level);
    const float8 blend = level - base;
    const int8 mode_s = LOAD_INT8(mode) & 3, mode_t = LOAD_INT8(mode) >> 2;
    const float8 s = wrapped8(u, mode_s), t = wrapped8(v, mode_t);

    float4 fine[8];
    int rows[8];
    const int8 row = LOAD_INT8(first) + convert_int8(base);
    STORE_INT8(row, rows);
    bilinear8(rows, s, t, mode_s, mode_t, fine, TEXTURE_ARGUMENTS);
    if (any_of8(blend > 0.0f)) {
        float4 coarse[8];
        float blends[8];
        STORE8(blend, blends);
        STORE_INT8((base < highest) ? row + 1 : row, rows);
        bilinear8(rows, s, t, mode_s, mode_t, coarse, TEXTURE_ARGUMENTS);
        for (int lane = 0; lane < 8; lane++)
            fine[lane] += (coarse[lane] - fine[lane]) * blends[lane];
    }
    *r = TEXEL_SCALE * (float8)(fine[0].x, fine[1].x, fine[2].x, fine[3].x, fine[4].x, fine[5].x, fine[6].x, fine[7].x);
    *g = TEXEL_SCALE * (float8)(fine[0].y, fine[1].y, fine[2].y, fine[3].y, fine[4].y, fine[5].y, fine[6].y, fine[7].y);
    *b = TEXEL_SCALE * (float8)(fine[0].z, fine[1].z, fine[2].z, fine[3].z, fine[4].z, fine[5].z, fine[6].z, fine[7].z);
}
