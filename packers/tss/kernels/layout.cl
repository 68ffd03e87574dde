#include "common/wide.cl"

// Where bins lie, and the items in them. A shelf is a row of slots; a bin continues the last shelf with as many slots
// as fit above and beside each other, and then opens shelves of its own.

#define REGION 6 // x, y and slots per column of its part of the last shelf, slots there; y of its shelves, slots in one

// totals: items per bin. regions: (bins, REGION). used: rows of the atlas that all bins need, or -1 if a slot is wider
// than it.
__kernel void lay_out(int count, int width, __global const int *slot_width, __global const int *slot_height,
                      __global const int *totals, __global int *regions, __global int *used)
{
    if (get_global_id(0) > 0)
        return;
    int x = width, y = 0, shelf = 0; // the free end of the last shelf
    bool fits = true;
    for (int b = 0; b < count; b++) {
        if (totals[b] == 0)
            continue;
        const int w = slot_width[b], h = slot_height[b], slots = (totals[b] + 1) / 2;
        const int stack = shelf / h, here = stack > 0 && x + w <= width ? MIN(slots, (width - x) / w * stack) : 0;
        const int rest = slots - here, row = width / w;
        __global int *region = regions + REGION * b;
        region[0] = x, region[1] = y, region[2] = stack, region[3] = here, region[4] = y + shelf, region[5] = row;
        if (here > 0)
            x += (here + stack - 1) / stack * w;
        if (rest == 0)
            continue;
        fits = fits && row > 0;
        const int shelves = row > 0 ? (rest + row - 1) / row : 0;
        y += shelf + (shelves - 1) * h;
        shelf = h;
        x = (rest - (shelves - 1) * row) * w;
    }
    *used = fits ? y + shelf : -1;
}

// places: column, row << 15 and whether turned << 30 of an item's first texel, -1 without a place. Items are listed in
// the order in which they are placed.
__kernel void place_items(int count, int height, __global const int *turns, __global const int *bins,
                          __global const int *ranks, __global const int *slot_width, __global const int *slot_height,
                          __global const int *regions, __global int *places)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int item = 2 * turns[i >> 1] + (i & 1), b = bins[item];
    places[i] = -1;
    if (b < 0)
        return;
    __global const int *region = regions + REGION * b;
    const int w = slot_width[b], h = slot_height[b], turned = ranks[item] & 1;
    int slot = ranks[item] >> 1, x, y;
    if (slot < region[3]) {
        x = region[0] + slot / region[2] * w;
        y = region[1] + slot % region[2] * h;
    } else if (region[5] > 0) {
        slot -= region[3];
        x = slot % region[5] * w;
        y = region[4] + slot / region[5] * h;
    } else {
        return;
    }
    if (y + h > height)
        return;
    places[i] = (x + turned * (w - 1)) | (y + turned * (h - 1)) << 15 | turned << 30;
}
