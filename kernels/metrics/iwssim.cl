// Information content weighted SSIM (Wang and Li 2011): SSIM of the bands of a Laplacian pyramid, each pixel weighted
// by the information that its neighbourhood in the band (and the coarser band) carries about both pictures.

#include "common/wide.cl"
#include "metrics/ssim.cl"

// The pyramid's 5-tap binomial filter has sum sqrt(2), so a level is 2^k times brighter than the picture, as published.
#define BINOMIAL_0 (6.0f * 1.41421356f / 16.0f)
#define BINOMIAL_1 (4.0f * 1.41421356f / 16.0f)
#define BINOMIAL_2 (1.0f * 1.41421356f / 16.0f)

#define MOST_NEIGHBOURS 10
#define BLOCK 5
#define NOISE 0.4f

// Fill 3 pixels of margin by reflection: about the first pixel on the left; on the right about the last pixel (skip 1)
// or behind it (skip 0).
__kernel void reflect_margins(const int width, const int height, const int stride, const int skip,
                              __global float *plane)
{
    const int row = get_global_id(0);
    if (row >= height)
        return;
    __global float *p = plane + plane_offset(stride, row, 0);
    for (int k = 1; k <= 3; k++) {
        p[-k] = p[k];
        p[width - 1 + k] = p[width - k - skip];
    }
}

INLINE int reflected(const int row, const int height, const int skip)
{
    const int positive = row < 0 ? -row : row;
    return positive < height ? positive : 2 * height - 1 - skip - positive;
}

// 16 columns of the vertical pass around `row`.
INLINE float16 binomial_column(__global const float *p, const int row, const int height, const int stride)
{
    const float16 far =
        vload16(0, p + reflected(row - 2, height, 1) * stride) + vload16(0, p + reflected(row + 2, height, 1) * stride);
    const float16 near =
        vload16(0, p + reflected(row - 1, height, 1) * stride) + vload16(0, p + reflected(row + 1, height, 1) * stride);
    return BINOMIAL_0 * vload16(0, p + row * stride) + (BINOMIAL_1 * near + BINOMIAL_2 * far);
}

// Every second pixel of the filtered plane: coarse (coarse_height, coarse_stride). Margins of `fine` reflect (skip 1).
__kernel void reduce(const int height, const int stride, const int coarse_width, const int coarse_height,
                     const int coarse_stride, __global const float *fine, __global float *coarse)
{
    const int pieces = (coarse_width + PIECE - 1) / PIECE;
    const int row = get_global_id(0) / pieces;
    if (row >= coarse_height)
        return;
    const int column = (get_global_id(0) % pieces) * PIECE;
    __global const float *p = fine + MARGIN + 2 * column;
    float evens[24], odds[24];
    for (int k = 0; k < 3; k++) {
        const float16 c = binomial_column(p + 16 * k - 2, 2 * row, height, stride);
        vstore8(c.even, k, evens);
        vstore8(c.odd, k, odds);
    }
    const float16 far = vload16(0, evens) + vload16(0, evens + 2);
    const float16 near = vload16(0, odds) + vload16(0, odds + 1);
    const float16 sum = BINOMIAL_0 * vload16(0, evens + 1) + (BINOMIAL_1 * near + BINOMIAL_2 * far);
    vstore16(sum, 0, coarse + plane_offset(coarse_stride, row, column));
}

// Even and odd pixels of one coarse row brought to the fine spacing, 16 fine pixels from an even column on.
INLINE float16 expanded_row(__global const float *p)
{
    const float8 before = vload8(0, p - 1), here = vload8(0, p), after = vload8(0, p + 1);
    float16 fine;
    fine.even = BINOMIAL_0 * here + BINOMIAL_2 * (before + after);
    fine.odd = BINOMIAL_1 * (here + after);
    return fine;
}

// band = fine - the expanded coarse plane. Margins of `coarse` reflect as `skip` says, and so do its rows.
__kernel void subtract_expanded(const int width, const int height, const int stride, const int coarse_height,
                                const int coarse_stride, const int skip_rows, __global const float *fine,
                                __global const float *coarse, __global float *band)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int row = get_global_id(0) / pieces;
    if (row >= height)
        return;
    const int column = (get_global_id(0) % pieces) * PIECE;
    __global const float *p = coarse + MARGIN + column / 2;
    const int middle = row / 2;
    const float16 here = expanded_row(p + middle * coarse_stride);
    const float16 after = expanded_row(p + reflected(middle + 1, coarse_height, skip_rows) * coarse_stride);
    float16 expanded;
    if (row % 2 == 0) {
        const float16 before = expanded_row(p + reflected(middle - 1, coarse_height, skip_rows) * coarse_stride);
        expanded = BINOMIAL_0 * here + BINOMIAL_2 * (before + after);
    } else {
        expanded = BINOMIAL_1 * (here + after);
    }
    const int at = plane_offset(stride, row, column);
    vstore16(vload16(0, fine + at) - expanded, 0, band + at);
}

