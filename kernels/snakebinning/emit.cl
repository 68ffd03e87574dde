#include "common/elementary.cl"
#include "snakebinning/pieces.cl"
#include "snakebinning/strip.cl"

// The texels of slots, as shading samples (section 3.7). Shading continues beyond the triangle's edges.

#define OUTSIDE 1.9f       // texels that a sample's barycentrics may lie further outside than one height
#define POSITIVE 0.35f     // share of the least inverse distance that the interpolated one stays above
#define MIDDLE (1.0f / 3.0f)  // texels from the tip's foot to the middle of POINT_SHAPE, both ways
#define POINT_SHAPE (ushort4)(0, 8, 8, 0)  // whose middle, and steps from texel to texel, are those of a point

static inline int2 columns_of(const Strip *s, ushort4 own, int line, int full, int enlarge) {
    const int2 slot = needed_columns(s->before8, s->before8, s->after8, s->height8, s->inset, line, enlarge);
    if (full) return slot;
    const int2 needed = needed_columns(s->before8, own.x, own.y, own.z, s->inset, line, enlarge);
    return (int2)(max(slot.x, needed.x), min(slot.y, needed.y));
}

// counts: samples of each run of triangles. full: whether whole slots are filled; those of pieces never are, because what
// lies beside a piece belongs to the next one.
__kernel void count_samples(int count, int run, int runs, int full, int enlarge, int first_piece,
                            __global const int *triangles,
                            __global const int2 *slots, __global const uint *places,
                            __global const ushort4 *drawn, __global const Strip *strips, __global int *counts) {
    const int r = get_global_id(0);
    if (r >= runs) return;
    int sum = 0;
    for (int i = r * run; i < min(count, (r + 1) * run); i++) {
        const int triangle = triangles[i];
        if (!places[triangle]) continue;
        const Strip s = strips[slots[triangle].x];
        if (full && triangle < first_piece) {
            sum += s.texels;
            continue;
        }
        const ushort4 own = drawn[triangle];
        for (int line = 0; line < lines_of(own.z); line++) {
            const int2 columns = columns_of(&s, own, line, 0, enlarge);
            sum += max(0, columns.y - columns.x + 1);
        }
    }
    counts[r] = sum;
}

// Screen-space barycentrics of vertices 0 to 2 at column x and line y of a slot, from its tip: at + across x + down y.
typedef struct {
    float at[3], across[3], down[3], q[3], lowest[3];
    float least, g11, g12, g22;  // least inverse distance; products of the edges 0-1 and 0-2
    // Of corner 0 in the triangle that the samples name, and how much further those of 1 and 2 are: in a small piece of
    // a very large triangle, only the last of a sample's operations rounds by more than a share of the piece.
    float bary1[3], bary2[3];
    int triangle;  // which the samples name
} Plane;

