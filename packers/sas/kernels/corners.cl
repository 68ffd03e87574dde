#include "layout.cl"

// Where the corners of a client's triangles lie in the atlas, from their patches' location words.

// words: per patch. points: u, v of the corners of each code (15 codes: role and rotation), three corners each.
__kernel void locate_corners(int count, __global const int *patches, __global const uchar *codes,
                             __global const uint *words, __global const float *points, __global float *corners)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const uint word = words[patches[i]];
    const Block block = unpack_location(word);
    const float2 first = (float2)(block.x, block.y) + 0.5f;
    const float2 steps = (float2)((1 << block.w) - 1, (1 << block.h) - 1);
    for (int k = 0; k < 3; k++) {
        const float2 texel = word ? first + steps * vload2(3 * codes[i] + k, points) : (float2)(NAN);
        vstore2(texel, 3 * i + k, corners);
    }
}
