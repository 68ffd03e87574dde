// What other kernels are measured against: a copy, and multiply-adds that need no memory.

// Copies `run` vectors per work-item.
__kernel void copy(const int count, const int run, __global const float16 *restrict from, __global float16 *restrict to)
{
    const int first = get_global_id(0) * run;
    const int last = min(first + run, count);
    for (int i = first; i < last; i++)
        to[i] = from[i];
}

// STEPS times x = x * a + b on CHAINS independent vectors, enough to keep the units busy while one result is awaited.
__kernel void multiply_add(const int count, const float a, const float b, __global float16 *restrict values)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    float16 x[CHAINS];
    for (int k = 0; k < CHAINS; k++)
        x[k] = values[i] + (float)k;
    for (int step = 0; step < STEPS; step++) {
#pragma unroll
        for (int k = 0; k < CHAINS; k++)
            x[k] = fma(x[k], (float16)a, (float16)b);
    }
    float16 sum = 0;
    for (int k = 0; k < CHAINS; k++)
        sum += x[k];
    values[i] = sum;
}
