// Which pixels a record covers, and at which depth: edges, depth plane, and the holes of alpha masks.
#include "raster/record.cl"

#pragma OPENCL EXTENSION cl_khr_fp64 : enable

#if MASKED
#include "texture/mask.cl"
#define ALPHA_PARAMETERS                                                                                  \
    , const float4 eye, const float16 rows, __global const float *positions, __global const int *indices, \
        MASK_PARAMETERS
#define ALPHA_ARGUMENTS , eye, rows, positions, indices, MASK_ARGUMENTS
#else
#define ALPHA_PARAMETERS
#define ALPHA_ARGUMENTS
#endif

#define FAR_EDGE (1 << 30) // beyond what an edge function can change by across a tile

// Half-plane of one edge from a to b, inside where >= 0: steps per pixel, and the value at a pixel's centre >> 8,
// which keeps the exact sign. Pixels on an edge belong to it if it is a top or a left one.
typedef struct {
    int along_x, along_y, at;
} Edge;

INLINE Edge edge_at(const int2 a, const int2 b, const int2 centre)
{
    Edge edge = {a.y - b.y, b.x - a.x, 0};
    const int owned = edge.along_x > 0 || (edge.along_x == 0 && edge.along_y > 0);
    const long value = (long)edge.along_x * (centre.x - a.x) + (long)edge.along_y * (centre.y - a.y) - !owned;
    const long scaled = value >> 8, capped = MIN(scaled, (long)FAR_EDGE);
    edge.at = (int)MAX(capped, (long)-FAR_EDGE);
    return edge;
}

// The depth plane through a record's corners.
typedef struct {
    double depth, along_x, along_y; // at the first corner; per sub-pixel
    int2 corner;
    float nearest, farthest;
} Plane;

INLINE Plane depth_plane(const int2 a, const int2 b, const int2 c, const float3 d)
{
    const int2 ab = b - a, ac = c - a;
    const double area = (double)((long)ab.x * ac.y - (long)ab.y * ac.x);
    const double db = (double)d.y - d.x, dc = (double)d.z - d.x;
    Plane plane;
    plane.depth = d.x;
    const double scale = 1.0 / area;
    plane.along_x = (db * ac.y - dc * ab.y) * scale;
    plane.along_y = (dc * ab.x - db * ac.x) * scale;
    plane.corner = a;
    plane.nearest = MAX(d.x, MAX(d.y, d.z));
    plane.farthest = MIN(d.x, MIN(d.y, d.z));
    return plane;
}

#if MASKED
// A masked triangle's own corners, also where the record is a piece of it: sub-pixels from the image's centre times w,
// and w; and the level of its mask.
typedef struct {
    float x[3], y[3], w[3];
    int triangle, level;
} MaskedTriangle;

INLINE MaskedTriangle masked_triangle(const int triangle ALPHA_PARAMETERS)
{
    MaskedTriangle masked;
    float x[3], y[3];
    int in_front = 1;
    for (int i = 0; i < 3; i++) {
        __global const float *p = positions + 3 * (size_t)indices[3 * (size_t)triangle + i];
        const float dx = p[0] - eye.x, dy = p[1] - eye.y, dz = p[2] - eye.z;
        masked.x[i] = ((rows.s0 * dx + rows.s1 * dy) + rows.s2 * dz) + rows.s3;
        masked.y[i] = ((rows.s4 * dx + rows.s5 * dy) + rows.s6 * dz) + rows.s7;
        masked.w[i] = ((rows.sc * dx + rows.sd * dy) + rows.se * dz) + rows.sf;
        in_front &= masked.w[i] > 0.0f;
        x[i] = masked.x[i] / (SUBPIXELS * masked.w[i]);
        y[i] = masked.y[i] / (SUBPIXELS * masked.w[i]);
    }
    const float doubled = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0]);
    const float pixels = in_front ? 0.5f * MAX(doubled, -doubled) : 1e12f; // reaches behind the eye: very large
    masked.triangle = triangle;
    masked.level = mask_slots[triangle] < 0 ? -1 : mask_level(triangle, pixels, MASK_ARGUMENTS);
    return masked;
}

// Clear the lanes of a row of 8 pixels that fall into the mask's holes. px, py: centres, in sub-pixels from the
// image's.
INLINE int8 without_holes(int8 draw, const MaskedTriangle *masked, const float8 px, const float py ALPHA_PARAMETERS)
{
    const int4 four = draw.lo | draw.hi;
    if (masked->level < 0 || (four.x | four.y | four.z | four.w) == 0)
        return draw;
    float8 u[3], v[3];
    for (int i = 0; i < 3; i++) {
        u[i] = masked->x[i] - px * masked->w[i];
        v[i] = masked->y[i] - py * masked->w[i];
    }
    const float8 a0 = u[1] * v[2] - v[1] * u[2], a1 = u[2] * v[0] - v[2] * u[0], a2 = u[0] * v[1] - v[0] * u[1];
    const float8 sum = (a0 + a1) + a2, b1 = a1 / sum, b2 = a2 / sum;
    for (int lane = 0; lane < 8; lane++)
        if (((const int *)&draw)[lane] && !mask_keeps(masked->triangle, ((const float *)&b1)[lane],
                                                      ((const float *)&b2)[lane], masked->level, MASK_ARGUMENTS))
            ((int *)&draw)[lane] = 0;
    return draw;
}

// The same for two rows of 8 pixels from (x, y) of a tile; middle: its first pixel's centre, from the image's.
INLINE int16 alpha_tested_rows(int16 draw, const MaskedTriangle *masked, const float2 middle, const int x,
                               const int y ALPHA_PARAMETERS)
{
    const float8 px = middle.x + (x + (float8)(0, 1, 2, 3, 4, 5, 6, 7)) * SUBPIXELS;
    const float py = middle.y + y * SUBPIXELS;
    draw.lo = without_holes(draw.lo, masked, px, py ALPHA_ARGUMENTS);
    draw.hi = without_holes(draw.hi, masked, px, py + SUBPIXELS ALPHA_ARGUMENTS);
    return draw;
}
#endif
