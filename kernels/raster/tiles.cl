// Drawing: one work-item per tile walks the tile's records in triangle order, with a hierarchical Z of 8 x 8 blocks.
#include "raster/bins.cl"
#include "raster/shapes.cl"

#pragma OPENCL EXTENSION cl_khr_fp64 : enable

#define BLOCK 8
#define BLOCKS (TILE / BLOCK) // per tile's side, at most 8
#define AT(vectors, type, i) (((const type *)(vectors))[i])

// A tile while it is drawn, block by block, two rows of 8 pixels per vector. Of each block: whether it is `held` yet,
// and its farthest depth, one row of blocks per vector.
typedef struct {
    float16 depth[TILE * BLOCKS / 2];
    int16 ids[TILE * BLOCKS / 2];
    float8 farthest[BLOCKS];
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

// Write 8 pixels of a row to the images, as far as they lie in them.
INLINE void store_pixels(const Tile *tile, const int x, const int y, const float8 depth, const int8 ids)
{
    const size_t to = (size_t)y * tile->width + x;
    if (x + BLOCK <= tile->width) {
        *(__global loose_float8 *)(tile->depths + to) = depth;
        *(__global loose_int8 *)(tile->triangles + to) = ids;
        return;
    }
    for (int i = 0; i < tile->width - x; i++) {
        tile->depths[to + i] = ((const float *)&depth)[i];
        tile->triangles[to + i] = ((const int *)&ids)[i];
    }
}

// Write a tile to the images: all of it, or the blocks that were held if it resumes.
INLINE void store_tile(Tile *tile)
{
    const int rows = MIN(TILE, tile->height - tile->origin.y), columns = tile->width - tile->origin.x;
    for (int block = 0; block < BLOCKS * BLOCKS; block++)
        if (!tile->held[block] && !tile->resumes)
            hold_block(tile, block % BLOCKS, block / BLOCKS);
    const float8 *depth = (const float8 *)tile->depth;
    const int8 *ids = (const int8 *)tile->ids;
    if (!tile->resumes && columns >= TILE && tile->width % 8 == 0) {
        for (int y = 0; y < rows; y++) {
            const size_t to = (size_t)(tile->origin.y + y) * tile->width + tile->origin.x;
            const int from = y / BLOCK * BLOCKS * BLOCK + y % BLOCK;
            UNROLL
            for (int bx = 0; bx < BLOCKS; bx++)
                STREAM(depth[from + bx * BLOCK], (__global float8 *)(tile->depths + to + bx * BLOCK));
            UNROLL
            for (int bx = 0; bx < BLOCKS; bx++)
                STREAM(ids[from + bx * BLOCK], (__global int8 *)(tile->triangles + to + bx * BLOCK));
        }
        return;
    }
    for (int y = 0; y < rows; y++)
        for (int bx = 0; bx * BLOCK < columns && bx < BLOCKS; bx++) {
            const int block = y / BLOCK * BLOCKS + bx, row = block * BLOCK + y % BLOCK;
            if (tile->held[block])
                store_pixels(tile, tile->origin.x + bx * BLOCK, tile->origin.y + y, depth[row], ids[row]);
        }
}

// Whether a box of few blocks (left, top, right, bottom) lies behind what is drawn.
INLINE int behind(const Tile *tile, const int4 box, const float nearest)
{
    if (box.z - box.x > 1 || box.w - box.y > 1)
        return 0;
    const float *upper = (const float *)&tile->farthest[box.y], *lower = (const float *)&tile->farthest[box.w];
    return (nearest < upper[box.x]) & (nearest < upper[box.z]) & (nearest < lower[box.x]) & (nearest < lower[box.z]);
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

// Draw the part of a shape that lies in a block; z0 is its depth at the block's first pixel. All rows, also those that
// the shape does not reach: a branch that cannot be foreseen costs more.
INLINE void draw_block(Tile *tile, const Shape *shape, const int bx, const int by, const float z0 ALPHA_PARAMETERS)
{
    const int8 steps = (int8)(0, 1, 2, 3, 4, 5, 6, 7), zero = 0, one = 1;
    const float8 lanes = (float8)(0, 1, 2, 3, 4, 5, 6, 7), upper = 0.0f, lower = 1.0f;
    const int16 columns = (int16)(steps, steps), rows_down = (int16)(zero, one);
    const float16 across = (float16)(lanes, lanes), down = (float16)(upper, lower);
    const int block = by * BLOCKS + bx, px = bx * BLOCK, py = by * BLOCK;
    if (!tile->held[block])
        hold_block(tile, bx, by);
    int16 inside[3];
    UNROLL
    for (int i = 0; i < 3; i++) {
        const Edge edge = shape->edges[i];
        inside[i] =
            (edge.at + edge.along_x * px + edge.along_y * py) + (edge.along_x * columns + edge.along_y * rows_down);
    }
    float16 *depth = tile->depth + block * (BLOCK / 2);
    int16 *ids = tile->ids + block * (BLOCK / 2);
    float16 farthest = INFINITY;
    UNROLL
    for (int j = 0; j < BLOCK / 2; j++) {
        float16 z = (z0 + (2 * j + down) * shape->slope_y) + across * shape->slope_x;
        z = MIN(z, shape->plane.nearest);
        z = MAX(z, shape->plane.farthest);
        const float16 before = depth[j];
        int16 draw =
            ((inside[0] | inside[1] | inside[2]) >= 0) & ((z > before) | ((z == before) & (shape->id < ids[j])));
#if MASKED
        if (shape->is_masked)
            draw = alpha_tested_rows(draw, &shape->masked, shape->middle, px, py + 2 * j ALPHA_ARGUMENTS);
#endif
        const float16 after = draw ? z : before;
        depth[j] = after;
        ids[j] = draw ? (int16)shape->id : ids[j];
        farthest = MIN(farthest, after);
        UNROLL
        for (int i = 0; i < 3; i++)
            inside[i] += 2 * shape->edges[i].along_y;
    }
    ((float *)tile->farthest)[by * 8 + bx] = smallest_of(MIN(farthest.lo, farthest.hi));
}

// Draw a shape: of the blocks of its box those that its edges reach and that do not lie nearer.
INLINE void draw_shape(Tile *tile, const Shape *shape ALPHA_PARAMETERS)
{
    const int8 blocks = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    const Plane plane = shape->plane;
    const int8 within = (blocks >= shape->left / BLOCK) & (blocks <= shape->right / BLOCK);
    const double8 along = plane.depth + plane.along_x * convert_double8(blocks * (BLOCK * SUBPIXELS) +
                                                                        (shape->centre.x - plane.corner.x));
    const float down = (shape->slope_y > 0 ? 7.0f : 0.0f) * shape->slope_y;
    const float right = (shape->slope_x > 0 ? 7.0f : 0.0f) * shape->slope_x;
    int8 reach[3]; // the edges' greatest values in each block
    UNROLL
    for (int i = 0; i < 3; i++) {
        const Edge edge = shape->edges[i];
        reach[i] = edge.at + 7 * (MAX(edge.along_x, 0) + MAX(edge.along_y, 0)) + edge.along_x * BLOCK * blocks;
    }
    float8 corners[BLOCKS];
    ulong touched = 0; // 8 blocks per row
    for (int by = shape->top / BLOCK; by <= shape->bottom / BLOCK; by++) {
        const float8 z0 =
            convert_float8(along + plane.along_y * (by * (BLOCK * SUBPIXELS) + shape->centre.y - plane.corner.y));
        float8 reached = (z0 + down) + right;
        reached = MIN(reached, plane.nearest);
        int8 inside = 0;
        UNROLL
        for (int i = 0; i < 3; i++)
            inside |= reach[i] + shape->edges[i].along_y * by * BLOCK;
        const uint drawn = bits_of(within & (inside >= 0) & (reached >= tile->farthest[by]));
        touched |= (ulong)drawn << 8 * by;
        corners[by] = z0;
    }
    for (; touched; touched &= touched - 1) {
        const int block = 63 - (int)clz(touched & -touched);
        draw_block(tile, shape, block % 8, block / 8, AT(corners, float, block) ALPHA_ARGUMENTS);
    }
}

// Draw one of the shapes.
INLINE void draw_lane(Tile *tile, const Shapes *shapes, const int lane ALPHA_PARAMETERS)
{
    Shape shape;
    shape.left = AT(&shapes->left, int, lane);
    shape.top = AT(&shapes->top, int, lane);
    shape.right = AT(&shapes->right, int, lane);
    shape.bottom = AT(&shapes->bottom, int, lane);
    shape.plane.nearest = AT(&shapes->nearest, float, lane);
    const int4 blocks = (int4)(shape.left / BLOCK, shape.top / BLOCK, shape.right / BLOCK, shape.bottom / BLOCK);
    if (behind(tile, blocks, shape.plane.nearest))
        return;
    const int id = AT(&shapes->id, int, lane);
    shape.id = id & ~MASK_BIT;
    shape.is_masked = id & MASK_BIT;
    shape.centre = tile->origin * SUBPIXELS + SUBPIXELS / 2;
    UNROLL
    for (int i = 0; i < 3; i++)
        shape.edges[i] = (Edge){AT(&shapes->along_x[i], int, lane), AT(&shapes->along_y[i], int, lane),
                                AT(&shapes->at[i], int, lane)};
    shape.plane.depth = AT(&shapes->depth, float, lane);
    shape.plane.along_x = AT(&shapes->rise_x, double, lane);
    shape.plane.along_y = AT(&shapes->rise_y, double, lane);
    shape.plane.corner = (int2)(AT(&shapes->corner_x, int, lane), AT(&shapes->corner_y, int, lane));
    shape.plane.farthest = AT(&shapes->farthest, float, lane);
    shape.slope_x = AT(&shapes->slope_x, float, lane);
    shape.slope_y = AT(&shapes->slope_y, float, lane);
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
                         const int resumes, __global const int2 *tile_bins, __global const int *entries,
                         __global const int *records, __global int *triangles, __global float *depths,
                         __global float *blocks, __global float *far ALPHA_PARAMETERS)
{
    const int id = get_global_id(0);
    if (id >= tiles)
        return;
    Bins bins = bins_of(id, chunks, tile_bins, entries);
    int numbers[BATCH];
    int count = next_batch(&bins, numbers);
    if (resumes && count == 0)
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
        ((float *)tile.farthest)[i / BLOCKS * 8 + i % BLOCKS] =
            resumes ? tile_blocks[i / BLOCKS * pitch + i % BLOCKS] : 0.0f;
    }
    for (; count > 0; count = next_batch(&bins, numbers)) {
        Fetched fetched;
        fetch_records(&fetched, records, numbers, count);
        for (int i = 0; i < count; i += 8) {
            int8 fields[RECORD];
            Shapes shapes;
            fields_of(&fetched, fields);
            if (i + 8 < count) // ahead of their use, because they are seldom in the cache
                fetch_records(&fetched, records, numbers + i + 8, count - i - 8);
            set_shapes(&shapes, fields, tile.origin);
            for (int lane = 0; lane < MIN(count - i, 8); lane++)
                draw_lane(&tile, &shapes, lane ALPHA_ARGUMENTS);
        }
    }

    float farthest = INFINITY;
    for (int i = 0; i < BLOCKS * BLOCKS; i++) {
        const float deepest = AT(tile.farthest, float, i / BLOCKS * 8 + i % BLOCKS);
        tile_blocks[i / BLOCKS * pitch + i % BLOCKS] = deepest;
        farthest = MIN(deepest, farthest);
    }
    far[id] = farthest;
    store_tile(&tile);
}
