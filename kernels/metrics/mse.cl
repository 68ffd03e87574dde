// Squared error of sRGB values, in whole numbers.

#include "metrics/colour.cl"

// The sum over the 16 pixels of a piece and the three channels: at most 48 * 255^2.
__kernel void squared_error(const int width, const int height, __global const uint *test,
                            __global const uint *reference, __global int *partial)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int id = get_global_id(0);
    const int row = id / pieces;
    if (row >= height)
        return;
    const int column = (id % pieces) * PIECE;
    const uint16 a = load_pixels(test, width, row, column), b = load_pixels(reference, width, row, column);
    float16 sum = 0.0f;
    for (int k = 0; k < 3; k++) {
        const float16 d = channel(a, k) - channel(b, k);
        sum += d * d;
    }
    partial[id] = convert_int(sum_of_lanes(inside_only(sum, column, 0, width)));
}
