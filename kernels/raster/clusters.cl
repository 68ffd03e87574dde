// Clusters: runs of CLUSTER triangles in file order, with their boxes, and their positions in groups of 8.
#include "common/elementary.cl"
#include "raster/camera.cl"
#include "raster/chunks.cl"
#include "raster/runs.cl"

#define BLOCK 8
#define SIZE_OF(a) MAX(a, -(a))
#define LARGEST 1e18f // clip-space positions of such points do not overflow

// A group holds 8 triangles as 9 x float8: x, y, z of corner 0, then 1, then 2; and their flags, 4 bits each. Lanes
// beyond the last triangle repeat one of its corners, and so have no area. A box is low.xyz and high.xyz in .s012 and
// .s456; .s3 is 0, or 1 where a position is not finite or beyond LARGEST.
__kernel void build_clusters(const int triangles, const int clusters, __global const float *positions,
                             __global const int *indices, __global const uchar *flags, __global float *groups,
                             __global uint *group_flags, __global float8 *boxes)
{
    const int cluster = get_global_id(0);
    if (cluster >= clusters)
        return;
    float3 low = INFINITY, high = -INFINITY;
    float wrong = 0.0f;
    uint packed = 0;
    for (int i = 0; i < CLUSTER; i++) {
        const int slot = cluster * CLUSTER + i;
        const int triangle = MIN(slot, triangles - 1);
        __global float *lane = groups + (size_t)(slot / 8) * 72 + slot % 8;
        for (int corner = 0; corner < 3; corner++) {
            const int vertex = indices[3 * (size_t)triangle + (slot < triangles ? corner : 0)];
            __global const float *at = positions + 3 * (size_t)vertex;
            const float3 p = (float3)(at[0], at[1], at[2]);
            lane[24 * corner] = p.x;
            lane[24 * corner + 8] = p.y;
            lane[24 * corner + 16] = p.z;
            low = MIN(p, low);
            high = MAX(p, high);
            const float3 size = MAX(p, -p);
            if (!(size.x <= LARGEST && size.y <= LARGEST && size.z <= LARGEST))
                wrong = 1.0f;
        }
        packed |= (uint)flags[triangle] << 4 * (slot % 8);
        if (slot % 8 == 7) {
            group_flags[slot / 8] = packed;
            packed = 0;
        }
    }
    boxes[cluster] = (float8)(low, wrong, high, 0.0f);
}

#define ROOM 64 // sub-pixels: more than rounding moves a corner's projection inside an image

// The last pixel whose centre is not beyond a position in sub-pixels from the image's centre, kept near the image.
INLINE int pixel_before(const float position, const int size)
{
    const float pixel = (position - SUBPIXELS / 2) / SUBPIXELS + 0.5f * size, capped = MIN(pixel, size + 2.0f);
    return (int)(MAX(capped, -2.0f) + 3.0f) - 3;
}

// Whether a box lies wholly outside plane . (p - eye, 1) >= 0, with room for rounding.
INLINE int beyond(const float4 plane, const float3 centre, const float3 extent)
{
    const float3 n = MAX(plane.xyz, -plane.xyz);
    const float near_corner = dot3(plane.xyz, centre) + plane.w + dot3(n, extent);
    return near_corner < -1e-5f * (dot3(n, MAX(centre, -centre) + extent) + MAX(plane.w, -plane.w));
}

INLINE int in_frustum(const float8 box, const float4 eye, const float16 rows, const int width, const int height)
{
    const float3 low = box.s012 - eye.xyz, high = box.s456 - eye.xyz;
    const float3 centre = 0.5f * low + 0.5f * high, extent = 0.5f * high - 0.5f * low;
    const float4 x = rows.s0123 / (0.5f * SUBPIXELS * width), y = rows.s4567 / (0.5f * SUBPIXELS * height);
    const float4 z = rows.s89ab, w = rows.scdef;
    return !(beyond(w - x, centre, extent) | beyond(w + x, centre, extent) | beyond(w - y, centre, extent) |
             beyond(w + y, centre, extent) | beyond(w - z, centre, extent) | beyond(z, centre, extent));
}

