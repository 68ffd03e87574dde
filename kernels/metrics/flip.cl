// FLIP for low dynamic range (Andersson et al. 2020): colours after the eye's contrast sensitivity in a Hunt-adjusted
// CIELAB, features as edges and points of luminance, and the difference of both.
//
// Defined by the launcher: SHARP_RADIUS (luminance and red-green), BLUR_RADIUS (blue-yellow), FEATURE_RADIUS, in
// pixels.

#include "metrics/colour.cl"

// Where the middle of each filter lies in `taps`: one after the other, ROWS - 1 zeros on both sides of each.
#define LUMINANCE (ROWS - 1 + SHARP_RADIUS)
#define RED_GREEN (LUMINANCE + 2 * (ROWS - 1 + SHARP_RADIUS) + 1)
#define YELLOW_1 (RED_GREEN + 2 * (ROWS - 1) + SHARP_RADIUS + BLUR_RADIUS + 1)
#define YELLOW_2 (YELLOW_1 + 2 * (ROWS - 1 + BLUR_RADIUS) + 1)
#define SMOOTH (YELLOW_2 + 2 * (ROWS - 1) + BLUR_RADIUS + FEATURE_RADIUS + 1)
#define EDGE (SMOOTH + 2 * (ROWS - 1 + FEATURE_RADIUS) + 1)
#define POINT (EDGE + 2 * (ROWS - 1 + FEATURE_RADIUS) + 1)

// Opponent planes: Y, X - Y and Y - Z, relative to white. YCxCz is 116 Y - 16, 500 (X - Y), 200 (Y - Z); the filters
// are linear with sum 1, so the scale may wait. Margins repeat the border pixels.
__kernel void opponents(const int width, const int height, const int stride, __global const uint *image,
                        __global const float *linear, __global const float *to_xyz, __global float *planes)
{
    const int pieces = stride / PIECE;
    const int row = get_global_id(0) / pieces;
    if (row >= height)
        return;
    const int column = (get_global_id(0) % pieces) * PIECE - MARGIN;
    const wide3 xyz = transform(to_xyz, linear_rgb(load_pixels(image, width, row, column), linear));
    const int size = height * stride;
    __global float *out = planes + plane_offset(stride, row, column);
    vstore16(xyz.y, 0, out);
    vstore16(xyz.x - xyz.y, 0, out + size);
    vstore16(xyz.y - xyz.z, 0, out + 2 * size);
}

// One symmetric filter along `step` elements (1: the row).
INLINE float16 filtered(__global const float *p, const int radius, __global const float *taps)
{
    float16 sum = taps[0] * vload16(0, p);
    for (int k = 1; k <= radius; k++)
        sum = taps[k] * (vload16(0, p - k) + vload16(0, p + k)) + sum;
    return sum;
}

// The horizontal passes. rows: 7 planes: luminance, red-green, yellow 1, yellow 2, smooth, edge, point.
__kernel void filter_rows(const int width, const int height, const int stride, __global const float *planes,
                          __global const float *taps, __global float *rows)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int row = get_global_id(0) / pieces;
    if (row >= height)
        return;
    const int size = height * stride;
    const int at = plane_offset(stride, row, (get_global_id(0) % pieces) * PIECE);
    __global const float *y = planes + at;
    __global const float *z = y + 2 * size;
    __global float *out = rows + at;
    vstore16(filtered(y, SHARP_RADIUS, taps + LUMINANCE), 0, out);
    vstore16(filtered(y + size, SHARP_RADIUS, taps + RED_GREEN), 0, out + size);

    float16 first = taps[YELLOW_1] * vload16(0, z), second = taps[YELLOW_2] * vload16(0, z);
    for (int k = 1; k <= BLUR_RADIUS; k++) {
        const float16 pair = vload16(0, z - k) + vload16(0, z + k);
        first = taps[YELLOW_1 + k] * pair + first;
        second = taps[YELLOW_2 + k] * pair + second;
    }
    vstore16(first, 0, out + 2 * size);
    vstore16(second, 0, out + 3 * size);

    float16 smooth = taps[SMOOTH] * vload16(0, y), edge = 0.0f, point = taps[POINT] * vload16(0, y);
    for (int k = 1; k <= FEATURE_RADIUS; k++) {
        const float16 before = vload16(0, y - k), after = vload16(0, y + k);
        const float16 pair = before + after;
        smooth = taps[SMOOTH + k] * pair + smooth;
        edge = taps[EDGE + k] * (after - before) + edge;
        point = taps[POINT + k] * pair + point;
    }
    vstore16(smooth, 0, out + 4 * size);
    vstore16(edge, 0, out + 5 * size);
    vstore16(point, 0, out + 6 * size);
}

