#include "common/types.cl"
#include "common/elementary.cl"
#include "layout.cl"

// The texels of blocks, as shading samples. u, v: position in the patch's unit square, with (0, 0) at the centre of the
// block's first texel and (1, 1) at that of its last.

// What a patch's samples need to know of its block. mask: its members in the set, 7 for all of them.
typedef struct {
    int x, y, width, height;
    int size, mask; // members, and which of them are in the set
    bool full;      // whether lookups touch all texels
} Shape;

INLINE Shape shape_of(uint word, __global const int *members, int mask, int complete)
{
    const Block block = unpack_location(word);
    Shape shape;
    shape.x = block.x, shape.y = block.y, shape.width = 1 << block.w, shape.height = 1 << block.h;
    shape.size = members[2] >= 0 ? 3 : members[1] >= 0 ? 2 : 1;
    shape.mask = complete ? 7 : mask;
    shape.full = shape.mask == 7 || (shape.size == 2 && mask == 3);
    return shape;
}

// Columns [first, last) of a row that bilinear lookups inside the triangles of the mask touch: a lookup touches the
// columns and rows less than one texel away.
INLINE int2 touched_columns(Shape shape, int row)
{
    if (shape.full)
        return (int2)(0, shape.width);
    const int width = shape.width - 1, height = MAX(shape.height - 1, 1), mask = shape.mask;
    const int above = MAX(row - 1, 0), below = MIN(row + 1, height);
    if (shape.size < 3) {
        const int past = (width * (height - above) + height - 1) / height; // of the triangle at (0, 0)
        const int before = width * (height - below) / height;              // of the one at (1, 1)
        return (int2)((mask & 1) ? 0 : before, (mask & 2) ? width + 1 : MIN(past, width) + 1);
    }
    int first = width, last = 0;
    if (mask & 1) {
        first = width * (height - below) / (2 * height);
        last = (width * (height + below) + 2 * height - 1) / (2 * height);
    }
    if (mask & 2) {
        const int right = width * (height + above) / (2 * height);
        first = MIN(first, right);
        last = width;
    }
    if (mask & 4) {
        const int left = (width * (height - above) + 2 * height - 1) / (2 * height);
        first = 0;
        last = MAX(last, left);
    }
    return (int2)(first, MIN(last, width) + 1);
}

// The ways on the surface along u and along v, from side to side of the patch: lengths, two per triangle.
__kernel void texel_derivatives(int count, __global const uchar *codes, __global const float *weights,
                                __global const int *indices, __global const float *positions, __global float *ways)
{
    const int triangle = get_global_id(0);
    if (triangle >= count)
        return;
    __global const float *weight = weights + 8 * codes[triangle];
    const float3 p0 = corner_position(positions, indices, triangle, 0);
    const float3 p1 = corner_position(positions, indices, triangle, 1) - p0;
    const float3 p2 = corner_position(positions, indices, triangle, 2) - p0;
    const float3 along = weight[1] * p1 + weight[4] * p2, down = weight[2] * p1 + weight[5] * p2;
    ways[2 * triangle] = sqrt(dot3(along, along));
    ways[2 * triangle + 1] = sqrt(dot3(down, down));
}

// A triangle's part of a block: its number, its footprint and barycentrics 1 and 2 as a + b u + c v.
typedef struct {
    int triangle;
    float footprint;
    float a1, b1, c1, a2, b2, c2;
} Part;

// A row of a block: texel of column 0; u = u0 + du * column, v likewise; a column belongs to the second part where
// second.x + second.y * column > 0, and to the third likewise.
typedef struct {
    int texel;
    float u0, du, v0, dv;
    int2 second, third;
} Row;

