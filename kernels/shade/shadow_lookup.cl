// Shadow map lookups, 8 wide: 3x3 percentage-closer filtering, the taps bilinear.
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
typedef float4 __attribute__((aligned(4))) loose_float4;

INLINE float8 row8(__global const float *row, float8 x, float8 y, float8 z)
{
    return row[0] * x + row[1] * y + row[2] * z + row[3];
}

// The map's 3x3 bilinear taps around texel coordinates (column, row): each is clamp(depth - steepness * map, 0, 1).
// Lanes that are not `inside` give 1.
INLINE float8 filtered8(__global const float *map, int size, float8 column, float8 row, float8 depth, float8 steepness,
                        int8 inside)
{
    const float8 column_low = floor8(column - 0.5f), row_low = floor8(row - 0.5f);
    int starts[8], looked[8];
    float weights_x[8], weights_y[8], lit[8], depths[8], slopes[8];
    STORE8(column - 0.5f - column_low, weights_x);
    STORE8(row - 0.5f - row_low, weights_y);
    STORE8(depth, depths);
    STORE8(steepness, slopes);
    STORE_INT8(inside, looked);
    STORE_INT8((convert_int8(row_low) - 1) * size + convert_int8(column_low) - 1, starts);
    for (int lane = 0; lane < 8; lane++) {
        lit[lane] = 1.0f;
        if (!looked[lane])
            continue;
        const float4 across = (float4)(1.0f - weights_x[lane], 1.0f, 1.0f, weights_x[lane]);
        const float4 down = (float4)(1.0f - weights_y[lane], 1.0f, 1.0f, weights_y[lane]);
        __global const float *taps = map + starts[lane];
        float4 sum = 0.0f;
        for (int i = 0; i < 4; i++) {
            float4 open = depths[lane] - *(__global const loose_float4 *)(taps + i * size) * slopes[lane];
            open = (open > 0.0f) ? ((open < 1.0f) ? open : (float4)1.0f) : (float4)0.0f;
            sum += open * (i == 0 ? down.x : i == 3 ? down.w : 1.0f);
        }
        sum *= across;
        lit[lane] = (sum.x + sum.y + sum.z + sum.w) * (1.0f / 9.0f);
    }
    return LOAD8(lit);
}

// The share of light that arrives at p; l: unit direction to the light; n: unit smooth normal on the lit side (the
// triangle's own would let coarse surfaces shadow themselves where light grazes them); lanes with `wanted` 0 give 1.
// Between lit and dark lies a ramp one texel deep instead of a step, so that shading is a continuous function of p.
INLINE float8 shadow8(__global const float *light, __global const float *shadow_maps, vector8 p, vector8 n, vector8 l,
                      int8 wanted)
{
    const int size = (int)light[SHADOW_SIZE];
    const float8 texel = light[TEXEL_BASE] + light[TEXEL_PER_W] * row8(light + SHADOW_W, p.x, p.y, p.z);
    const float8 cosine = n.x * light[AXIS] + n.y * light[AXIS + 1] + n.z * light[AXIS + 2];
    const float8 squared = (cosine * cosine < 1.0f) ? 1.0f - cosine * cosine : (float8)0.0f;
    const float8 sine = squared * inverse_sqrt8(squared);
    const float8 normal_offset = texel * NORMAL_OFFSET * sine;
    const float8 light_offset = texel * LIGHT_OFFSET;
    const float8 x = p.x + n.x * normal_offset + l.x * light_offset;
    const float8 y = p.y + n.y * normal_offset + l.y * light_offset;
    const float8 z = p.z + n.z * normal_offset + l.z * light_offset;
    const float8 w = row8(light + SHADOW_W, x, y, z);
    const float8 inverse = 1.0f / ((w > 0.0f) ? w : (float8)1.0f);
    const float8 column = row8(light + SHADOW_X, x, y, z) * inverse, row = row8(light + SHADOW_Y, x, y, z) * inverse;
    const float8 depth = row8(light + SHADOW_DEPTH, x, y, z) * inverse;
    const float8 ramp = texel * (light[DEPTH_BASE] + light[DEPTH_PER_SQUARE] * depth * depth);
    const float8 steepness = 1.0f / ((ramp > 1e-12f) ? ramp : (float8)1e-12f);
    const float far = size - 2;
    const int8 inside = wanted && w > 0.0f && column >= 2.0f && column <= far && row >= 2.0f && row <= far;
    if (!any_of8(inside))
        return 1.0f;
    // Other lanes may lie anywhere, also where no int reaches.
    const float8 x_inside = inside ? column : (float8)2.0f, y_inside = inside ? row : (float8)2.0f;
    return filtered8(shadow_maps + as_int(light[SHADOW_START]), size, x_inside, y_inside, depth * steepness + 1.0f,
                     steepness, inside);
}
#endif
