// Float math of as many samples as are shaded at once, one per lane, from plain operations: PoCL calls its built-ins,
// and the registers are spilled around each call.
#include "common/elementary.cl"

// Most of the time goes by waiting for results, so that 32 lanes, in two of AVX-512's registers or four of AVX2's, are
// faster than one register's. Elsewhere, on GPUs too, they would need more registers than there are, and OpenCL has no
// vectors of 32. No result depends on it.
#ifndef LANES
#if defined(__x86_64__) && defined(__clang__)
#define LANES 32
#else
#define LANES 8
#endif
#endif

#if LANES == 32
typedef float __attribute__((ext_vector_type(LANES))) floatN;
typedef int __attribute__((ext_vector_type(LANES))) intN;
typedef ushort __attribute__((ext_vector_type(LANES))) ushortN;
#define as_floatN(x) __builtin_astype(x, floatN)
#define as_intN(x) __builtin_astype(x, intN)
#define convert_floatN(x) __builtin_convertvector(x, floatN)
#define convert_intN(x) __builtin_convertvector(x, intN)
#define CALLED __attribute__((noinline)) static // what is called several times, where code is large
#else
typedef float8 floatN;
typedef int8 intN;
typedef ushort8 ushortN;
#define as_floatN as_float8
#define as_intN as_int8
#define convert_floatN convert_float8
#define convert_intN convert_int8
#define CALLED INLINE
#endif
DEFINE_LOG2(log2_N, floatN, intN, as_floatN, as_intN, convert_floatN)
DEFINE_EXP2(exp2_N, floatN, intN, as_floatN, convert_floatN, convert_intN)

typedef float4 __attribute__((aligned(4))) loose_float4;
typedef floatN __attribute__((aligned(4))) loose_floatN;
typedef intN __attribute__((aligned(4))) loose_intN;

#define LOADN(pointer) (*(const loose_floatN *)(pointer))
#define STOREN(value, pointer) (*(loose_floatN *)(pointer) = (value))
#define LOAD_INTN(pointer) (*(const loose_intN *)(pointer))
#define STORE_INTN(value, pointer) (*(loose_intN *)(pointer) = (value))

// Which lanes of a comparison hold, as bits.
INLINE uint bits_ofN(intN mask)
{
#if LANES == 32
    return bits_of(mask.lo.lo) | bits_of(mask.lo.hi) << 8 | bits_of(mask.hi.lo) << 16 | bits_of(mask.hi.hi) << 24;
#else
    return bits_of(mask);
#endif
}

// Whether any does.
INLINE int any_ofN(intN mask)
{
#if LANES == 32
    const int16 sixteen = mask.lo | mask.hi;
    const int8 eight = sixteen.lo | sixteen.hi;
#else
    const int8 eight = mask;
#endif
    const int4 four = eight.lo | eight.hi;
    const int2 two = four.lo | four.hi;
    return (two.x | two.y) != 0;
}

// The largest whole number not above a; |a| < 2^31.
INLINE floatN floorN(floatN a)
{
    const floatN cut = convert_floatN(convert_intN(a));
    return cut - ((cut > a) ? (floatN)1.0f : (floatN)0.0f);
}

// 1 / sqrt(a) within 5e-6 of itself, for a > 0 (not subnormal); finite at 0. A linear guess on the bits and two steps
// of Newton's method; constant of the guess: Lomont 2003, "Fast inverse square root".
INLINE floatN inverse_sqrtN(floatN a)
{
    floatN y = as_floatN(0x5f375a86 - (as_intN(a) >> 1));
    const floatN half_a = 0.5f * a;
    y = y * (1.5f - half_a * y * y);
    return y * (1.5f - half_a * y * y);
}

// What lanes load from memory comes as a float4 each. Those of the lanes i, i + 4, i + 8, ... are the parts of one
// floatN, the quad i: shuffles within parts, which are fast, turn the four quads into columns and numbers into quads.
#define QUADS 4
#define QUAD_LOOP _Pragma("nounroll") // unrolled it exceeds the instruction cache
#if LANES == 32
#define PARTS(a, b, c, d)                                                                                       \
    a, b, c, d, a + 4, b + 4, c + 4, d + 4, a + 8, b + 8, c + 8, d + 8, a + 12, b + 12, c + 12, d + 12, a + 16, \
        b + 16, c + 16, d + 16, a + 20, b + 20, c + 20, d + 20, a + 24, b + 24, c + 24, d + 24, a + 28, b + 28, \
        c + 28, d + 28
#define LANE_NUMBERS ((intN)(PARTS(0, 1, 2, 3)))
#define OF_QUAD(load, i) \
    load(i), load(i + 4), load(i + 8), load(i + 12), load(i + 16), load(i + 20), load(i + 24), load(i + 28)
#define QUAD(a, i) __builtin_shufflevector(a, a, PARTS(i, i, i, i))
#define TO_QUADS(a) {QUAD(a, 0), QUAD(a, 1), QUAD(a, 2), QUAD(a, 3)}
#define FIRST_TWO(p, q) __builtin_shufflevector(p, q, PARTS(0, LANES, 1, LANES + 1))
#define LAST_TWO(p, q) __builtin_shufflevector(p, q, PARTS(2, LANES + 2, 3, LANES + 3))
#define FIRST_PAIRS(p, q) __builtin_shufflevector(p, q, PARTS(0, 1, LANES, LANES + 1))
#define LAST_PAIRS(p, q) __builtin_shufflevector(p, q, PARTS(2, 3, LANES + 2, LANES + 3))
#else
#define LANE_NUMBERS ((int8)(0, 1, 2, 3, 4, 5, 6, 7))
#define OF_QUAD(load, i) load(i), load(i + 4)
#define TO_QUADS(a) {a.s00004444, a.s11115555, a.s22226666, a.s33337777}
#define FIRST_TWO(p, q) ((float8)(p.s0, q.s0, p.s1, q.s1, p.s4, q.s4, p.s5, q.s5))
#define LAST_TWO(p, q) ((float8)(p.s2, q.s2, p.s3, q.s3, p.s6, q.s6, p.s7, q.s7))
#define FIRST_PAIRS(p, q) ((float8)(p.s01, q.s01, p.s45, q.s45))
#define LAST_PAIRS(p, q) ((float8)(p.s23, q.s23, p.s67, q.s67))
#endif

// Four floats from each of the lanes' places in a table.
INLINE floatN loaded_quads(__global const float *table, const int *places, int i)
{
#define FOUR_FLOATS(lane) *(__global const loose_float4 *)(table + places[lane])
    return (floatN)(OF_QUAD(FOUR_FLOATS, i));
#undef FOUR_FLOATS
}

// The lanes' float4, as columns.
INLINE void columns_of(const floatN *quads, floatN *columns)
{
    const floatN xy01 = FIRST_TWO(quads[0], quads[1]), xy23 = FIRST_TWO(quads[2], quads[3]);
    const floatN zw01 = LAST_TWO(quads[0], quads[1]), zw23 = LAST_TWO(quads[2], quads[3]);
    columns[0] = FIRST_PAIRS(xy01, xy23);
    columns[1] = LAST_PAIRS(xy01, xy23);
    columns[2] = FIRST_PAIRS(zw01, zw23);
    columns[3] = LAST_PAIRS(zw01, zw23);
}
