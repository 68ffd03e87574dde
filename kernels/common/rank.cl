// Rank of each item among those of its class, in list order, by counting in runs: no atomic decides an order.

__kernel void count_classes(int count, int run, int runs, int class_count, __global const int *classes,
                            __global int *table)
{
    const int r = get_global_id(0);
    if (r >= runs)
        return;
    __global int *row = table + r * class_count;
    for (int c = 0; c < class_count; c++)
        row[c] = 0;
    const int end = min(count, (r + 1) * run);
    for (int i = r * run; i < end; i++)
        if (classes[i] >= 0)
            row[classes[i]]++;
}

// Per class, counts become the number of items in earlier runs.
__kernel void scan_runs(int runs, int class_count, __global int *table, __global int *totals)
{
    const int c = get_global_id(0);
    if (c >= class_count)
        return;
    int sum = 0;
    for (int r = 0; r < runs; r++) {
        const int items = table[r * class_count + c];
        table[r * class_count + c] = sum;
        sum += items;
    }
    totals[c] = sum;
}

__kernel void rank_items(int count, int run, int runs, int class_count, __global const int *classes,
                         __global int *table, __global int *ranks)
{
    const int r = get_global_id(0);
    if (r >= runs)
        return;
    __global int *row = table + r * class_count;
    const int end = min(count, (r + 1) * run);
    for (int i = r * run; i < end; i++)
        ranks[i] = classes[i] >= 0 ? row[classes[i]]++ : -1;
}