static inline Plane plane_of(ushort4 own, uint word, __global const float *positions, __global const int *indices,
                      int triangle, int first_piece, __global const float *pieces) {
    const float before = 0.125f * own.x, after = 0.125f * own.y, height = 0.125f * own.z, length = before + after;
    const int a = word >> 24 & 3, after_a = a == 2 ? 0 : a + 1, last = 3 - a - after_a;
    const int b = word >> 26 & 1 ? last : after_a, c = word >> 26 & 1 ? after_a : last;
    Plane p;
    // x runs from the tip's foot: the corner a is at -before, b at +after.
    p.at[c] = 0.0f, p.across[c] = 0.0f, p.down[c] = 1.0f / height;
    p.at[a] = after / length, p.across[a] = -1.0f / length, p.down[a] = -p.at[a] / height;
    p.at[b] = before / length, p.across[b] = 1.0f / length, p.down[b] = -p.at[b] / height;
    // Heights of the triangle over the edges opposite its corners, in texels.
    const float area = length * height;
    const float right = sqrt(height * height + after * after), left = sqrt(height * height + before * before);
    const float heights[3] = {area / right, area / left, height};
    p.lowest[a] = -1.0f - OUTSIDE / fmax(heights[0], 1.0f);
    p.lowest[b] = -1.0f - OUTSIDE / fmax(heights[1], 1.0f);
    p.lowest[c] = -1.0f - OUTSIDE / fmax(heights[2], 1.0f);
    for (int k = 0; k < 3; k++) p.q[k] = (float)(word >> 8 * k & 255) * (1.0f / 255.0f);
    p.least = fmin(fmin(p.q[0], p.q[1]), p.q[2]);
    const float3 p0 = vload3(0, corner_of(triangle, 0, positions, indices, first_piece, pieces));
    const float3 e1 = vload3(0, corner_of(triangle, 1, positions, indices, first_piece, pieces)) - p0;
    const float3 e2 = vload3(0, corner_of(triangle, 2, positions, indices, first_piece, pieces)) - p0;
    p.g11 = dot3(e1, e1), p.g12 = dot3(e1, e2), p.g22 = dot3(e2, e2);
    p.triangle = triangle;
    for (int k = 0; k < 3; k++) p.bary1[k] = k == 1, p.bary2[k] = k == 2;
    if (triangle >= first_piece) {
        __global const float *piece = pieces + PIECE_FLOATS * (triangle - first_piece);
        p.triangle = as_int(piece[PIECE_PARENT]);
        for (int k = 0; k < 3; k++)
            p.bary1[k] = piece[PIECE_BARY + 2 * k] - (k ? p.bary1[0] : 0.0f),
            p.bary2[k] = piece[PIECE_BARY + 2 * k + 1] - (k ? p.bary2[0] : 0.0f);
    }
    return p;
}

typedef struct {
    float8 bary1, bary2, footprint;
} Samples8;

// Length squared on the surface of a step that changes the barycentrics 1 and 2 by d1 and d2.
#define STEP8(p, d1, d2) ((d1) * (d1) * (p)->g11 + 2.0f * (d1) * (d2) * (p)->g12 + (d2) * (d2) * (p)->g22)

// Eight samples at columns x from the tip on a line y from the longest edge. Encoding of section 5 of Tessellated
// Shading Streaming: object-space barycentrics are mu q / sum(mu q) for screen-space ones mu, q = 1 / w.
INLINE Samples8 sample8(const Plane *p, float8 x, float y) {
    float8 mu[3];
    for (int k = 0; k < 3; k++) mu[k] = p->at[k] + p->down[k] * y + p->across[k] * x;
    // Far outside, towards the middle: first until the inverse distance is positive, then to what is allowed.
    const float centre = (p->q[0] + p->q[1] + p->q[2]) * (1.0f / 3.0f), third = 1.0f / 3.0f;
    float8 q = mu[0] * p->q[0] + mu[1] * p->q[1] + mu[2] * p->q[2];
    const int8 beyond = q < POSITIVE * p->least;
    const float8 part = beyond ? (centre - POSITIVE * p->least) / (centre - q) : (float8)(1.0f);
    for (int k = 0; k < 3; k++) mu[k] = beyond ? third + part * (mu[k] - third) : mu[k];
    q = beyond ? (float8)(POSITIVE * p->least) : q;
    const float8 inverse = 1.0f / q;
    float8 bary[3], shrink = (float8)(1.0f);
    for (int k = 0; k < 3; k++) {
        bary[k] = mu[k] * p->q[k] * inverse;
        const float8 needed = (third - p->lowest[k]) / (third - bary[k]);
        shrink = bary[k] < p->lowest[k] && needed < shrink ? needed : shrink;
    }
    Samples8 s;
    const float along = p->across[0] * p->q[0] + p->across[1] * p->q[1] + p->across[2] * p->q[2];
    const float across = p->down[0] * p->q[0] + p->down[1] * p->q[1] + p->down[2] * p->q[2];
    const float8 right1 = (p->across[1] * p->q[1] - bary[1] * along) * inverse;
    const float8 right2 = (p->across[2] * p->q[2] - bary[2] * along) * inverse;
    const float8 down1 = (p->down[1] * p->q[1] - bary[1] * across) * inverse;
    const float8 down2 = (p->down[2] * p->q[2] - bary[2] * across) * inverse;
    const float8 right = STEP8(p, right1, right2), down = STEP8(p, down1, down2);
    s.footprint = sqrt(GREATER(GREATER(right, down), (float8)(0.0f)));
    for (int k = 0; k < 3; k++) bary[k] = third + shrink * (bary[k] - third);
    s.bary1 = p->bary1[0] + (bary[1] * p->bary1[1] + bary[2] * p->bary1[2]);
    s.bary2 = p->bary2[0] + (bary[1] * p->bary2[1] + bary[2] * p->bary2[2]);
    return s;
}

