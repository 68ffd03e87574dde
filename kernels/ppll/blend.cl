// Compositing each pixel's sorted fragments with the over operator (eq. 1.1), on encoded colours.

// rows: `words` per fragment, RGBA bytes first. A pixel's colours are summed from the nearest on, each with the share
// that those before let through; what is left of the background comes last.
__kernel void blend_lists(const int pixels, __global const int *offsets, __global const uint *rows, const int words,
                          __global const uint *background, __global uint *picture)
{
    const int pixel = get_global_id(0);
    if (pixel >= pixels)
        return;
    float4 sum = 0.0f;
    float through = 1.0f;
    const int end = offsets[pixel + 1];
    for (int at = offsets[pixel]; at < end; at++) {
        const uint colour = rows[(size_t)at * words];
        const float alpha = (colour >> 24) * (1.0f / 255.0f), share = through * alpha;
        sum += share * (float4)(colour & 255, (colour >> 8) & 255, (colour >> 16) & 255, 255.0f);
        through *= 1.0f - alpha;
        if (through == 0.0f)
            break;
    }
    const uint behind = background[pixel];
    sum += through * (float4)(behind & 255, (behind >> 8) & 255, (behind >> 16) & 255, behind >> 24);
    sum += 0.5f;
    picture[pixel] = (uint)sum.x | (uint)sum.y << 8 | (uint)sum.z << 16 | (uint)sum.w << 24;
}
