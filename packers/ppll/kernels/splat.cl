// Reprojection: fragments are points, drawn as small squares; each pixel sorts, groups and blends what falls on it.
#include "common/elementary.cl"
#include "sort.cl"

// Squares are this much larger than a pixel's share, so that neighbours overlap where the view stretches them.
#define OVERLAP 1.5f
// Those of fragments that lie anywhere in their pixel: two of them may be nearly two pixels apart.
#define LOOSE_OVERLAP 1.95f
#define WIDEST 4.0f // pixels to each side
// Points of neighbouring list pixels belong to one surface if their distances differ by less than this share.
#define SAME_SURFACE 0.02f
#define MEMBERS 16 // of a group

// Where list fragments are seen: points: column, row, distance, half the side of the square (< 0: not seen);
// also each one's distance as a sorting key, its pixel in the lists and its colour. `at` is the first place to write,
// `first_pixel` the number of the lists' first pixel among those of all list views.
// turn: rows of the 3 x 4 matrix from list eye space to the view's eye space. lens: columns and rows per tangent and
// the image's centre. size: pixels of the view per list pixel at equal distance.
__kernel void place_points(const int pixels, const int width, __global const int *offsets, __global const uint *rows,
                           const int words, const float4 rays, const float near, const float4 turn_x,
                           const float4 turn_y, const float4 turn_z, const float4 lens, const float size, const int at,
                           const int first_pixel, __global float4 *points, __global float *keys, __global int *sources,
                           __global uint *colours)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    const int end = offsets[pixel + 1], y = pixel / width, x = pixel - y * width;
    for (int i = offsets[pixel]; i < end; i++) {
        __global const uint *row = rows + (size_t)i * words;
        float4 p;
        p.w = 1.0f;
        if (words == 2) {
            p.z = near / as_float(row[1]);
            p.x = (rays.x * x + rays.y) * p.z;
            p.y = (rays.z * y + rays.w) * p.z;
        } else {
            p.x = as_float(row[2]);
            p.y = as_float(row[3]);
            p.z = as_float(row[4]);
        }
        const float from = p.z;
        p.z = -p.z;
        const float distance = -dot4(turn_z, p);
        const int seen = row[0] >> 24 && distance > near && distance < 1e30f;
        const float column = lens.x * dot4(turn_x, p) / distance + lens.z;
        const float line = lens.w - lens.y * dot4(turn_y, p) / distance;
        const float spread = size * from / distance;
        const float half_side = 0.5f * (words == 2 ? OVERLAP : LOOSE_OVERLAP) * (spread > 1.0f ? spread : 1.0f);
        points[at + i] = (float4)(column, line, distance, seen ? (half_side < WIDEST ? half_side : WIDEST) : -1.0f);
        keys[at + i] = distance;
        sources[at + i] = first_pixel + pixel;
        colours[at + i] = row[0];
    }
}

// The pixels (left, top, right, bottom) whose centres a point's square covers; none where right < left.
INLINE int4 covered(const float4 point, const int width, const int height)
{
    const float left = point.x - point.w, right = point.x + point.w, top = point.y - point.w, low = point.y + point.w;
    if (point.w < 0.0f || !(left < width && right > 0.0f && top < height && low > 0.0f))
        return (int4)(0, 0, -1, -1);
    const int first_x = (int)ceil(left - 0.5f), last_x = (int)ceil(right - 0.5f) - 1;
    const int first_y = (int)ceil(top - 0.5f), last_y = (int)ceil(low - 0.5f) - 1;
    return (int4)(first_x > 0 ? first_x : 0, first_y > 0 ? first_y : 0, last_x < width ? last_x : width - 1,
                  last_y < height ? last_y : height - 1);
}

__kernel void count_points(const int count, const int width, const int height, __global const float4 *points,
                           __global int *counts)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int4 box = covered(points[i], width, height);
    for (int y = box.y; y <= box.w; y++)
        for (int x = box.x; x <= box.z; x++)
            atomic_inc(counts + y * width + x);
}

// Each pixel's points in any order; blend_points sorts them. `cursor` begins as the pixels' first places.
__kernel void list_points(const int count, const int width, const int height, __global const float4 *points,
                          __global int *cursor, __global int *numbers)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int4 box = covered(points[i], width, height);
    for (int y = box.y; y <= box.w; y++)
        for (int x = box.x; x <= box.z; x++)
            numbers[atomic_inc(cursor + y * width + x)] = i;
}

// A pixel's colour: the points that fall on it, nearest first, in groups of one surface; a group's colour and opacity
// are averages, weighted by how near the points are to the pixel's centre. depth: near over the distance of the nearest
// point, 0 where there is none.
__kernel void blend_points(const int pixels, const int width, __global const int *offsets, __global int *numbers,
                           __global const float4 *points, __global const float *keys, __global const int *sources,
                           __global const uint *colours, const float near, __global uint *picture,
                           __global float *depth)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    const int first = offsets[pixel], end = offsets[pixel + 1];
    sort_numbers(numbers + first, end - first, keys);
    depth[pixel] = first < end ? near / keys[numbers[first]] : 0.0f;
    const float px = pixel % width + 0.5f, py = pixel / width + 0.5f;
    float4 sum = 0.0f;
    float through = 1.0f;
    for (int i = first; i < end && through > 0.0f;) {
        const float farthest = keys[numbers[i]] * (1.0f + SAME_SURFACE);
        int members[MEMBERS], count = 0;
        float4 group = 0.0f;
        float weight = 0.0f;
        for (; i < end && count < MEMBERS && keys[numbers[i]] <= farthest; i++) {
            const int number = numbers[i], source = sources[number];
            int again = 0;
            for (int k = 0; k < count; k++)
                again |= members[k] == source;
            if (again)
                break;
            members[count++] = source;
            const float4 point = points[number];
            const float near_x = 1.0f - fabs(point.x - px) / point.w, near_y = 1.0f - fabs(point.y - py) / point.w;
            const float w = near_x * near_y + 1e-4f;
            const uint c = colours[number];
            group += w * (float4)(c & 255, (c >> 8) & 255, (c >> 16) & 255, c >> 24);
            weight += w;
        }
        group /= weight;
        const float alpha = group.w > 254.99f ? 1.0f : group.w * (1.0f / 255.0f);
        sum += through * alpha * group;
        through *= 1.0f - alpha;
    }
    const uint behind = picture[pixel];
    sum += through * (float4)(behind & 255, (behind >> 8) & 255, (behind >> 16) & 255, 255.0f) + 0.5f;
    picture[pixel] = (uint)sum.x | (uint)sum.y << 8 | (uint)sum.z << 16 | 0xff000000u;
}
