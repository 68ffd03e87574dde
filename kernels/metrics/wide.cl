// 16-wide elementary functions, because PoCL's own run lane by lane, and the layout of planes that the metrics share.
//
// A plane is float (height, stride): 16 pixels of margin, the row, room up to a multiple of 32, 16 pixels of margin.
// Work-items are pieces of 16 pixels of a row, or the pieces of ROWS rows below each other.
#include "common/wide.cl"

#define PIECE 16
#define MARGIN 16
#define ROWS 4

INLINE int plane_offset(const int stride, const int row, const int column)
{
    return row * stride + MARGIN + column;
}

INLINE float16 lane_numbers(void)
{
    return (float16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
}

// `value` in the lanes whose column is in first..end-1, 0 elsewhere (also where the value is not a number).
INLINE float16 inside_only(const float16 value, const int column, const int first, const int end)
{
    const float16 x = lane_numbers() + (float)column;
    return (x >= (float)first) && (x < (float)end) ? value : (float16)(0.0f);
}

INLINE float sum_of_lanes(const float16 v)
{
    const float8 eight = v.lo + v.hi;
    const float4 four = eight.lo + eight.hi;
    return (four.x + four.y) + (four.z + four.w);
}

INLINE float16 larger(const float16 a, const float16 b)
{
    return a > b ? a : b;
}

INLINE float16 smaller(const float16 a, const float16 b)
{
    return a < b ? a : b;
}

// Cube root of x >= 1e-6: Newton's iteration for its inverse, from a third of the exponent (error 3e-7).
INLINE float16 cube_root(const float16 x)
{
    float16 y = as_float16(1419967116 - convert_int16(convert_float16(as_int16(x)) * (1.0f / 3.0f)));
    for (int i = 0; i < 3; i++)
        y *= (4.0f - x * (y * y * y)) * (1.0f / 3.0f);
    return x * (y * y);
}

// Base 2 logarithm of positive normal x: exponent, plus the series of 2 artanh(t) of the mantissa (error 2e-7).
INLINE float16 logarithm2(const float16 x)
{
    const int16 bits = as_int16(x) - 0x3f3504f3; // the mantissa comes out between sqrt(1/2) and sqrt(2)
    const float16 exponent = convert_float16(bits >> 23);
    const float16 mantissa = as_float16((bits & 0x007fffff) + 0x3f3504f3);
    const float16 t = (mantissa - 1.0f) / (mantissa + 1.0f);
    const float16 s = t * t;
    const float16 series = 1.0f + s * (1.0f / 3 + s * (1.0f / 5 + s * (1.0f / 7 + s * (1.0f / 9))));
    return exponent + 2.8853900818f * t * series;
}

// 2 to the power x, for x in -126..126 (relative error 2e-7).
INLINE float16 power_of_2(const float16 x)
{
    const float16 clamped = smaller(larger(x, (float16)(-126.0f)), (float16)(126.0f));
    const float16 shifted = clamped + 12582912.0f; // 1.5 * 2^23: rounds to a whole number
    const float16 f = (clamped - (shifted - 12582912.0f)) * 0.69314718056f;
    const float16 series =
        1.0f + f * (1.0f + f * (1.0f / 2 + f * (1.0f / 6 + f * (1.0f / 24 + f * (1.0f / 120 + f * (1.0f / 720))))));
    return series * as_float16((as_int16(shifted) << 23) + 0x3f800000);
}

// x to the power y for x >= 0; 0 stays 0.
INLINE float16 power(const float16 x, const float16 y)
{
    const float16 least = 1e-30f;
    return x > least ? power_of_2(y * logarithm2(larger(x, least))) : (float16)(0.0f);
}

// Offset of a row; the first and last stand for those beyond the border.
INLINE int row_offset(const int row, const int height, const int stride)
{
    return clamp(row, 0, height - 1) * stride;
}

typedef struct {
    float16 row[ROWS];
} wide_rows;

// A filter down the columns, for ROWS rows from `row` on, which share what they load. `taps` points to the middle of
// radius taps to either side and ROWS - 1 zeros beyond them.
INLINE wide_rows filtered_down(__global const float *plane, const int row, const int height, const int stride,
                               const int radius, __global const float *taps)
{
    float16 a = 0.0f, b = 0.0f, c = 0.0f, d = 0.0f;
    for (int k = -radius; k < radius + ROWS; k++) {
        const float16 v = vload16(0, plane + row_offset(row + k, height, stride));
        a = taps[k] * v + a;
        b = taps[k - 1] * v + b;
        c = taps[k - 2] * v + c;
        d = taps[k - 3] * v + d;
    }
    return (wide_rows){{a, b, c, d}};
}