// The coarser band brought to the size of a band, bilinearly. Per axis: the parent's pixel and the weight of the next.
__kernel void enlarge(const int width, const int height, const int stride, const int parent_stride,
                      __global const float *parent, __global const int *columns, __global const float *column_weights,
                      __global const int *rows, __global const float *row_weights, __global float *out)
{
    const int row = get_global_id(0);
    if (row >= height)
        return;
    __global const float *upper = parent + plane_offset(parent_stride, rows[row], 0);
    __global const float *lower = upper + parent_stride;
    const float v = row_weights[row];
    for (int x = 0; x < width; x++) {
        const int i = columns[x];
        const float u = column_weights[x];
        const float a = upper[i] + u * (upper[i + 1] - upper[i]);
        const float b = lower[i] + u * (lower[i + 1] - lower[i]);
        out[plane_offset(stride, row, x)] = a + v * (b - a);
    }
}

// Where neighbour `number` of the pixel at 0 lies: the 3x3 around it row by row, then the parent.
INLINE __global const float *neighbour(__global const float *band, __global const float *parent, const int stride,
                                       const int number)
{
    return number < 9 ? band + (number / 3 - 1) * stride + number % 3 - 1 : parent;
}

// Sums over one row (border pixels left out) of the products of all pairs of neighbours: partial (height - 2, pairs),
// pairs (0, 0), (1, 0), (1, 1), (2, 0) ... BLOCK sums at a time, because one alone waits for its own additions.
__kernel void neighbour_products(const int width, const int height, const int stride, const int neighbours,
                                 __global const float *band, __global const float *parent, __global float *partial)
{
    const int row = get_global_id(0) + 1;
    if (row >= height - 1)
        return;
    const int at = plane_offset(stride, row, 0);
    __global float *out = partial + (row - 1) * (neighbours * (neighbours + 1) / 2);
    for (int i = 0; i < neighbours; i++)
        for (int first = 0; first <= i; first += BLOCK) {
            __global const float *a = neighbour(band, parent, stride, i) + at;
            __global const float *others[BLOCK];
            float16 sums[BLOCK];
            for (int j = 0; j < BLOCK; j++) {
                others[j] = neighbour(band, parent, stride, first + j) + at;
                sums[j] = 0.0f;
            }
            for (int column = 0; column < width; column += PIECE) {
                const float16 v = vload16(0, a + column);
                if (column > 0 && column + PIECE < width)
                    for (int j = 0; j < BLOCK; j++)
                        sums[j] += v * vload16(0, others[j] + column);
                else
                    for (int j = 0; j < BLOCK; j++)
                        sums[j] += inside_only(v * vload16(0, others[j] + column), column, 1, width - 1);
            }
            for (int j = 0; j < BLOCK && first + j <= i; j++)
                *out++ = sum_of_lanes(sums[j]);
        }
}

// The squared length, per neighbour, of each neighbourhood after `whiten` (neighbours, neighbours) makes it white.
__kernel void whitened_energy(const int width, const int height, const int stride, const int neighbours,
                              __global const float *band, __global const float *parent, __global const float *whiten,
                              __global float *energy)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int row = get_global_id(0) / pieces + 1;
    if (row >= height - 1)
        return;
    const int at = plane_offset(stride, row, (get_global_id(0) % pieces) * PIECE);
    float16 values[MOST_NEIGHBOURS];
    for (int i = 0; i < neighbours; i++)
        values[i] = vload16(0, neighbour(band, parent, stride, i) + at);
    float16 sum = 0.0f;
    for (int i = 0; i < neighbours; i++) {
        float16 white = 0.0f;
        for (int j = 0; j < neighbours; j++)
            white = whiten[i * neighbours + j] * values[j] + white;
        sum = white * white + sum;
    }
    vstore16(sum / (float)neighbours, 0, energy + at);
}

// Gain g and remaining variance v of the test's 3x3 neighbourhood as g times the reference's plus noise.
// Variances below `least` count as none: they are rounding.
typedef struct {
    float16 gain, variance;
} channel_model;

