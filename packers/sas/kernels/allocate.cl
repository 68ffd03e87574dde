#include "common/wide.cl"
#include "layout.cl"

// Persistent allocation of blocks in three phases: request, provision, assign. `top` is log2 of a superblock's side.

INLINE int class_of_word(uint word, int top)
{
    const Block block = unpack_location(word);
    return size_class(block.w, block.h, top);
}

// wanted: the class of the block a patch needs, -1 if it has one of that size. released: the class of the block it
// gives up for it, -1 if none.
__kernel void request(int count, __global const int *patches, __global const int *sizes, int bias, int top,
                      __global const uint *words, __global int *wanted, __global int *released)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int w = level_at(sizes[i] & 0xFF, bias, top), h = level_at(sizes[i] >> 8, bias, top);
    const int now = size_class(w, h, top);
    const uint word = words[patches[i]];
    const int held = word ? class_of_word(word, top) : -1;
    wanted[i] = held == now ? -1 : now;
    released[i] = held == now ? -1 : held;
}

// Advances each class's superblocks by what its requests need beyond its free slots, in the order of classes.
// used: slots ever handed out, owned: superblocks, bases: `used` before this call, all per class. table (classes,
// total): the superblocks of a class in order; ordinals (total): the inverse. state[0]: superblocks taken, state[1]: 1
// if they did not suffice.
__kernel void provision(int top, int total, __global const int *requests, __global const int *free_slots,
                        __global int *used, __global int *owned, __global int *bases, __global int *table,
                        __global int *ordinals, __global int *state)
{
    if (get_global_id(0) > 0)
        return;
    state[1] = 0;
    for (int h = 0; h <= top; h++)
        for (int w = 0; w <= top; w++) {
            const int c = size_class(w, h, top), shift = 2 * top - w - h;
            bases[c] = used[c];
            const int end = used[c] + max(0, requests[c] - free_slots[c]);
            while (owned[c] << shift < end && state[0] < total) {
                ordinals[state[0]] = owned[c];
                table[c * total + owned[c]++] = state[0]++;
            }
            used[c] = min(end, owned[c] << shift);
            if (used[c] < end)
                state[1] = 1;
        }
}

// Free slots are taken from the end of a class's part of the pool, new ones in order.
__kernel void assign(int count, __global const int *patches, __global const int *wanted, __global const int *ranks,
                     int top, int total, int columns, __global const int *bases, __global const int *owned,
                     __global const int *table, __global const int *free_slots, __global const int *pool_starts,
                     __global const int *pool, __global uint *words)
{
    const int i = get_global_id(0);
    if (i >= count || wanted[i] < 0)
        return;
    const int c = wanted[i], w = c % (top + 1), h = c / (top + 1), shift = 2 * top - w - h;
    const int fresh = ranks[i] - free_slots[c];
    const int slot = fresh < 0 ? pool[pool_starts[c] - fresh - 1] : bases[c] + fresh;
    uint word = 0;
    if (slot >> shift < owned[c]) {
        const int superblock = table[c * total + (slot >> shift)], inside = slot & ((1 << shift) - 1);
        Block block;
        block.x = (superblock % columns << top) + ((inside & ((1 << (top - w)) - 1)) << w);
        block.y = (superblock / columns << top) + (inside >> (top - w) << h);
        block.w = w;
        block.h = h;
        word = pack_location(block);
    }
    words[patches[i]] = word;
}

// released: the class of the block of each patch that was visible before and is not now, -1 for the others.
__kernel void release_hidden(int count, __global const int *patches, __global const int *members,
                             __global const int *marks, int mark, int top, __global const uint *words,
                             __global int *released)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int3 m = vload3(patches[i], members);
    const bool visible =
        (m.x >= 0 && marks[m.x] == mark) || (m.y >= 0 && marks[m.y] == mark) || (m.z >= 0 && marks[m.z] == mark);
    const uint word = words[patches[i]];
    released[i] = visible || !word ? -1 : class_of_word(word, top);
}

// Moves what is left of each class's free slots to the pool's new layout.
__kernel void carry_pool(int classes, __global const int *free_slots, __global const int *old_starts,
                         __global const int *old_pool, __global const int *starts, __global int *pool)
{
    const int c = get_global_id(0);
    if (c >= classes)
        return;
    for (int k = 0; k < free_slots[c]; k++)
        pool[starts[c] + k] = old_pool[old_starts[c] + k];
}

// Writes released slots after the free ones; the patch has no block any more.
__kernel void recycle(int count, __global const int *patches, __global const int *released, __global const int *ranks,
                      int top, int columns, __global const int *ordinals, __global const int *free_slots,
                      __global const int *starts, __global int *pool, __global uint *words)
{
    const int i = get_global_id(0);
    if (i >= count || released[i] < 0)
        return;
    const int c = released[i];
    const Block block = unpack_location(words[patches[i]]);
    const int mask = (1 << top) - 1;
    const int superblock = (block.y >> top) * columns + (block.x >> top);
    const int inside = ((block.y & mask) >> block.h << (top - block.w)) + ((block.x & mask) >> block.w);
    const int slot = (ordinals[superblock] << (2 * top - block.w - block.h)) + inside;
    pool[starts[c] + free_slots[c] + ranks[i]] = slot;
    words[patches[i]] = 0;
}

__kernel void read_words(int count, __global const int *patches, __global const uint *words, __global uint *found)
{
    const int i = get_global_id(0);
    if (i < count)
        found[i] = words[patches[i]];
}
