#include "strip.cl"

// Triangles to strips, and their ranks in them to places in the atlas.

// Which triangles have no slot from this rebuild on, or from before their strip moved.
__kernel void find_new(int count, int rebuilt, __global const int *triangles, __global const int *placed_at,
                       __global const int2 *slots, __global const Strip *strips, __global uchar *is_new)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int placed = placed_at[triangles[i]];
    is_new[i] = placed < rebuilt || placed < strips[slots[triangles[i]].x].moved_at;
}

// Strips of those triangles that take a slot: new ones, and all of strips that have moved; -1 for the others.
__kernel void find_strips(int count, int frame, __global const int *triangles, __global const uchar *is_new,
                          __global const int *bins, __global const int *map, __global const int *strip_of,
                          __global const Strip *strips, __global int *classes)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int strip = strip_of[map[bins[triangles[i]]]];
    classes[i] = is_new[i] || strips[strip].moved_at == frame ? strip : -1;
}

// The part of a strip with a rank, which becomes that in the part; -1 where there are not so many slots.
INLINE int find_part(__global const Strip *strips, int strip, int *rank)
{
    for (; strip >= 0; strip = strips[strip].more) {
        const int room = strips[strip].superblock < 0 ? 0 : strips[strip].rows * strips[strip].per_row;
        if (*rank < room)
            break;
        *rank -= room;
    }
    return strip;
}

// A place: column of the tip in 1/8 texel, from the first texel's centre | line of the longest edge << 16 |
// turned << 29 | 1 << 31; 0 for none. drawn: lengths in 1/8 texel as they are in the atlas. slots: strip, or
// its part, and rank in it.
__kernel void place_triangles(int count, int frame, __global const int *triangles, __global const int *classes,
                              __global const int *ranks, __global const Strip *strips,
                              __global const int *block_corners, __global const ushort4 *lengths,
                              __global int *placed_at, __global int2 *slots, __global uint *places,
                              __global ushort4 *drawn)
{
    const int i = get_global_id(0);
    if (i >= count || classes[i] < 0)
        return;
    const int triangle = triangles[i];
    int rank = strips[classes[i]].base + ranks[i];
    const int part = find_part(strips, classes[i], &rank);
    slots[triangle] = (int2)(part < 0 ? classes[i] : part, rank);
    placed_at[triangle] = frame;
    places[triangle] = 0;
    if (part < 0)
        return;
    const Strip s = strips[part];
    const int row = rank / s.per_row, column = rank % s.per_row, turned = column & 1;
    const int x = block_corners[2 * s.superblock] + column / 2 * s.period;
    const int y = block_corners[2 * s.superblock + 1] + s.y + row * s.lines;
    const int tip8 = 8 * s.inset + s.before8;
    const int tip = 8 * x + (turned ? 8 * s.odd - tip8 : tip8), line = turned ? y + s.lines - 1 : y;
    places[triangle] = (uint)tip | (uint)line << 16 | (uint)turned << 29 | 1u << 31;
    const ushort4 own = lengths[triangle];
    int before8 = min((int)own.x, s.before8), after8 = min((int)own.y, s.after8);
    after8 += clamp(8 - before8 - after8, 0, s.after8 - after8);
    before8 += clamp(8 - before8 - after8, 0, s.before8 - before8);
    drawn[triangle] = (ushort4)(before8, after8, min((int)own.z, s.height8), 0);
}

// What a client needs of each triangle: place, before | after << 16, height, and the word of weights and roles. cuts:
// texels by which the lengths of a triangle in another bin's strip differ from its own, -1 in its own bin's.
__kernel void list_records(int count, __global const int *triangles, __global const uint *places,
                           __global const ushort4 *drawn, __global const uint *words, __global const int *bins,
                           __global const ushort4 *lengths, __global const int2 *slots, __global const Strip *strips,
                           __global uint4 *records, __global float *cuts)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int triangle = triangles[i];
    const ushort4 own = drawn[triangle];
    const ushort4 wanted = lengths[triangle];
    const bool mapped = strips[slots[triangle].x].bin != bins[triangle];
    cuts[i] = mapped ? 0.125f * (abs(wanted.x - own.x) + abs(wanted.y - own.y) + abs(wanted.z - own.z)) : -1.0f;
    const uint place = places[triangle];
    records[i] = place ? (uint4)(place, own.x | (uint)own.y << 16, own.z, words[triangle]) : (uint4)(0);
}
