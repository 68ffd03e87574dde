// For hot loops. PoCL may call its built-in functions (min, max, clamp, fabs, vload8, convert_...) instead of inlining
// them, depending on the processor, and each call spills all vector registers; operators, casts of pointers and these
// macros always stay in registers.

#define LESSER(a, b) ((a) < (b) ? (a) : (b))
#define GREATER(a, b) ((a) > (b) ? (a) : (b))

// For loads and stores of 8 values at any address: *(loose_int8 *)pointer.
typedef int8 __attribute__((aligned(4))) loose_int8;
typedef float8 __attribute__((aligned(4))) loose_float8;

#define INLINE __attribute__((always_inline)) inline