// Filtered opponents to Hunt-adjusted CIELAB: out of gamut colours are clamped to the display's.
INLINE wide3 hunt_lab(const wide3 opponents, __global const float *to_rgb, __global const float *to_xyz)
{
    const wide3 xyz = {opponents.x + opponents.y, opponents.x, opponents.x - opponents.z};
    wide3 rgb = transform(to_rgb, xyz);
    rgb.x = smaller(larger(rgb.x, 0.0f), 1.0f);
    rgb.y = smaller(larger(rgb.y, 0.0f), 1.0f);
    rgb.z = smaller(larger(rgb.z, 0.0f), 1.0f);
    wide3 lab = lab_of(transform(to_xyz, rgb));
    lab.y *= 0.01f * lab.x;
    lab.z *= 0.01f * lab.x;
    return lab;
}

// The vertical passes over colours. features: planes 0..2: L, a, b (Hunt-adjusted).
// share: of the first of the two Gaussians of blue-yellow.
__kernel void colour_columns(const int width, const int height, const int stride, __global const float *rows,
                             __global const float *taps, const float share, __global const float *to_rgb,
                             __global const float *to_xyz, __global float *features)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int row = get_global_id(0) / pieces * ROWS;
    if (row >= height)
        return;
    const int size = height * stride;
    const int column = plane_offset(stride, 0, (get_global_id(0) % pieces) * PIECE);
    __global const float *in = rows + column;
    const wide_rows luminance = filtered_down(in, row, height, stride, SHARP_RADIUS, taps + LUMINANCE);
    const wide_rows red_green = filtered_down(in + size, row, height, stride, SHARP_RADIUS, taps + RED_GREEN);
    const wide_rows first = filtered_down(in + 2 * size, row, height, stride, BLUR_RADIUS, taps + YELLOW_1);
    const wide_rows second = filtered_down(in + 3 * size, row, height, stride, BLUR_RADIUS, taps + YELLOW_2);
    for (int k = 0; k < ROWS && row + k < height; k++) {
        const wide3 opponents = {luminance.row[k], red_green.row[k],
                                 second.row[k] + share * (first.row[k] - second.row[k])};
        const wide3 lab = hunt_lab(opponents, to_rgb, to_xyz);
        __global float *out = features + column + (row + k) * stride;
        vstore16(lab.x, 0, out);
        vstore16(lab.y, 0, out + size);
        vstore16(lab.z, 0, out + 2 * size);
    }
}

// The vertical passes over features. features: planes 3 and 4: magnitudes of edges and points.
__kernel void feature_columns(const int width, const int height, const int stride, __global const float *rows,
                              __global const float *taps, __global float *features)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int row = get_global_id(0) / pieces * ROWS;
    if (row >= height)
        return;
    const int size = height * stride;
    const int column = plane_offset(stride, 0, (get_global_id(0) % pieces) * PIECE);
    __global const float *smooth = rows + 4 * size + column;
    const wide_rows edge_x = filtered_down(smooth + size, row, height, stride, FEATURE_RADIUS, taps + SMOOTH);
    const wide_rows point_x = filtered_down(smooth + 2 * size, row, height, stride, FEATURE_RADIUS, taps + SMOOTH);
    const wide_rows edge_y = filtered_down(smooth, row, height, stride, FEATURE_RADIUS, taps + EDGE);
    const wide_rows point_y = filtered_down(smooth, row, height, stride, FEATURE_RADIUS, taps + POINT);
    for (int k = 0; k < ROWS && row + k < height; k++) {
        __global float *out = features + 3 * size + column + (row + k) * stride;
        vstore16(sqrt(edge_x.row[k] * edge_x.row[k] + edge_y.row[k] * edge_y.row[k]), 0, out);
        vstore16(sqrt(point_x.row[k] * point_x.row[k] + point_y.row[k] * point_y.row[k]), 0, out + size);
    }
}

// Features of two pictures to the FLIP value of each pixel, 0..1, and the sum over each piece.
// largest: the colour difference of green and blue, to the power .7.
__kernel void difference(const int width, const int height, const int stride, __global const float *test,
                         __global const float *reference, const float largest, __global float *map,
                         __global float *partial)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int id = get_global_id(0);
    const int row = id / pieces;
    if (row >= height)
        return;
    const int size = height * stride;
    const int column = (id % pieces) * PIECE;
    const int at = plane_offset(stride, row, column);
    float16 d[5];
    for (int k = 0; k < 5; k++)
        d[k] = vload16(0, test + k * size + at) - vload16(0, reference + k * size + at);
    const float16 hyab = fabs(d[0]) + sqrt(d[1] * d[1] + d[2] * d[2]);
    const float16 colour = power(hyab, 0.7f);
    const float16 bend = 0.4f * largest;
    const float16 low = colour * (0.95f / bend);
    const float16 high = 0.95f + (colour - bend) * (0.05f / (largest - bend));
    const float16 colour_error = smaller(colour < bend ? low : high, 1.0f);
    const float16 feature = larger(fabs(d[3]), fabs(d[4])) * 0.70710678f;
    const float16 value = power(colour_error, 1.0f - smaller(sqrt(feature), 1.0f));
    vstore16(value, 0, map + at);
    partial[id] = sum_of_lanes(inside_only(value, column, 0, width));
}
