// For hot loops. PoCL may call its built-in functions (min, max, clamp, fabs, vload8, convert_...) instead of inlining
// them, depending on the processor, and each call spills all vector registers; operators, casts of pointers and these
// macros always stay in registers.

#define MIN(a, b) ((a) < (b) ? (a) : (b))
#define MAX(a, b) ((a) > (b) ? (a) : (b))

// For loads and stores at any address: *(loose_int8 *)pointer.
typedef int4 __attribute__((aligned(4))) loose_int4;
typedef int8 __attribute__((aligned(4))) loose_int8;
typedef float8 __attribute__((aligned(4))) loose_float8;

// Stores aligned vectors that are not read again soon past the caches, where the compiler knows how.
#ifdef __has_builtin
#if __has_builtin(__builtin_nontemporal_store)
#define STREAM(value, pointer) __builtin_nontemporal_store(value, pointer)
#endif
#endif
#ifndef STREAM
#define STREAM(value, pointer) (*(pointer) = (value))
#endif

// `static`, as everywhere beside `inline`: without it C99 provides no body for calls that are not inlined.
#define INLINE __attribute__((always_inline)) static inline

// Loops over the elements of small arrays must be unrolled, or the arrays go through memory.
#define UNROLL _Pragma("unroll")

// Which lanes of a comparison hold, as bits.
INLINE uint bits_of(const int8 mask)
{
    const int8 bits = mask & (int8)(1, 2, 4, 8, 16, 32, 64, 128);
    const int4 four = bits.lo | bits.hi;
    const int2 two = four.lo | four.hi;
    return (uint)(two.x | two.y);
}

INLINE float smallest_of(const float8 v)
{
    const float4 four = MIN(v.lo, v.hi);
    const float2 two = MIN(four.lo, four.hi);
    return MIN(two.x, two.y);
}
