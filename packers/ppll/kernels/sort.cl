// Sorting the numbers of one pixel's fragments by (key, number): no two compare equal, so the order is the only one.
#include "common/wide.cl"

INLINE void sort_numbers(__global int *numbers, const int count, __global const float *keys)
{
    int gap = count > 16 ? count / 2 : 1;
    for (; count > 1; gap = gap * 5 / 11 > 1 ? gap * 5 / 11 : 1) {
        for (int i = gap; i < count; i++) {
            const int number = numbers[i];
            const float key = keys[number];
            int j = i;
            for (; j >= gap; j -= gap) {
                const int other = numbers[j - gap];
                if (keys[other] < key || (keys[other] == key && other < number))
                    break;
                numbers[j] = other;
            }
            numbers[j] = number;
        }
        if (gap == 1)
            break;
    }
}
