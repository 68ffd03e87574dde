// A tile's bins: in `entries`, one run of record numbers from each chunk of the set-up, in triangle order.
#include "common/wide.cl"
#define BATCH 512 // numbers

typedef struct {
    __global const int *entries;
    __global const int2 *bins; // of the tile: begin and end, chunk by chunk
    int chunks, chunk, taken;  // where it is read: the chunk, and how many of its numbers were
} Bins;

INLINE Bins bins_of(const int tile, const int chunks, __global const int2 *bins, __global const int *entries)
{
    return (Bins){entries, bins + (size_t)tile * chunks, chunks, 0, 0};
}

// The next numbers, of which there are BATCH, or fewer at the end. Returns how many.
INLINE int next_batch(Bins *bins, int *numbers)
{
    int count = 0;
    while (bins->chunk < bins->chunks && count < BATCH) {
        const int2 bin = bins->bins[bins->chunk];
        const int begin = bin.x + bins->taken, end = MIN(bin.y, begin + (BATCH - count));
        for (int i = begin; i < end; i++)
            numbers[count++] = bins->entries[i];
        bins->taken = end - bin.x;
        if (end == bin.y) {
            bins->chunk++;
            bins->taken = 0;
        }
    }
    return count;
}
