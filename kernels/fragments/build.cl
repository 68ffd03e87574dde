// The fragments of every pixel: counted and written by one work-item per tile, then sorted by one per pixel.
#include "raster/coverage.cl"

#define BLOCK 8
#define BLOCKS (TILE / BLOCK) // per tile's side

#if FRONT
// What is in front of the fragments that count: a picture's triangles and depths. `numbers`: what it calls the
// triangles, for those of equal depth.
#define FRONT_PARAMETERS                                                                                               \
    , __global const int *front_triangle, __global const float *front_depth, __global const int *numbers
#define FRONT_ARGUMENTS , front_triangle, front_depth, numbers
#else
#define FRONT_PARAMETERS
#define FRONT_ARGUMENTS
#endif

// Where the tiles' fragments go. `cursor`: how many each pixel of the tile has so far, rows of 8 pixels.
typedef struct {
    int2 origin; // the tile's first pixel
    int width, height;
    __global const int *offsets; // 0: count only
    __global int *triangle;
    __global float *depth;
    int8 cursor[TILE * BLOCKS];
} Target;

// Which lanes of a comparison hold, as bits.
INLINE uint lanes_of(const int8 mask)
{
    const int8 bits = mask & (int8)(1, 2, 4, 8, 16, 32, 64, 128);
    const int4 four = bits.lo | bits.hi;
    return four.x | four.y | four.z | four.w;
}

// Write a row's fragments behind those that their pixels have: at once where they come to lie side by side, as most do
// where one surface covers all.
INLINE void write_row(Target *target, const int x, const int y, const int at, const int8 draw, const float8 z,
                      const int id)
{
    uint left = lanes_of(draw);
    if (left == 0)
        return;
    __global const int *offsets = target->offsets + (target->origin.y + y) * target->width + target->origin.x + x;
    if (left == 255 && target->origin.x + x + 8 <= target->width) {
        const int8 to = *(__global const loose_int8 *)offsets + target->cursor[at];
        const int8 aside = to != to.s0 + (int8)(0, 1, 2, 3, 4, 5, 6, 7);
        const int4 apart = aside.lo | aside.hi;
        if ((apart.x | apart.y | apart.z | apart.w) == 0) {
            target->cursor[at] += 1;
            *(__global loose_int8 *)(target->triangle + to.s0) = (int8)id;
            *(__global loose_float8 *)(target->depth + to.s0) = z;
            return;
        }
    }
    int *cursor = (int *)&target->cursor[at];
    __global int *triangle = target->triangle;
    __global float *depth = target->depth;
    for (; left; left &= left - 1) { // over the bits that are set: a branch per lane would be hard to predict
        const int lane = 31 - clz(left & (0u - left));
        const int to = offsets[lane] + cursor[lane]++;
        triangle[to] = id;
        depth[to] = ((const float *)&z)[lane];
    }
}

