#include "common/elementary.cl"
#include "pieces.cl"
#include "strip.cl"

// The texels of slots, as shading samples (section 3.7). Shading continues beyond the triangle's edges.

#define OUTSIDE 1.9f                      // texels that a sample's barycentrics may lie further outside than one height
#define POSITIVE 0.35f                    // share of the least inverse distance that the interpolated one stays above
#define MIDDLE (1.0f / 3.0f)              // texels from the tip's foot to the middle of POINT_SHAPE, both ways
#define POINT_SHAPE (ushort4)(0, 8, 8, 0) // whose middle, and steps from texel to texel, are those of a point

// Columns of a line that a triangle needs of its slot.
INLINE int2 own_columns(const Strip *s, ushort4 own, int line, int enlarge)
{
    const int2 slot = needed_columns(s->before8, s->before8, s->after8, s->height8, s->inset, line, enlarge);
    const int2 needed = needed_columns(s->before8, own.x, own.y, own.z, s->inset, line, enlarge);
    return (int2)(MAX(slot.x, needed.x), MIN(slot.y, needed.y));
}

// sizes: room for the texels of a slot of each strip, in whole steps of eight.
__kernel void size_slots(int count, __global const Strip *strips, __global int *sizes)
{
    const int i = get_global_id(0);
    if (i < count)
        sizes[i] = strips[i].bin < 0 || strips[i].superblock < 0 ? 0 : (strips[i].texels + 7) & ~7;
}

// texels: of a slot of each strip, line by line from the longest edge: column | line << 16. All triangles of a strip
// have the same. lists: what else their samples need of it, all of which stays in the nearest caches: the tip's column
// in 1/8 texel, how many texels, and where they are listed.
__kernel void list_slots(int count, int run, int enlarge, __global const Strip *strips, __global const int *sizes,
                         __global const int *offsets, __global int *texels, __global int4 *lists)
{
    const int r = get_global_id(0);
    for (int i = r * run; i < min(count, (r + 1) * run); i++) {
        lists[i] = (int4)(0);
        if (!sizes[i])
            continue;
        const Strip s = strips[i];
        int at = offsets[i];
        lists[i] = (int4)(8 * s.inset + s.before8, s.texels, at, 0);
        for (int line = 0; line < s.lines; line++) {
            const int2 slot = needed_columns(s.before8, s.before8, s.after8, s.height8, s.inset, line, enlarge);
            for (int column = slot.x; column <= slot.y; column++)
                texels[at++] = column | line << 16;
        }
        while (at < offsets[i] + sizes[i])
            texels[at++] = 0;
    }
}

// counts: samples of each run of triangles. lists: see list_slots. full: whether whole slots are filled; those of
// pieces never are, because what lies beside a piece belongs to the next one.
__kernel void count_samples(int count, int run, int runs, int full, int enlarge, int first_piece,
                            __global const int *triangles, __global const int2 *slots, __global const uint *places,
                            __global const ushort4 *drawn, __global const Strip *strips, __global const int4 *lists,
                            __global int *counts)
{
    const int r = get_global_id(0);
    if (r >= runs)
        return;
    int sum = 0;
    for (int i = r * run; i < min(count, (r + 1) * run); i++) {
        const int triangle = triangles[i];
        if (!places[triangle])
            continue;
        if (full && triangle < first_piece) {
            sum += lists[slots[triangle].x].y;
            continue;
        }
        const Strip s = strips[slots[triangle].x];
        const ushort4 own = drawn[triangle];
        for (int line = 0; line < lines_of(own.z); line++) {
            const int2 columns = own_columns(&s, own, line, enlarge);
            sum += max(0, columns.y - columns.x + 1);
        }
    }
    counts[r] = sum;
}

// Eight triangles: lengths in texels, q = 1 / w of their corners, which of these are at the ends of the longest edge,
// and the edges 0-1 and 0-2.
typedef struct {
    float8 before, after, height, q[3];
    int8 a, b;
    float8 along1[3], along2[3];
} Shapes;

// What is the same for all samples of each of eight triangles. Object-space barycentrics are mu q / sum(mu q) for
// screen-space ones mu (section 5 of Tessellated Shading Streaming). n1, n2 and sum: mu q of vertices 1 and 2, and the
// sum, at column x and line y of a slot, from its tip: [0] + [1] x + [2] y.
typedef struct {
    float8 n1[3], n2[3], sum[3];
    float8 q1, q2, centre, edge; // q of vertices 1 and 2, their mean, and the least that is allowed
    float8 lowest[3];            // barycentrics that are allowed
    float8 g11, g12, g22;        // products of the edges 0-1, twice 0-1 and 0-2, and 0-2
} Planes;

