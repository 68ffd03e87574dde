// Triangle set-up: transform, near clip, snapping, culling; one work-item per chunk of the visible clusters.
// Triangles are taken 8 at a time; those that cross the near plane or leave the guard band are clipped one by one.
#include "raster/chunks.cl"
#include "raster/record.cl"

#pragma OPENCL EXTENSION cl_khr_fp64 : enable

#define DOUBLE_SIDED 1
#define MASKED 2
#define BLOCK 8
#define ROUND 12582912.0f // 1.5 * 2^23: adding it leaves the nearest integer in a float's low bits

typedef struct {
    int width, height, tiles_x, capacity;
    __global int *records;          // of this chunk
    __global int *counts;           // records per tile, of this chunk
    int written, entries;           // records, and the tiles that they touch, added up
    int resumes;                    // whether farthest[] is filled
    __global const float *farthest; // drawn depth of each 8 x 8 block
} Output;

INLINE int any8(const int8 mask)
{
    const int4 four = mask.lo | mask.hi;
    const int2 two = four.lo | four.hi;
    return (two.x | two.y) != 0;
}

// Whether a box of few pixels lies behind what is drawn.
INLINE int hidden(const Output *out, const int left, const int top, const int right, const int bottom,
                  const float nearest)
{
    if (right - left > 4 * BLOCK || bottom - top > 4 * BLOCK)
        return 0;
    for (int y = top / BLOCK; y <= bottom / BLOCK; y++)
        for (int x = left / BLOCK; x <= right / BLOCK; x++)
            if (nearest >= out->farthest[y * out->tiles_x * (TILE / BLOCK) + x])
                return 0;
    return 1;
}

// Add one record, unless it is culled or covers no pixel centre's row or column. Beyond the capacity it is only
// counted.
INLINE void add_record(Output *out, const int2 a, int2 b, int2 c, const float da, float db, float dc,
                       const int triangle, const int flags)
{
    const int2 ab = b - a, ac = c - a;
    const long area = (long)ab.x * ac.y - (long)ab.y * ac.x;
    if (area == 0 || (area > 0 && !(flags & DOUBLE_SIDED)))
        return;
    if (area < 0) { // counter-clockwise on screen: a front face
        const int2 corner = b;
        b = c;
        c = corner;
        const float depth = db;
        db = dc;
        dc = depth;
    }
    const int left = MAX(first_pixel(least(a.x, b.x, c.x)), 0);
    const int top = MAX(first_pixel(least(a.y, b.y, c.y)), 0);
    const int right = MIN(last_pixel(most(a.x, b.x, c.x)), out->width - 1);
    const int bottom = MIN(last_pixel(most(a.y, b.y, c.y)), out->height - 1);
    if (left > right || top > bottom)
        return;
    if (out->resumes && hidden(out, left, top, right, bottom, MAX(da, MAX(db, dc))))
        return;
    const int4 tiles = (int4)(left / TILE, top / TILE, right / TILE, bottom / TILE);
    for (int y = tiles.y; y <= tiles.w; y++)
        for (int x = tiles.x; x <= tiles.z; x++)
            out->counts[y * out->tiles_x + x]++;
    out->entries += (tiles.z - tiles.x + 1) * (tiles.w - tiles.y + 1);
    if (out->written < out->capacity) {
        __global int *record = out->records + (size_t)out->written * RECORD;
        *(__global loose_int8 *)record = (int8)(a, b, c, as_int(da), as_int(db));
        *(__global loose_int4 *)(record + 8) =
            (int4)(as_int(dc), triangle | (flags & MASKED ? MASK_BIT : 0), left | top << 16, right | bottom << 16);
    }
    out->written++;
}

// A polygon's corner in clip space; `original` is the triangle's corner it is, or -1 for one made by clipping.
typedef struct {
    double4 p;
    int original;
} Corner;

// Distance to clipping plane 0 (near) to 4 (right, left, bottom, top of the guard band); inside where >= 0.
INLINE double plane_distance(const double4 p, const int plane)
{
    switch (plane) {
    case 0:
        return p.w - p.z;
    case 1:
        return GUARD * p.w - p.x;
    case 2:
        return GUARD * p.w + p.x;
    case 3:
        return GUARD * p.w - p.y;
    default:
        return GUARD * p.w + p.y;
    }
}

