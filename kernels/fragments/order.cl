// Fragments tile by tile and triangle by triangle, which is how they are shaded fastest: those shaded at once then
// mostly share a triangle, and those shaded next need the same texels. In the lists they are the layers of one pixel.

// One work-item per tile of TILE x TILE pixels sorts its fragments by their triangles' last digit to the base BUCKETS;
// those of one bucket stay in the order of the lists. to_place: where each fragment is in the lists.
__kernel void order_fragments(const int tiles, const int tiles_x, const int width, const int height,
                              __global const int *offsets, __global const int *triangle, __global const float *bary1,
                              __global const float *bary2, __global const float *footprint, __global int *to_triangle,
                              __global float *to_bary1, __global float *to_bary2, __global float *to_footprint,
                              __global int *to_place)
{
    const int tile = get_global_id(0);
    if (tile >= tiles)
        return;
    const int left = tile % tiles_x * TILE, right = min(left + TILE, width);
    const int top = tile / tiles_x * TILE, bottom = min(top + TILE, height);
    int next[BUCKETS]; // of each bucket, how many fragments, then its next free place
    for (int i = 0; i < BUCKETS; i++)
        next[i] = 0;
    int start = offsets[top * width];
    for (int y = top; y < bottom; y++) {
        const int first = offsets[y * width + left], end = offsets[y * width + right];
        start += first - offsets[y * width]; // those of the tiles to the left come before
        for (int at = first; at < end; at++)
            next[triangle[at] & (BUCKETS - 1)]++;
    }
    for (int i = 0; i < BUCKETS; i++) {
        const int count = next[i];
        next[i] = start;
        start += count;
    }
    for (int y = top; y < bottom; y++)
        for (int at = offsets[y * width + left]; at < offsets[y * width + right]; at++) {
            const int id = triangle[at], to = next[id & (BUCKETS - 1)]++;
            to_triangle[to] = id;
            to_bary1[to] = bary1[at];
            to_bary2[to] = bary2[at];
            to_footprint[to] = footprint[at];
            to_place[to] = at;
        }
}
