// A polynomial, 8 wide, and an integer hash of each value's place: what every other kernel relies on.

#define DEGREE 12

__kernel void smoke(int steps, __global const float *x, __global const float *coefficients, __global float *values,
                    __global uint *hashes)
{
    int step = get_global_id(0);
    if (step >= steps)
        return;
    float8 at = vload8(step, x);
    float8 sum = (float8)(coefficients[DEGREE]);
    for (int power = DEGREE - 1; power >= 0; power--)
        sum = sum * at + (float8)(coefficients[power]);
    vstore8(sum, step, values);
    uint8 place = (uint8)((uint)step * 8u) + (uint8)(0, 1, 2, 3, 4, 5, 6, 7);
    place = (place ^ (place >> 7)) * 0x9E3779B1u;
    vstore8(place ^ rotate(place, (uint8)(13)), step, hashes);
}