// Whether a box covers no pixel's centre, or lies behind what is drawn at all that it can cover: `blocks` and `tiles`
// hold the farthest depth of each 8 x 8 block and of each tile. A box that reaches in front of the near plane, or whose
// distance float32 may get wrong by more than 1e-5, is taken for visible.
INLINE int hidden(const float8 box, const float4 eye, const float16 rows, const int width, const int height,
                  const int tiles_x, __global const float *blocks, __global const float *tiles)
{
    const float8 x = (float8)(box.s0404, box.s0404) - eye.x, y = (float8)(box.s1155, box.s1155) - eye.y;
    const float8 z = (float8)(box.s2222, box.s6666) - eye.z; // of the corners
    const float8 along_x = rows.sc * x, along_y = rows.sd * y, along_z = rows.se * z;
    const float8 w = ((along_x + along_y) + along_z) + rows.sf;
    const float8 terms = (SIZE_OF(along_x) + SIZE_OF(along_y)) + SIZE_OF(along_z);
    const float8 depth = ((rows.s8 * x + rows.s9 * y) + rows.sa * z) + rows.sb;
    if (bits_of((w > depth) & (w > 0.1f * terms)) != 255)
        return 0;
    const float8 inverse = 1.0f / w;
    const float8 column = (((rows.s0 * x + rows.s1 * y) + rows.s2 * z) + rows.s3) * inverse;
    const float8 row = (((rows.s4 * x + rows.s5 * y) + rows.s6 * z) + rows.s7) * inverse;
    const float left = smallest_of(column), right = -smallest_of(-column);
    const float top = smallest_of(row), bottom = -smallest_of(-row);
    const float nearest = -smallest_of(-depth * inverse) * (1.0f + 1e-5f); // room for rounding
    const int x0 = pixel_before(left - ROOM, width) + 1, x1 = pixel_before(right + ROOM, width);
    const int y0 = pixel_before(top - ROOM, height) + 1, y1 = pixel_before(bottom + ROOM, height);
    if (x0 > x1 || y0 > y1)
        return 1;
    const int fine = x1 - x0 < 16 * BLOCK && y1 - y0 < 16 * BLOCK;
    const int side = fine ? BLOCK : TILE, pitch = fine ? tiles_x * (TILE / BLOCK) : tiles_x;
    __global const float *farthest = fine ? blocks : tiles;
    for (int y = MAX(y0, 0) / side; y <= MIN(y1, height - 1) / side; y++)
        for (int x = MAX(x0, 0) / side; x <= MIN(x1, width - 1) / side; x++)
            if (nearest >= farthest[y * pitch + x])
                return 0;
    return 1;
}

// The clusters that may lie in the frustum, ascending: those last seen at most `max_age` draws ago in `recent`, the
// others in `others`. One item looks at one chunk of all clusters, lists what it finds from the chunk's first place on,
// and notes how many. Where it does not cull, all are recent.
__kernel void choose_clusters(const int chunks, const int clusters, const float4 eye, const float16 rows,
                              const int width, const int height, __global const float8 *boxes, const int culls,
                              __global const int *last_seen, const int now, const int max_age, __global int *recent,
                              __global int *recent_counts, __global int *others, __global int *other_counts)
{
    const int chunk = get_global_id(0);
    if (chunk >= chunks)
        return;
    const int first = chunk_start(clusters, chunk, chunks);
    const int end = chunk_start(clusters, chunk + 1, chunks);
    int seen = 0, unseen = 0;
    for (int cluster = first; cluster < end; cluster++) {
        if (culls && !in_frustum(boxes[cluster], eye, rows, width, height))
            continue;
        if (!culls || now - last_seen[cluster] <= max_age)
            recent[first + seen++] = cluster;
        else
            others[first + unseen++] = cluster;
    }
    recent_counts[chunk] = seen;
    other_counts[chunk] = unseen;
}

// Strike from a list as `choose_clusters` makes it what the picture hides.
__kernel void cull_occluded(const int chunks, const int clusters, const float4 eye, const float16 rows, const int width,
                            const int height, __global const float8 *boxes, const int tiles_x,
                            __global const float *blocks, __global const float *tiles, __global int *listed,
                            __global int *counts)
{
    const int chunk = get_global_id(0);
    if (chunk >= chunks)
        return;
    const int first = chunk_start(clusters, chunk, chunks);
    const int end = first + counts[chunk];
    int kept = 0;
    for (int i = first; i < end; i++) {
        const int cluster = listed[i];
        if (!hidden(boxes[cluster], eye, rows, width, height, tiles_x, blocks, tiles))
            listed[first + kept++] = cluster;
    }
    counts[chunk] = kept;
}

// Note which clusters a picture shows, from every eighth row, in turn: what is missed costs time only. Items that note
// the same cluster store the same value, whole, so it does not matter which is last, and nobody reads it meanwhile.
__kernel void note_seen(const int height, const int width, __global const int *triangles, const int now,
                        __global int *last_seen)
{
    const int y = get_global_id(0) * 8 + now % 8;
    if (y >= height)
        return;
    __global const int *row = triangles + (size_t)y * width;
    for (int x = 0; x < width; x += 8) {
        if (x > 0 && x + 8 <= width && !begins_run(row + x))
            continue;
        int before = -1;
        for (int i = x; i < MIN(x + 8, width); i++) {
            if (row[i] != before && row[i] >= 0)
                last_seen[row[i] / CLUSTER] = now;
            before = row[i];
        }
    }
}
