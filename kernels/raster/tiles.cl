// Drawing: one work-item per tile walks the tile's records in triangle order, with a hierarchical Z of 8 x 8 blocks.
#include "raster/coverage.cl"

#define BLOCK 8
#define BLOCKS (TILE / BLOCK) // per tile's side

// A tile while it is drawn, block by block, two rows of 8 pixels per vector. Of each block: whether it is `held` yet, how
// often it was touched, and its farthest depth, which may lag behind.
typedef struct {
    float16 depth[TILE * BLOCKS / 2];
    int16 ids[TILE * BLOCKS / 2];
    float farthest[BLOCKS * BLOCKS];
    uchar held[BLOCKS * BLOCKS], touched[BLOCKS * BLOCKS];
    int2 origin; // its first pixel
    int width, height, resumes;
    __global int *triangles; // the images
    __global float *depths;
} Tile;

// Fetch a block from the images where the tile resumes, otherwise begin it with nothing.
INLINE void hold_block(Tile *tile, const int bx, const int by)
{
    const int block = by * BLOCKS + bx, x = tile->origin.x + bx * BLOCK, y = tile->origin.y + by * BLOCK;
    float8 *depth = (float8 *)tile->depth + block * BLOCK;
    int8 *ids = (int8 *)tile->ids + block * BLOCK;
    tile->held[block] = 1;
    for (int j = 0; j < BLOCK; j++) {
        depth[j] = 0.0f;
        ids[j] = -1;
        if (!tile->resumes || y + j >= tile->height)
            continue;
        const size_t from = (size_t)(y + j) * tile->width + x;
        if (x + BLOCK <= tile->width) {
            depth[j] = *(__global loose_float8 *)(tile->depths + from);
            ids[j] = *(__global loose_int8 *)(tile->triangles + from);
            continue;
        }
        for (int i = 0; i < tile->width - x; i++) {
            ((float *)&depth[j])[i] = tile->depths[from + i];
            ((int *)&ids[j])[i] = tile->triangles[from + i];
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
        const float8 depth = tile->held[block] ? ((float8 *)tile->depth)[block * BLOCK + y % BLOCK] : (float8)0.0f;
        const int8 ids = tile->held[block] ? ((int8 *)tile->ids)[block * BLOCK + y % BLOCK] : (int8)-1;
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

// The farthest depth of a block.
INLINE float farthest_of(const float16 *depth)
{
    const float16 low01 = LESSER(depth[0], depth[1]), low23 = LESSER(depth[2], depth[3]);
    const float16 low = LESSER(low01, low23);
    return smallest_of(LESSER(low.lo, low.hi));
}

// Whether a box of few blocks (left, top, right, bottom) lies behind what is drawn.
INLINE int behind(const Tile *tile, const int4 box, const float nearest)
{
    if (box.z - box.x > 1 || box.w - box.y > 1)
        return 0;
    const float *upper = tile->farthest + box.y * BLOCKS, *lower = tile->farthest + box.w * BLOCKS;
    return (nearest < upper[box.x]) & (nearest < upper[box.z]) & (nearest < lower[box.x]) & (nearest < lower[box.z]);
}

// A record, see record.cl.
typedef struct {
    int8 corners;
    int4 rest;
} Record;

INLINE Record fetch(__global const int *records, const int number)
{
    __global const int *at = records + (size_t)number * RECORD;
    return (Record){*(__global const loose_int8 *)at, *(__global const loose_int4 *)(at + 8)};
}

// A record in a tile: the tile's pixels that its box holds, and what decides coverage and depth.
typedef struct {
    int left, top, right, bottom, id;
    int2 centre; // of the tile's first pixel
    Edge edges[3];
    Plane plane;
    float slope_x, slope_y; // depth per pixel
    int is_masked;
#if MASKED
    MaskedTriangle masked;
    float2 middle; // `centre`, from the image's centre
#endif
} Shape;

#if MASKED
// Clear the lanes of two rows of 8 pixels from (x, y) of the tile that fall into the mask's holes.
INLINE int16 rows_without_holes(int16 draw, const Shape *shape, const int x, const int y ALPHA_PARAMETERS)
{
    const float8 px = shape->middle.x + (x + (float8)(0, 1, 2, 3, 4, 5, 6, 7)) * SUBPIXELS;
    const float py = shape->middle.y + y * SUBPIXELS;
    draw.lo = without_holes(draw.lo, &shape->masked, px, py ALPHA_ARGUMENTS);
    draw.hi = without_holes(draw.hi, &shape->masked, px, py + SUBPIXELS ALPHA_ARGUMENTS);
    return draw;
}
#endif

// Draw the part of a shape that lies in a block.
INLINE void draw_block(Tile *tile, const Shape *shape, const int bx, const int by ALPHA_PARAMETERS)
{
    const int8 steps = (int8)(0, 1, 2, 3, 4, 5, 6, 7), zero = 0, one = 1;
    const float8 lanes = (float8)(0, 1, 2, 3, 4, 5, 6, 7), upper = 0.0f, lower = 1.0f;
    const int16 columns = (int16)(steps, steps), rows_down = (int16)(zero, one);
    const float16 across = (float16)(lanes, lanes), down = (float16)(upper, lower);
    const int block = by * BLOCKS + bx, px = bx * BLOCK, py = by * BLOCK;
    const Plane plane = shape->plane;
    const float slope_x = shape->slope_x, slope_y = shape->slope_y;
    const float z0 = (float)(plane.depth + plane.along_x * (px * SUBPIXELS + shape->centre.x - plane.corner.x) +
                             plane.along_y * (py * SUBPIXELS + shape->centre.y - plane.corner.y));
    const float reached = (z0 + (slope_y > 0 ? 7.0f : 0.0f) * slope_y) + (slope_x > 0 ? 7.0f : 0.0f) * slope_x;
    if (LESSER(reached, plane.nearest) < tile->farthest[block])
        return;
    if (!tile->held[block])
        hold_block(tile, bx, by);
    const int first = GREATER(shape->top - py, 0) / 2, last = LESSER(shape->bottom - py, BLOCK - 1) / 2;
    int16 inside[3];
    for (int i = 0; i < 3; i++) {
        const Edge edge = shape->edges[i];
        inside[i] = (edge.at + edge.along_x * px + edge.along_y * (py + 2 * first)) +
                    (edge.along_x * columns + edge.along_y * rows_down);
    }
    float16 *depth = tile->depth + block * (BLOCK / 2);
    int16 *ids = tile->ids + block * (BLOCK / 2);
    for (int j = first; j <= last; j++) {
        float16 z = (z0 + (2 * j + down) * slope_y) + across * slope_x;
        z = LESSER(z, plane.nearest);
        z = GREATER(z, plane.farthest);
        int16 draw = ((inside[0] | inside[1] | inside[2]) >= 0) &
                     ((z > depth[j]) | ((z == depth[j]) & (shape->id < ids[j])));
#if MASKED
        if (shape->is_masked)
            draw = rows_without_holes(draw, shape, px, py + 2 * j ALPHA_ARGUMENTS);
#endif
        depth[j] = draw ? z : depth[j];
        ids[j] = draw ? (int16)shape->id : ids[j];
        for (int i = 0; i < 3; i++)
            inside[i] += 2 * shape->edges[i].along_y;
    }
    if (last - first == BLOCK / 2 - 1 || ++tile->touched[block] % 4 == 0)
        tile->farthest[block] = farthest_of(depth);
}

// Draw a shape: the blocks of its box, 8 at a time, that its edges reach.
INLINE void draw_shape(Tile *tile, const Shape *shape ALPHA_PARAMETERS)
{
    const int8 steps = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    const int left = shape->left / BLOCK, right = shape->right / BLOCK;
    for (int start = left / 8 * 8; start <= right; start += 8) {
        const int8 blocks = start + steps, within = (blocks >= left) & (blocks <= right);
        int8 reach[3]; // the edges' greatest values in each block
        for (int i = 0; i < 3; i++) {
            const Edge edge = shape->edges[i];
            reach[i] = edge.at + 7 * (GREATER(edge.along_x, 0) + GREATER(edge.along_y, 0)) +
                       edge.along_x * BLOCK * blocks;
        }
        for (int by = shape->top / BLOCK; by <= shape->bottom / BLOCK; by++) {
            int8 inside = 0;
            for (int i = 0; i < 3; i++)
                inside |= reach[i] + shape->edges[i].along_y * by * BLOCK;
            for (uint todo = bits_of(within & (inside >= 0)); todo; todo &= todo - 1)
                draw_block(tile, shape, start + 31 - (int)clz(todo & -todo), by ALPHA_ARGUMENTS);
        }
    }
}

// Draw one record into a tile.
INLINE void draw_record(Tile *tile, const Record record ALPHA_PARAMETERS)
{
    const int2 a = record.corners.s01, b = record.corners.s23, c = record.corners.s45, origin = tile->origin;
    const float3 d = (float3)(as_float2(record.corners.s67), as_float(record.rest.x));
    const int4 box = record_pixels(record.rest.zw);
    Shape shape;
    shape.left = GREATER(box.x - origin.x, 0);
    shape.top = GREATER(box.y - origin.y, 0);
    shape.right = LESSER(box.z - origin.x, TILE - 1);
    shape.bottom = LESSER(box.w - origin.y, TILE - 1);
    const int4 blocks = (int4)(shape.left / BLOCK, shape.top / BLOCK, shape.right / BLOCK, shape.bottom / BLOCK);
    if (behind(tile, blocks, GREATER(d.x, GREATER(d.y, d.z))))
        return;
    shape.id = record.rest.y & ~MASK_BIT;
    shape.is_masked = record.rest.y & MASK_BIT;
    shape.centre = origin * SUBPIXELS + SUBPIXELS / 2;
    shape.edges[0] = edge_at(a, b, shape.centre);
    shape.edges[1] = edge_at(b, c, shape.centre);
    shape.edges[2] = edge_at(c, a, shape.centre);
    shape.plane = depth_plane(a, b, c, d);
    shape.slope_x = (float)(shape.plane.along_x * SUBPIXELS);
    shape.slope_y = (float)(shape.plane.along_y * SUBPIXELS);
#if MASKED
    if (shape.is_masked)
        shape.masked = masked_triangle(shape.id ALPHA_ARGUMENTS);
    const int2 half_size = (int2)(tile->width, tile->height) * (SUBPIXELS / 2);
    shape.middle = (float2)(shape.centre.x - half_size.x, shape.centre.y - half_size.y);
#endif
    draw_shape(tile, &shape ALPHA_ARGUMENTS);
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
        tile.touched[i] = 0;
        tile.farthest[i] = resumes ? tile_blocks[i / BLOCKS * pitch + i % BLOCKS] : 0.0f;
    }
    Record next = first < end ? fetch(records, entries[first]) : (Record){0, 0};
    for (int i = first; i < end; i++) {
        const Record record = next;
        next = fetch(records, entries[LESSER(i + 1, end - 1)]); // ahead of its use, because it is seldom in the cache
        draw_record(&tile, record ALPHA_ARGUMENTS);
    }

    float farthest = INFINITY;
    for (int i = 0; i < BLOCKS * BLOCKS; i++) {
        if (tile.held[i])
            tile.farthest[i] = farthest_of(tile.depth + i * (BLOCK / 2));
        tile_blocks[i / BLOCKS * pitch + i % BLOCKS] = tile.farthest[i];
        farthest = LESSER(tile.farthest[i], farthest);
    }
    far[id] = farthest;
    for (int y = 0; y < TILE && tile.origin.y + y < height; y++)
        store_row(&tile, y);
}