// Sutherland-Hodgman against one plane. New corners are interpolated from the inside corner, so that both triangles
// at an edge get the same point.
INLINE int clip_polygon(const Corner *in, const int count, const int plane, Corner *out)
{
    int kept = 0;
    for (int i = 0; i < count; i++) {
        const Corner a = in[i], b = in[i + 1 < count ? i + 1 : 0];
        const double at_a = plane_distance(a.p, plane), at_b = plane_distance(b.p, plane);
        if (at_a >= 0.0)
            out[kept++] = a;
        if ((at_a >= 0.0) != (at_b >= 0.0)) {
            const double4 from = at_a >= 0.0 ? a.p : b.p, to = at_a >= 0.0 ? b.p : a.p;
            const double inside = at_a >= 0.0 ? at_a : at_b, outside = at_a >= 0.0 ? at_b : at_a;
            out[kept].p = from + (to - from) * (inside / (inside - outside));
            out[kept++].original = -1;
        }
    }
    return kept;
}

// Clip a triangle (clip-space corners p; snapped positions and depths of its own corners) and add its pieces as a fan.
INLINE void add_clipped(Output *out, const float4 *p, const int2 *snapped, const float *depth, const int2 middle,
                        const int triangle, const int flags)
{
    Corner first[8], second[8];
    UNROLL
    for (int i = 0; i < 3; i++) {
        first[i].p = convert_double4(p[i]);
        first[i].original = i;
    }
    int count = clip_polygon(first, 3, 0, second);
    count = clip_polygon(second, count, 1, first);
    count = clip_polygon(first, count, 2, second);
    count = clip_polygon(second, count, 3, first);
    count = clip_polygon(first, count, 4, second);
    int2 xy[8];
    float d[8];
    for (int i = 0; i < count; i++) {
        const double4 q = second[i].p;
        const int own = second[i].original;
        xy[i] = own >= 0 ? snapped[own] : convert_int2_sat(rint(q.xy / q.w)) + middle;
        d[i] = own >= 0 ? depth[own] : (float)(q.z / q.w);
    }
    for (int i = 2; i < count; i++)
        add_record(out, xy[0], xy[i - 1], xy[i], d[0], d[i - 1], d[i], triangle, flags);
}

// Whether one of the samples of a box of up to 2 x 2 pixels lies inside: edges a + {0, 1} along x and y.
INLINE int8 edge_inside(const uint8 steps_x, const uint8 steps_y, const uint8 at, int8 *right, int8 *below, int8 *both)
{
    const int8 sx = as_int8(steps_x), sy = as_int8(steps_y);
    const uint8 bias = ((sx > 0) | ((sx == 0) & (sy > 0))) ? (uint8)0 : (uint8)1;
    const uint8 e = at - bias;
    *right |= as_int8(e + steps_x * SUBPIXELS);
    *below |= as_int8(e + steps_y * SUBPIXELS);
    *both |= as_int8(e + (steps_x + steps_y) * SUBPIXELS);
    return as_int8(e);
}

