// Trilinear lookups of LANES samples at a time in the mip chains of texture/buffers.py. Texels are fetched lane by
// lane, because there is no gather.

#include "shade/wide_math.cl"

#define TEXTURE_PARAMETERS __global const int4 *textures, __global const int4 *levels, __global const ushort4 *texels
#define TEXTURE_ARGUMENTS textures, levels, texels
#define TEXEL_SCALE (1.0f / 65535.0f)
#define CLAMP_MODE 1
#define MIRROR_MODE 2

// A coordinate wrapped into 0..1; what is not a number or beyond 1e6 counts as 0.
INLINE floatN wrappedN(floatN u, intN mode)
{
    u = (u > -1e6f && u < 1e6f) ? u : (floatN)0.0f; // farther out float32 has no texels left
    floatN inside = u - floorN(u);
#if WRAP_MODES
    const floatN half_turn = u * 0.5f;
    const floatN sawtooth = (half_turn - floorN(half_turn)) * 2.0f;
    inside = (mode == MIRROR_MODE) ? ((sawtooth > 1.0f) ? 2.0f - sawtooth : sawtooth) : inside;
    const floatN clamped = (u > 0.0f) ? ((u < 1.0f) ? u : (floatN)1.0f) : (floatN)0.0f;
    inside = (mode == CLAMP_MODE) ? clamped : inside;
#endif
    return inside;
}

// The two texels that a lookup at `u` (wrapped, 0..1) blends along one axis, and the weight of the second.
INLINE floatN neighboursN(floatN u, intN size, intN mode, intN *first, intN *second)
{
    const floatN x = u * convert_floatN(size) - 0.5f;
    const floatN low = floorN(x);
    intN a = convert_intN(low);
    intN b = a + 1;
#if WRAP_MODES
    const intN cyclic = mode == 0;
    a = (a < 0) ? (cyclic ? size - 1 : (intN)0) : a;
    b = (b >= size) ? (cyclic ? (intN)0 : size - 1) : b;
#else
    a = (a < 0) ? size - 1 : a;
    b = (b >= size) ? (intN)0 : b;
#endif
    *first = a;
    *second = b;
    return x - low;
}

// Rows of a table, one per lane, as columns. Neighbouring samples mostly ask for the same one.
INLINE void rowsN(__global const int4 *table, intN numbers, intN *x, intN *y, intN *z, intN *w)
{
    if (any_ofN(numbers != numbers.s0)) {
        int each[LANES], columns[4][LANES];
        STORE_INTN(numbers, each);
        for (int lane = 0; lane < LANES; lane++) {
            const int4 row = table[each[lane]];
            columns[0][lane] = row.x;
            columns[1][lane] = row.y;
            columns[2][lane] = row.z;
            columns[3][lane] = row.w;
        }
        *x = LOAD_INTN(columns[0]);
        *y = LOAD_INTN(columns[1]);
        *z = LOAD_INTN(columns[2]);
        *w = LOAD_INTN(columns[3]);
    } else {
        const int4 row = table[numbers.s0];
        *x = row.x;
        *y = row.y;
        *z = row.z;
        *w = row.w;
    }
}

// The texels at some lanes' places.
INLINE floatN texel_quads(__global const ushort4 *texels, const int *places, int i)
{
#define TEXEL(lane) texels[places[lane]]
    return convert_floatN(((ushortN)(OF_QUAD(TEXEL, i))));
#undef TEXEL
}

// Bilinear lookup of one level per lane (rows of the level table); u, v wrapped. Results scaled by 65535, in quads.
INLINE void bilinearN(intN level, floatN u, floatN v, intN mode_s, intN mode_t, floatN *quads, TEXTURE_PARAMETERS)
{
    intN offset, width, height, unused, x0, x1, y0, y1;
    rowsN(levels, level, &offset, &width, &height, &unused);
    const floatN across = neighboursN(u, width, mode_s, &x0, &x1), down = neighboursN(v, height, mode_t, &y0, &y1);
    const floatN weights_x[QUADS] = TO_QUADS(across), weights_y[QUADS] = TO_QUADS(down);
    const intN near = offset + y0 * width, far = offset + y1 * width;
    int near_0[LANES], near_1[LANES], far_0[LANES], far_1[LANES];
    STORE_INTN(near + x0, near_0);
    STORE_INTN(near + x1, near_1);
    STORE_INTN(far + x0, far_0);
    STORE_INTN(far + x1, far_1);
    QUAD_LOOP
    for (int i = 0; i < QUADS; i++) {
        const floatN a = texel_quads(texels, near_0, i), b = texel_quads(texels, near_1, i);
        const floatN c = texel_quads(texels, far_0, i), d = texel_quads(texels, far_1, i);
        const floatN top = a + (b - a) * weights_x[i];
        const floatN bottom = c + (d - c) * weights_x[i];
        quads[i] = top + (bottom - top) * weights_y[i];
    }
}

// Trilinear lookup: linear RGB (0..1) of `texture` (entries of the texture table) at u, v; `footprint` is the side of
// the sample in texture space (1 = the whole texture).
CALLED void textureN(intN texture, floatN u, floatN v, floatN footprint, floatN *r, floatN *g, floatN *b,
                     TEXTURE_PARAMETERS)
{
    intN first, last, mode, size;
    rowsN(textures, texture, &first, &last, &mode, &size);
    const floatN texels_across = footprint * convert_floatN(size);
    const floatN highest = convert_floatN(last);
    floatN level = (texels_across > 1.0f) ? log2_N(texels_across) : (floatN)0.0f;
    level = (level < highest) ? level : highest;
    const floatN base = floorN(level);
    const floatN blend = level - base;
    const intN mode_s = mode & 3, mode_t = mode >> 2;
    const floatN s = wrappedN(u, mode_s), t = wrappedN(v, mode_t);

    floatN fine[QUADS], channels[4];
    const intN row = first + convert_intN(base);
    bilinearN(row, s, t, mode_s, mode_t, fine, TEXTURE_ARGUMENTS);
    if (any_ofN(blend > 0.0f)) {
        floatN coarse[QUADS];
        const floatN blends[QUADS] = TO_QUADS(blend);
        bilinearN((base < highest) ? row + 1 : row, s, t, mode_s, mode_t, coarse, TEXTURE_ARGUMENTS);
        UNROLL
        for (int i = 0; i < QUADS; i++)
            fine[i] += (coarse[i] - fine[i]) * blends[i];
    }
    columns_of(fine, channels);
    *r = TEXEL_SCALE * channels[0];
    *g = TEXEL_SCALE * channels[1];
    *b = TEXEL_SCALE * channels[2];
}
