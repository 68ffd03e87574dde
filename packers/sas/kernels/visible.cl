#include "common/types.cl"

// Potentially visible patches in the order of their first triangle, and which of their triangles are in the set.

INLINE bool marked(int triangle, __global const int *marks, int mark)
{
    return triangle >= 0 && marks[triangle] == mark;
}

__kernel void mark_triangles(int count, __global const int *pvs, int mark, __global int *marks)
{
    const int i = get_global_id(0);
    if (i < count)
        marks[pvs[i]] = mark;
}

// 1 for a triangle that is the first of its patch in the set.
__kernel void find_first(int count, __global const int *pvs, __global const int *patch_of_triangle,
                         __global const int *members, __global const int *marks, int mark, __global int *first)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int triangle = pvs[i];
    const int3 member = vload3(patch_of_triangle[triangle], members);
    const bool earlier = (member.x < triangle && marked(member.x, marks, mark)) ||
                         (member.y < triangle && marked(member.y, marks, mark)) ||
                         (member.z < triangle && marked(member.z, marks, mark));
    first[i] = !earlier;
}

__kernel void list_patches(int count, __global const int *pvs, __global const int *patch_of_triangle,
                           __global const int *members, __global const int *marks, int mark, __global const int *first,
                           __global const int *offsets, __global int *patches, __global uchar *masks)
{
    const int i = get_global_id(0);
    if (i >= count || !first[i])
        return;
    const int patch = patch_of_triangle[pvs[i]];
    const int3 member = vload3(patch, members);
    patches[offsets[i]] = patch;
    masks[offsets[i]] = (marked(member.x, marks, mark) ? 1 : 0) | (marked(member.y, marks, mark) ? 2 : 0) |
                        (marked(member.z, marks, mark) ? 4 : 0);
}
