// Lists as they are sent: the header and the links of the thesis (section 2.2) around the WORDS of every fragment.
// SHUFFLED: field by field and byte by byte instead of fragment by fragment; see wire.py.
#include "common/wide.cl"

#define FIELDS (WORDS + 1)

#if SHUFFLED
#define FIRST(fragment) 1
#define NEXT(fragment) 1
#else
#define FIRST(fragment) ((fragment) + 1)
#define NEXT(fragment) ((fragment) + 2)
#endif

// Field `field` of record `at`, of `count` records that have `fields` of them.
INLINE void put(__global uint *records, const size_t count, const int fields, const size_t at, const int field,
                const uint word)
{
#if SHUFFLED
    __global uchar *planes = (__global uchar *)(records + count * field);
    planes[at] = (uchar)word;
    planes[count + at] = (uchar)(word >> 8);
    planes[2 * count + at] = (uchar)(word >> 16);
    planes[3 * count + at] = (uchar)(word >> 24);
#else
    records[at * fields + field] = word;
#endif
}

// Every fragment as if another one of its pixel followed.
__kernel void write_fragments(const int count, __global const uint *rows, const int start, __global uint *wire)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    UNROLL
    for (int word = 0; word < WORDS; word++)
        put(wire + start, count, FIELDS, i, word, rows[(size_t)i * WORDS + word]);
    put(wire + start, count, FIELDS, i, WORDS, NEXT(i));
}

// Where the lists begin, and where they end; `start`: of the header, which the fragments follow.
__kernel void write_ends(const int pixels, const int count, __global const int *offsets, const int start,
                         __global uint *wire)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    const int first = offsets[pixel], end = offsets[pixel + 1];
    put(wire + start, pixels, 1, pixel, 0, first < end ? FIRST(first) : 0);
    if (first < end)
        put(wire + start + pixels, count, FIELDS, end - 1, WORDS, 0);
}
