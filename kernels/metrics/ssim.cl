// The moments under a sliding Gaussian window, and the structural similarity made from them (Wang et al. 2004).

#include "metrics/colour.cl"

#define RADIUS 5                   // an 11 x 11 window
#define MIDDLE (RADIUS + ROWS - 1) // of `taps`, which has ROWS - 1 zeros on both sides

// BT.601 luma less 128: the variances that follow are small differences of squares, so the numbers are kept small.
__kernel void centred_luma(const int width, const int height, const int stride, __global const uint *image,
                           __global float *plane)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int row = get_global_id(0) / pieces;
    if (row >= height)
        return;
    const int column = (get_global_id(0) % pieces) * PIECE;
    vstore16(luma(load_pixels(image, width, row, column)) - 128.0f, 0, plane + plane_offset(stride, row, column));
}

// Horizontal pass. Pictures are compared by their difference d = b - a: what all formulas make of it is exactly 0 where
// it is 0, however a compiler rounds. rows: 3 planes: the means of d, b b and d d. against: 1, or 0 where nothing is
// compared and d is b. Pixels within RADIUS of a side border mean nothing.
__kernel void window_rows(const int width, const int height, const int stride, const float against,
                          __global const float *a, __global const float *b, __global const float *taps,
                          __global float *rows)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int row = get_global_id(0) / pieces;
    if (row >= height)
        return;
    const int at = plane_offset(stride, row, (get_global_id(0) % pieces) * PIECE);
    float16 difference = 0.0f, square = 0.0f, apart = 0.0f;
    for (int k = -RADIUS; k <= RADIUS; k++) {
        const float16 second = vload16(0, b + at + k), d = second - against * vload16(0, a + at + k);
        const float16 weighted = taps[MIDDLE + k] * d;
        difference += weighted;
        square = taps[MIDDLE + k] * second * second + square;
        apart = weighted * d + apart;
    }
    const int size = height * stride;
    vstore16(difference, 0, rows + at);
    vstore16(square, 0, rows + at + size);
    vstore16(apart, 0, rows + at + 2 * size);
}

INLINE wide_rows window_columns(__global const float *rows, const int row, const int height, const int stride,
                                __global const float *taps)
{
    return filtered_down(rows, row, height, stride, RADIUS, taps + MIDDLE);
}

// What SSIM lacks to 1: in contrast and structure together, and in luminance.
typedef struct {
    float16 contrast_structure, luminance;
} dissimilarity;

INLINE float16 whole_loss(const dissimilarity d)
{
    return d.contrast_structure + d.luminance - d.contrast_structure * d.luminance;
}

// The dissimilarity of a reference of mean mu_a and mean square aa, and a test of mean square bb, for a mean difference
// mu_d and its mean square dd. origin: what was subtracted from both. c1, c2: (K1 L)^2 and (K2 L)^2.
// 2 cov = var a + var b - var d, and 2 m n = m m + n n - (m - n)^2.
INLINE dissimilarity dissimilarity_of(const float16 mu_a, const float16 aa, const float16 mu_d, const float16 bb,
                                      const float16 dd, const float origin, const float c1, const float c2)
{
    const float16 mu_b = mu_a + mu_d;
    // Rounded below zero, variances stay so: c2 is far larger.
    const float16 variances = (aa - mu_a * mu_a) + (bb - mu_b * mu_b);
    const float16 apart = dd - mu_d * mu_d;
    const float16 m = mu_a + origin, n = mu_b + origin;
    return (dissimilarity){apart / (variances + c2), mu_d * mu_d / (m * m + n * n + c1)};
}

// The vertical pass of the reference. moments: 2 planes: mean and mean square.
__kernel void reference_moments(const int width, const int height, const int stride, __global const float *rows,
                                __global const float *taps, __global float *moments)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int row = get_global_id(0) / pieces * ROWS + RADIUS;
    if (row >= height - RADIUS)
        return;
    const int column = plane_offset(stride, 0, (get_global_id(0) % pieces) * PIECE);
    const int size = height * stride;
    const wide_rows mean = window_columns(rows + column, row, height, stride, taps);
    const wide_rows square = window_columns(rows + column + size, row, height, stride, taps);
    for (int k = 0; k < ROWS && row + k < height - RADIUS; k++) {
        vstore16(mean.row[k], 0, moments + column + (row + k) * stride);
        vstore16(square.row[k], 0, moments + column + (row + k) * stride + size);
    }
}

// The vertical pass of the test, and the sum of 1 - SSIM over the pixels of each work-item whose window is inside.
__kernel void dissimilarity_sums(const int width, const int height, const int stride, __global const float *moments,
                                 __global const float *rows, __global const float *taps, const float origin,
                                 const float c1, const float c2, __global float *partial)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int id = get_global_id(0);
    const int row = id / pieces * ROWS + RADIUS;
    if (row >= height - RADIUS)
        return;
    const int first = (id % pieces) * PIECE;
    const int column = plane_offset(stride, 0, first);
    const int size = height * stride;
    const wide_rows difference = window_columns(rows + column, row, height, stride, taps);
    const wide_rows square = window_columns(rows + column + size, row, height, stride, taps);
    const wide_rows apart = window_columns(rows + column + 2 * size, row, height, stride, taps);
    float16 sum = 0.0f;
    for (int k = 0; k < ROWS && row + k < height - RADIUS; k++) {
        __global const float *reference = moments + column + (row + k) * stride;
        sum += whole_loss(dissimilarity_of(vload16(0, reference), vload16(0, reference + size), difference.row[k],
                                           square.row[k], apart.row[k], origin, c1, c2));
    }
    partial[id] = sum_of_lanes(inside_only(sum, first, RADIUS, width - RADIUS));
}
