// Which lookups in an atlas could break a rule: all operations, and their order, are those of NumPy in the check.

#include "common/wide.cl"

#pragma OPENCL EXTENSION cl_khr_fp64 : enable

// Limits of the check, as the caller gives them.
#define WEIGHT limits[0]
#define NEAR_SQUARED limits[1]
#define LOCATION limits[2]
#define REACH limits[3]

// Where a point is looked up: the upper left one of the four texels around it, and the place between their centres.
typedef struct {
    int column, row;
    double x, y;
} Lookup;

INLINE Lookup lookup_at(__global const double *place, const int width, const int height)
{
    // From centre to centre, with a border of one texel around the atlas.
    const double across = place[0] + 0.5, down = place[1] + 0.5;
    const double x = MIN(MAX(across, 0.0), width + 0.999), y = MIN(MAX(down, 0.0), height + 0.999);
    const int column = x == x ? (int)x : 0, row = y == y ? (int)y : 0;
    return (Lookup){column - 1, row - 1, x - column, y - row};
}

INLINE double3 surface_point(__global const double *corners, const double b1, const double b2)
{
    const double3 a = vload3(0, corners), b = vload3(1, corners), c = vload3(2, corners);
    return a + b1 * (b - a) + b2 * (c - a);
}

// What lies in the four texels of each of `run` lookups: its owner, or why there is none, and the barycentrics. In two
// steps, so that memory is asked for all samples at a time, and then for all their owners.
INLINE void read_texels(const int run, const int width, const int height, __global const double *places,
                        __global const int *plane, __global const int *owners, __global const float *owner_bary,
                        int *owner, float2 *owned)
{
    int sample[4 * RUN];
    for (int i = 0; i < run; i++) {
        const Lookup at = lookup_at(places + 2 * i, width, height);
        UNROLL
        for (int k = 0; k < 4; k++) {
            const int column = at.column + (k & 1), row = at.row + (k >> 1);
            const int inside = column >= 0 && column < width && row >= 0 && row < height;
            sample[4 * i + k] = inside ? plane[row * width + column] : BORDER;
        }
    }
    for (int i = 0; i < 4 * run; i++) {
        const int at = sample[i];
        owner[i] = at >= 0 ? owners[at] : at;
        owned[i] = at >= 0 ? (float2)(owner_bary[2 * at], owner_bary[2 * at + 1]) : 0;
    }
}

// Whether a point of one row's triangle may be too far from one of another's. NumPy takes the root of the one side,
// here the other one is squared: a margin for the rounding of both.
INLINE int is_far(const int row, const double b1, const double b2, const int row_there, const double o1,
                  const double o2, __global const double *corners, __global const double *texel_size, const double most)
{
    const double3 there = surface_point(corners + 9 * row_there, o1, o2);
    const double3 off = there - surface_point(corners + 9 * row, b1, b2);
    const double reach = most * (texel_size[row] + texel_size[row_there]);
    return !(off.x * off.x + off.y * off.y + off.z * off.z <= reach * reach * (1 - 1e-9));
}

// Whether barycentrics that are so much off are more than `most` texels off, by the map through the triangle's corners.
INLINE int is_off(const double off1, const double off2, __global const double *to_column, __global const double *to_row,
                  const double most)
{
    const double c = to_column[0] * off1 + to_column[1] * off2, r = to_row[0] * off1 + to_row[1] * off2;
    return !(c <= most && -c <= most && r <= most && -r <= most);
}

// RUN lookups per item. A triangle's row is its place in the tables, -1 for one that is in none; jacobian: of all rows
// first that of the column.
__kernel void screen_lookups(const int count, const int only_known, const int width, const int height, const int rows,
                             __global const int *triangle, __global const float *bary, __global const double *places,
                             __global const int *row_of, __global const double *jacobian,
                             __global const double *texel_size, __global const double *corners,
                             __global const int *plane, __global const int *owners, __global const float *owner_bary,
                             __global const double *limits, __global uchar *marks, __global int *counts)
{
    const int first = RUN * get_global_id(0), run = MIN(RUN, count - first);
    if (run <= 0)
        return;
    int owner[4 * RUN];
    float2 owned[4 * RUN];
    read_texels(run, width, height, places + 2 * first, plane, owners, owner_bary, owner, owned);
    int marked = 0, all_touched = 0, missing = 0;
    for (int i = 0; i < run; i++) {
        const int number = first + i, own = triangle[number], row = row_of[own];
        __global const double *place = places + 2 * number;
        const int known = row >= 0 && place[0] - place[0] == 0; // neither NaN nor infinite
        const int unclear = !known || place[1] != place[1];
        marks[number] = unclear && !(only_known && !known);
        marked += marks[number];
        if (unclear)
            continue;
        const Lookup at = lookup_at(place, width, height);
        const double weight[4] = {(1 - at.x) * (1 - at.y), at.x * (1 - at.y), (1 - at.x) * at.y, at.x * at.y};
        const double across[4] = {at.x, 1 - at.x, at.x, 1 - at.x}, down[4] = {at.y, at.y, 1 - at.y, 1 - at.y};
        const double b1 = bary[2 * number], b2 = bary[2 * number + 1];
        double total = 0, sum1 = 0, sum2 = 0;
        int whole = 1, bad = 0;
        UNROLL
        for (int k = 0; k < 4; k++) {
            const int touched = weight[k] > WEIGHT, other = touched && owner[4 * i + k] != own;
            const double w = touched ? weight[k] : 0, o1 = owned[4 * i + k].x, o2 = owned[4 * i + k].y;
            total = k ? total + w : w;
            sum1 = k ? sum1 + w * o1 : w * o1;
            sum2 = k ? sum2 + w * o2 : w * o2;
            whole &= !other;
            all_touched += touched;
            if (!other)
                continue;
            const int triangle_there = owner[4 * i + k];
#if GAPS
            if (triangle_there != BORDER && across[k] * across[k] + down[k] * down[k] > NEAR_SQUARED) {
                missing++;
                continue;
            }
#endif
            const int row_there = triangle_there >= 0 ? row_of[triangle_there] : -1;
            bad |= row_there < 0 || is_far(row, b1, b2, row_there, o1, o2, corners, texel_size, REACH);
        }
        if (whole) {
            bad |=
                is_off(sum1 / total - b1, sum2 / total - b2, jacobian + 2 * row, jacobian + 2 * (rows + row), LOCATION);
        }
        marks[number] = bad;
        marked += bad;
    }
    if (marked)
        atomic_add(counts, marked);
#if GAPS
    if (all_touched)
        atomic_add(counts + 1, all_touched);
    if (missing)
        atomic_add(counts + 2, missing);
#endif
}
