// Triangle set-up: transform, near clip, snapping, culling; one work-item per chunk of the visible clusters.
// Triangles are taken 8 at a time; those that cross the near plane or leave the guard band are clipped one by one.
#include "raster/record.cl"

#define DOUBLE_SIDED 1
#define MASKED 2
#define ROUND 12582912.0f // 1.5 * 2^23: adding it leaves the nearest integer in a float's low bits

typedef struct {
    int width, height, tiles_x, capacity;
    __global int *records; // of this chunk
    __global int *counts;  // records per tile, of this chunk
    int written;
} Output;

inline int any8(const int8 mask)
{
    const int4 four = mask.lo | mask.hi;
    const int2 two = four.lo | four.hi;
    return (two.x | two.y) != 0;
}

inline float8 smallest(const float8 a, const float8 b) { return (a < b) ? a : b; }
inline float8 largest(const float8 a, const float8 b) { return (a > b) ? a : b; }

// Add one record, unless it is culled or covers no pixel centre's row or column. Beyond the capacity it is only counted.
inline void add_record(Output *out, const int2 a, int2 b, int2 c, const float da, float db, float dc,
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
    const int left = max(first_pixel(least(a.x, b.x, c.x)), 0);
    const int top = max(first_pixel(least(a.y, b.y, c.y)), 0);
    const int right = min(last_pixel(most(a.x, b.x, c.x)), out->width - 1);
    const int bottom = min(last_pixel(most(a.y, b.y, c.y)), out->height - 1);
    if (left > right || top > bottom)
        return;
    for (int y = top / TILE; y <= bottom / TILE; y++)
        for (int x = left / TILE; x <= right / TILE; x++)
            out->counts[y * out->tiles_x + x]++;
    if (out->written < out->capacity) {
        __global int *record = out->records + (size_t)out->written * RECORD;
        vstore8((int8)(a, b, c, as_int(da), as_int(db)), 0, record);
        vstore2((int2)(as_int(dc), triangle | (flags & MASKED ? MASK_BIT : 0)), 4, record);
    }
    out->written++;
}

// A polygon's corner in clip space; `original` is the triangle's corner it is, or -1 for one made by clipping.
typedef struct {
    double4 p;
    int original;
} Corner;

// Distance to clipping plane 0 (near) to 4 (right, left, bottom, top of the guard band); inside where >= 0.
inline double plane_distance(const double4 p, const int plane)
{
    switch (plane) {
    case 0: return p.w - p.z;
    case 1: return GUARD * p.w - p.x;
    case 2: return GUARD * p.w + p.x;
    case 3: return GUARD * p.w - p.y;
    default: return GUARD * p.w + p.y;
    }
}

