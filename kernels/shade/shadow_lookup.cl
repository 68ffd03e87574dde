// Shadow map lookups: 3x3 percentage-closer filtering, the taps bilinear.
#include "shade/vector.cl"

// Layout of a light's shadow in its record: rows of the map's transform (from scene space to map texels x and y, depth
// and w), where the map starts, its side in texels (0: none), and the side of one map texel in scene units, which is
// TEXEL_BASE + TEXEL_PER_W * w. Depth per scene unit along the light is DEPTH_BASE + DEPTH_PER_SQUARE * depth^2.
#define AXIS 8
#define SHADOW_X 20
#define SHADOW_Y 24
#define SHADOW_DEPTH 28
#define SHADOW_W 32
#define SHADOW_START 36
#define SHADOW_SIZE 37
#define TEXEL_BASE 38
#define TEXEL_PER_W 39
#define DEPTH_BASE 40
#define DEPTH_PER_SQUARE 41

// The filter reaches two texels, diagonally 2 sqrt 2. A plane whose normal is at an angle a to the map's axis cannot
// shadow itself if it is pushed out by that times sin a: 1 / w is affine on the map, with the normal's part across the
// axis as its slope.
#define NORMAL_OFFSET 2.83f
// Towards the light, for curvature and what depth loses to rounding; in texels.
#define LIGHT_OFFSET 0.75f

#if SHADOWS
INLINE floatN rowN(__global const float *row, floatN x, floatN y, floatN z)
{
    return row[0] * x + row[1] * y + row[2] * z + row[3];
}

// How open a row of four taps is: clamp(depth - steepness * map, 0, 1).
INLINE floatN openN(floatN taps, floatN depth, floatN steepness)
{
    const floatN open = depth - taps * steepness;
    return (open > 0.0f) ? ((open < 1.0f) ? open : (floatN)1.0f) : (floatN)0.0f;
}

// The map's 3x3 bilinear taps around texel coordinates (column, row): each is clamp(depth - steepness * map, 0, 1).
// Lanes that are not `inside` give 1, but must lie there, too.
INLINE floatN filteredN(__global const float *map, int size, floatN column, floatN row, floatN depth, floatN steepness,
                        intN inside)
{
    const floatN column_low = floorN(column - 0.5f), row_low = floorN(row - 0.5f);
    const floatN right = column - 0.5f - column_low, lower = row - 0.5f - row_low;
    const floatN left = 1.0f - right, upper = 1.0f - lower;
    const floatN depths[QUADS] = TO_QUADS(depth), slopes[QUADS] = TO_QUADS(steepness);
    const floatN uppers[QUADS] = TO_QUADS(upper), lowers[QUADS] = TO_QUADS(lower);
    floatN sums[QUADS], columns[4];
    int starts[LANES];
    STORE_INTN((convert_intN(row_low) - 1) * size + convert_intN(column_low) - 1, starts);
    QUAD_LOOP
    for (int i = 0; i < QUADS; i++) {
        const floatN a = openN(loaded_quads(map, starts, i), depths[i], slopes[i]);
        const floatN b = openN(loaded_quads(map + size, starts, i), depths[i], slopes[i]);
        const floatN c = openN(loaded_quads(map + 2 * size, starts, i), depths[i], slopes[i]);
        const floatN d = openN(loaded_quads(map + 3 * size, starts, i), depths[i], slopes[i]);
        sums[i] = a * uppers[i] + b + c + d * lowers[i];
    }
    columns_of(sums, columns);
    const floatN lit = (columns[0] * left + columns[1] + columns[2] + columns[3] * right) * (1.0f / 9.0f);
    return inside ? lit : (floatN)1.0f;
}

// The share of light that arrives at p; l: unit direction to the light; n: unit smooth normal on the lit side (the
// triangle's own would let coarse surfaces shadow themselves where light grazes them); lanes with `wanted` 0 give 1.
// Between lit and dark lies a ramp one texel deep instead of a step, so that shading is a continuous function of p.
INLINE floatN shadowN(__global const float *light, __global const float *shadow_maps, vectorN p, vectorN n, vectorN l,
                      intN wanted)
{
    const int size = (int)light[SHADOW_SIZE];
    const floatN texel = light[TEXEL_BASE] + light[TEXEL_PER_W] * rowN(light + SHADOW_W, p.x, p.y, p.z);
    const floatN cosine = n.x * light[AXIS] + n.y * light[AXIS + 1] + n.z * light[AXIS + 2];
    const floatN squared = (cosine * cosine < 1.0f) ? 1.0f - cosine * cosine : (floatN)0.0f;
    const floatN sine = squared * inverse_sqrtN(squared);
    const floatN normal_offset = texel * NORMAL_OFFSET * sine;
    const floatN light_offset = texel * LIGHT_OFFSET;
    const floatN x = p.x + n.x * normal_offset + l.x * light_offset;
    const floatN y = p.y + n.y * normal_offset + l.y * light_offset;
    const floatN z = p.z + n.z * normal_offset + l.z * light_offset;
    const floatN w = rowN(light + SHADOW_W, x, y, z);
    const floatN inverse = 1.0f / ((w > 0.0f) ? w : (floatN)1.0f);
    const floatN column = rowN(light + SHADOW_X, x, y, z) * inverse, row = rowN(light + SHADOW_Y, x, y, z) * inverse;
    const floatN depth = rowN(light + SHADOW_DEPTH, x, y, z) * inverse;
    const floatN ramp = texel * (light[DEPTH_BASE] + light[DEPTH_PER_SQUARE] * depth * depth);
    const floatN steepness = 1.0f / ((ramp > 1e-12f) ? ramp : (floatN)1e-12f);
    const float far = size - 2;
    const intN inside = wanted && w > 0.0f && column >= 2.0f && column <= far && row >= 2.0f && row <= far;
    if (!any_ofN(inside))
        return 1.0f;
    // Other lanes may lie anywhere, also where no int reaches.
    const floatN x_inside = inside ? column : (floatN)2.0f, y_inside = inside ? row : (floatN)2.0f;
    return filteredN(shadow_maps + as_int(light[SHADOW_START]), size, x_inside, y_inside, depth * steepness + 1.0f,
                     steepness, inside);
}
#endif
