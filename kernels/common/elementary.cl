// Elementary functions from plain operations, which IEEE 754 defines: runtimes differ in the last places of their
// built-ins log2, exp2 and atan2, and in the order in which dot and length add. Coefficients: minimax over the reduced
// range, by iteratively reweighted least squares.
#include "common/wide.cl"

// log2 x for normal x > 0, within 3 units of the last place of max(|log2 x|, 2^-10): x = 2^e m, sqrt(1/2) <= m <
// sqrt(2).
#define DEFINE_LOG2(NAME, FLOAT, INT, AS_FLOAT, AS_INT, CONVERT_FLOAT) \
    INLINE FLOAT NAME(const FLOAT x)                                   \
    {                                                                  \
        const INT exponent = (AS_INT(x) - 0x3f3504f3) >> 23;           \
        const FLOAT f = AS_FLOAT(AS_INT(x) - (exponent << 23)) - 1.0f; \
        FLOAT p = 0.12926393747f * f - 0.20893365145f;                 \
        p = p * f + 0.21521231532f;                                    \
        p = p * f - 0.23867571354f;                                    \
        p = p * f + 0.28793910146f;                                    \
        p = p * f - 0.36071625352f;                                    \
        p = p * f + 0.48091027141f;                                    \
        p = p * f - 0.72134721279f;                                    \
        p = p * f + 1.44269502163f;                                    \
        return CONVERT_FLOAT(exponent) + f * p;                        \
    }
DEFINE_LOG2(log2_1, float, int, as_float, as_int, convert_float)
DEFINE_LOG2(log2_8, float8, int8, as_float8, as_int8, convert_float8)

// 2^x for -126 <= x < 127, within 2 units of the last place; what is below counts as -126.
#define DEFINE_EXP2(NAME, FLOAT, INT, AS_FLOAT, CONVERT_FLOAT, CONVERT_INT) \
    INLINE FLOAT NAME(const FLOAT x)                                        \
    {                                                                       \
        const FLOAT y = (x > -126.0f) ? x : (FLOAT) - 126.0f;               \
        const INT whole = CONVERT_INT(y + 126.5f) - 126;                    \
        const FLOAT f = y - CONVERT_FLOAT(whole);                           \
        FLOAT p = 0.00015478021f * f + 0.00134004315f;                      \
        p = p * f + 0.00961799454f;                                         \
        p = p * f + 0.05550327150f;                                         \
        p = p * f + 0.24022652209f;                                         \
        p = p * f + 0.69314718246f;                                         \
        p = p * f + 1.0f;                                                   \
        return p * AS_FLOAT((whole + 127) << 23);                           \
    }
DEFINE_EXP2(exp2_8, float8, int8, as_float8, convert_float8, convert_int8)

// The angle of (x, y) in -pi..pi, within 4 units of the last place of pi; 0 for the zero vector.
INLINE float8 atan2_8(const float8 y, const float8 x)
{
    const float8 across = (x < 0.0f) ? -x : x, up = (y < 0.0f) ? -y : y;
    const int8 steep = up > across;
    const float8 long_side = steep ? up : across, short_side = steep ? across : up;
    const float8 t = short_side / ((long_side > 0.0f) ? long_side : (float8)1.0f), s = t * t;
    float8 p = 0.00290354621f * s - 0.01628298312f;
    p = p * s + 0.04303932935f;
    p = p * s - 0.07533672452f;
    p = p * s + 0.10654675961f;
    p = p * s - 0.14207133651f;
    p = p * s + 0.19993053377f;
    p = p * s - 0.33333092928f;
    p = t + t * (p * s);
    p = steep ? (float8)1.57079637f - p : p;
    p = (x < 0.0f) ? (float8)3.14159274f - p : p;
    return (y < 0.0f) ? -p : p;
}

INLINE float dot2(const float2 a, const float2 b)
{
    return a.x * b.x + a.y * b.y;
}

INLINE float dot3(const float3 a, const float3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

INLINE float dot4(const float4 a, const float4 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w;
}

INLINE float3 cross3(const float3 a, const float3 b)
{
    return (float3)(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
