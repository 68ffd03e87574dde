// The fragments of every pixel: drawn once by one work-item per tile, into pages in triangle order, then put in their
// pixels and sorted by one per tile.
#include "raster/bins.cl"
#include "raster/shapes.cl"

#pragma OPENCL EXTENSION cl_khr_fp64 : enable

#define BLOCK 8
#define BLOCKS (TILE / BLOCK) // per tile's side, at most 8
#define AT(vectors, type, i) (((const type *)(vectors))[i])

#if FRONT
// What is in front of the fragments that count: a picture's triangles and depths. `numbers`: what it calls the
// triangles, for those of equal depth.
#define FRONT_PARAMETERS \
    , __global const int *front_triangle, __global const float *front_depth, __global const int *numbers
#define FRONT_ARGUMENTS , front_triangle, front_depth, numbers
#else
#define FRONT_PARAMETERS
#define FRONT_ARGUMENTS
#endif

// Where a tile's fragments go: pages of PAGE fragments each, taken from a pool as they are needed: the numbers of the
// fragments' pixels in the tile (block by block, row by row), then their triangles, then their depths.
// links: of each page the next (-1: none), and how many fragments it holds.
typedef struct {
    int8 rows[BLOCKS]; // fragments of each row of pixels
    int2 origin;       // the tile's first pixel
    int width, height;
    int capacity; // of the pool, pages
    int page, filled;
    __global int *pages, *taken, *first;
    __global int2 *links;
} Target;

// Go on in a new page. Beyond the pool's end pages are only counted.
INLINE void turn_page(Target *target)
{
    const int page = atomic_inc(target->taken);
    if (page < target->capacity) {
        if (target->page < 0)
            *target->first = page;
        else
            target->links[target->page] = (int2)(page, target->filled);
        target->page = page;
    } else
        target->page = target->capacity;
    target->filled = 0;
}

// A record in a tile: what decides coverage and depth.
typedef struct {
    int id;
    Edge edges[3];
    float nearest, farthest, slope_x, slope_y; // depth: limits, and per pixel
#if MASKED
    int is_masked;
    MaskedTriangle masked;
    float2 middle; // the centre of the tile's first pixel, from the image's centre
#endif
} Shape;

#if FRONT
// Clear the lanes of a row of 8 pixels from (x, y) of the tile where the picture shows something nearer.
INLINE int8 in_front(int8 draw, const Target *target, const int x, const int y, const float8 z,
                     const int id FRONT_PARAMETERS)
{
    if (bits_of(draw) == 0)
        return draw;
    const size_t at = (size_t)(target->origin.y + y) * target->width + target->origin.x + x;
    float8 depth = INFINITY;
    int8 triangle = -1;
    if (target->origin.x + x + 8 <= target->width) {
        depth = *(__global const loose_float8 *)(front_depth + at);
        triangle = *(__global const loose_int8 *)(front_triangle + at);
    } else {
        for (int lane = 0; lane < target->width - target->origin.x - x; lane++) {
            ((float *)&depth)[lane] = front_depth[at + lane];
            ((int *)&triangle)[lane] = front_triangle[at + lane];
        }
    }
    return draw & ((z > depth) | ((z == depth) & (numbers[id] < triangle)));
}
#endif

// The lanes of two comparisons as 32 bits.
INLINE uint bits_of_two(const int16 first, const int16 second)
{
    const int16 low = (int16)(1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768);
    const int16 bits = (first & low) | (second & (low << 16));
    const int8 eight = bits.lo | bits.hi;
    const int4 four = eight.lo | eight.hi;
    const int2 two = four.lo | four.hi;
    return (uint)(two.x | two.y);
}

// How many bits of each byte are set, from the lowest byte on.
INLINE int8 bits_per_byte(ulong bits)
{
    bits -= (bits >> 1) & 0x5555555555555555;
    bits = (bits & 0x3333333333333333) + ((bits >> 2) & 0x3333333333333333);
    bits = (bits + (bits >> 4)) & 0x0f0f0f0f0f0f0f0f;
    return convert_int8(as_uchar8(bits));
}