#define LANE(wide, k) (((const float *)&(wide))[k])

INLINE void planes_of(const Shapes *s, Planes *p)
{
    const float8 before = s->before, after = s->after, height = s->height, edge = 1.0f / (before + after);
    // x runs from the tip's foot: the corner a is at -before, b at +after.
    const float8 at_a = after * edge, at_b = before * edge, up = 1.0f / height;
    const float8 down_a = -at_a * up, down_b = -at_b * up;
    // Heights over the edges opposite the corners, in texels.
    const float8 area = (before + after) * height;
    const float8 over_a = area / sqrt(height * height + after * after);
    const float8 over_b = area / sqrt(height * height + before * before);
    const float8 low_a = -1.0f - OUTSIDE / MAX(over_a, (float8)(1.0f));
    const float8 low_b = -1.0f - OUTSIDE / MAX(over_b, (float8)(1.0f));
    const float8 low_c = -1.0f - OUTSIDE / MAX(height, (float8)(1.0f));
    float8 n[3][3];
    UNROLL for (int k = 0; k < 3; k++)
    {
        const int8 is_a = s->a == k, is_b = s->b == k;
        n[k][0] = s->q[k] * (is_a ? at_a : is_b ? at_b : (float8)(0.0f));
        n[k][1] = s->q[k] * (is_a ? -edge : is_b ? edge : (float8)(0.0f));
        n[k][2] = s->q[k] * (is_a ? down_a : is_b ? down_b : up);
        p->lowest[k] = is_a ? low_a : is_b ? low_b : low_c;
    }
    UNROLL for (int k = 0; k < 3; k++) p->n1[k] = n[1][k], p->n2[k] = n[2][k], p->sum[k] = n[0][k] + n[1][k] + n[2][k];
    p->q1 = s->q[1], p->q2 = s->q[2], p->centre = (s->q[0] + s->q[1] + s->q[2]) * (1.0f / 3.0f);
    const float8 least = MIN(s->q[0], s->q[1]);
    p->edge = POSITIVE * MIN(least, s->q[2]);
    const float8 *u = s->along1, *v = s->along2;
    p->g11 = u[0] * u[0] + u[1] * u[1] + u[2] * u[2];
    p->g12 = 2.0f * (u[0] * v[0] + u[1] * v[1] + u[2] * v[2]);
    p->g22 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
}

typedef struct {
    float8 bary1, bary2, footprint;
} Samples8;

// Whether any lane of a comparison holds.
INLINE bool any8(int8 mask)
{
    const long4 four = as_long4(mask);
    return (four.x | four.y | four.z | four.w) != 0;
}

// Eight samples of which some are far outside: brought towards the middle until the inverse distance is positive, and
// then to what is allowed.
typedef struct {
    float8 q, bary1, bary2, allowed1, allowed2;
} Near8;

INLINE Near8 limit8(const Planes *p, int k, float8 q, float8 n1, float8 n2)
{
    const float third = 1.0f / 3.0f, edge = LANE(p->edge, k), centre = LANE(p->centre, k);
    const int8 beyond = q < edge;
    const float8 part = beyond ? (centre - edge) / (centre - q) : (float8)(1.0f);
    Near8 s;
    s.q = beyond ? (float8)(edge) : q;
    s.bary1 = (part * n1 + (1.0f - part) * (third * LANE(p->q1, k))) / s.q;
    s.bary2 = (part * n2 + (1.0f - part) * (third * LANE(p->q2, k))) / s.q;
    const float8 bary[3] = {1.0f - s.bary1 - s.bary2, s.bary1, s.bary2};
    float8 shrink = (float8)(1.0f);
    UNROLL for (int c = 0; c < 3; c++)
    {
        const float lowest = LANE(p->lowest[c], k);
        const float8 needed = (third - lowest) / (third - bary[c]);
        shrink = bary[c] < lowest && needed < shrink ? needed : shrink;
    }
    s.allowed1 = third + shrink * (bary[1] - third);
    s.allowed2 = third + shrink * (bary[2] - third);
    return s;
}