static inline void store_lanes(int8 value, __global int *array, int count) {
    for (int k = 0; k < count; k++) array[k] = ((int *)&value)[k];
}

__kernel void emit_samples(int count, int run, int runs, int full, int enlarge, int first_piece,
                           __global const int *triangles,
                           __global const int2 *slots, __global const uint *places,
                           __global const ushort4 *drawn, __global const Strip *strips,
                           __global const uint *words, __global const float *positions,
                           __global const int *indices, __global const float *pieces, int atlas_width,
                           __global const int *counts,
                           __global const int *offsets, __global int *triangle_out, __global float *bary1,
                           __global float *bary2, __global float *footprint, __global int *texel) {
    const int r = get_global_id(0);
    if (r >= runs) return;
    int at = offsets[r];
    const int last = at + counts[r];
    const int8 lane = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    const float8 step = (float8)(0, 1, 2, 3, 4, 5, 6, 7);
    for (int i = r * run; i < min(count, (r + 1) * run); i++) {
        const int triangle = triangles[i];
        const uint place = places[triangle];
        if (!place) continue;
        const Strip s = strips[slots[triangle].x];
        const ushort4 own = drawn[triangle];
        const int point = own.z == 0;
        const Plane p = plane_of(point ? POINT_SHAPE : own, words[triangle], positions, indices, triangle, first_piece,
                                 pieces);
        const int turned = place >> 29 & 1, sign = turned ? -1 : 1;
        const int tip8 = 8 * s.inset + s.before8, row = place >> 16 & 0x1FFF;
        const int origin = ((int)(place & 0xFFFF) - sign * tip8) / 8;  // column of the slot's column 0
        const int whole = full && triangle < first_piece, lines = whole ? s.lines : lines_of(own.z);
        for (int line = 0; line < lines; line++) {
            const int2 columns = columns_of(&s, own, line, whole, enlarge);
            const int samples = columns.y - columns.x + 1;
            const int first = (row + sign * line) * atlas_width + origin;
            for (int k = 0; k < samples; k += 8) {
                const int column = columns.x + k, to = at + k;
                const float x = point ? MIDDLE : (float)column - 0.125f * tip8, y = point ? MIDDLE : (float)line;
                const Samples8 v = sample8(&p, x + step, y);
                const int8 texels = first + sign * (column + lane);
                if (to + 8 <= last) {  // lanes beyond the line are written again by the next lines of this run
                    *(__global loose_int8 *)(triangle_out + to) = (int8)(p.triangle);
                    *(__global loose_float8 *)(bary1 + to) = v.bary1;
                    *(__global loose_float8 *)(bary2 + to) = v.bary2;
                    *(__global loose_float8 *)(footprint + to) = v.footprint;
                    *(__global loose_int8 *)(texel + to) = texels;
                } else {
                    const int left = min(8, samples - k);
                    store_lanes((int8)(p.triangle), triangle_out + to, left);
                    store_lanes(as_int8(v.bary1), (__global int *)bary1 + to, left);
                    store_lanes(as_int8(v.bary2), (__global int *)bary2 + to, left);
                    store_lanes(as_int8(v.footprint), (__global int *)footprint + to, left);
                    store_lanes(texels, texel + to, left);
                }
            }
            at += max(0, samples);
        }
    }
}