// Lanes to keep of the good ones of 8 triangles with snapped corners x, y: those that face the viewer and may cover a
// sample. Exact for boxes of up to 2 x 2 pixels; unsigned arithmetic, because lanes to ignore may lie anywhere and
// their sums overflow.
INLINE int8 cull_triangles(const int8 *x, const int8 *y, const int8 good, const int8 two_sided, const int width,
                           const int height)
{
    const int8 left = MIN(x[0], MIN(x[1], x[2])), right = MAX(x[0], MAX(x[1], x[2]));
    const int8 top = MIN(y[0], MIN(y[1], y[2])), bottom = MAX(y[0], MAX(y[1], y[2]));
    const int8 begin_x = as_int8(as_uint8(left) + 127) >> 8, first_x = MAX(begin_x, 0);
    const int8 begin_y = as_int8(as_uint8(top) + 127) >> 8, first_y = MAX(begin_y, 0);
    const int8 end_x = as_int8(as_uint8(right) - 128) >> 8, last_x = MIN(end_x, width - 1);
    const int8 end_y = as_int8(as_uint8(bottom) - 128) >> 8, last_y = MIN(end_y, height - 1);
    int8 keep = good ? ((first_x <= last_x) & (first_y <= last_y)) : (int8)0;
    if (!any8(keep))
        return keep;
    const uint8 ax = as_uint8(x[0]), bx = as_uint8(x[1]), cx = as_uint8(x[2]);
    const uint8 ay = as_uint8(y[0]), by = as_uint8(y[1]), cy = as_uint8(y[2]);
    const uint8 abx = bx - ax, bcx = cx - bx, cax = ax - cx;
    const uint8 aby = by - ay, bcy = cy - by, cay = ay - cy;
    const int8 area = as_int8(aby * cax - abx * cay);
    const int8 wide = as_int8(as_uint8(right) - as_uint8(left)), high = as_int8(as_uint8(bottom) - as_uint8(top));
    const int8 small = (wide < (1 << 14)) & (high < (1 << 14));
    keep &= ~small | (area < 0) | (two_sided & (area > 0));
    const int8 tiny = small & (last_x - first_x < 2) & (last_y - first_y < 2);
    if (!any8(keep & tiny))
        return keep;
    const uint8 turn = (area > 0) ? (uint8)1 : (uint8)(-1); // edges run so that the inside is positive
    const uint8 px = as_uint8(first_x) * SUBPIXELS + 128, py = as_uint8(first_y) * SUBPIXELS + 128;
    int8 here = 0, beside = 0, below = 0, both = 0;
    here |= edge_inside(-aby * turn, abx * turn, (abx * (py - ay) - aby * (px - ax)) * turn, &beside, &below, &both);
    here |= edge_inside(-bcy * turn, bcx * turn, (bcx * (py - by) - bcy * (px - bx)) * turn, &beside, &below, &both);
    here |= edge_inside(-cay * turn, cax * turn, (cax * (py - cy) - cay * (px - cx)) * turn, &beside, &below, &both);
    return keep & (~tiny | (here >= 0) | (beside >= 0) | (below >= 0) | (both >= 0));
}

// The 8 triangles of a group.
INLINE void add_group(Output *out, __global const float8 *group, const uint group_flags, const int triangle,
                      const float4 eye, const float16 rows)
{
    const int2 middle = (int2)(out->width * (SUBPIXELS / 2), out->height * (SUBPIXELS / 2));
    float8 cx[3], cy[3], cz[3], cw[3], depth[3];
    int8 x[3], y[3], good = -1, out_near = -1, out_left = -1, out_right = -1, out_top = -1, out_bottom = -1,
                     out_far = -1;
    UNROLL
    for (int i = 0; i < 3; i++) {
        const float8 dx = group[3 * i] - eye.s0;
        const float8 dy = group[3 * i + 1] - eye.s1;
        const float8 dz = group[3 * i + 2] - eye.s2;
        cx[i] = ((rows.s0 * dx + rows.s1 * dy) + rows.s2 * dz) + rows.s3;
        cy[i] = ((rows.s4 * dx + rows.s5 * dy) + rows.s6 * dz) + rows.s7;
        cz[i] = ((rows.s8 * dx + rows.s9 * dy) + rows.sa * dz) + rows.sb;
        cw[i] = ((rows.sc * dx + rows.sd * dy) + rows.se * dz) + rows.sf;
        const float8 inverse = 1.0f / cw[i], sx = cx[i] * inverse, sy = cy[i] * inverse;
        x[i] = as_int8(as_uint8(sx + ROUND) + (uint)(middle.x - as_int(ROUND)));
        y[i] = as_int8(as_uint8(sy + ROUND) + (uint)(middle.y - as_int(ROUND)));
        depth[i] = cz[i] * inverse;
        good &= (cz[i] <= cw[i]) & (sx <= GUARD) & (sx >= -GUARD) & (sy <= GUARD) & (sy >= -GUARD);
    }
    const int8 flags = (as_int8((uint8)group_flags >> (uint8)(0, 4, 8, 12, 16, 20, 24, 28))) & 15;
    int8 keep = cull_triangles(x, y, good, (flags & DOUBLE_SIDED) != 0, out->width, out->height);
    if (any8(~good)) {
        UNROLL
        for (int i = 0; i < 3; i++) {
            const float8 edge_x = cw[i] * (float)middle.x, edge_y = cw[i] * (float)middle.y;
            out_near &= cz[i] > cw[i];
            out_far &= cz[i] <= 0.0f;
            out_left &= cx[i] < -edge_x;
            out_right &= cx[i] > edge_x;
            out_top &= cy[i] < -edge_y;
            out_bottom &= cy[i] > edge_y;
        }
        keep |= ~good & ~(out_near | out_far | out_left | out_right | out_top | out_bottom);
    }
    if (!any8(keep))
        return;
    for (int lane = 0; lane < 8; lane++) {
        if (!((const int *)&keep)[lane])
            continue;
        int2 xy[3];
        float d[3];
        UNROLL
        for (int i = 0; i < 3; i++) {
            xy[i] = (int2)(((const int *)&x[i])[lane], ((const int *)&y[i])[lane]);
            d[i] = ((const float *)&depth[i])[lane];
        }
        if (((const int *)&good)[lane]) {
            add_record(out, xy[0], xy[1], xy[2], d[0], d[1], d[2], triangle + lane, ((const int *)&flags)[lane]);
        } else {
            float4 corners[3];
            UNROLL
            for (int i = 0; i < 3; i++) {
                corners[i] = (float4)(((const float *)&cx[i])[lane], ((const float *)&cy[i])[lane],
                                      ((const float *)&cz[i])[lane], ((const float *)&cw[i])[lane]);
            }
            add_clipped(out, corners, xy, d, middle, triangle + lane, ((const int *)&flags)[lane]);
        }
    }
}