// Eight samples of triangle k of eight, at columns x from the tip on lines y from the longest edge.
INLINE Samples8 sample8(const Planes *p, int k, float8 x, float8 y)
{
    const float across1 = LANE(p->n1[1], k), across2 = LANE(p->n2[1], k), across = LANE(p->sum[1], k);
    const float down1 = LANE(p->n1[2], k), down2 = LANE(p->n2[2], k), down = LANE(p->sum[2], k);
    const float8 n1 = LANE(p->n1[0], k) + down1 * y + across1 * x, n2 = LANE(p->n2[0], k) + down2 * y + across2 * x;
    const float8 q = LANE(p->sum[0], k) + down * y + across * x;
    float8 inverse = 1.0f / q, bary1 = n1 * inverse, bary2 = n2 * inverse;
    const int8 far = q < LANE(p->edge, k) || bary1 < LANE(p->lowest[1], k) || bary2 < LANE(p->lowest[2], k) ||
                     1.0f - bary1 - bary2 < LANE(p->lowest[0], k);
    Samples8 s = {bary1, bary2, q};
    if (any8(far)) {
        const Near8 near = limit8(p, k, q, n1, n2);
        inverse = far ? 1.0f / near.q : inverse;
        bary1 = far ? near.bary1 : bary1, bary2 = far ? near.bary2 : bary2;
        s.bary1 = far ? near.allowed1 : bary1, s.bary2 = far ? near.allowed2 : bary2;
    }
    // Lengths squared on the surface of the steps to the next column and line, but for `inverse`.
    const float g11 = LANE(p->g11, k), g12 = LANE(p->g12, k), g22 = LANE(p->g22, k);
    const float8 u1 = across1 - bary1 * across, u2 = across2 - bary2 * across;
    const float8 v1 = down1 - bary1 * down, v2 = down2 - bary2 * down;
    const float8 right = u1 * (u1 * g11 + u2 * g12) + u2 * u2 * g22;
    const float8 below = v1 * (v1 * g11 + v2 * g12) + v2 * v2 * g22;
    s.footprint = sqrt(MAX(MAX(right, below), (float8)(0.0f))) * inverse;
    return s;
}

// Samples of a piece in its parent. The differences of the piece's corners come first: in a small piece of a very large
// triangle, only the last operation rounds by more than a share of the piece.
INLINE void move_to_parent(Samples8 *s, __global const float *bary)
{
    const float8 b1 = s->bary1, b2 = s->bary2;
    s->bary1 = bary[0] + (b1 * (bary[2] - bary[0]) + b2 * (bary[4] - bary[0]));
    s->bary2 = bary[1] + (b1 * (bary[3] - bary[1]) + b2 * (bary[5] - bary[1]));
}

INLINE void store_lanes(int8 value, __global int *array, int count)
{
    for (int k = 0; k < count; k++)
        array[k] = ((int *)&value)[k];
}

// Where samples go, and the end of the run's.
typedef struct {
    __global int *triangle;
    __global float *bary1, *bary2, *footprint;
    __global int *texel;
    int end;
} Out;

// A triangle in its slot: the texel of the first column and line, steps of the texel per column and line, column and
// line 0 from the tip, the slot's texels and where these are listed, which triangle the samples name, and barycentrics
// of a piece's corners in that, else 0.
typedef struct {
    int first, across, down;
    float x, y;
    int strip, texels, list, triangle;
    __global const float *piece;
} Slot;

// Up to eight samples of triangle k at texels of its slot: column | line << 16.
INLINE void emit8(const Planes *p, int k, const Slot *slot, int8 texels, Out out, int at, int count)
{
    const int8 column = texels & 0xFFFF, line = texels >> 16;
    Samples8 v = sample8(p, k, slot->x + convert_float8(column), slot->y + convert_float8(line));
    if (slot->piece)
        move_to_parent(&v, slot->piece);
    const int8 texel = slot->first + slot->down * line + slot->across * column;
    if (at + 8 <= out.end) { // those beyond `count` are written again by the next ones of this run
        *(__global loose_int8 *)(out.triangle + at) = (int8)(slot->triangle);
        *(__global loose_float8 *)(out.bary1 + at) = v.bary1;
        *(__global loose_float8 *)(out.bary2 + at) = v.bary2;
        *(__global loose_float8 *)(out.footprint + at) = v.footprint;
        *(__global loose_int8 *)(out.texel + at) = texel;
    } else {
        store_lanes((int8)(slot->triangle), out.triangle + at, count);
        store_lanes(as_int8(v.bary1), (__global int *)out.bary1 + at, count);
        store_lanes(as_int8(v.bary2), (__global int *)out.bary2 + at, count);
        store_lanes(as_int8(v.footprint), (__global int *)out.footprint + at, count);
        store_lanes(texel, out.texel + at, count);
    }
}

#define SET(wide, k, value) (((float *)&(wide))[k] = (value))

