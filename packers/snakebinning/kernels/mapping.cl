#include "bins.cl"

// Bin mapping (section 3.4, algorithm 1): bins with few triangles, sources, go to near bins with many, sinks.

#define ANGLE_RANGE 5    // to either side
#define HEIGHT_RANGE 200 // upwards only
#define PER_ANGLE 400    // squared bins of height that one squared bin of an angle counts for
#define FAR 0x7FFFFFFF

// map: a bin's target, -1 for one without. sinks: a bit per bin. sources: becomes the number of bins left without. The
// bin of points stays by itself: no other has their slots.
__kernel void find_sinks(int count, __global const int *used, __global const int *counts, int most, __global int *map,
                         __global uint *sinks, __global int *sources)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int bin = used[i];
    if (map[bin] >= 0)
        return;
    if (counts[bin] <= most && bin != POINTS) {
        atomic_inc(sources);
        return;
    }
    map[bin] = bin;
    atomic_or(&sinks[bin >> 5], 1u << (bin & 31));
}

// The first sink of a column from height `low` to `high`, -1 for none.
INLINE int first_sink(__global const uint *column, int low, int high)
{
    for (int word = low >> 5; word <= high >> 5; word++) {
        uint bits = column[word];
        if (word == low >> 5)
            bits &= 0xFFFFFFFFu << (low & 31);
        if (bits) {
            const int height = 32 * word + 31 - clz(bits & -bits);
            return height <= high ? height : -1;
        }
    }
    return -1;
}

// found: for each used bin without a target the nearest sink, the one with the lowest number of equally near ones.
__kernel void search_exactly(int count, __global const int *used, __global const int *map, __global const uint *sinks,
                             __global int *found)
{
    const int i = get_global_id(0);
    if (i >= count || map[used[i]] >= 0)
        return;
    const int alpha = used[i] / COLUMN / ANGLES, beta = used[i] / COLUMN % ANGLES, height = used[i] % COLUMN;
    const int high = min(height + HEIGHT_RANGE, HEIGHTS - 1);
    int nearest = FAR, target = -1;
    for (int a = max(alpha - ANGLE_RANGE, 0); a <= min(alpha + ANGLE_RANGE, ANGLES - 1); a++)
        for (int b = max(beta - ANGLE_RANGE, 0); b <= min(beta + ANGLE_RANGE, ANGLES - 1); b++) {
            const int aside = PER_ANGLE * ((a - alpha) * (a - alpha) + (b - beta) * (b - beta));
            if (aside >= nearest)
                continue;
            const int h = first_sink(sinks + (a * ANGLES + b) * WORDS, height, high);
            const int distance = aside + (h - height) * (h - height);
            if (h >= 0 && distance < nearest)
                nearest = distance, target = bin_of(a, b, h);
        }
    found[i] = target;
}

// The hierarchy of section 4: cells of 1, 2, 5 and 10 bins of each angle and 20 times as many of the height. A cell's
// key: distance of the sink nearest to its centre, above the sink's place in the cell.
#define LEVELS 4
#define NO_KEY 0xFFFFFFFFu

__constant const int SIDES[LEVELS] = {1, 2, 5, 10};
__constant const int OFFSETS[LEVELS] = {0, 30 * 30 * 75, 30 * 30 * 75 + 15 * 15 * 38,
                                        30 * 30 * 75 + 15 * 15 * 38 + 6 * 6 * 15};

typedef struct {
    int cell, a, b, h; // number, and the bin's place in it
} Place;

INLINE Place place_in(int level, int bin)
{
    const int side = SIDES[level], tall = 20 * side, across = ANGLES / side, up = (HEIGHTS + tall - 1) / tall;
    const int alpha = bin / COLUMN / ANGLES, beta = bin / COLUMN % ANGLES, height = bin % COLUMN;
    const int cell = (alpha / side * across + beta / side) * up + height / tall;
    return (Place){OFFSETS[level] + cell, alpha % side, beta % side, height % tall};
}

__kernel void add_sinks(int count, __global const int *used, __global const int *map, __global uint *keys)
{
    const int i = get_global_id(0);
    if (i >= count || map[used[i]] != used[i] || used[i] == POINTS)
        return;
    for (int level = 0; level < LEVELS; level++) {
        const int side = SIDES[level], tall = 20 * side;
        const Place p = place_in(level, used[i]);
        const int a = 2 * p.a + 1 - side, b = 2 * p.b + 1 - side, h = 2 * p.h + 1 - tall; // twice, from the centre
        const uint distance = PER_ANGLE * (a * a + b * b) + h * h;
        atomic_min(&keys[p.cell], distance << 15 | (uint)((p.a * side + p.b) * tall + p.h));
    }
}

// found: for each used bin without a target the first sink on the way up the hierarchy that is not lower than itself.
__kernel void search_hierarchy(int count, __global const int *used, __global const int *map, __global const uint *keys,
                               __global int *found)
{
    const int i = get_global_id(0);
    if (i >= count || map[used[i]] >= 0)
        return;
    const int bin = used[i], alpha = bin / COLUMN / ANGLES, beta = bin / COLUMN % ANGLES, height = bin % COLUMN;
    int target = -1;
    for (int level = 0; level < LEVELS && target < 0; level++) {
        const int side = SIDES[level], tall = 20 * side;
        const Place p = place_in(level, bin);
        const uint key = keys[p.cell];
        const int at = key & 0x7FFF, h = at % tall + height - p.h;
        if (key != NO_KEY && h >= height)
            target = bin_of(alpha - p.a + at / tall / side, beta - p.b + at / tall % side, h);
    }
    found[i] = target;
}

// Sources go to the sinks that were found for them; the others are promoted to sinks.
__kernel void apply_mapping(int count, __global const int *used, __global const int *found, __global int *map,
                            __global uint *sinks)
{
    const int i = get_global_id(0);
    if (i >= count || map[used[i]] >= 0)
        return;
    const int bin = used[i];
    map[bin] = found[i] >= 0 ? found[i] : bin;
    if (found[i] < 0)
        atomic_or(&sinks[bin >> 5], 1u << (bin & 31));
}