// step_u, step_v: 1 / (side - 1), or 0 along a side of one texel, which stands for the middle of the patch.
INLINE Row make_row(Shape shape, int row, float step_u, float step_v, int atlas_width)
{
    const int w = shape.width, h = shape.height;
    Row result;
    result.texel = (shape.y + row) * atlas_width + shape.x;
    result.du = step_u;
    result.dv = 0.0f;
    result.u0 = w > 1 ? 0.0f : 0.5f;
    result.v0 = h > 1 ? step_v * (float)row : 0.5f;
    result.second = result.third = (int2)(0, 0);
    if (shape.size == 1) { // the middle of a triangle's row, or column, ends at the diagonal
        if (w == 1 && h == 1)
            result.u0 = result.v0 = 1.0f / 3.0f;
        else if (w == 1)
            result.u0 = 0.5f - 0.5f * result.v0;
        else if (h == 1)
            result.dv = -0.5f * step_u;
        return result;
    }
    // u = (un0 + un1 * column) / ud and v = vn / vd in whole numbers; on a shared edge the first part owns, if it is in
    // the set.
    const int ud = w > 1 ? w - 1 : 2, un0 = w > 1 ? 0 : 1, un1 = w > 1 ? 1 : 0;
    const int vd = h > 1 ? h - 1 : 2, vn = h > 1 ? row : 1, tie = (shape.mask & 1) ? 0 : 1;
    if (shape.size == 2) {
        result.second = (int2)(un0 * vd + vn * ud - ud * vd + tie, un1 * vd);
    } else {
        result.second = (int2)(2 * un0 * vd - vn * ud - ud * vd + tie, 2 * un1 * vd);
        result.third = (int2)(ud * vd - vn * ud - 2 * un0 * vd + tie, -2 * un1 * vd);
    }
    return result;
}

// The member that owns a column of a row.
INLINE int owner_of(Row row, int column)
{
    return row.third.x + row.third.y * column > 0 ? 2 : row.second.x + row.second.y * column > 0 ? 1 : 0;
}

// How many of the patch's triangles in the set, `mask`, own no texel. Of pairs two texels hold some of each, of fans
// four in two columns or more.
INLINE int without_texel(Shape shape, int mask)
{
    const int texels = shape.width * shape.height;
    if (shape.size == 1 || (shape.size == 2 && texels > 1) || (shape.width > 1 && texels > 2))
        return 0;
    int owners = 0;
    for (int y = 0; y < shape.height; y++) {
        const Row row = make_row(shape, y, 0.0f, 0.0f, 0);
        const int2 columns = touched_columns(shape, y);
        for (int column = columns.x; column < columns.y; column++)
            owners |= 1 << owner_of(row, column);
    }
    return popcount(mask & ~owners);
}

// words: of patches, locations of blocks as large as they ask for, all in the atlas' corner. top: the largest level.
__kernel void ask_in_corner(int count, __global const int *patches, __global const int *sizes, int bias, int top,
                            __global uint *words)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const Block block = {0, 0, level_at(sizes[i] & 0xFF, bias, top), level_at(sizes[i] >> 8, bias, top)};
    words[patches[i]] = pack_location(block);
}

// counts: samples of each run of patches. without: triangles in the set whose patch has a block, of which they own no
// texel, added up.
__kernel void count_samples(int count, int run, int runs, int complete, __global const int *patches,
                            __global const uchar *masks, __global const int *members, __global const uint *words,
                            __global int *counts, __global int *without)
{
    const int r = get_global_id(0);
    if (r >= runs)
        return;
    int sum = 0, bare = 0;
    const int end = MIN(count, (r + 1) * run);
    for (int i = r * run; i < end; i++) {
        const uint word = words[patches[i]];
        if (!word)
            continue;
        const Shape shape = shape_of(word, members + 3 * patches[i], masks[i], complete);
        bare += without_texel(shape, masks[i]);
        if (shape.full) {
            sum += shape.width * shape.height;
            continue;
        }
        for (int row = 0; row < shape.height; row++) {
            const int2 columns = touched_columns(shape, row);
            sum += columns.y - columns.x;
        }
    }
    counts[r] = sum;
    if (bare)
        atomic_add(without, bare);
}

// Eight samples of a row from `column` on, of which those beyond the row's end mean nothing.
typedef struct {
    int8 triangle, texel;
    float8 bary1, bary2, footprint;
} Samples8;