// Triangle k of eight, whose corners are `corner`.
INLINE void add_shape(Shapes *s, int k, ushort4 own, uint word, __global const float **corner)
{
    SET(s->before, k, 0.125f * own.x), SET(s->after, k, 0.125f * own.y), SET(s->height, k, 0.125f * own.z);
    UNROLL for (int c = 0; c < 3; c++)
    {
        SET(s->q[c], k, (float)(word >> 8 * c & 255) * (1.0f / 255.0f));
        SET(s->along1[c], k, corner[1][c] - corner[0][c]), SET(s->along2[c], k, corner[2][c] - corner[0][c]);
    }
    const int a = word >> 24 & 3, after_a = a == 2 ? 0 : a + 1;
    ((int *)&s->a)[k] = a, ((int *)&s->b)[k] = word >> 26 & 1 ? 3 - a - after_a : after_a;
}

// Emit the texels that a triangle needs of its slot, line by line; how many.
INLINE int emit_own(const Planes *planes, const int k, const Slot *slot, const Strip *s, const ushort4 own,
                    const int enlarge, const Out out, const int at)
{
    const int8 lane = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    int emitted = 0;
    for (int line = 0; line < lines_of(own.z); line++) {
        const int2 columns = own_columns(s, own, line, enlarge);
        const int samples = MAX(0, columns.y - columns.x + 1);
        for (int i = 0; i < samples; i += 8)
            emit8(planes, k, slot, (columns.x + i + lane) | line << 16, out, at + emitted + i, MIN(8, samples - i));
        emitted += samples;
    }
    return emitted;
}

// Eight triangles at a time: first what memory has of all of them, so that one does not wait for another.
__kernel void emit_samples(int count, int run, int runs, int full, int enlarge, int first_piece,
                           __global const int *triangles, __global const int2 *slots, __global const uint *places,
                           __global const ushort4 *drawn, __global const Strip *strips, __global const int4 *lists,
                           __global const int *slot_texels, __global const uint *words, __global const float *positions,
                           __global const int *indices, __global const float *pieces, int atlas_width,
                           __global const int *counts, __global const int *offsets, __global int *triangle_out,
                           __global float *bary1, __global float *bary2, __global float *footprint, __global int *texel)
{
    const int r = get_global_id(0);
    if (r >= runs)
        return;
    int at = offsets[r];
    const Out out = {triangle_out, bary1, bary2, footprint, texel, at + counts[r]};
    const int end = min(count, (r + 1) * run);
    for (int start = r * run; start < end; start += 8) {
        Shapes shapes;
        Planes planes;
        Slot of[8];
        int8 heads[8];
        for (int k = 0; k < MIN(8, end - start); k++) {
            const int triangle = triangles[start + k], strip = slots[triangle].x;
            const uint place = places[triangle];
            const ushort4 own = drawn[triangle];
            const int point = own.z == 0, is_piece = triangle >= first_piece;
            __global const float *piece = pieces + PIECE_FLOATS * (is_piece ? triangle - first_piece : 0);
            const int4 list = lists[strip];
            const int sign = 1 - 2 * (int)(place >> 29 & 1);
            const int origin = ((int)(place & 0xFFFF) - sign * list.x) / 8; // column of the slot's column 0
            of[k] = (Slot){(int)(place >> 16 & 0x1FFF) * atlas_width + origin,
                           sign,
                           sign * atlas_width,
                           point ? MIDDLE : -0.125f * list.x,
                           point ? MIDDLE : 0.0f,
                           place ? strip : -1,
                           full && !is_piece ? list.y : 0,
                           list.z,
                           is_piece ? as_int(piece[PIECE_PARENT]) : triangle,
                           is_piece ? piece + PIECE_BARY : 0};
            heads[k] = *(__global loose_int8 *)(slot_texels + list.z);
            __global const float *corner[3];
            UNROLL for (int c = 0; c < 3; c++) corner[c] =
                corner_of(triangle, c, positions, indices, first_piece, pieces);
            add_shape(&shapes, k, point ? POINT_SHAPE : own, words[triangle], corner);
        }
        planes_of(&shapes, &planes);
        for (int k = 0; k < MIN(8, end - start); k++) {
            const Slot slot = of[k];
            if (slot.strip < 0)
                continue;
            int8 texels = heads[k];
            for (int i = 0; i < slot.texels; i += 8) {
                emit8(&planes, k, &slot, texels, out, at + i, MIN(8, slot.texels - i));
                texels = *(__global loose_int8 *)(slot_texels + slot.list + i + 8);
            }
            at += slot.texels;
            if (slot.texels)
                continue;
            const Strip s = strips[slot.strip];
            at += emit_own(&planes, k, &slot, &s, drawn[triangles[start + k]], enlarge, out, at);
        }
    }
}
