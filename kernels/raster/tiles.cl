// Drawing: one work-item per tile walks the tile's records in triangle order, with a hierarchical Z of 8 x 8 blocks.
#include "raster/record.cl"

#if MASKED
#include "texture/mask.cl"
#define ALPHA_PARAMETERS                                                                                               \
    , const float4 eye, const float16 rows, __global const float *positions, __global const int *indices,              \
        MASK_PARAMETERS
#define ALPHA_ARGUMENTS , eye, rows, positions, indices, MASK_ARGUMENTS
#else
#define ALPHA_PARAMETERS
#define ALPHA_ARGUMENTS
#endif

#define BLOCK 8
#define BLOCKS (TILE / BLOCK) // per tile's side
#define FAR_EDGE (1 << 30)    // beyond what an edge function can change by across a tile

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
    const long scaled = value >> 8, capped = LESSER(scaled, (long)FAR_EDGE);
    edge.at = (int)GREATER(capped, (long)-FAR_EDGE);
    return edge;
}

INLINE float smallest_of(const float8 v)
{
    const float4 four = LESSER(v.lo, v.hi);
    const float2 two = LESSER(four.lo, four.hi);
    return LESSER(two.x, two.y);
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
    plane.nearest = GREATER(d.x, GREATER(d.y, d.z));
    plane.farthest = LESSER(d.x, LESSER(d.y, d.z));
    return plane;
}

// A tile while it is drawn, block by block, rows of 8 pixels; `held` tells which blocks are here yet.
typedef struct {
    float8 depth[TILE * BLOCKS];
    int8 ids[TILE * BLOCKS];
    float farthest[BLOCKS * BLOCKS];
    uchar held[BLOCKS * BLOCKS];
    int2 origin; // its first pixel
    int width, height, resumes;
    __global int *triangles; // the images
    __global float *depths;
} Tile;

// Fetch a block from the images where the tile resumes, otherwise begin it with nothing.
INLINE void hold_block(Tile *tile, const int bx, const int by)
{
    const int block = by * BLOCKS + bx, x = tile->origin.x + bx * BLOCK, y = tile->origin.y + by * BLOCK;
    tile->held[block] = 1;
    for (int j = 0; j < BLOCK; j++) {
        const int at = block * BLOCK + j;
        tile->depth[at] = 0.0f;
        tile->ids[at] = -1;
        if (!tile->resumes || y + j >= tile->height)
            continue;
        const size_t from = (size_t)(y + j) * tile->width + x;
        if (x + BLOCK <= tile->width) {
            tile->depth[at] = *(__global loose_float8 *)(tile->depths + from);
            tile->ids[at] = *(__global loose_int8 *)(tile->triangles + from);
            continue;
        }
        for (int i = 0; i < tile->width - x; i++) {
            ((float *)&tile->depth[at])[i] = tile->depths[from + i];
            ((int *)&tile->ids[at])[i] = tile->triangles[from + i];
        }
    }
}

// Write row `y` of a tile to the images: the blocks held, and where it does not resume nothing for the others.
INLINE void store_row(const Tile *tile, const int y)
{
    for (int bx = 0; bx < BLOCKS; bx++) {
        const int block = y / BLOCK * BLOCKS + bx, x = tile->origin.x + bx * BLOCK;
        if (x >= tile->width || (tile->resumes && !tile->held[block]))
            continue;
        const float8 depth = tile->held[block] ? tile->depth[block * BLOCK + y % BLOCK] : (float8)0.0f;
        const int8 ids = tile->held[block] ? tile->ids[block * BLOCK + y % BLOCK] : (int8)-1;
        const size_t to = (size_t)(tile->origin.y + y) * tile->width + x;
        if (x + BLOCK <= tile->width) {
            *(__global loose_float8 *)(tile->depths + to) = depth;
            *(__global loose_int8 *)(tile->triangles + to) = ids;
            continue;
        }
        for (int i = 0; i < tile->width - x; i++) {
            tile->depths[to + i] = ((const float *)&depth)[i];
            tile->triangles[to + i] = ((const int *)&ids)[i];
        }
    }
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
    const float pixels = in_front ? 0.5f * GREATER(doubled, -doubled) : 1e12f; // reaches behind the eye: very large
    masked.triangle = triangle;
    masked.level = mask_slots[triangle] < 0 ? -1 : mask_level(triangle, pixels, MASK_ARGUMENTS);
    return masked;
}