INLINE Samples8 sample_row(int column, const Row *row, const Part *part, int members)
{
    const int8 i = column + (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    const float8 x = (float)column + (float8)(0, 1, 2, 3, 4, 5, 6, 7);
    const float8 u = row->u0 + row->du * x, v = row->v0 + row->dv * x;
    Samples8 s;
    s.texel = row->texel + i;
    s.triangle = (int8)(part[0].triangle);
    s.footprint = (float8)(part[0].footprint);
    s.bary1 = part[0].a1 + part[0].b1 * u + part[0].c1 * v;
    s.bary2 = part[0].a2 + part[0].b2 * u + part[0].c2 * v;
    for (int k = 1; k < members; k++) {
        const int2 line = k == 1 ? row->second : row->third;
        const int8 inside = line.x + line.y * i > 0;
        s.triangle = inside ? (int8)(part[k].triangle) : s.triangle;
        s.footprint = inside ? (float8)(part[k].footprint) : s.footprint;
        s.bary1 = inside ? part[k].a1 + part[k].b1 * u + part[k].c1 * v : s.bary1;
        s.bary2 = inside ? part[k].a2 + part[k].b2 * u + part[k].c2 * v : s.bary2;
    }
    return s;
}

INLINE void store_lanes(int8 value, __global int *array, int count)
{
    for (int k = 0; k < count; k++)
        array[k] = ((int *)&value)[k];
}

// codes: role and rotation per triangle. weights: a1 b1 c1 a2 b2 c2 0 0 of each code. ways: as from texel_derivatives.
// The rest as in count_samples.
__kernel void emit_samples(int count, int run, int runs, int complete, __global const int *patches,
                           __global const uchar *masks, __global const int *members, __global const uint *words,
                           __global const uchar *codes, __global const float *weights, __global const float *ways,
                           int atlas_width, __global const int *counts, __global const int *offsets,
                           __global int *triangle, __global float *bary1, __global float *bary2,
                           __global float *footprint, __global int *texel)
{
    const int r = get_global_id(0);
    if (r >= runs)
        return;
    int at = offsets[r];
    const int last = at + counts[r];
    const int end = MIN(count, (r + 1) * run);
    for (int i = r * run; i < end; i++) {
        const uint word = words[patches[i]];
        if (!word)
            continue;
        __global const int *member = members + 3 * patches[i];
        const Shape shape = shape_of(word, member, masks[i], complete);
        const float step_u = shape.width > 1 ? 1.0f / (float)(shape.width - 1) : 0.0f;
        const float step_v = shape.height > 1 ? 1.0f / (float)(shape.height - 1) : 0.0f;
        Part part[3];
        for (int k = 0; k < shape.size; k++) {
            const int t = member[k];
            __global const float *weight = weights + 8 * codes[t];
            const float along_u = shape.width > 1 ? step_u * ways[2 * t] : ways[2 * t];
            const float along_v = shape.height > 1 ? step_v * ways[2 * t + 1] : ways[2 * t + 1];
            part[k] =
                (Part){t, MAX(along_u, along_v), weight[0], weight[1], weight[2], weight[3], weight[4], weight[5]};
        }
        for (int y = 0; y < shape.height; y++) {
            const Row row = make_row(shape, y, step_u, step_v, atlas_width);
            const int2 columns = touched_columns(shape, y);
            const int samples = columns.y - columns.x;
            for (int k = 0; k < samples; k += 8) {
                const Samples8 s = sample_row(columns.x + k, &row, part, shape.size);
                const int to = at + k;
                if (to + 8 <= last) { // lanes beyond the row are written again by the next rows of this run
                    *(__global loose_int8 *)(triangle + to) = s.triangle;
                    *(__global loose_float8 *)(bary1 + to) = s.bary1;
                    *(__global loose_float8 *)(bary2 + to) = s.bary2;
                    *(__global loose_float8 *)(footprint + to) = s.footprint;
                    *(__global loose_int8 *)(texel + to) = s.texel;
                } else {
                    const int left = MIN(8, samples - k);
                    store_lanes(s.triangle, triangle + to, left);
                    store_lanes(as_int8(s.bary1), (__global int *)bary1 + to, left);
                    store_lanes(as_int8(s.bary2), (__global int *)bary2 + to, left);
                    store_lanes(as_int8(s.footprint), (__global int *)footprint + to, left);
                    store_lanes(s.texel, texel + to, left);
                }
            }
            at += samples;
        }
    }
}
