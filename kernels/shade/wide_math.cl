// Float math 8 wide from plain operations: PoCL calls its built-ins, and the registers are spilled around each call.
#include "common/elementary.cl"

#define LOAD8(pointer) (*(const loose_float8 *)(pointer))
#define STORE8(value, pointer) (*(loose_float8 *)(pointer) = (value))
#define LOAD_INT8(pointer) (*(const loose_int8 *)(pointer))
#define STORE_INT8(value, pointer) (*(loose_int8 *)(pointer) = (value))

// Whether any lane of a comparison's result is true.
INLINE int any_of8(int8 mask)
{
    const int4 four = mask.lo | mask.hi;
    const int2 two = four.lo | four.hi;
    return (two.x | two.y) != 0;
}

// The largest whole number not above a; |a| < 2^31.
INLINE float8 floor8(float8 a)
{
    const float8 cut = convert_float8(convert_int8(a));
    return cut - ((cut > a) ? (float8)1.0f : (float8)0.0f);
}

// 1 / sqrt(a) within 5e-6 of itself, for a > 0 (not subnormal); finite at 0. A linear guess on the bits and two steps
// of Newton's method; constant of the guess: Lomont 2003, "Fast inverse square root".
INLINE float8 inverse_sqrt8(float8 a)
{
    float8 y = as_float8(0x5f375a86 - (as_int8(a) >> 1));
    const float8 half_a = 0.5f * a;
    y = y * (1.5f - half_a * y * y);
    return y * (1.5f - half_a * y * y);
}