INLINE channel_model fitted(__global const float *reference, __global const float *test, const int stride,
                            const float least)
{
    // Moments about the middle pixel: small numbers, so that nothing is lost in the difference of squares.
    const float16 middle_r = vload16(0, reference), middle_t = vload16(0, test);
    float16 mean_r = 0.0f, mean_t = 0.0f, rr = 0.0f, tt = 0.0f, rt = 0.0f;
    for (int k = 0; k < 9; k++) {
        const int i = (k / 3 - 1) * stride + k % 3 - 1;
        const float16 r = vload16(0, reference + i) - middle_r, t = vload16(0, test + i) - middle_t;
        mean_r += r;
        mean_t += t;
        rr += r * r;
        tt += t * t;
        rt += r * t;
    }
    const float ninth = 1.0f / 9;
    rr = (rr - mean_r * mean_r * ninth) * ninth;
    tt = (tt - mean_t * mean_t * ninth) * ninth;
    rt = (rt - mean_r * mean_t * ninth) * ninth;
    const int16 no_reference = rr < least, no_test = tt < least;
    const float16 gain = rt / larger(rr, least);
    const float16 variance = larger(tt - gain * rt, 0.0f);
    return (channel_model){no_reference || no_test ? (float16)(0.0f) : gain,
                           no_test ? (float16)(0.0f) : (no_reference ? tt : variance)};
}

// Information weight: sum over eigenvalues e of log2(1 + ((v + (1 + g^2) n) energy e + n v) / n^2), n the noise.
// The product of the terms is taken, its exponents apart, and one logarithm of what is left.
INLINE float16 information(const channel_model m, const float16 energy, const int neighbours,
                           __global const float *eigenvalues)
{
    const float16 slope = (m.variance + (1.0f + m.gain * m.gain) * NOISE) * energy * (1.0f / (NOISE * NOISE));
    const float16 base = 1.0f + m.variance * (1.0f / NOISE);
    float16 product = 1.0f;
    int16 exponents = 0;
    for (int i = 0; i < neighbours; i++) {
        const int16 bits = as_int16(base + slope * eigenvalues[i]);
        exponents += (bits >> 23) - 127;
        product *= as_float16((bits & 0x007fffff) | 0x3f800000);
    }
    return convert_float16(exponents) + logarithm2(product);
}

// The vertical window pass of the test, and per work-item the sums of weight * contrast-structure and of weight.
__kernel void weighted_sums(const int width, const int height, const int stride, const int neighbours,
                            __global const float *moments, __global const float *rows, __global const float *taps,
                            const float c1, const float c2, __global const float *reference, __global const float *test,
                            __global const float *energy, __global const float *eigenvalues, const float least,
                            __global float *partial)
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
    float16 weighted = 0.0f, weights = 0.0f;
    for (int k = 0; k < ROWS && row + k < height - RADIUS; k++) {
        const int at = column + (row + k) * stride;
        const dissimilarity d = dissimilarity_of(vload16(0, moments + at), vload16(0, moments + at + size),
                                                 difference.row[k], square.row[k], apart.row[k], 0.0f, c1, c2);
        const channel_model model = fitted(reference + at, test + at, stride, least);
        const float16 weight = information(model, vload16(0, energy + at), neighbours, eigenvalues);
        weighted += weight - weight * d.contrast_structure;
        weights += weight;
    }
    partial[2 * id] = sum_of_lanes(inside_only(weighted, first, RADIUS, width - RADIUS));
    partial[2 * id + 1] = sum_of_lanes(inside_only(weights, first, RADIUS, width - RADIUS));
}

// SSIM on the coarsest plane, whose values reach thousands: moments about the window's own middle pixel.
// One work-item per pixel whose window is inside; ssim (height - 10, width - 10).
__kernel void coarsest_similarity(const int width, const int height, const int stride, __global const float *reference,
                                  __global const float *test, __global const float *taps, const float origin,
                                  const float c1, const float c2, __global float *ssim)
{
    const int across = width - 2 * RADIUS;
    const int id = get_global_id(0);
    const int row = id / across + RADIUS;
    if (row >= height - RADIUS)
        return;
    const int at = plane_offset(stride, row, id % across + RADIUS);
    const float middle_a = reference[at], middle_b = test[at], middle_d = middle_b - middle_a;
    float mu_a = 0.0f, mu_b = 0.0f, mu_d = 0.0f, aa = 0.0f, bb = 0.0f, dd = 0.0f;
    for (int y = -RADIUS; y <= RADIUS; y++)
        for (int x = -RADIUS; x <= RADIUS; x++) {
            const float w = taps[MIDDLE + y] * taps[MIDDLE + x];
            const float first = reference[at + y * stride + x], second = test[at + y * stride + x];
            const float a = first - middle_a, b = second - middle_b, d = (second - first) - middle_d;
            mu_a += w * a;
            mu_b += w * b;
            mu_d += w * d;
            aa += w * (a * a);
            bb += w * (b * b);
            dd += w * (d * d);
        }
    const float variances = (aa - mu_a * mu_a) + (bb - mu_b * mu_b); // as in ssim.cl
    const float m = mu_a + middle_a + origin, n = mu_b + middle_b + origin, between = mu_d + middle_d;
    const float contrast_structure = 1.0f - (dd - mu_d * mu_d) / (variances + c2);
    ssim[id] = contrast_structure * (1.0f - between * between / (m * m + n * n + c1));
}
