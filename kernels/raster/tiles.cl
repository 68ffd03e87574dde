// Drawing: one work-item per tile walks the tile's records in triangle order, with a hierarchical Z of 8 x 8 blocks.
#include "raster/record.cl"

#define BLOCK 8
#define BLOCKS (TILE / BLOCK) // per tile's side
#define FAR_EDGE (1 << 30)    // beyond what an edge function can change by across a tile

// Half-plane of one edge from a to b, inside where >= 0: steps per pixel, and the value at a pixel's centre >> 8,
// which keeps the exact sign. Pixels on an edge belong to it if it is a top or a left one.
typedef struct {
    int along_x, along_y, at;
} Edge;

inline Edge edge_at(const int2 a, const int2 b, const int2 centre)
{
    Edge edge = {a.y - b.y, b.x - a.x, 0};
    const int owned = edge.along_x > 0 || (edge.along_x == 0 && edge.along_y > 0);
    const long value = (long)edge.along_x * (centre.x - a.x) + (long)edge.along_y * (centre.y - a.y) - !owned;
    edge.at = (int)clamp(value >> 8, (long)-FAR_EDGE, (long)FAR_EDGE);
    return edge;
}

inline float smallest_of(const float8 v)
{
    const float4 four = (v.lo < v.hi) ? v.lo : v.hi;
    const float2 two = (four.lo < four.hi) ? four.lo : four.hi;
    return two.x < two.y ? two.x : two.y;
}

// The depth plane through a record's corners.
typedef struct {
    double depth, along_x, along_y; // at the first corner; per sub-pixel
    int2 corner;
    float nearest, farthest;
} Plane;

inline Plane depth_plane(const int2 a, const int2 b, const int2 c, const float3 d)
{
    const int2 ab = b - a, ac = c - a;
    const double area = (double)((long)ab.x * ac.y - (long)ab.y * ac.x);
    const double db = (double)d.y - d.x, dc = (double)d.z - d.x;
    Plane plane;
    plane.depth = d.x;
    plane.along_x = (db * ac.y - dc * ab.y) / area;
    plane.along_y = (dc * ab.x - db * ac.x) / area;
    plane.corner = a;
    plane.nearest = max(d.x, max(d.y, d.z));
    plane.farthest = min(d.x, min(d.y, d.z));
    return plane;
}

