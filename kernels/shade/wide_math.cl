// Float math of as many samples as are shaded at once, one per lane, from plain operations: PoCL calls its built-ins,
// and the registers are spilled around each call.
#include "common/elementary.cl"

// 16 lanes fill AVX-512's registers, and two of AVX2's: while one waits for a result, the other is worked on.
// Elsewhere, on GPUs too, they would need more registers than there are. No result depends on it.
#ifdef __x86_64__
#define LANES 16
typedef float16 floatN;
typedef int16 intN;
#define as_floatN as_float16
#define as_intN as_int16
#define convert_floatN convert_float16
#define convert_intN convert_int16
#define log2_N log2_16
#define exp2_N exp2_16
#define LANE_NUMBERS ((int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))
#else
#define LANES 8
typedef float8 floatN;
typedef int8 intN;
#define as_floatN as_float8
#define as_intN as_int8
#define convert_floatN convert_float8
#define convert_intN convert_int8
#define log2_N log2_8
#define exp2_N exp2_8
#define LANE_NUMBERS ((int8)(0, 1, 2, 3, 4, 5, 6, 7))
#endif

typedef float4 __attribute__((aligned(4))) loose_float4;
typedef floatN __attribute__((aligned(4))) loose_floatN;
typedef intN __attribute__((aligned(4))) loose_intN;

#define LOADN(pointer) (*(const loose_floatN *)(pointer))
#define STOREN(value, pointer) (*(loose_floatN *)(pointer) = (value))
#define LOAD_INTN(pointer) (*(const loose_intN *)(pointer))
#define STORE_INTN(value, pointer) (*(loose_intN *)(pointer) = (value))

// Which lanes of a comparison hold, as bits; whether any does.
#if LANES == 16
INLINE uint bits_ofN(intN mask)
{
    return bits_of(mask.lo) | bits_of(mask.hi) << 8;
}

INLINE int any_ofN(intN mask)
{
    const int8 eight = mask.lo | mask.hi;
    const int4 four = eight.lo | eight.hi;
    const int2 two = four.lo | four.hi;
    return (two.x | two.y) != 0;
}
#else
INLINE uint bits_ofN(intN mask)
{
    return bits_of(mask);
}

INLINE int any_ofN(intN mask)
{
    const int4 four = mask.lo | mask.hi;
    const int2 two = four.lo | four.hi;
    return (two.x | two.y) != 0;
}
#endif

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
// floatN, the `quads` i: so that shuffles within parts, which are fast, turn four quads into columns and numbers into
// quads.
#define QUADS 4
#define QUAD_LOOP _Pragma("nounroll") // as long as each lookup is unrolled, the kernel exceeds the instruction cache
#if LANES == 16
#define OF_QUAD(load, i) load(i), load((i) + 4), load((i) + 8), load((i) + 12)
#define TO_QUADS(a) {a.s000044448888cccc, a.s111155559999dddd, a.s22226666aaaaeeee, a.s33337777bbbbffff}
#define FIRST_TWO(p, q) \
    ((float16)(p.s0, q.s0, p.s1, q.s1, p.s4, q.s4, p.s5, q.s5, p.s8, q.s8, p.s9, q.s9, p.sc, q.sc, p.sd, q.sd))
#define LAST_TWO(p, q) \
    ((float16)(p.s2, q.s2, p.s3, q.s3, p.s6, q.s6, p.s7, q.s7, p.sa, q.sa, p.sb, q.sb, p.se, q.se, p.sf, q.sf))
#define FIRST_PAIRS(p, q) ((float16)(p.s01, q.s01, p.s45, q.s45, p.s89, q.s89, p.scd, q.scd))
#define LAST_PAIRS(p, q) ((float16)(p.s23, q.s23, p.s67, q.s67, p.sab, q.sab, p.sef, q.sef))
#else
#define OF_QUAD(load, i) load(i), load((i) + 4)
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
