#include "common/wide.cl"

// The server's camera as Tessellated Shading Streaming sees through it: 8 points per step.

// camera: eye (3, float32), what its rounding left over (3), rows of the rotation for right, up and depth (9), pixels
// per unit of x / depth and y / depth (2), tangents of the view's half angles (2), cosine between its axis and its
// corner, near distance.
#define RIGHT 6
#define UP 9
#define DEPTH 12
#define SCALE_X 15
#define SCALE_Y 16
#define TANGENT_X 17
#define TANGENT_Y 18
#define CORNER 19
#define NEAR 20

typedef struct {
    float8 x, y, z;
} Points8;

INLINE Points8 from_eye(Points8 p, __global const float *camera)
{
    const Points8 q = {(p.x - camera[0]) - camera[3], (p.y - camera[1]) - camera[4], (p.z - camera[2]) - camera[5]};
    return q;
}

INLINE float8 along(Points8 p, __global const float *row)
{
    return row[0] * p.x + row[1] * p.y + row[2] * p.z;
}

// The depth that projects a point of the view where it appears, and others to the view's border: what the cell cannot
// see has no size, and all depths are positive.
INLINE float8 bounded_depth(Points8 p, __global const float *camera, int8 *bounded)
{
    const float8 depth = along(p, camera + DEPTH);
    const float8 distance = sqrt(p.x * p.x + p.y * p.y + p.z * p.z);
    const float8 right = along(p, camera + RIGHT) / camera[TANGENT_X], up = along(p, camera + UP) / camera[TANGENT_Y];
    const float8 beside = right < 0.0f ? -right : right, above = up < 0.0f ? -up : up;
    float8 least = MAX(camera[CORNER] * distance, (float8)(camera[NEAR]));
    least = MAX(beside, least);
    least = MAX(above, least);
    *bounded |= depth < 0.9999f * least; // rounding leaves the view's corner itself unbounded
    return MAX(depth, least);
}

// A triangle on screen. level: that of the equal-spacing pattern with as many samples as it has pixels, not rounded.
// base: its longest edge in pixels, from corner `first` to the next; height: over it; foot: where, 0 to 1.
typedef struct {
    float8 level, base, height, foot;
    int8 first;
} Shape8;

INLINE Shape8 shape_of(const float8 *x, const float8 *y)
{
    Shape8 s;
    float8 longest = (float8)(-1.0f), dx = longest, dy = longest, to_x = longest, to_y = longest;
    s.first = (int8)(0);
    for (int k = 0; k < 3; k++) {
        const int next = k == 2 ? 0 : k + 1, last = k == 0 ? 2 : k - 1;
        const float8 ex = x[next] - x[k], ey = y[next] - y[k], squared = ex * ex + ey * ey;
        const int8 longer = squared > longest;
        longest = longer ? squared : longest;
        dx = longer ? ex : dx;
        dy = longer ? ey : dy;
        to_x = longer ? x[last] - x[k] : to_x;
        to_y = longer ? y[last] - y[k] : to_y;
        s.first = longer ? (int8)(k) : s.first;
    }
    const float8 cross = dx * to_y - dy * to_x, twice = cross < 0.0f ? -cross : cross;
    const int8 flat = !(longest > 0.0f);
    const float8 squared = flat ? (float8)(1.0f) : longest;
    const float8 foot = (dx * to_x + dy * to_y) / squared;
    s.base = flat ? (float8)(0.0f) : sqrt(squared);
    s.height = flat ? (float8)(0.0f) : twice / s.base;
    s.foot = flat ? (float8)(0.5f) : clamp(foot, 0.0f, 1.0f);
    s.level = flat ? (float8)(0.0f) : sqrt(twice * (2.0f / 3.0f)); // v(l) is about 3/4 l^2
    return s;
}
