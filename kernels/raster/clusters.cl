// Clusters: runs of CLUSTER triangles in file order, with their boxes, and their positions in groups of 8.
#include "raster/camera.cl"

// A group holds 8 triangles as 9 x float8: x, y, z of corner 0, then 1, then 2. Lanes beyond the last triangle repeat
// one of its corners, and so have no area. A box is low.xyz and high.xyz in .s012 and .s456; .s3 is 0, or NaN where a
// position is not finite.
__kernel void build_clusters(const int triangles, const int clusters, __global const float *positions,
                             __global const int *indices, __global const uchar *flags, __global float *groups,
                             __global uchar *group_flags, __global float8 *boxes)
{
    const int cluster = get_global_id(0);
    if (cluster >= clusters)
        return;
    float3 low = INFINITY, high = -INFINITY;
    float wrong = 0.0f;
    for (int i = 0; i < CLUSTER; i++) {
        const int slot = cluster * CLUSTER + i;
        const int triangle = min(slot, triangles - 1);
        __global float *lane = groups + (size_t)(slot / 8) * 72 + slot % 8;
        for (int corner = 0; corner < 3; corner++) {
            const int vertex = indices[3 * (size_t)triangle + (slot < triangles ? corner : 0)];
            const float3 p = vload3(vertex, positions);
            lane[24 * corner] = p.x;
            lane[24 * corner + 8] = p.y;
            lane[24 * corner + 16] = p.z;
            low = (float3)(p.x < low.x ? p.x : low.x, p.y < low.y ? p.y : low.y, p.z < low.z ? p.z : low.z);
            high = (float3)(p.x > high.x ? p.x : high.x, p.y > high.y ? p.y : high.y, p.z > high.z ? p.z : high.z);
            wrong += (p.x - p.x) + (p.y - p.y) + (p.z - p.z);
        }
        group_flags[slot] = flags[triangle];
    }
    boxes[cluster] = (float8)(low, wrong, high, 0.0f);
}

// Whether a box lies wholly outside plane . (p - eye, 1) >= 0, with room for rounding.
inline int beyond(const float4 plane, const float3 centre, const float3 extent)
{
    const float3 n = fabs(plane.xyz);
    const float near_corner = dot(plane.xyz, centre) + plane.w + dot(n, extent);
    return near_corner < -1e-5f * (dot(n, fabs(centre) + extent) + fabs(plane.w));
}

// 1 where any part of a cluster's box may lie in the camera's frustum.
__kernel void clusters_in_frustum(const int clusters, const float8 eye, const float16 rows, const int width,
                                  const int height, __global const float8 *boxes, __global int *visible)
{
    const int cluster = get_global_id(0);
    if (cluster >= clusters)
        return;
    const float8 box = boxes[cluster];
    const float3 low = from_eye(box.s012, eye), high = from_eye(box.s456, eye);
    const float3 centre = 0.5f * low + 0.5f * high, extent = 0.5f * high - 0.5f * low;
    const float4 x = rows.s0123 / (0.5f * SUBPIXELS * width), y = rows.s4567 / (0.5f * SUBPIXELS * height);
    const float4 z = rows.s89ab, w = rows.scdef;
    visible[cluster] = !(beyond(w - x, centre, extent) | beyond(w + x, centre, extent) |
                         beyond(w - y, centre, extent) | beyond(w + y, centre, extent) |
                         beyond(w - z, centre, extent) | beyond(z, centre, extent));
}

__kernel void list_clusters(const int clusters, __global const int *visible, __global const int *offsets,
                            __global int *list)
{
    const int cluster = get_global_id(0);
    if (cluster < clusters && visible[cluster])
        list[offsets[cluster]] = cluster;
}
