// The moments under a sliding Gaussian window, and the structural similarity made from them (Wang et al. 2004).

#include "metrics/colour.cl"

#define RADIUS 5  // an 11 x 11 window
#define MIDDLE (RADIUS + ROWS - 1)  // of `taps`, which has ROWS - 1 zeros on both sides

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

// Horizontal pass. rows: 3 planes: the means of b, b b and a b. Pixels within RADIUS of a side border mean nothing.
__kernel void window_rows(const int width, const int height, const int stride, __global const float *a,
                          __global const float *b, __global const float *taps, __global float *rows)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int row = get_global_id(0) / pieces;
    if (row >= height)
        return;
    const int at = plane_offset(stride, row, (get_global_id(0) % pieces) * PIECE);
    float16 mean = 0.0f, square = 0.0f, product = 0.0f;
    for (int k = -RADIUS; k <= RADIUS; k++) {
        const float16 first = vload16(0, a + at + k), second = vload16(0, b + at + k);
        const float16 weighted = taps[MIDDLE + k] * second;
        mean += weighted;
        square = weighted * second + square;
        product = weighted * first + product;
    }
    const int size = height * stride;
    vstore16(mean, 0, rows + at);
    vstore16(square, 0, rows + at + size);
    vstore16(product, 0, rows + at + 2 * size);
}

static inline wide_rows window_columns(__global const float *rows, const int row, const int height, const int stride,
                                __global const float *taps)
{
    return filtered_down(rows, row, height, stride, RADIUS, taps + MIDDLE);
}

// What SSIM compares: contrast and structure together, and luminance.
typedef struct {
    float16 contrast_structure, luminance;
} similarity;

// The similarity of a reference of mean mu_a and mean square aa, and a test of mu_b, bb and mean product ab.
// origin: what was subtracted from both. c1, c2: (K1 L)^2 and (K2 L)^2.
static inline similarity similarity_of(const float16 mu_a, const float16 aa, const float16 mu_b, const float16 bb,
                                const float16 ab, const float origin, const float c1, const float c2)
{
    // Unfused, so that identical pictures give exactly 1.
    #pragma OPENCL FP_CONTRACT OFF
    // Rounded below zero, a variance stays so: the covariance of identical pictures does too, and c2 is far larger.
    const float16 variance_a = aa - mu_a * mu_a, variance_b = bb - mu_b * mu_b;
    const float16 covariance = ab - mu_a * mu_b;
    const float16 m = mu_a + origin, n = mu_b + origin;
    return (similarity){(2.0f * covariance + c2) / (variance_a + variance_b + c2),
                        (2.0f * (m * n) + c1) / (m * m + n * n + c1)};
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

// The vertical pass of the test, and the sum of SSIM over the pixels of each work-item whose window is inside.
__kernel void similarity_sums(const int width, const int height, const int stride, __global const float *moments,
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
    const wide_rows mean = window_columns(rows + column, row, height, stride, taps);
    const wide_rows square = window_columns(rows + column + size, row, height, stride, taps);
    const wide_rows product = window_columns(rows + column + 2 * size, row, height, stride, taps);
    float16 sum = 0.0f;
    for (int k = 0; k < ROWS && row + k < height - RADIUS; k++) {
        __global const float *reference = moments + column + (row + k) * stride;
        const similarity s = similarity_of(vload16(0, reference), vload16(0, reference + size), mean.row[k],
                                           square.row[k], product.row[k], origin, c1, c2);
        sum += s.contrast_structure * s.luminance;
    }
    partial[id] = sum_of_lanes(inside_only(sum, first, RADIUS, width - RADIUS));
}
