// Runs of pixels that show the same triangle.
#include "common/wide.cl"

// Whether any of the 8 pixels at `row` shows another triangle than the pixel to its left.
INLINE int begins_run(__global const int *row)
{
    const int8 change = *(__global const loose_int8 *)row != *(__global const loose_int8 *)(row - 1);
    const int4 four = change.lo | change.hi;
    return (four.x | four.y | four.z | four.w) != 0;
}
