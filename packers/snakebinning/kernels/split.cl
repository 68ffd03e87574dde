// A client's samples on sliced triangles: which piece each lies in.

// pieces: by triangle of the client, first and number of its pieces. maps: six floats per piece, which take the
// parent's barycentrics 1 and 2 to the piece's: o1 and o2 of the piece's corner 0, then a, b of a (b1 - o1) + b (b2 -
// o2) for 1, then for 2. Differences come first, because those of near numbers are exact: in a small piece of a very
// large triangle a and b are large. Pieces count on from `triangles`. Weights are kept inside the piece, beyond which
// it has no texels.
__kernel void split_samples(int count, int triangles, __global const int2 *pieces, __global const float *maps,
                            __global const int *triangle, __global const float *bary1, __global const float *bary2,
                            __global int *to_triangle, __global float *to_bary1, __global float *to_bary2)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int2 own = pieces[triangle[i]];
    const float b1 = bary1[i], b2 = bary2[i];
    int part = triangle[i];
    float best = -INFINITY, best1 = b1, best2 = b2;
    for (int k = own.x; k < own.x + own.y; k++) {
        __global const float *map = maps + 6 * k;
        const float d1 = b1 - map[0], d2 = b2 - map[1];
        const float w1 = map[2] * d1 + map[3] * d2, w2 = map[4] * d1 + map[5] * d2;
        const float least = fmin(fmin(w1, w2), 1.0f - w1 - w2);
        if (least > best)
            best = least, part = triangles + k, best1 = fmax(w1, 0.0f), best2 = fmax(w2, 0.0f);
    }
    const float sum = own.y ? fmax(best1 + best2, 1.0f) : 1.0f;
    to_triangle[i] = part, to_bary1[i] = best1 / sum, to_bary2[i] = best2 / sum;
}