// Clear the lanes of a row of 8 pixels that fall into the mask's holes. px, py: centres, in sub-pixels from the image's.
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
        if (((const int *)&draw)[lane] &&
            !mask_keeps(masked->triangle, ((const float *)&b1)[lane], ((const float *)&b2)[lane], masked->level,
                        MASK_ARGUMENTS))
            ((int *)&draw)[lane] = 0;
    return draw;
}
#endif

// Whether a box of few blocks (left, top, right, bottom) lies behind what is drawn.
INLINE int behind(const Tile *tile, const int4 box, const float nearest)
{
    if (box.z - box.x > 1 || box.w - box.y > 1)
        return 0;
    const float *upper = tile->farthest + box.y * BLOCKS, *lower = tile->farthest + box.w * BLOCKS;
    return (nearest < upper[box.x]) & (nearest < upper[box.z]) & (nearest < lower[box.x]) & (nearest < lower[box.z]);
}

// Draw one record into a tile.
INLINE void draw_record(__global const int *record, Tile *tile ALPHA_PARAMETERS)
{
    const int2 origin = tile->origin;
    const int2 a = (int2)(record[0], record[1]), b = (int2)(record[2], record[3]), c = (int2)(record[4], record[5]);
    const float3 d = (float3)(as_float(record[6]), as_float(record[7]), as_float(record[8]));
    const int4 box = record_pixels(record, tile->width, tile->height);
    const int left = GREATER(box.x - origin.x, 0), right = LESSER(box.z - origin.x, TILE - 1);
    const int top = GREATER(box.y - origin.y, 0), bottom = LESSER(box.w - origin.y, TILE - 1);
    const int id = record[9] & ~MASK_BIT;
    const float8 lanes = (float8)(0, 1, 2, 3, 4, 5, 6, 7);
    const int8 steps = (int8)(0, 1, 2, 3, 4, 5, 6, 7);

    if (behind(tile, (int4)(left, top, right, bottom) / BLOCK, GREATER(d.x, GREATER(d.y, d.z))))
        return;
    const Plane plane = depth_plane(a, b, c, d);
    const int2 centre = origin * SUBPIXELS + SUBPIXELS / 2;
    const Edge e0 = edge_at(a, b, centre), e1 = edge_at(b, c, centre), e2 = edge_at(c, a, centre);
    const int reach0 = 7 * (GREATER(e0.along_x, 0) + GREATER(e0.along_y, 0));
    const int reach1 = 7 * (GREATER(e1.along_x, 0) + GREATER(e1.along_y, 0));
    const int reach2 = 7 * (GREATER(e2.along_x, 0) + GREATER(e2.along_y, 0));
    const float slope_x = (float)(plane.along_x * SUBPIXELS), slope_y = (float)(plane.along_y * SUBPIXELS);

#if MASKED
    const int is_masked = record[9] & MASK_BIT;
    MaskedTriangle masked;
    if (is_masked)
        masked = masked_triangle(id ALPHA_ARGUMENTS);
    const float2 middle = (float2)(centre.x - tile->width * (SUBPIXELS / 2), centre.y - tile->height * (SUBPIXELS / 2));
#endif
    for (int by = top / BLOCK; by <= bottom / BLOCK; by++)
        for (int bx = left / BLOCK; bx <= right / BLOCK; bx++) {
            const int block = by * BLOCKS + bx, px = bx * BLOCK, py = by * BLOCK;
            const int at0 = e0.at + e0.along_x * px + e0.along_y * py;
            const int at1 = e1.at + e1.along_x * px + e1.along_y * py;
            const int at2 = e2.at + e2.along_x * px + e2.along_y * py;
            if (((at0 + reach0) | (at1 + reach1) | (at2 + reach2)) < 0)
                continue;
            const float z0 = (float)(plane.depth + plane.along_x * (px * SUBPIXELS + centre.x - plane.corner.x) +
                                     plane.along_y * (py * SUBPIXELS + centre.y - plane.corner.y));
            const float reached = (z0 + (slope_y > 0 ? 7.0f : 0.0f) * slope_y) + (slope_x > 0 ? 7.0f : 0.0f) * slope_x;
            if (LESSER(reached, plane.nearest) < tile->farthest[block])
                continue;
            if (!tile->held[block])
                hold_block(tile, bx, by);
            const int first = GREATER(top - py, 0), last = LESSER(bottom - py, BLOCK - 1);
            int8 row0 = at0 + e0.along_y * first + e0.along_x * steps;
            int8 row1 = at1 + e1.along_y * first + e1.along_x * steps;
            int8 row2 = at2 + e2.along_y * first + e2.along_x * steps;
            for (int j = first; j <= last; j++) {
                float8 z = (z0 + j * slope_y) + lanes * slope_x;
                z = LESSER(z, plane.nearest);
                z = GREATER(z, plane.farthest);
                const int at = block * BLOCK + j;
                const float8 old = tile->depth[at];
                int8 draw = ((row0 | row1 | row2) >= 0) & ((z > old) | ((z == old) & (id < tile->ids[at])));
#if MASKED
                if (is_masked)
                    draw = without_holes(draw, &masked, middle.x + (px + lanes) * SUBPIXELS,
                                         middle.y + (py + j) * SUBPIXELS ALPHA_ARGUMENTS);
#endif
                tile->depth[at] = draw ? z : old;
                tile->ids[at] = draw ? (int8)id : tile->ids[at];
                row0 += e0.along_y;
                row1 += e1.along_y;
                row2 += e2.along_y;
            }
            const float8 *row = tile->depth + block * BLOCK;
            const float8 low0 = LESSER(row[0], row[1]), low1 = LESSER(row[2], row[3]);
            const float8 low2 = LESSER(row[4], row[5]), low3 = LESSER(row[6], row[7]);
            const float8 low01 = LESSER(low0, low1), low23 = LESSER(low2, low3);
            tile->farthest[block] = smallest_of(LESSER(low01, low23));
        }
}