// Add the fragments of a shape in a block, at the pixels and depths that the rasteriser gives it; z0 is its depth at
// the block's first pixel.
INLINE void add_block(Target *target, const Shape *shape, const int bx, const int by,
                      const float z0 ALPHA_PARAMETERS FRONT_PARAMETERS)
{
    const int8 steps = (int8)(0, 1, 2, 3, 4, 5, 6, 7), zero = 0, one = 1;
    const float8 lanes = (float8)(0, 1, 2, 3, 4, 5, 6, 7), upper = 0.0f, lower = 1.0f;
    const int16 columns = (int16)(steps, steps), rows_down = (int16)(zero, one);
    const float16 across = (float16)(lanes, lanes), down = (float16)(upper, lower);
    const int block = by * BLOCKS + bx, px = bx * BLOCK, py = by * BLOCK;
    const int16 in_width = columns < target->width - target->origin.x - px;
    int16 inside[3], draw[BLOCK / 2];
    float16 z[BLOCK / 2];
    UNROLL
    for (int i = 0; i < 3; i++) {
        const Edge edge = shape->edges[i];
        inside[i] =
            (edge.at + edge.along_x * px + edge.along_y * py) + (edge.along_x * columns + edge.along_y * rows_down);
    }
    UNROLL
    for (int j = 0; j < BLOCK / 2; j++) {
        z[j] = (z0 + (2 * j + down) * shape->slope_y) + across * shape->slope_x;
        z[j] = MIN(z[j], shape->nearest);
        z[j] = MAX(z[j], shape->farthest);
        draw[j] = ((inside[0] | inside[1] | inside[2]) >= 0) & (z[j] > 0.0f) & in_width &
                  (2 * j + rows_down < target->height - target->origin.y - py);
#if MASKED
        if (shape->is_masked)
            draw[j] = alpha_tested_rows(draw[j], &shape->masked, shape->middle, px, py + 2 * j ALPHA_ARGUMENTS);
#endif
#if FRONT
        draw[j].lo = in_front(draw[j].lo, target, px, py + 2 * j, z[j].lo, shape->id FRONT_ARGUMENTS);
        draw[j].hi = in_front(draw[j].hi, target, px, py + 2 * j + 1, z[j].hi, shape->id FRONT_ARGUMENTS);
#endif
        UNROLL
        for (int i = 0; i < 3; i++)
            inside[i] += 2 * shape->edges[i].along_y;
    }
    ulong left = bits_of_two(draw[0], draw[1]) | (ulong)bits_of_two(draw[2], draw[3]) << 32;
    if (left == 0)
        return;
    target->rows[by] += bits_per_byte(left);
    if (target->filled > PAGE - BLOCK * BLOCK)
        turn_page(target);
    __global int *to = target->pages + (size_t)target->page * (3 * PAGE) + target->filled;
    const int first = block * (BLOCK * BLOCK);
    target->filled += (int)popcount(left);
    if (target->page == target->capacity)
        return;
    for (; left; left &= left - 1, to++) { // over the bits that are set: a branch per lane would be hard to predict
        const int lane = 63 - (int)clz(left & (0 - left));
        to[0] = first + lane;
        to[PAGE] = shape->id;
        to[2 * PAGE] = as_int(AT(z, float, lane));
    }
}

