// Shared by all kernels: vector widths, triangle fetch.
#include "common/wide.cl"

// Corner `corner` (0..2) of triangle `triangle`; positions are packed float3 (V, 3), indices int3 (T, 3).
INLINE float3 corner_position(__global const float *positions, __global const int *indices, int triangle, int corner)
{
    return vload3(indices[3 * triangle + corner], positions);
}
