// Which lookups in an atlas could break a rule: all operations, and their order, are those of NumPy in the check.

#include "common/wide.cl"

#pragma OPENCL EXTENSION cl_khr_fp64 : enable

// Limits of the check, as the caller gives them.
#define WEIGHT limits[0]
#define NEAR_SQUARED limits[1]
#define LOCATION limits[2]
#define REACH limits[3]

INLINE double3 surface_point(__global const double *corners, const double b1, const double b2)
{
    const double3 a = vload3(0, corners), b = vload3(1, corners), c = vload3(2, corners);
    return a + b1 * (b - a) + b2 * (c - a);
}

// RUN lookups per item. A triangle's row is its place in the tables, -1 for one that is in none; jacobian: of all rows
// first that of the column.
__kernel void screen_lookups(const int count, const int only_known, const int width, const int height,
                             __global const int *triangle, __global const float *bary, __global const double *places,
                             const int rows, __global const int *row_of, __global const double *jacobian,
                             __global const double *texel_size, __global const double *corners,
                             __global const int *plane, __global const int *owners, __global const float *owner_bary,
                             __global const double *limits, __global uchar *marks, __global int *counts)
{
    const int first = RUN * get_global_id(0), last = MIN(first + RUN, count);
    int marked = 0, all_touched = 0, missing = 0;
    for (int i = first; i < last; i++) {
        marks[i] = 0;
        const int own_triangle = triangle[i], row = row_of[own_triangle];
        const double column_at = places[2 * i], line_at = places[2 * i + 1];
        const int known = row >= 0 && column_at - column_at == 0; // neither NaN nor infinite
        if (only_known && !known)
            continue;
        if (!known || line_at != line_at) {
            marks[i] = 1;
            marked++;
            continue;
        }
        double x = MIN(MAX(column_at + 0.5, 0.0), width + 0.999), y = MIN(MAX(line_at + 0.5, 0.0), height + 0.999);
        const int column = (int)x, line = (int)y;
        x -= column;
        y -= line;
        double weight[4] = {(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y};
        const double across[4] = {x, 1 - x, x, 1 - x}, down[4] = {y, y, 1 - y, 1 - y};
        const double b1 = bary[2 * i], b2 = bary[2 * i + 1];
        double total = 0, sum1 = 0, sum2 = 0;
        int whole = 1, bad = 0;
        UNROLL
        for (int k = 0; k < 4; k++) {
            const int sample = plane[(line + (k >> 1)) * (width + 2) + column + (k & 1)];
            const int owner = sample >= 0 ? owners[sample] : sample;
            const int touched = weight[k] > WEIGHT;
            const int other = touched && owner != own_triangle;
            const double w = touched ? weight[k] : 0;
            const double o1 = sample >= 0 ? owner_bary[2 * sample] : 0, o2 = sample >= 0 ? owner_bary[2 * sample + 1] : 0;
            total = k ? total + w : w;
            sum1 = k ? sum1 + w * o1 : w * o1;
            sum2 = k ? sum2 + w * o2 : w * o2;
            whole &= !other;
            all_touched += touched;
#if GAPS
            if (other && owner != BORDER && across[k] * across[k] + down[k] * down[k] > NEAR_SQUARED) {
                missing++;
                continue;
            }
#endif
            if (!other || bad)
                continue;
            const int other_row = owner >= 0 ? row_of[owner] : -1;
            if (other_row < 0) {
                bad = 1;
                continue;
            }
            const double3 off = surface_point(corners + 9 * other_row, o1, o2) - surface_point(corners + 9 * row, b1, b2);
            const double reach = REACH * (texel_size[row] + texel_size[other_row]);
            // The root is taken of the one side there and the square of the other one here: a margin for its rounding.
            bad = !(off.x * off.x + off.y * off.y + off.z * off.z <= reach * reach * (1 - 1e-9));
        }
        if (whole) {
            const double off1 = sum1 / total - b1, off2 = sum2 / total - b2;
            __global const double *to_column = jacobian + 2 * row, *to_line = jacobian + 2 * (rows + row);
            const double c = to_column[0] * off1 + to_column[1] * off2, r = to_line[0] * off1 + to_line[1] * off2;
            bad |= !(c <= LOCATION && -c <= LOCATION && r <= LOCATION && -r <= LOCATION);
        }
        marks[i] = bad;
        marked += bad;
    }
    if (marked)
        atomic_add(counts, marked);
    if (GAPS && all_touched)
        atomic_add(counts + 1, all_touched);
    if (GAPS && missing)
        atomic_add(counts + 2, missing);
}
