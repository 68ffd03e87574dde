#include "common/wide.cl"

// Pieces of a triangle: n x n of them, in rows of equal screen weight of corner 2, from corner 0 towards corner 1, one
// upright and one turned in turn.

// Weights of corners 1 and 2 at a piece's corner 0, and the step from it to its other corners (turned: negative).
typedef struct {
    float u, v, step;
} Piece;

INLINE Piece piece_of(int n, int index)
{
    int row = 0, start = 0;
    while (index - start >= 2 * (n - row) - 1) {
        start += 2 * (n - row) - 1;
        row++;
    }
    const int column = (index - start) >> 1, turned = (index - start) & 1;
    const float step = 1.0f / (float)n;
    Piece piece = {(float)(column + turned) * step, (float)(row + turned) * step, turned ? -step : step};
    return piece;
}

// Perspective: screen weights are proportional to object weights times depth. The inverse depths to use for corners 0,
// 1, 2, at most 1. Ratios are bounded by a quarter of the height in texels (where a triangle leaves the view its pieces
// may be as low as one), so that samples up to two texels outside the triangle stay before the horizon, and lookups are
// off by a sixteenth of a texel at most.
INLINE float3 inverse_depths(float4 depths, int pieces, float scale)
{
    const float height = scale * depths.w, parts = (float)pieces, low = -height < parts ? -height : parts;
    const float quarter = 0.25f * (height < 0.0f ? low : height);
    const float ratio = quarter > 1.0f ? quarter : 1.0f;
    float most = depths.x > depths.y ? depths.x : depths.y;
    most = most > depths.z ? most : depths.z;
    const float least = most / ratio;
    const float x = MAX(depths.x, least), y = MAX(depths.y, least), z = MAX(depths.z, least);
    float nearest = x < y ? x : y;
    nearest = nearest < z ? nearest : z;
    const float3 inverse = (float3)(nearest / x, nearest / y, nearest / z);
    return inverse;
}
