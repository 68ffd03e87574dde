// How much each fragment covers what is behind it, 0..255, LANES fragments at a time.
#define WRAP_MODES 1
#include "texture/sample.cl"

// surfaces: per material, alpha, texture (0: none), what blends it (0: nothing, 1: light let through, 2: alpha), share
// of light kept. Opaque ones cover all.
__kernel void fragment_opacity(const int count, __global const int *triangle, __global const float *bary1,
                               __global const float *bary2, __global const float *footprint,
                               __global const int *indices, __global const int2 *faces, __global const float4 *surfaces,
                               __global const float4 *corners, __global int *opacity, TEXTURE_PARAMETERS)
{
    const int first = get_global_id(0) * LANES;
    if (first >= count)
        return;
    float alpha[LANES], u[LANES], v[LANES], side[LANES];
    int texture[LANES];
    int textured = 0;
    for (int lane = 0; lane < LANES; lane++) {
        const int i = MIN(first + lane, count - 1), id = triangle[i];
        const float b1 = bary1[i], b2 = bary2[i];
        const float4 a = corners[indices[3 * id]], b = corners[indices[3 * id + 1]], c = corners[indices[3 * id + 2]];
        const float4 at = a + b1 * (b - a) + b2 * (c - a); // u, v, alpha of the vertex colour
        const float4 surface = surfaces[faces[id].x];
        const int blends = surface.z > 0.0f;
        alpha[lane] = blends ? surface.x * surface.w * (surface.z > 1.0f ? at.z : 1.0f) : 1.0f;
        texture[lane] = blends ? (int)surface.y : 0;
        u[lane] = at.x;
        v[lane] = at.y;
        side[lane] = footprint[i] * as_float(faces[id].y);
        textured |= texture[lane];
    }
    if (textured) {
        int mode[LANES], row[LANES];
        floatN quads[QUADS], channels[4];
        float level[LANES], covered[LANES];
        for (int lane = 0; lane < LANES; lane++) {
            const int4 entry = textures[texture[lane]];
            const float across = side[lane] * entry.w;
            level[lane] = across > 1.0f ? log2_1(across) + 0.5f : 0.0f;
            mode[lane] = entry.z;
            row[lane] = entry.x + (level[lane] < entry.y ? (int)level[lane] : entry.y);
        }
        const intN modes = LOAD_INTN(mode), mode_s = modes & 3, mode_t = modes >> 2;
        const floatN s = wrappedN(LOADN(u), mode_s), t = wrappedN(LOADN(v), mode_t);
        bilinearN(LOAD_INTN(row), s, t, mode_s, mode_t, quads, TEXTURE_ARGUMENTS);
        columns_of(quads, channels);
        STOREN(channels[3], covered);
        for (int lane = 0; lane < LANES; lane++)
            alpha[lane] *= texture[lane] ? covered[lane] * TEXEL_SCALE : 1.0f;
    }
    for (int lane = 0; lane < LANES && first + lane < count; lane++) {
        const float share = alpha[lane] > 0.0f ? (alpha[lane] < 1.0f ? alpha[lane] : 1.0f) : 0.0f;
        opacity[first + lane] = (int)(share * 255.0f + 0.5f);
    }
}

// The samples' opacities as grey texels, alpha 255.
__kernel void write_opacity(const int count, __global const int *texel, __global const int *opacity,
                            __global uint *target)
{
    const int i = get_global_id(0);
    if (i < count)
        target[texel[i]] = (uint)opacity[i] * 0x010101u | 0xff000000u;
}