// Sort the chunk's records into tiles: the numbers of a tile's, in triangle order, are entries[bins[tile].x] to
// entries[bins[tile].y], of which the chunk's begin at `first`.
INLINE void fill_bins(const Output *out, const int tiles, const int chunks, const int chunk, const int first,
                      __global int *entries, __global int2 *bins)
{
    int end = first;
    for (int tile = 0; tile < tiles; tile++) {
        const int begin = end;
        end += out->counts[tile];
        bins[(size_t)tile * chunks + chunk] = (int2)(begin, end);
        out->counts[tile] = begin;
    }
    const int number = chunk * out->capacity;
    for (int i = 0; i < out->written; i++) {
        const int4 box = record_pixels(*(__global const int2 *)(out->records + (size_t)i * RECORD + 10));
        for (int y = box.y / TILE; y <= box.w / TILE; y++)
            for (int x = box.x / TILE; x <= box.z / TILE; x++)
                entries[out->counts[y * out->tiles_x + x]++] = number + i;
    }
}

// Records of a chunk of the listed clusters (see `choose_clusters`), in triangle order, sorted into tiles.
// `needed` (chunks) is how many records and entries there are; beyond the capacities, a chunk's bins are empty.
// bins (tiles, chunks) is where the numbers of a tile's records lie among `entries`; counts (chunks, tiles) is scratch.
__kernel void set_up(const int chunks, const int clusters, __global const int *listed,
                     __global const int *listed_counts, __global const float8 *groups, __global const uint *flags,
                     const float4 eye, const float16 rows, const int width, const int height, const int tiles_x,
                     const int tiles, const int resumes, __global const float *farthest, const int capacity,
                     const int entry_capacity, __global int *records, __global int *entries, __global int *counts,
                     __global int2 *bins, __global int2 *needed)
{
    const int chunk = get_global_id(0);
    if (chunk >= chunks)
        return;
    Output out = {
        width, height, tiles_x, capacity, records + (size_t)chunk * capacity * RECORD, counts + (size_t)chunk * tiles,
        0,     0,      resumes, farthest};
    for (int tile = 0; tile < tiles; tile++)
        out.counts[tile] = 0;
    int total = 0;
    for (int part = 0; part < chunks; part++)
        total += listed_counts[part];
    int at = chunk_start(total, chunk, chunks), left = chunk_start(total, chunk + 1, chunks) - at, part = 0;
    for (; left > 0; left--, at++) {
        while (at >= listed_counts[part])
            at -= listed_counts[part++];
        const int cluster = listed[chunk_start(clusters, part, chunks) + at];
        for (int k = 0; k < CLUSTER; k += 8) {
            const int triangle = cluster * CLUSTER + k;
            add_group(&out, groups + (size_t)(triangle / 8) * 9, flags[triangle / 8], triangle, eye, rows);
        }
    }
    needed[chunk] = (int2)(out.written, out.entries);
    if (out.written <= capacity && out.entries <= entry_capacity)
        fill_bins(&out, tiles, chunks, chunk, chunk * entry_capacity, entries, bins);
    else
        for (int tile = 0; tile < tiles; tile++)
            bins[(size_t)tile * chunks + chunk] = 0;
}
