#include "piece.cl"

// inverse: inverse depths of the three corners, and 0.
__kernel void invert_depths(int count, __global const float *depths, __global const int *pieces, float scale,
                            __global float *inverse)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const float3 w = inverse_depths(vload4(i, depths), pieces[i], scale);
    vstore4((float4)(w, 0.0f), i, inverse);
}
