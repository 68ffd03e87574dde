#include "common/types.cl"
#include "common/wide.cl"
#include "sas/layout.cl"

// The texels of blocks, as shading samples. u, v: position in the patch's unit square, with (0, 0) at the centre of the
// block's first texel and (1, 1) at that of its last.

// Columns [first, last) of row `row` that bilinear lookups inside the block's triangles of `mask` touch, for a block of
// `members` triangles and w x h texels. A lookup at x, y touches the columns and rows less than one texel away.
INLINE int2 touched_columns(int members, int mask, int w, int h, int row) {
    const int width = w - 1, height = GREATER(h - 1, 1);
    const int above = GREATER(row - 1, 0), below = LESSER(row + 1, height);
    if (members < 3) {
        const int past = (width * (height - above) + height - 1) / height;  // of the triangle at (0, 0)
        const int before = (width * (height - below) ) / height;            // of the one at (1, 1)
        const int first = (mask & 1) ? 0 : before;
        return (int2)(first, (mask & 2) ? w : LESSER(past, width) + 1);
    }
    int first = width, last = 0;
    if (mask & 1) {
        first = width * (height - below) / (2 * height);
        last = (width * (height + below) + 2 * height - 1) / (2 * height);
    }
    if (mask & 2) {
        first = LESSER(first, width * (height + above) / (2 * height));
        last = width;
    }
    if (mask & 4) {
        first = 0;
        last = GREATER(last, (width * (height - above) + 2 * height - 1) / (2 * height));
    }
    return (int2)(first, LESSER(last, width) + 1);
}

inline int members_of(int3 member) { return member.z >= 0 ? 3 : member.y >= 0 ? 2 : 1; }

// counts: samples of each run of patches; a mask of 7 in place of the patch's own where `complete`.
__kernel void count_samples(int count, int run, int runs, int complete, __global const int *patches,
                            __global const uchar *masks, __global const int *members, __global const uint *words,
                            __global int *counts) {
    const int r = get_global_id(0);
    if (r >= runs) return;
    int sum = 0;
    const int end = min(count, (r + 1) * run);
    for (int i = r * run; i < end; i++) {
        const uint word = words[patches[i]];
        if (!word) continue;
        const Block block = unpack_location(word);
        const int w = 1 << block.w, h = 1 << block.h, size = members_of(vload3(patches[i], members));
        const int mask = complete ? 7 : masks[i];
        if (size < 3 && mask >= 3 || mask == 7) {
            sum += w * h;
            continue;
        }
        for (int row = 0; row < h; row++) {
            const int2 columns = touched_columns(size, mask, w, h, row);
            sum += columns.y - columns.x;
        }
    }
    counts[r] = sum;
}

// A triangle's part of a block: barycentrics 1 and 2 as a + b u + c v.
typedef struct {
    int triangle;
    float footprint;
    float a1, b1, c1, a2, b2, c2;
} Part;

inline float3 role_weights(__global const float *weights, int role, int corner) {
    return vload3(3 * role + corner, weights);
}

inline Part make_part(int triangle, int code, Block block, __global const float *weights, __global const int *indices,
                      __global const float *positions) {
    const int role = code / 3, rotation = code - 3 * role;
    const float3 k0 = role_weights(weights, role, (3 - rotation) % 3);
    const float3 k1 = role_weights(weights, role, (4 - rotation) % 3);
    const float3 k2 = role_weights(weights, role, (5 - rotation) % 3);
    const float3 p0 = corner_position(positions, indices, triangle, 0);
    const float3 p1 = corner_position(positions, indices, triangle, 1) - p0;
    const float3 p2 = corner_position(positions, indices, triangle, 2) - p0;
    const float3 along_u = k1.y * p1 + k2.y * p2, along_v = k1.z * p1 + k2.z * p2;
    const float steps_u = (float)max((1 << block.w) - 1, 1), steps_v = (float)max((1 << block.h) - 1, 1);
    Part part;
    part.triangle = triangle;
    part.footprint = fmax(length(along_u) / steps_u, length(along_v) / steps_v);
    part.a1 = k1.x, part.b1 = k1.y, part.c1 = k1.z;
    part.a2 = k2.x, part.b2 = k2.y, part.c2 = k2.z;
    return part;
}

// A row of a block: texel of column 0; u = u0 + du * column, v likewise; a column belongs to the second part where
// second.x + second.y * column > 0, and to the third likewise.
typedef struct {
    int texel;
    float u0, du, v0, dv;
    int2 second, third;
} Row;

