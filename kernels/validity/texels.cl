// Whether a plane's alpha says which texels have a sample.

// One row of the atlas. counts: texels that have one, and those whose alpha is not 255 then and 0 elsewhere.
__kernel void compare_alpha(const int width, const int height, __global const uint *texels, __global const int *plane,
                            __global int *counts)
{
    const int row = get_global_id(0);
    if (row >= height)
        return;
    __global const uint *colours = texels + (size_t)row * width;
    __global const int *samples = plane + (size_t)row * width;
    int owned = 0, wrong = 0;
    for (int i = 0; i < width; i++) {
        owned += samples[i] >= 0;
        wrong += colours[i] >> 24 != (samples[i] >= 0 ? 255 : 0);
    }
    atomic_add(counts, owned);
    atomic_add(counts + 1, wrong);
}
