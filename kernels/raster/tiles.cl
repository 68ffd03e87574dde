// Drawing: one work-item per tile walks the tile's records in triangle order, with a hierarchical Z of 8 x 8 blocks.
#include "raster/coverage.cl"

#define BLOCK 8
#define BLOCKS (TILE / BLOCK) // per tile's side

INLINE float smallest_of(const float8 v)
{
    const float4 four = LESSER(v.lo, v.hi);
    const float2 two = LESSER(four.lo, four.hi);
    return LESSER(two.x, two.y);
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
