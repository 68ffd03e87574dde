#include "common/wide.cl"
#include "place.cl"

// Where in a TSS atlas surface points lie, 8 per step.

#define SLACK 0.0009765625f // of a cell: rounding must not send a sample of the cut's line to its copy
#define UNPLACED -4

// Position in the L of a point with weights b, c of corners 1 and 2: equation 4.
INLINE void locate_in_l(int8 level, float8 b, float8 c, float8 *x, float8 *y)
{
    const float8 a = 1.0f - b - c, l = convert_float8(level);
    const int8 one = b > a && b >= c, two = !one && c > a;
    const float8 across = one || two ? (one ? a : b) : b, down = two ? a : c;
    const int8 upper = across >= down;
    const float8 high = upper ? across : down, low = upper ? down : across;
    const float8 column = (high + 0.5f * low) * l, row = 1.5f * low * l;
    const float8 right = upper ? column : row, below = upper ? row : column;
    const int8 over = two && upper && (level & 1) != 0 && right > convert_float8(level >> 1) + SLACK;
    *x = over ? l - below : (one ? l - right : right);
    *y = over ? l - right : (two ? l - below : below);
}

// Screen weights of corners 1 and 2 of the piece that holds a point, and the piece's number; n along an edge.
INLINE int8 find_piece(int8 n, float8 *b, float8 *c)
{
    const float8 number = convert_float8(n), u = *b * number, v = *c * number;
    // Bounded before they are converted: samples beyond their triangle may lie anywhere, and what is no number counts
    // as 0.
    const float8 right = MAX(u, 0.0f), down = MAX(v, 0.0f);
    const int8 row = convert_int8(MIN(down, number - 1.0f));
    const int8 column = convert_int8(MIN(right, number - 1.0f - convert_float8(row)));
    const float8 p = u - convert_float8(column), q = v - convert_float8(row);
    const int8 turned = p + q > 1.0f && column + row < n - 1;
    *b = turned ? 1.0f - p : p;
    *c = turned ? 1.0f - q : q;
    return n * n - (n - row) * (n - row) + 2 * column + (turned ? (int8)(1) : (int8)(0));
}

// Position in right triangles of a point with weights b of the base's end and c of the apex; `second` says in which of
// the two.
INLINE void locate_in_half(int8 before, int8 after, int8 h, float8 b, float8 c, float8 *x, float8 *y, int8 *second)
{
    const float8 foot = convert_float8(before), base = convert_float8(before + after);
    const float8 along = b * base + c * foot - foot, up = c * convert_float8(h);
    *second = (along >= 0.0f && after > 0) || before == 0;
    const float8 way = along < 0.0f ? -along : along;
    const int8 wide = (*second ? after : before) > h;
    *x = wide ? way : up;
    *y = wide ? up : way;
}

// records: per primitive 4 integers. An L: level (0 for a single texel) and place. Right triangles: -1 - the corner
// where the longest edge begins; places; texels along the base before and after the foot, << 10; height << 20.
// UNPLACED.
__kernel void locate(int count, int room, __global const int *triangle, __global const float *bary1,
                     __global const float *bary2, __global const float *inverse, __global const int *pieces,
                     __global const int *starts, __global const int *records, __global float *places)
{
    const int first = 8 * get_global_id(0);
    if (first >= count)
        return;
    float8 v0, v1, v2;
    int8 n, start, record[4];
    for (int k = 0; k < 8; k++) {
        const int t = triangle[MIN(first + k, count - 1)];
        const float4 v = vload4(t, inverse);
        ((float *)&v0)[k] = v.x, ((float *)&v1)[k] = v.y, ((float *)&v2)[k] = v.z;
        ((int *)&n)[k] = pieces[t];
        ((int *)&start)[k] = starts[t];
    }
    const float8 l1 = *(__global const loose_float8 *)(bary1 + first);
    const float8 l2 = *(__global const loose_float8 *)(bary2 + first);
    // Screen weights from object weights: the inverse of the samples' perspective (equation 5).
    const float8 d0 = (1.0f - l1 - l2) / v0, d1 = l1 / v1, d2 = l2 / v2, sum = d0 + d1 + d2;
    float8 b = d1 / sum, c = d2 / sum;
    const int8 primitive = start + find_piece(n, &b, &c);
    for (int k = 0; k < 8; k++) {
        const int4 words = vload4(((int *)&primitive)[k], records);
        ((int *)&record[0])[k] = words.x, ((int *)&record[1])[k] = words.y;
        ((int *)&record[2])[k] = words.z, ((int *)&record[3])[k] = words.w;
    }
    const float8 a = 1.0f - b - c;
    const int8 turn = -1 - record[0];
    const float8 end = turn == 1 ? c : (turn == 2 ? a : b), apex = turn == 1 ? a : (turn == 2 ? b : c);
    float8 x, y, x2, y2;
    int8 second;
    locate_in_l(record[0], b, c, &x, &y);
    locate_in_half(record[3] & 1023, record[3] >> 10 & 1023, record[3] >> 20 & 1023, end, apex, &x2, &y2, &second);
    const int8 halves = record[0] < 0, placed = record[0] != UNPLACED;
    const int8 word = halves && second ? record[2] : record[1];
    x = halves ? x2 : x;
    y = halves ? y2 : y;
    x = record[0] == 0 ? (float8)(0.0f) : x;
    y = record[0] == 0 ? (float8)(0.0f) : y;
    const int8 back = (word >> 30 & 1) != 0;
    x = convert_float8(word & 0x7FFF) + (back ? -x : x);
    y = convert_float8(word >> 15 & 0x7FFF) + (back ? -y : y);
    *(__global loose_float8 *)(places + first) = placed ? x : (float8)(NAN);
    *(__global loose_float8 *)(places + room + first) = placed ? y : (float8)(NAN);
}
