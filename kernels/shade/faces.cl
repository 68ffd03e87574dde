#include "shade/uv_scale.cl"
// Per triangle: its material, and its UV scale in 1 / scene unit.
__kernel void uv_scales(const int count, __global const float *vertices, __global const int *indices,
                        __global const int *materials, __global int *faces)
{
    const int id = get_global_id(0);
    if (id >= count)
        return;
    const int3 corner = vload3(id, indices);
    const float8 v0 = vload8(corner.x, vertices);
    const float8 d1 = vload8(corner.y, vertices) - v0, d2 = vload8(corner.z, vertices) - v0;
    vstore2((int2)(materials[id], as_int(uv_scale(d1.s012, d2.s012, d1.s67, d2.s67))), id, faces);
}
