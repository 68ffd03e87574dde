#include "common/wide.cl"
#include "limits.cl"

// What becomes of each primitive: a single texel, an L, or two right triangles.

INLINE int whole(float value, float most)
{
    const float bounded = value < most ? value : most;
    return (int)rint(bounded > 1.0f ? bounded : 1.0f);
}

INLINE int bin_of_half(int w, int h, __global const int *of_size, __global const int *size_class, int classes)
{
    if (w == 0)
        return -1;
    const int p = w > h ? w : h, q = w > h ? h : w;
    return of_size[size_class[q] * classes + size_class[p]];
}

// forms: kind (OVERSAMPLED, or the level of an L, 0 for a single texel), and for right triangles their common height
// and the texels along the base before and after its foot. bins: of a primitive's two items, -1 for none, in the order
// in which they are placed (`turns`). threshold: longest edge over height from which a triangle is slanted. A piece of
// a cut triangle may be large where the cell cannot see it: it has at least the corners' samples.
__kernel void choose_strategies(int count, __global const float *shapes, __global const int *parents,
                                __global const int *pieces, float scale, float threshold, __global const int *turns,
                                __global const int *of_level, __global const int *of_size,
                                __global const int *size_class, int classes, __global int *forms, __global int *bins)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const float4 shape = vload4(i, shapes);
    const float level = rint(shape.x * scale);
    const bool tiny = level < 1.0f, cut = pieces[parents[i]] > 1;
    const bool slanted = shape.y > threshold * shape.z && !(tiny && threshold > 0.0f);
    int4 form = (int4)(0);
    int2 bin;
    if (tiny && !cut) {
        bin = (int2)(of_level[0], -1);
    } else if (slanted) {
        const int texels = tiny ? 1 : whole(shape.y * scale, LONGEST), before = (int)rint(shape.w * (float)texels);
        form = (int4)(OVERSAMPLED, tiny ? 1 : whole(shape.z * scale, LONGEST), before, texels - before);
        bin.x = bin_of_half(form.z, form.y, of_size, size_class, classes);
        bin.y = bin_of_half(form.w, form.y, of_size, size_class, classes);
    } else {
        form.x = whole(level, LEVELS);
        bin = (int2)(of_level[form.x], -1);
    }
    vstore4(form, i, forms);
    vstore2(bin, turns[i], bins);
}
