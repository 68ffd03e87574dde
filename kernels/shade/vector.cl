// Vectors of 8 lanes.
#include "shade/wide_math.cl"

typedef struct {
    float8 x, y, z;
} vector8;

INLINE float8 dot8(vector8 a, vector8 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

INLINE vector8 multiply8(vector8 a, vector8 b)
{
    return (vector8){a.x * b.x, a.y * b.y, a.z * b.z};
}

INLINE vector8 scaled8(vector8 a, float8 by)
{
    return (vector8){a.x * by, a.y * by, a.z * by};
}

// a where share is 0, b where it is 1.
INLINE vector8 mixed8(vector8 a, vector8 b, float8 share)
{
    return (vector8){a.x + (b.x - a.x) * share, a.y + (b.y - a.y) * share, a.z + (b.z - a.z) * share};
}

INLINE float8 positive8(float8 a)
{
    return (a > 0.0f) ? a : (float8)0.0f;
}

INLINE float8 largest8(float8 a, float8 b)
{
    return (a > b) ? a : b;
}

INLINE float8 abs8(float8 a)
{
    return (a > 0.0f) ? a : -a;
}

// a of length 1; `otherwise` where a is zero or not finite. Scaled first, so that tiny vectors do not underflow.
INLINE vector8 normalize8(vector8 a, vector8 otherwise)
{
    const float8 largest = largest8(largest8(abs8(a.x), abs8(a.y)), abs8(a.z));
    const int8 usable = largest > 0.0f && largest < 1e30f;
    const float8 scale = 1.0f / (usable ? largest : (float8)1.0f);
    const float8 x = a.x * scale, y = a.y * scale, z = a.z * scale;
    const float8 inverse = inverse_sqrt8(x * x + y * y + z * z);
    const vector8 result = {usable ? x * inverse : otherwise.x, usable ? y * inverse : otherwise.y,
                            usable ? z * inverse : otherwise.z};
    return result;
}
