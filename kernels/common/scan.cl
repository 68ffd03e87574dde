// Exclusive prefix sum in two passes over fixed runs of the input: sums per run, then a walk of each run from its base.
// Integers only, so the cut into runs changes no result.

__kernel void run_sums(const int count, const int run, __global const int *values, __global long *sums)
{
    const int id = get_global_id(0);
    if (id > (count - 1) / run)
        return;
    const int first = id * run;
    const int end = min(first + run, count);
    long8 wide = 0;
    int i = first;
    for (; i + 8 <= end; i += 8)
        wide += convert_long8(vload8(0, values + i));
    const long4 four = wide.lo + wide.hi;
    long sum = four.x + four.y + four.z + four.w;
    for (; i < end; i++)
        sum += values[i];
    sums[id] = sum;
}

__kernel void run_offsets(const int count, const int run, __global const int *values, __global const int *bases,
                          __global int *offsets)
{
    const int id = get_global_id(0);
    if (id > (count - 1) / run)
        return;
    const int first = id * run;
    const int end = min(first + run, count);
    int sum = bases[id];
    for (int i = first; i < end; i++) {
        const int value = values[i];
        offsets[i] = sum;
        sum += value;
    }
}