// Add the fragments of one of the shapes: in the blocks of its box that its edges reach.
INLINE void add_lane(Target *target, const Shapes *shapes, const int lane ALPHA_PARAMETERS FRONT_PARAMETERS)
{
    const int8 blocks = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    const int left = AT(&shapes->left, int, lane) / BLOCK, right = AT(&shapes->right, int, lane) / BLOCK;
    const int top = AT(&shapes->top, int, lane) / BLOCK, bottom = AT(&shapes->bottom, int, lane) / BLOCK;
    const int2 centre = target->origin * SUBPIXELS + SUBPIXELS / 2;
    const int8 within = (blocks >= left) & (blocks <= right);
    const double rise_x = AT(&shapes->rise_x, double, lane), rise_y = AT(&shapes->rise_y, double, lane);
    const double8 along =
        (double)AT(&shapes->depth, float, lane) +
        rise_x * convert_double8(blocks * (BLOCK * SUBPIXELS) + (centre.x - AT(&shapes->corner_x, int, lane)));
    const int down = centre.y - AT(&shapes->corner_y, int, lane), id = AT(&shapes->id, int, lane);
    Shape shape;
    shape.id = id & ~MASK_BIT;
    shape.nearest = AT(&shapes->nearest, float, lane);
    shape.farthest = AT(&shapes->farthest, float, lane);
    shape.slope_x = AT(&shapes->slope_x, float, lane);
    shape.slope_y = AT(&shapes->slope_y, float, lane);
#if MASKED
    shape.is_masked = id & MASK_BIT;
    if (shape.is_masked)
        shape.masked = masked_triangle(shape.id ALPHA_ARGUMENTS);
    shape.middle = (float2)(centre.x - target->width * (SUBPIXELS / 2), centre.y - target->height * (SUBPIXELS / 2));
#endif
    int8 reach[3]; // the edges' greatest values in each block
    UNROLL
    for (int i = 0; i < 3; i++) {
        const Edge edge = {AT(&shapes->along_x[i], int, lane), AT(&shapes->along_y[i], int, lane),
                           AT(&shapes->at[i], int, lane)};
        shape.edges[i] = edge;
        reach[i] = edge.at + 7 * (MAX(edge.along_x, 0) + MAX(edge.along_y, 0)) + edge.along_x * BLOCK * blocks;
    }
    float8 corners[BLOCKS]; // depth at the blocks' first pixels
    ulong touched = 0;      // 8 blocks per row
    for (int by = top; by <= bottom; by++) {
        int8 inside = 0;
        UNROLL
        for (int i = 0; i < 3; i++)
            inside |= reach[i] + shape.edges[i].along_y * by * BLOCK;
        touched |= (ulong)bits_of(within & (inside >= 0)) << 8 * by;
        corners[by] = convert_float8(along + rise_y * (by * (BLOCK * SUBPIXELS) + down));
    }
    for (; touched; touched &= touched - 1) {
        const int block = 63 - (int)clz(touched & (0 - touched));
        add_block(target, &shape, block % 8, block / 8, AT(corners, float, block) ALPHA_ARGUMENTS FRONT_ARGUMENTS);
    }
}

// Draw the triangles with members[triangle] == member into pages; `first`: each tile's first page, or -1.
// runs: fragments of each tile's rows, as those follow in the image.
__kernel void draw_fragments(const int tiles, const int tiles_x, const int width, const int height, const int chunks,
                             __global const int2 *tile_bins, __global const int *entries, __global const int *records,
                             __global const uchar *members, const int member, const int capacity, __global int *pages,
                             __global int2 *links, __global int *taken, __global int *firsts,
                             __global int *runs ALPHA_PARAMETERS FRONT_PARAMETERS)
{
    const int tile = get_global_id(0);
    if (tile >= tiles)
        return;
    Target target;
    target.origin = (int2)(tile % tiles_x, tile / tiles_x) * TILE;
    target.width = width;
    target.height = height;
    target.capacity = capacity;
    target.page = -1;
    target.filled = PAGE;
    target.pages = pages;
    target.links = links;
    target.taken = taken;
    target.first = firsts + tile;
    firsts[tile] = -1;
    for (int i = 0; i < BLOCKS; i++)
        target.rows[i] = 0;
    Bins bins = bins_of(tile, chunks, tile_bins, entries);
    int listed[BATCH];
    for (int count; (count = next_batch(&bins, listed)) > 0;) {
        Fetched fetched;
        fetch_records(&fetched, records, listed, count);
        for (int i = 0; i < count; i += 8) {
            int8 fields[RECORD];
            Shapes shapes;
            fields_of(&fetched, fields);
            if (i + 8 < count) // ahead of their use, because they are seldom in the cache
                fetch_records(&fetched, records, listed + i + 8, count - i - 8);
            set_shapes(&shapes, fields, target.origin);
            for (int lane = 0; lane < MIN(count - i, 8); lane++)
                if (members[AT(&shapes.id, int, lane) & ~MASK_BIT] == member)
                    add_lane(&target, &shapes, lane ALPHA_ARGUMENTS FRONT_ARGUMENTS);
        }
    }
    if (target.page >= 0 && target.page < capacity)
        links[target.page] = (int2)(-1, target.filled);

    for (int y = 0; y < TILE && target.origin.y + y < height; y++)
        runs[(size_t)(target.origin.y + y) * tiles_x + tile % tiles_x] = AT(target.rows, int, y);
}