#if FRONT
// Clear the lanes of a row of 8 pixels from (x, y) of the tile where the picture shows something nearer.
INLINE int8 in_front(int8 draw, const Target *target, const int x, const int y, const float8 z,
                     const int id FRONT_PARAMETERS)
{
    if (lanes_of(draw) == 0)
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

// Count or write the fragments of one record in a tile: the pixels and depths that the rasteriser gives it.
INLINE void add_record(__global const int *record, Target *target ALPHA_PARAMETERS FRONT_PARAMETERS)
{
    const int2 origin = target->origin;
    const int2 a = (int2)(record[0], record[1]), b = (int2)(record[2], record[3]), c = (int2)(record[4], record[5]);
    const float3 d = (float3)(as_float(record[6]), as_float(record[7]), as_float(record[8]));
    const int2 low = (int2)(least(a.x, b.x, c.x), least(a.y, b.y, c.y));
    const int2 high = (int2)(most(a.x, b.x, c.x), most(a.y, b.y, c.y));
    const int left = GREATER(first_pixel(low.x) - origin.x, 0), top = GREATER(first_pixel(low.y) - origin.y, 0);
    const int right = LESSER(LESSER(last_pixel(high.x), target->width - 1) - origin.x, TILE - 1);
    const int bottom = LESSER(LESSER(last_pixel(high.y), target->height - 1) - origin.y, TILE - 1);
    const int id = record[9] & ~MASK_BIT;
    const float8 lanes = (float8)(0, 1, 2, 3, 4, 5, 6, 7);
    const int8 steps = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
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
    const float2 middle =
        (float2)(centre.x - target->width * (SUBPIXELS / 2), centre.y - target->height * (SUBPIXELS / 2));
#endif
    for (int by = top / BLOCK; by <= bottom / BLOCK; by++)
        for (int bx = left / BLOCK; bx <= right / BLOCK; bx++) {
            const int px = bx * BLOCK, py = by * BLOCK;
            const int at0 = e0.at + e0.along_x * px + e0.along_y * py;
            const int at1 = e1.at + e1.along_x * px + e1.along_y * py;
            const int at2 = e2.at + e2.along_x * px + e2.along_y * py;
            if (((at0 + reach0) | (at1 + reach1) | (at2 + reach2)) < 0)
                continue;
            const float z0 = (float)(plane.depth + plane.along_x * (px * SUBPIXELS + centre.x - plane.corner.x) +
                                     plane.along_y * (py * SUBPIXELS + centre.y - plane.corner.y));
            const int first = GREATER(top - py, 0), last = LESSER(bottom - py, BLOCK - 1);
            for (int j = first; j <= last; j++) {
                const int y = py + j, at = y * BLOCKS + bx;
                const int8 row0 = at0 + e0.along_y * j + e0.along_x * steps;
                const int8 row1 = at1 + e1.along_y * j + e1.along_x * steps;
                const int8 row2 = at2 + e2.along_y * j + e2.along_x * steps;
                float8 z = (z0 + j * slope_y) + lanes * slope_x;
                z = LESSER(z, plane.nearest);
                z = GREATER(z, plane.farthest);
                int8 draw = ((row0 | row1 | row2) >= 0) & (z > 0.0f) & (px + steps >= left) & (px + steps <= right);
#if MASKED
                if (is_masked)
                    draw = without_holes(draw, &masked, middle.x + (px + lanes) * SUBPIXELS,
                                         middle.y + y * SUBPIXELS ALPHA_ARGUMENTS);
#endif
#if FRONT
                draw = in_front(draw, target, px, y, z, id FRONT_ARGUMENTS);
#endif
                if (target->offsets)
                    write_row(target, px, y, at, draw, z, id);
                else
                    target->cursor[at] -= draw;
            }
        }
}

INLINE void add_records(Target *target, const int tile, const int tiles_x, const int chunks, __global const int *ends,
                        __global const int *entries, __global const int *records, __global const uchar *members,
                        const int member ALPHA_PARAMETERS FRONT_PARAMETERS)
{
    const int first = tile == 0 ? 0 : ends[(size_t)tile * chunks - 1], end = ends[(size_t)(tile + 1) * chunks - 1];
    target->origin = (int2)(tile % tiles_x, tile / tiles_x) * TILE;
    for (int i = 0; i < TILE * BLOCKS; i++)
        target->cursor[i] = 0;
    for (int i = first; i < end; i++) {
        __global const int *record = records + (size_t)entries[i] * RECORD;
        if (members[record[9] & ~MASK_BIT] == member)
            add_record(record, target ALPHA_ARGUMENTS FRONT_ARGUMENTS);
    }
}

// How many fragments of triangles with members[triangle] == member each pixel has.
__kernel void count_fragments(const int tiles, const int tiles_x, const int width, const int height, const int chunks,
                              __global const int *ends, __global const int *entries, __global const int *records,
                              __global const uchar *members, const int member,
                              __global int *counts ALPHA_PARAMETERS FRONT_PARAMETERS)
{
    const int tile = get_global_id(0);
    if (tile >= tiles)
        return;
    Target target;
    target.width = width;
    target.height = height;
    target.offsets = 0;
    add_records(&target, tile, tiles_x, chunks, ends, entries, records, members, member ALPHA_ARGUMENTS FRONT_ARGUMENTS);
    for (int y = 0; y < TILE && target.origin.y + y < height; y++)
        for (int x = 0; x < TILE && target.origin.x + x < width; x++)
            counts[(size_t)(target.origin.y + y) * width + target.origin.x + x] =
                ((const int *)&target.cursor[y * BLOCKS])[x];
}

// The fragments, pixel after pixel from `offsets`, in triangle order.
__kernel void write_fragments(const int tiles, const int tiles_x, const int width, const int height, const int chunks,
                              __global const int *ends, __global const int *entries, __global const int *records,
                              __global const uchar *members, const int member, __global const int *offsets,
                              __global int *triangle, __global float *depth ALPHA_PARAMETERS FRONT_PARAMETERS)
{
    const int tile = get_global_id(0);
    if (tile >= tiles)
        return;
    Target target;
    target.width = width;
    target.height = height;
    target.offsets = offsets;
    target.triangle = triangle;
    target.depth = depth;
    add_records(&target, tile, tiles_x, chunks, ends, entries, records, members, member ALPHA_ARGUMENTS FRONT_ARGUMENTS);
}

// Sorts each pixel's fragments, nearest (greatest depth) first, of equal depths the lowest triangle, and notes whose they
// are. Shell's sort, which is plain insertion for short lists; no two compare equal, so the order is the only one.
__kernel void sort_fragments(const int pixels, __global const int *offsets, __global int *triangle,
                             __global int *owner, __global float *depth)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    const int first = offsets[pixel], count = offsets[pixel + 1] - first;
    for (int i = 0; i < count; i++)
        owner[first + i] = pixel;
    __global int *ids = triangle + first;
    __global float *depths = depth + first;
    int gap = count > 16 ? count / 2 : 1;
    for (; count > 1; gap = gap * 5 / 11 > 1 ? gap * 5 / 11 : 1) {
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

// members[id] = node[id] + 1 for the listed triangles.
__kernel void mark_members(const int count, __global const int *listed, __global const uchar *node,
                           __global uchar *members)
{
    const int i = get_global_id(0);
    if (i < count)
        members[listed[i]] = node[listed[i]] + 1;
}
