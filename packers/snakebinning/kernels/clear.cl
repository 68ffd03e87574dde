#include "strip.cl"

// What is left of a strip, in its average colour (section 3.8). Texels keep alpha 0: nothing was shaded there.

__kernel void clear_strips(int count, __global const Strip *strips, __global const int *blocks, int width,
                           __global uchar4 *atlas)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const Strip s = strips[i];
    if (s.bin < 0 || s.superblock < 0)
        return;
    const int across = blocks[3 * s.superblock + 2], lines = s.rows * s.lines;
    __global uchar4 *first = atlas + (size_t)(blocks[3 * s.superblock + 1] + s.y) * width + blocks[3 * s.superblock];
    ulong4 sum = 0;
    for (int line = 0; line < lines; line++)
        for (int k = 0; k < across; k++) {
            const uchar4 texel = first[(size_t)line * width + k];
            sum += texel.w ? (ulong4)(texel.x, texel.y, texel.z, 1) : (ulong4)(0);
        }
    const ulong total = sum.w ? sum.w : 1;
    const uchar4 mean = convert_uchar4((sum + total / 2) / total) * (uchar4)(1, 1, 1, 0);
    for (int line = 0; line < lines; line++)
        for (int k = 0; k < across; k++)
            if (!first[(size_t)line * width + k].w)
                first[(size_t)line * width + k] = mean;
}
