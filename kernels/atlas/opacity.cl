// How much the fragments of a client cover.

// drawn: negative where a fragment's triangle has no place in the atlas; it is not there then. constants: by the
// client's triangles, 0..255, or VARIES, where `alphas` (grey, from the alpha plane) says it. Without that plane they
// are opaque.
__kernel void fragment_opacity(const int count, __global const int *triangle, __global const int *drawn,
                               __global const int *constants, __global int *opacity
#if PLANE
                               ,
                               __global const uint *alphas
#endif
)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    int covered = constants[triangle[i]];
    if (covered == VARIES)
#if PLANE
        covered = alphas[i] & 255;
#else
        covered = 255;
#endif
    opacity[i] = drawn[i] < 0 ? 0 : covered;
}
