// Lookups in an environment map: bilinear in the direction, linear between two levels of roughness. Layout of
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

// a between two numbers; what is not a number counts as the lower one.
INLINE floatN withinN(floatN a, float low, float high)
{
    return (a > low) ? ((a < high) ? a : (floatN)high) : (floatN)low;
}

// How much of what a surface of this roughness reflects comes from the map; the rest is the sky's.
INLINE floatN map_shareN(floatN roughness)
{
    return withinN((MATT - roughness) * FADE, 0.0f, 1.0f);
}

// Bilinear RGB of one level of roughness.
INLINE floatN bilinear_level(__global const float *map, const int *places, int i, floatN across, floatN down)
{
    __global const float *below = map + STRIDE * TEXEL_FLOATS;
    const floatN a = loaded_quads(map, places, i), b = loaded_quads(map + TEXEL_FLOATS, places, i);
    const floatN c = loaded_quads(below, places, i), d = loaded_quads(below + TEXEL_FLOATS, places, i);
    const floatN top = a + (b - a) * across, bottom = c + (d - c) * across;
    return top + (bottom - top) * down;
}

// Radiance from around a direction, as a surface of this roughness reflects it.
INLINE vectorN environmentN(__global const float *map, vectorN direction, floatN roughness)
{
    const floatN sum = absN(direction.x) + absN(direction.y) + absN(direction.z);
    const floatN inverse = 1.0f / ((sum > 1e-20f) ? sum : (floatN)1e-20f);
    const floatN x = direction.x * inverse, z = direction.z * inverse;
    const floatN folded_x = 1.0f - absN(z), folded_z = 1.0f - absN(x);
    const intN below = direction.y < 0.0f;
    const floatN u = below ? ((x < 0.0f) ? -folded_x : folded_x) : x;
    const floatN v = below ? ((z < 0.0f) ? -folded_z : folded_z) : z;
    const floatN column = withinN(u * (0.5f * MAP_SIDE) + (0.5f * MAP_SIDE + 0.5f), 0.5f, MAP_SIDE + 0.5f);
    const floatN row = withinN(v * (0.5f * MAP_SIDE) + (0.5f * MAP_SIDE + 0.5f), 0.5f, MAP_SIDE + 0.5f);
    const floatN level = withinN((roughness - SMOOTHEST) * LEVELS_PER_ROUGHNESS, 0.0f, LAST_LEVEL);
    const floatN left = floorN(column), upper = floorN(row), cut = floorN(level);
    const intN whole = convert_intN((cut < LAST_LEVEL - 1.0f) ? cut : (floatN)(LAST_LEVEL - 1.0f));
    const floatN across = column - left, down = row - upper, further = level - convert_floatN(whole);
    const floatN weights_x[QUADS] = TO_QUADS(across), weights_y[QUADS] = TO_QUADS(down),
                 steps[QUADS] = TO_QUADS(further);
    floatN colours[QUADS], channels[4];
    int places[LANES];
    STORE_INTN((convert_intN(upper) * STRIDE + convert_intN(left)) * TEXEL_FLOATS + whole * 3, places);
    QUAD_LOOP
    for (int i = 0; i < QUADS; i++) {
        const floatN smooth = bilinear_level(map, places, i, weights_x[i], weights_y[i]);
        const floatN rough = bilinear_level(map + 3, places, i, weights_x[i], weights_y[i]);
        colours[i] = smooth + (rough - smooth) * steps[i];
    }
    columns_of(colours, channels);
    return (vectorN){channels[0], channels[1], channels[2]};
}