// Draw one record into a tile whose first pixel is `origin`; depth and ids are stored block by block.
inline void draw_record(__global const int *record, const int2 origin, const int width, const int height, float *depth,
                        int *ids, float *farthest)
{
    const int2 a = (int2)(record[0], record[1]), b = (int2)(record[2], record[3]), c = (int2)(record[4], record[5]);
    const float3 d = (float3)(as_float(record[6]), as_float(record[7]), as_float(record[8]));
    const int4 box = record_pixels(record, width, height);
    const int left = max(box.x - origin.x, 0), right = min(box.z - origin.x, TILE - 1);
    const int top = max(box.y - origin.y, 0), bottom = min(box.w - origin.y, TILE - 1);
    const float8 lanes = (float8)(0, 1, 2, 3, 4, 5, 6, 7);
    const int8 steps = (int8)(0, 1, 2, 3, 4, 5, 6, 7);

    const Plane plane = depth_plane(a, b, c, d);
    if (left / BLOCK == right / BLOCK && top / BLOCK == bottom / BLOCK &&
        plane.nearest <= farthest[top / BLOCK * BLOCKS + left / BLOCK])
        return;
    const int2 centre = origin * SUBPIXELS + SUBPIXELS / 2;
    const Edge e0 = edge_at(a, b, centre), e1 = edge_at(b, c, centre), e2 = edge_at(c, a, centre);
    const int reach0 = 7 * (max(e0.along_x, 0) + max(e0.along_y, 0));
    const int reach1 = 7 * (max(e1.along_x, 0) + max(e1.along_y, 0));
    const int reach2 = 7 * (max(e2.along_x, 0) + max(e2.along_y, 0));
    const float slope_x = (float)(plane.along_x * SUBPIXELS), slope_y = (float)(plane.along_y * SUBPIXELS);

    for (int by = top / BLOCK; by <= bottom / BLOCK; by++)
        for (int bx = left / BLOCK; bx <= right / BLOCK; bx++) {
            const int block = by * BLOCKS + bx, px = bx * BLOCK, py = by * BLOCK;
            const float z0 = (float)(plane.depth + plane.along_x * (px * SUBPIXELS + centre.x - plane.corner.x) +
                                     plane.along_y * (py * SUBPIXELS + centre.y - plane.corner.y));
            const float reached = (z0 + (slope_y > 0 ? 7.0f : 0.0f) * slope_y) + (slope_x > 0 ? 7.0f : 0.0f) * slope_x;
            if (min(reached, plane.nearest) <= farthest[block])
                continue;
            const int at0 = e0.at + e0.along_x * px + e0.along_y * py;
            const int at1 = e1.at + e1.along_x * px + e1.along_y * py;
            const int at2 = e2.at + e2.along_x * px + e2.along_y * py;
            if (((at0 + reach0) | (at1 + reach1) | (at2 + reach2)) < 0)
                continue;
            const int first = max(top - py, 0), last = min(bottom - py, BLOCK - 1);
            int8 row0 = at0 + e0.along_y * first + e0.along_x * steps;
            int8 row1 = at1 + e1.along_y * first + e1.along_x * steps;
            int8 row2 = at2 + e2.along_y * first + e2.along_x * steps;
            for (int j = first; j <= last; j++) {
                float8 z = (z0 + j * slope_y) + lanes * slope_x;
                z = (z < plane.nearest) ? z : (float8)plane.nearest;
                z = (z > plane.farthest) ? z : (float8)plane.farthest;
                const float8 old = vload8(block * BLOCK + j, depth);
                const int8 draw = ((row0 | row1 | row2) >= 0) & (z > old);
                vstore8(draw ? z : old, block * BLOCK + j, depth);
                vstore8(draw ? (int8)record[9] : vload8(block * BLOCK + j, ids), block * BLOCK + j, ids);
                row0 += e0.along_y;
                row1 += e1.along_y;
                row2 += e2.along_y;
            }
            float8 low = vload8(block * BLOCK, depth);
            for (int j = 1; j < BLOCK; j++) {
                const float8 row = vload8(block * BLOCK + j, depth);
                low = (row < low) ? row : low;
            }
            farthest[block] = smallest_of(low);
        }
}

// The nearest triangle (-1: none) and its depth at each pixel; of equal depths the lowest triangle.
__kernel void draw_tiles(const int tiles, const int tiles_x, const int width, const int height, const int chunks,
                         const int total, __global const int *ends, __global const int *entries,
                         __global const int *records, __global int *triangles, __global float *depths)
{
    const int tile = get_global_id(0);
    if (tile >= tiles)
        return;
    const int2 origin = (int2)(tile % tiles_x, tile / tiles_x) * TILE;
    float depth[TILE * TILE], farthest[BLOCKS * BLOCKS];
    int ids[TILE * TILE];
    for (int i = 0; i < TILE * BLOCKS; i++) {
        vstore8((float8)0.0f, i, depth);
        vstore8((int8)-1, i, ids);
    }
    for (int i = 0; i < BLOCKS * BLOCKS; i++)
        farthest[i] = 0.0f;

    const int first = tile == 0 ? 0 : ends[(size_t)tile * chunks - 1], end = ends[(size_t)(tile + 1) * chunks - 1];
    for (int i = first; i < end; i++)
        draw_record(records + (size_t)entries[i] * RECORD, origin, width, height, depth, ids, farthest);

    for (int y = 0; y < min(TILE, height - origin.y); y++) {
        const size_t row = (size_t)(origin.y + y) * width + origin.x;
        for (int x = 0; x < min(TILE, width - origin.x); x += BLOCK) {
            const int at = (y / BLOCK * BLOCKS + x / BLOCK) * BLOCK * BLOCK + y % BLOCK * BLOCK;
            for (int i = 0; i < min(BLOCK, width - origin.x - x); i++) {
                triangles[row + x + i] = ids[at + i] < 0 ? -1 : ids[at + i] & ~MASK_BIT;
                depths[row + x + i] = depth[at + i];
            }
        }
    }
}
