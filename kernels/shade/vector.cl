// Vectors, one per lane.
#include "shade/wide_math.cl"

typedef struct {
    floatN x, y, z;
} vectorN;

INLINE floatN dotN(vectorN a, vectorN b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

INLINE vectorN multiplyN(vectorN a, vectorN b)
{
    return (vectorN){a.x * b.x, a.y * b.y, a.z * b.z};
}

INLINE vectorN scaledN(vectorN a, floatN by)
{
    return (vectorN){a.x * by, a.y * by, a.z * by};
}

// a where share is 0, b where it is 1.
INLINE vectorN mixedN(vectorN a, vectorN b, floatN share)
{
    return (vectorN){a.x + (b.x - a.x) * share, a.y + (b.y - a.y) * share, a.z + (b.z - a.z) * share};
}

INLINE floatN positiveN(floatN a)
{
    return (a > 0.0f) ? a : (floatN)0.0f;
}

INLINE floatN largestN(floatN a, floatN b)
{
    return (a > b) ? a : b;
}

INLINE floatN absN(floatN a)
{
    return (a > 0.0f) ? a : -a;
}

// a of length 1; `otherwise` where a is zero or not finite. Scaled first, so that tiny vectors do not underflow.
INLINE vectorN normalizeN(vectorN a, vectorN otherwise)
{
    const floatN largest = largestN(largestN(absN(a.x), absN(a.y)), absN(a.z));
    const intN usable = largest > 0.0f && largest < 1e30f;
    const floatN scale = 1.0f / (usable ? largest : (floatN)1.0f);
    const floatN x = a.x * scale, y = a.y * scale, z = a.z * scale;
    const floatN inverse = inverse_sqrtN(x * x + y * y + z * z);
    const vectorN result = {usable ? x * inverse : otherwise.x, usable ? y * inverse : otherwise.y,
                            usable ? z * inverse : otherwise.z};
    return result;
}