// Sutherland-Hodgman against one plane. New corners are interpolated from the inside corner, so that both triangles
// at an edge get the same point.
inline int clip_polygon(const Corner *in, const int count, const int plane, Corner *out)
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
inline void add_clipped(Output *out, const float4 *p, const int2 *snapped, const float *depth, const int2 middle,
                        const int triangle, const int flags)
{
    Corner first[8], second[8];
    for (int i = 0; i < 3; i++) {
        const float4 difference = p[i] - p[i];
        if (difference.x != 0.0f || difference.y != 0.0f || difference.z != 0.0f || difference.w != 0.0f)
            return; // overflowed: farther away than float32 reaches
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
inline int8 edge_inside(const uint8 steps_x, const uint8 steps_y, const uint8 at, int8 *right, int8 *below, int8 *both)
{
    const int8 sx = as_int8(steps_x), sy = as_int8(steps_y);
    const uint8 bias = ((sx > 0) | ((sx == 0) & (sy > 0))) ? (uint8)0 : (uint8)1;
    const uint8 e = at - bias;
    *right |= as_int8(e + steps_x * SUBPIXELS);
    *below |= as_int8(e + steps_y * SUBPIXELS);
    *both |= as_int8(e + (steps_x + steps_y) * SUBPIXELS);
    return as_int8(e);
}

// Lanes to keep of 8 triangles with snapped corners x, y: those that face the viewer and may cover a sample. Exact for
// boxes of up to 2 x 2 pixels; unsigned arithmetic, because lanes to ignore may overflow.
inline int8 worth_drawing(const int8 *x, const int8 *y, const int8 two_sided, const int width, const int height)
{
    const int8 left = min(x[0], min(x[1], x[2])), right = max(x[0], max(x[1], x[2]));
    const int8 top = min(y[0], min(y[1], y[2])), bottom = max(y[0], max(y[1], y[2]));
    const int8 first_x = max((left + 127) >> 8, 0), last_x = min((right - 128) >> 8, width - 1);
    const int8 first_y = max((top + 127) >> 8, 0), last_y = min((bottom - 128) >> 8, height - 1);
    int8 keep = (first_x <= last_x) & (first_y <= last_y);
    if (!any8(keep))
        return keep;
    const uint8 abx = as_uint8(x[1] - x[0]), aby = as_uint8(y[1] - y[0]);
    const uint8 bcx = as_uint8(x[2] - x[1]), bcy = as_uint8(y[2] - y[1]);
    const uint8 cax = as_uint8(x[0] - x[2]), cay = as_uint8(y[0] - y[2]);
    const int8 area = as_int8(aby * cax - abx * cay);
    const int8 small = (right - left < (1 << 14)) & (bottom - top < (1 << 14));
    keep &= ~small | (area < 0) | (two_sided & (area > 0));
    const int8 tiny = small & (last_x - first_x < 2) & (last_y - first_y < 2);
    if (!any8(keep & tiny))
        return keep;
    const uint8 turn = (area > 0) ? (uint8)1 : (uint8)(-1); // edges run so that the inside is positive
    const uint8 px = as_uint8(first_x * SUBPIXELS + 128), py = as_uint8(first_y * SUBPIXELS + 128);
    int8 here = 0, beside = 0, below = 0, both = 0;
    here |= edge_inside(-aby * turn, abx * turn, (abx * (py - as_uint8(y[0])) - aby * (px - as_uint8(x[0]))) * turn,
                        &beside, &below, &both);
    here |= edge_inside(-bcy * turn, bcx * turn, (bcx * (py - as_uint8(y[1])) - bcy * (px - as_uint8(x[1]))) * turn,
                        &beside, &below, &both);
    here |= edge_inside(-cay * turn, cax * turn, (cax * (py - as_uint8(y[2])) - cay * (px - as_uint8(x[2]))) * turn,
                        &beside, &below, &both);
    return keep & (~tiny | (here >= 0) | (beside >= 0) | (below >= 0) | (both >= 0));
}

// The 8 triangles of a group.
inline void add_group(Output *out, __global const float *group, __global const uchar *group_flags, const int triangle,
                      const float8 eye, const float16 rows)
{
    const int2 middle = (int2)(out->width * (SUBPIXELS / 2), out->height * (SUBPIXELS / 2));
    float8 cx[3], cy[3], cz[3], cw[3], depth[3];
    int8 x[3], y[3], good = -1, out_near = -1, out_left = -1, out_right = -1, out_top = -1, out_bottom = -1,
                     out_far = -1;
    for (int i = 0; i < 3; i++) {
        const float8 dx = (vload8(3 * i, group) - eye.s0) - eye.s4;
        const float8 dy = (vload8(3 * i + 1, group) - eye.s1) - eye.s5;
        const float8 dz = (vload8(3 * i + 2, group) - eye.s2) - eye.s6;
        cx[i] = ((rows.s0 * dx + rows.s1 * dy) + rows.s2 * dz) + rows.s3;
        cy[i] = ((rows.s4 * dx + rows.s5 * dy) + rows.s6 * dz) + rows.s7;
        cz[i] = ((rows.s8 * dx + rows.s9 * dy) + rows.sa * dz) + rows.sb;
        cw[i] = ((rows.sc * dx + rows.sd * dy) + rows.se * dz) + rows.sf;
        const int8 inside = (cz[i] <= cw[i]) & (fabs(cx[i]) <= GUARD * cw[i]) & (fabs(cy[i]) <= GUARD * cw[i]);
        const float8 inverse = 1.0f / ((cw[i] > 0.0f) ? cw[i] : (float8)1.0f);
        x[i] = as_int8((inside ? cx[i] * inverse : (float8)0.0f) + ROUND) - as_int(ROUND) + middle.x;
        y[i] = as_int8((inside ? cy[i] * inverse : (float8)0.0f) + ROUND) - as_int(ROUND) + middle.y;
        depth[i] = cz[i] * inverse;
        good &= inside;
    }
    const int8 flags = convert_int8(vload8(0, group_flags));
    int8 keep = good & worth_drawing(x, y, (flags & DOUBLE_SIDED) != 0, out->width, out->height);
    if (any8(~good)) {
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
    int kept[8], unclipped[8], lane_x[24], lane_y[24], lane_flags[8];
    float lane_depth[24];
    vstore8(keep, 0, kept);
    vstore8(good, 0, unclipped);
    vstore8(flags, 0, lane_flags);
    for (int i = 0; i < 3; i++) {
        vstore8(x[i], i, lane_x);
        vstore8(y[i], i, lane_y);
        vstore8(depth[i], i, lane_depth);
    }
    for (int lane = 0; lane < 8; lane++) {
        if (!kept[lane])
            continue;
        int2 xy[3];
        float d[3];
        for (int i = 0; i < 3; i++) {
            xy[i] = (int2)(lane_x[8 * i + lane], lane_y[8 * i + lane]);
            d[i] = lane_depth[8 * i + lane];
        }
        if (unclipped[lane]) {
            add_record(out, xy[0], xy[1], xy[2], d[0], d[1], d[2], triangle + lane, lane_flags[lane]);
        } else {
            float4 corners[3];
            for (int i = 0; i < 3; i++) {
                const float3 p = (float3)(group[24 * i + lane], group[24 * i + 8 + lane], group[24 * i + 16 + lane]);
                corners[i] = project(from_eye(p, eye), rows);
            }
            add_clipped(out, corners, xy, d, middle, triangle + lane, lane_flags[lane]);
        }
    }
}

// Records of a chunk of the listed clusters, in triangle order, and how many each tile gets from it.
// counts (chunks, tiles) is scratch; tile_counts (tiles, chunks) and written (chunks) are results.
__kernel void set_up(const int chunks, const int clusters, __global const int *list, __global const float *groups,
                     __global const uchar *flags, const float8 eye, const float16 rows, const int width,
                     const int height, const int tiles_x, const int tiles, const int capacity, __global int *records,
                     __global int *counts, __global int *tile_counts, __global int *written)
{
    const int chunk = get_global_id(0);
    if (chunk >= chunks)
        return;
    Output out = {width, height, tiles_x, capacity, records + (size_t)chunk * capacity * RECORD,
                  counts + (size_t)chunk * tiles, 0};
    for (int tile = 0; tile < tiles; tile++)
        out.counts[tile] = 0;
    const int end = (long)clusters * (chunk + 1) / chunks;
    for (int i = (long)clusters * chunk / chunks; i < end; i++)
        for (int k = 0; k < CLUSTER; k += 8) {
            const int triangle = list[i] * CLUSTER + k;
            add_group(&out, groups + (size_t)triangle * 9, flags + triangle, triangle, eye, rows);
        }
    for (int tile = 0; tile < tiles; tile++)
        tile_counts[(size_t)tile * chunks + chunk] = out.counts[tile];
    written[chunk] = out.written;
}

// Each tile's list of records, in triangle order: a chunk's part begins at offsets[tile * chunks + chunk].
__kernel void fill_bins(const int chunks, const int width, const int height, const int tiles_x, const int capacity,
                        __global const int *records, __global const int *written, __global int *offsets,
                        __global int *entries)
{
    const int chunk = get_global_id(0);
    if (chunk >= chunks)
        return;
    const int first = chunk * capacity, end = first + written[chunk];
    for (int i = first; i < end; i++) {
        const int4 box = record_pixels(records + (size_t)i * RECORD, width, height);
        for (int y = box.y / TILE; y <= box.w / TILE; y++)
            for (int x = box.x / TILE; x <= box.z / TILE; x++)
                entries[offsets[(size_t)(y * tiles_x + x) * chunks + chunk]++] = i;
    }
}
