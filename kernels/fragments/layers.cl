// Blended triangles in front of a picture of opaque ones: their numbers, and what is seen of both.

// A little below 1/255, so that what contributes exactly that is kept whatever the rounding.
#define LEAST (0.999f / 255.0f)

// numbers[ids[i]] in place of ids[i]; what is negative stays.
__kernel void renumber(const int count, __global const int *numbers, __global int *ids)
{
    const int i = get_global_id(0);
    if (i < count && ids[i] >= 0)
        ids[i] = numbers[ids[i]];
}

// 0, 1, 2 ...
__kernel void count_up(const int count, __global int *numbers)
{
    const int i = get_global_id(0);
    if (i < count)
        numbers[i] = i;
}

// flags[id] = 1 for the triangles whose colour makes up 1/255 or more of a pixel: alpha times what is let through by
// the fragments in front. triangle, opacity (0..255): of the fragments, nearest first. opaque: what is behind them.
// Items that mark the same triangle store the same byte, see raster/mark.cl.
__kernel void mark_layers(const int pixels, __global const int *offsets, __global const int *triangle,
                          __global const int *opacity, __global const int *opaque, __global uchar *flags)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    const int end = offsets[pixel + 1];
    float through = 1.0f;
    for (int at = offsets[pixel]; at < end && through >= LEAST; at++) {
        const float alpha = opacity[at] * (1.0f / 255.0f);
        if (through * alpha >= LEAST)
            flags[triangle[at]] = 1;
        through *= 1.0f - alpha;
    }
    if (through >= LEAST && opaque[pixel] >= 0)
        flags[opaque[pixel]] = 1;
}
