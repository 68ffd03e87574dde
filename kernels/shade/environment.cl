// Lookups in an environment map, 8 wide: bilinear in the direction, linear between two levels of roughness. Layout of
// the map: kernels/shade/environment.py.
#include "shade/vector.cl"

#define SMOOTHEST 0.05f                  // roughness of the first level
#define LEVELS_PER_ROUGHNESS 5.33333333f // four steps up to MATT
#define MATT 0.8f                        // roughness of the last level, from which on the map does not count
#define FADE 5.0f                        // 1 / (MATT - 0.6): up to a roughness of 0.6 nothing but the map counts
#define LAST_LEVEL 4.0f
#define MAP_SIDE 128.0f // texels, without the border
#define STRIDE 130      // texels in a row, with it
#define TEXEL_FLOATS 16 // RGB of each level

#define CHANNEL(c, i) ((float8)(c[0].i, c[1].i, c[2].i, c[3].i, c[4].i, c[5].i, c[6].i, c[7].i))

// a between two numbers; what is not a number counts as the lower one.
INLINE float8 within8(float8 a, float low, float high)
{
    return (a > low) ? ((a < high) ? a : (float8)high) : (float8)low;
}

// How much of what a surface of this roughness reflects comes from the map; the rest is the sky's.
INLINE float8 map_share8(float8 roughness)
{
    return within8((MATT - roughness) * FADE, 0.0f, 1.0f);
}

// Radiance from around a direction, as a surface of this roughness reflects it.
INLINE vector8 environment8(__global const float *map, vector8 direction, float8 roughness)
{
    const float8 sum = abs8(direction.x) + abs8(direction.y) + abs8(direction.z);
    const float8 inverse = 1.0f / ((sum > 1e-20f) ? sum : (float8)1e-20f);
    const float8 x = direction.x * inverse, z = direction.z * inverse;
    const float8 folded_x = 1.0f - abs8(z), folded_z = 1.0f - abs8(x);
    const int8 below = direction.y < 0.0f;
    const float8 u = below ? ((x < 0.0f) ? -folded_x : folded_x) : x;
    const float8 v = below ? ((z < 0.0f) ? -folded_z : folded_z) : z;
    const float8 column = within8(u * (0.5f * MAP_SIDE) + (0.5f * MAP_SIDE + 0.5f), 0.5f, MAP_SIDE + 0.5f);
    const float8 row = within8(v * (0.5f * MAP_SIDE) + (0.5f * MAP_SIDE + 0.5f), 0.5f, MAP_SIDE + 0.5f);
    const float8 level = within8((roughness - SMOOTHEST) * LEVELS_PER_ROUGHNESS, 0.0f, LAST_LEVEL);
    const float8 left = floor8(column), upper = floor8(row), cut = floor8(level);
    const int8 whole = convert_int8((cut < LAST_LEVEL - 1.0f) ? cut : (float8)(LAST_LEVEL - 1.0f));
    int starts[8];
    float across[8], down[8], further[8];
    float4 colours[8];
    STORE_INT8((convert_int8(upper) * STRIDE + convert_int8(left)) * TEXEL_FLOATS + whole * 3, starts);
    STORE8(column - left, across);
    STORE8(row - upper, down);
    STORE8(level - convert_float8(whole), further);
    for (int lane = 0; lane < 8; lane++) { // two levels at once, one after the other in a texel
        __global const float *first = map + starts[lane], *second = first + STRIDE * TEXEL_FLOATS;
        const float8 a = *(__global const loose_float8 *)first;
        const float8 b = *(__global const loose_float8 *)(first + TEXEL_FLOATS);
        const float8 c = *(__global const loose_float8 *)second;
        const float8 d = *(__global const loose_float8 *)(second + TEXEL_FLOATS);
        const float8 top = a + (b - a) * across[lane], bottom = c + (d - c) * across[lane];
        const float8 both = top + (bottom - top) * down[lane];
        const float4 smooth = both.s0123, rough = both.s3456;
        colours[lane] = smooth + (rough - smooth) * further[lane];
    }
    return (vector8){CHANNEL(colours, x), CHANNEL(colours, y), CHANNEL(colours, z)};
}