inline Row make_row(Block block, int members, int mask, int row, int atlas_width) {
    const int w = 1 << block.w, h = 1 << block.h;
    // u = (un0 + un1 * column) / ud, exactly; a side of one texel stands for the middle of the patch.
    const int ud = w > 1 ? w - 1 : 2, un0 = w > 1 ? 0 : 1, un1 = w > 1 ? 1 : 0;
    const int vd = h > 1 ? h - 1 : 2, vn = h > 1 ? row : 1;
    Row result;
    result.texel = (block.y + row) * atlas_width + block.x;
    result.u0 = (float)un0 / (float)ud;
    result.du = (float)un1 / (float)ud;
    result.v0 = (float)vn / (float)vd;
    result.dv = 0.0f;
    if (members == 1 && w == 1 && h == 1) {
        result.u0 = result.v0 = 1.0f / 3.0f;
    } else if (members == 1 && w == 1) {  // the middle of a triangle's row, or column, ends at the diagonal
        result.u0 = 0.5f - 0.5f * result.v0;
    } else if (members == 1 && h == 1) {
        result.v0 = 0.5f;
        result.dv = -0.5f * result.du;
    }
    // On a shared edge the first part owns, if it is in the set.
    const int tie = (mask & 1) ? 0 : 1;
    result.second = result.third = (int2)(0, 0);
    if (members == 2) result.second = (int2)(un0 * vd + vn * ud - ud * vd + tie, un1 * vd);
    if (members == 3) {
        result.second = (int2)(2 * un0 * vd - vn * ud - ud * vd + tie, 2 * un1 * vd);
        result.third = (int2)(ud * vd - vn * ud - 2 * un0 * vd + tie, -2 * un1 * vd);
    }
    return result;
}

// Eight samples of a row from `column` on, of which those beyond the row's end mean nothing.
typedef struct {
    int8 triangle, texel;
    float8 bary1, bary2, footprint;
} Samples8;

INLINE Samples8 sample_row(int column, const Row *row, const Part *part, int members) {
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

inline void store_lanes(int8 value, __global int *array, int count) {
    for (int k = 0; k < count; k++) array[k] = ((int *)&value)[k];
}

// codes: role and rotation per triangle. weights: (role, corner, 3) as in layout.py. The rest as in count_samples.
__kernel void emit_samples(int count, int run, int runs, int complete, __global const int *patches,
                           __global const uchar *masks, __global const int *members, __global const uint *words,
                           __global const uchar *codes, __global const float *weights, __global const int *indices,
                           __global const float *positions, int atlas_width, __global const int *counts,
                           __global const int *offsets, __global int *triangle, __global float *bary1, __global float *bary2,
                           __global float *footprint, __global int *texel) {
    const int r = get_global_id(0);
    if (r >= runs) return;
    int at = offsets[r];
    const int last = at + counts[r];
    const int end = min(count, (r + 1) * run);
    for (int i = r * run; i < end; i++) {
        const uint word = words[patches[i]];
        if (!word) continue;
        const Block block = unpack_location(word);
        const int w = 1 << block.w, h = 1 << block.h, mask = complete ? 7 : masks[i];
        const int3 member = vload3(patches[i], members);
        const int size = members_of(member);
        Part part[3];
        part[0] = make_part(member.x, codes[member.x], block, weights, indices, positions);
        if (size > 1) part[1] = make_part(member.y, codes[member.y], block, weights, indices, positions);
        if (size > 2) part[2] = make_part(member.z, codes[member.z], block, weights, indices, positions);
        for (int y = 0; y < h; y++) {
            const Row row = make_row(block, size, mask, y, atlas_width);
            const int2 columns = touched_columns(size, mask, w, h, y);
            const int samples = columns.y - columns.x;
            for (int k = 0; k < samples; k += 8) {
                const Samples8 s = sample_row(columns.x + k, &row, part, size);
                const int to = at + k;
                if (to + 8 <= last) {  // lanes beyond the row are written again by the next rows of this run
                    *(__global loose_int8 *)(triangle + to) = s.triangle;
                    *(__global loose_float8 *)(bary1 + to) = s.bary1;
                    *(__global loose_float8 *)(bary2 + to) = s.bary2;
                    *(__global loose_float8 *)(footprint + to) = s.footprint;
                    *(__global loose_int8 *)(texel + to) = s.texel;
                } else {
                    const int left = min(8, samples - k);
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