// A fragment as a number that is less the nearer it is (the greater its depth, which is positive), and of equal depths
// the lower its triangle is.
#define KEY(z, id) ((ulong)~as_uint(z) << 32 | (uint)(id))
#define ORDER(i, j)                                                            \
    {                                                                          \
        const ulong low = MIN(keys[i], keys[j]), high = MAX(keys[i], keys[j]); \
        keys[i] = low;                                                         \
        keys[j] = high;                                                        \
    }
#define NETWORK 4

// Sorts 2 to NETWORK fragments without branches, which could not be foreseen.
INLINE void sort_few(const int count, __global int *ids, __global float *depths)
{
    ulong keys[NETWORK];
    UNROLL
    for (int i = 0; i < NETWORK; i++)
        keys[i] = i < count ? KEY(depths[MIN(i, count - 1)], ids[MIN(i, count - 1)]) : ~(ulong)0;
    ORDER(0, 1)
    ORDER(2, 3)
    ORDER(0, 2)
    ORDER(1, 3)
    ORDER(1, 2)
    for (int i = NETWORK - 1; i >= 0; i--) { // what lies beyond the end becomes the last once more, and is overwritten
        const int to = MIN(i, count - 1);
        ids[to] = (int)(uint)keys[i];
        depths[to] = as_float(~(uint)(keys[i] >> 32));
    }
}

// Sorts a pixel's fragments, nearest first. Shell's sort, which is plain insertion for short lists; no two compare
// equal, so the order is the only one.
INLINE void sort_list(const int count, __global int *ids, __global float *depths)
{
    for (int gap = count > 16 ? count / 2 : 1;; gap = gap * 5 / 11 > 1 ? gap * 5 / 11 : 1) {
        for (int i = gap; i < count; i++) {
            const float z = depths[i];
            const int id = ids[i];
            int j = i;
            for (; j >= gap && (depths[j - gap] < z || (depths[j - gap] == z && ids[j - gap] > id)); j -= gap) {
                depths[j] = depths[j - gap];
                ids[j] = ids[j - gap];
            }
            depths[j] = z;
            ids[j] = id;
        }
        if (gap == 1)
            break;
    }
}

// Write 8 pixels' values to an image, as far as they lie in it.
INLINE void store_pixels(__global int *image, const int width, const int x, const int y, const int8 values)
{
    __global int *to = image + (size_t)y * width + x;
    if (x + BLOCK <= width)
        *(__global loose_int8 *)to = values;
    else
        for (int lane = 0; lane < width - x; lane++)
            to[lane] = AT(&values, int, lane);
}

// Count the fragments of each pixel of a tile, whose first page is `first`.
INLINE void count_in_pixels(const int first, __global const int *pages, __global const int2 *links, int *counts)
{
    int2 link;
    for (int page = first; page >= 0; page = link.x) {
        link = links[page];
        for (int i = 0; i < link.y; i++)
            counts[pages[(size_t)page * (3 * PAGE) + i]]++;
    }
}