// The nearest triangle (-1: none) and its depth at each pixel; of equal depths the lowest triangle. `blocks` and `far`
// get the farthest depth of each 8 x 8 block and of each tile. Where it resumes, the tiles hold an earlier pass's.
__kernel void draw_tiles(const int tiles, const int tiles_x, const int width, const int height, const int chunks,
                         const int resumes, __global const int *ends, __global const int *entries,
                         __global const int *records, __global int *triangles, __global float *depths,
                         __global float *blocks, __global float *far ALPHA_PARAMETERS)
{
    const int id = get_global_id(0);
    if (id >= tiles)
        return;
    const int first = id == 0 ? 0 : ends[(size_t)id * chunks - 1], end = ends[(size_t)(id + 1) * chunks - 1];
    if (resumes && first == end)
        return;
    const int2 corner = (int2)(id % tiles_x, id / tiles_x);
    const int pitch = tiles_x * BLOCKS;
    __global float *tile_blocks = blocks + (size_t)corner.y * BLOCKS * pitch + corner.x * BLOCKS;
    Tile tile;
    tile.origin = corner * TILE;
    tile.width = width;
    tile.height = height;
    tile.resumes = resumes;
    tile.triangles = triangles;
    tile.depths = depths;
    for (int i = 0; i < BLOCKS * BLOCKS; i++) {
        tile.held[i] = 0;
        tile.farthest[i] = resumes ? tile_blocks[i / BLOCKS * pitch + i % BLOCKS] : 0.0f;
    }
    for (int i = first; i < end; i++)
        draw_record(records + (size_t)entries[i] * RECORD, &tile ALPHA_ARGUMENTS);

    float farthest = INFINITY;
    for (int i = 0; i < BLOCKS * BLOCKS; i++) {
        tile_blocks[i / BLOCKS * pitch + i % BLOCKS] = tile.farthest[i];
        farthest = LESSER(tile.farthest[i], farthest);
    }
    far[id] = farthest;
    for (int y = 0; y < TILE && tile.origin.y + y < height; y++)
        store_row(&tile, y);
}
