// Compositing each pixel's sorted fragments with the over operator (eq. 1.1), on encoded colours.
#include "common/wide.cl"

// What a pixel shows of its nearest fragments, and the share of light that they let through.
typedef struct {
    float4 sum;
    float through;
} Over;

// Put the next fragment behind those so far; alpha in 0..1.
INLINE Over put_behind(Over over, const uint colour, const float alpha)
{
    const float share = over.through * alpha;
    over.sum += share * (float4)(colour & 255, (colour >> 8) & 255, (colour >> 16) & 255, 255.0f);
    over.through *= 1.0f - alpha;
    return over;
}

// The pixel over a background whose alpha is how much it covers.
INLINE uint over_background(const Over over, const uint behind)
{
    const float4 back = (float4)(behind & 255, (behind >> 8) & 255, (behind >> 16) & 255, behind >> 24);
    const float4 sum = over.sum + over.through * back + 0.5f;
    return (uint)sum.x | (uint)sum.y << 8 | (uint)sum.z << 16 | (uint)sum.w << 24;
}

// rows: `words` per fragment, RGBA bytes first.
__kernel void blend_lists(const int pixels, __global const int *offsets, __global const uint *rows, const int words,
                          __global const uint *background, __global uint *picture)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    Over over = {0.0f, 1.0f};
    const int end = offsets[pixel + 1];
    for (int at = offsets[pixel]; at < end && over.through > 0.0f; at++) {
        const uint colour = rows[(size_t)at * words];
        over = put_behind(over, colour, (colour >> 24) * (1.0f / 255.0f));
    }
    picture[pixel] = over_background(over, background[pixel]);
}

// Blend the fragments in front of a picture over it, and note whose is nearest of those that are visible. Pixels
// without fragments are left alone. opacity: 0..255.
__kernel void blend_layers(const int pixels, __global const int *offsets, __global const uint *colours,
                           __global const int *opacity, __global const int *ids, __global uint *picture,
                           __global int *nearest)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    const int first = offsets[pixel], end = offsets[pixel + 1];
    Over over = {0.0f, 1.0f};
    int front = -1;
    for (int at = first; at < end && over.through > 0.0f; at++) {
        if (opacity[at] == 0)
            continue;
        front = front < 0 ? ids[at] : front;
        over = put_behind(over, colours[at], opacity[at] * (1.0f / 255.0f));
    }
    if (front < 0)
        return;
    picture[pixel] = over_background(over, picture[pixel]);
    nearest[pixel] = front;
}