// Sort the fragments of a tile's pixels that have `several`; `places`: where each pixel's end.
INLINE void sort_pixels(const int2 origin, const int rows, const int columns, const int width,
                        __global const int *offsets, int8 *places, const uchar *several, __global int *triangle,
                        __global float *depth)
{
    for (int y = 0; y < rows; y++)
        for (int x = 0; x < columns; x += BLOCK) {
            const int at = (y / BLOCK * BLOCKS + x / BLOCK) * BLOCK + y % BLOCK;
            for (uint left = several[at]; left; left &= left - 1) {
                const int lane = 31 - clz(left & (0u - left));
                const int begin = offsets[(size_t)(origin.y + y) * width + origin.x + x + lane];
                const int count = AT(&places[at], int, lane) - begin;
                if (count <= NETWORK)
                    sort_few(count, triangle + begin, depth + begin);
                else
                    sort_list(count, triangle + begin, depth + begin);
            }
        }
}

// Each pixel's fragments from `offsets` on, sorted, and whose they are. starts: where each tile's row of them begins.
__kernel void place_fragments(const int tiles, const int tiles_x, const int width, const int height,
                              __global const int *pages, __global const int2 *links, __global const int *firsts,
                              __global const int *starts, __global int *offsets, __global int *triangle,
                              __global int *owner, __global float *depth)
{
    const int tile = get_global_id(0);
    if (tile >= tiles)
        return;
    const int2 origin = (int2)(tile % tiles_x, tile / tiles_x) * TILE;
    const int rows = MIN(TILE, height - origin.y), columns = MIN(TILE, width - origin.x);
    if (firsts[tile] < 0) {
        for (int y = 0; y < rows; y++)
            for (int x = 0; x < columns; x += BLOCK)
                store_pixels(offsets, width, origin.x + x, origin.y + y,
                             (int8)starts[(size_t)(origin.y + y) * tiles_x + tile % tiles_x]);
        return;
    }

    int8 places[TILE * BLOCKS];   // of each pixel, how many fragments, then its next free place
    uchar several[TILE * BLOCKS]; // which of 8 pixels have more than one
    for (int i = 0; i < TILE * BLOCKS; i++)
        places[i] = 0;
    int *next = (int *)places;
    count_in_pixels(firsts[tile], pages, links, next);
    const int8 none = 0;
    for (int y = 0; y < rows; y++) {
        int start = starts[(size_t)(origin.y + y) * tiles_x + tile % tiles_x];
        for (int x = 0; x < columns; x += BLOCK) {
            const int at = (y / BLOCK * BLOCKS + x / BLOCK) * BLOCK + y % BLOCK;
            const int8 counts = places[at];
            several[at] = (uchar)bits_of(counts > 1);
            int8 sum = counts; // becomes that of the lanes up to each
            sum += (int8)(0, sum.s0123, sum.s45, sum.s6);
            sum += (int8)(0, 0, sum.s0123, sum.s45);
            sum += (int8)(none.lo, sum.lo);
            places[at] = start + sum - counts;
            start += sum.s7;
            store_pixels(offsets, width, origin.x + x, origin.y + y, places[at]);
        }
    }
    const int corner = origin.y * width + origin.x;
    int2 link;
    for (int page = firsts[tile]; page >= 0; page = link.x) {
        __global const int *from = pages + (size_t)page * (3 * PAGE);
        link = links[page];
        for (int i = 0; i < link.y; i++) {
            const uint pixel = from[i], block = pixel / (BLOCK * BLOCK);
            const uint x = block % BLOCKS * BLOCK + pixel % BLOCK, y = block / BLOCKS * BLOCK + pixel / BLOCK % BLOCK;
            const int to = next[pixel]++;
            triangle[to] = from[PAGE + i];
            depth[to] = as_float(from[2 * PAGE + i]);
            owner[to] = corner + y * width + x;
        }
    }
    sort_pixels(origin, rows, columns, width, offsets, places, several, triangle, depth);
}

// members[id] = node[id] + 1 for the listed triangles.
__kernel void mark_members(const int count, __global const int *listed, __global const uchar *node,
                           __global uchar *members)
{
    const int i = get_global_id(0);
    if (i < count)
        members[listed[i]] = node[listed[i]] + 1;
}
