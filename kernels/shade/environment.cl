// Lookups in an environment map, 8 wide: bilinear in the direction, linear between two levels of roughness. Layout of the
// map: kernels/shade/environment.py.
#include "shade/vector.cl"

#define SMOOTHEST 0.05f                  // roughness of the first level
#define LEVELS_PER_ROUGHNESS 5.33333333f // four steps up to MATT
#define MATT 0.8f                        // roughness of the last level, from which on the map does not count
#define FADE 5.0f                        // 1 / (MATT - 0.6): up to a roughness of 0.6 nothing but the map counts
#define LAST_LEVEL 4.0f
#define STRIDE 130 // texels in a row of the map: a side of the first level with its border

// How much of what a surface of this roughness reflects comes from the map; the rest is the sky's.
INLINE float8 map_share8(float8 roughness)
{
    const float8 share = (MATT - roughness) * FADE;
    return (share > 0.0f) ? ((share < 1.0f) ? share : (float8)1.0f) : (float8)0.0f;
}

// The texels around 8 points of a level: the number of the first, and the weights of the next ones in row and column.
typedef struct {
    int start[8];
    float across[8], down[8];
} taps8;

// x, y: place on the octahedron's square, -1..1. size: texels along a side, without the border; row: where it begins.
INLINE taps8 taps_of(float8 x, float8 y, float8 size, float8 row)
{
    const float8 half_size = 0.5f * size, end = size + 0.5f;
    float8 column = x * half_size + (half_size + 0.5f), line = y * half_size + (half_size + 0.5f);
    column = (column > 0.5f) ? ((column < end) ? column : end) : (float8)0.5f;
    line = (line > 0.5f) ? ((line < end) ? line : end) : (float8)0.5f;
    const float8 left = floor8(column), upper = floor8(line);
    taps8 taps;
    STORE_INT8(convert_int8((row + upper) * (float)STRIDE + left), taps.start);
    STORE8(column - left, taps.across);
    STORE8(line - upper, taps.down);
    return taps;
}

INLINE float4 between_texels(__global const float *map, const taps8 *taps, int lane)
{
    __global const float *first = map + 4 * taps->start[lane];
    const float8 upper = *(__global const loose_float8 *)first;
    const float8 lower = *(__global const loose_float8 *)(first + 4 * STRIDE);
    const float8 row = upper + (lower - upper) * taps->down[lane];
    return row.lo + (row.hi - row.lo) * taps->across[lane];
}

// Radiance from around a direction, as a surface of this roughness reflects it.
INLINE vector8 environment8(__global const float *map, vector8 direction, float8 roughness)
{
    const float8 sum = magnitude8(direction.x) + magnitude8(direction.y) + magnitude8(direction.z);
    const float8 inverse = 1.0f / ((sum > 1e-20f) ? sum : (float8)1e-20f);
    const float8 x = direction.x * inverse, z = direction.z * inverse;
    const float8 folded_x = 1.0f - magnitude8(z), folded_z = 1.0f - magnitude8(x);
    const int8 below = direction.y < 0.0f;
    const float8 u = below ? ((x < 0.0f) ? -folded_x : folded_x) : x;
    const float8 v = below ? ((z < 0.0f) ? -folded_z : folded_z) : z;
    float8 level = (roughness - SMOOTHEST) * LEVELS_PER_ROUGHNESS;
    level = (level > 0.0f) ? ((level < LAST_LEVEL) ? level : (float8)LAST_LEVEL) : (float8)0.0f;
    const float8 cut = floor8(level), whole = (cut < LAST_LEVEL - 1.0f) ? cut : (float8)(LAST_LEVEL - 1.0f);
    float further[8], red[8], green[8], blue[8];
    STORE8(level - whole, further);
    // Sides are 128, 64, 32, 16 and 8; each level begins where the one before it and its border end.
    const float8 size = as_float8((134 - convert_int8(whole)) << 23);
    const taps8 near = taps_of(u, v, size, 256.0f - 2.0f * size + 2.0f * whole);
    const taps8 far = taps_of(u, v, 0.5f * size, 258.0f - size + 2.0f * whole);
    for (int lane = 0; lane < 8; lane++) {
        const float4 smooth = between_texels(map, &near, lane), rough = between_texels(map, &far, lane);
        const float4 colour = smooth + (rough - smooth) * further[lane];
        red[lane] = colour.x;
        green[lane] = colour.y;
        blue[lane] = colour.z;
    }
    return (vector8){LOAD8(red), LOAD8(green), LOAD8(blue)};
}
