#include "common/elementary.cl"

// log2 |y|, 2^x and the angle of (x, y), 8 at a time.
__kernel void elementary(const int groups, __global const float8 *x, __global const float8 *y, __global float8 *log2_y,
                         __global float8 *exp2_x, __global float8 *angle)
{
    const int i = get_global_id(0);
    if (i >= groups)
        return;
    log2_y[i] = log2_8((y[i] < 0.0f) ? -y[i] : y[i]);
    exp2_x[i] = exp2_8(x[i]);
    angle[i] = atan2_8(y[i], x[i]);
}
