#include "limits.cl"
#include "piece.cl"
#include "place.cl"

// The shading samples of placed primitives.

#define IOTA ((float8)(0.0f, 1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f, 7.0f))

// cells: first cell of each level in the table of cells.
INLINE int samples_of(int4 form, int2 places, __global const int *starts)
{
    if (form.x != OVERSAMPLED)
        return places.x >= 0 ? starts[form.x + 1] - starts[form.x] : 0;
    int sum = 0;
    for (int side = 0; side < 2; side++) {
        const int w = side ? form.w : form.z;
        if ((side ? places.y : places.x) < 0 || w == 0)
            continue;
        const int h = form.y, p = MAX(w, h), q = MIN(w, h);
        for (int row = 0; row <= q; row++)
            sum += row_length(p, q, row);
    }
    return sum;
}

__kernel void count_samples(int count, int run, int runs, __global const int *forms, __global const int *places,
                            __global const int *starts, __global int *counts)
{
    const int r = get_global_id(0);
    if (r >= runs)
        return;
    const int end = MIN(count, (r + 1) * run);
    int sum = 0;
    for (int i = r * run; i < end; i++)
        sum += samples_of(vload4(i, forms), vload2(i, places), starts);
    counts[r] = sum;
}

typedef struct {
    float x, y, z;
} Vector;

// A triangle as its samples see it. v0: inverse depth of corner 0; k1, k2: what those of the others have more; e1, e2:
// its edges from corner 0; least: of the perspective's denominator, against samples beyond the horizon.
typedef struct {
    int id;
    float v0, v1, v2, k1, k2, least;
    Vector e1, e2;
    Vector step; // of the footprint: numerator, and its share of the way to the sample
    float share;
} Surface;

INLINE Vector difference(__global const float *a, __global const float *b)
{
    Vector v = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return v;
}

INLINE Surface surface_of(int id, float4 inverse, __global const int *indices, __global const float *positions)
{
    Surface s;
    __global const int *corner = indices + 3 * (size_t)id;
    __global const float *p0 = positions + 3 * (size_t)corner[0];
    s.id = id;
    s.v0 = inverse.x, s.v1 = inverse.y, s.v2 = inverse.z;
    s.k1 = s.v1 - s.v0, s.k2 = s.v2 - s.v0;
    const float low = s.v0 < s.v1 ? s.v0 : s.v1;
    s.least = 0.25f * (low < s.v2 ? low : s.v2);
    s.e1 = difference(positions + 3 * (size_t)corner[1], p0);
    s.e2 = difference(positions + 3 * (size_t)corner[2], p0);
    return s;
}

// The way on the surface that a step of screen weights (a, b) takes from where they are (m1, m2), squared, times D^2:
// d(P) = (a v1 (e1 - r) + b v2 (e2 - r) + (a + b) v0 r) / D, r the way from corner 0 to P.
INLINE float squared_way(Surface *s, float a, float b, float m1, float m2)
{
    const float d = s->v0 + m1 * s->k1 + m2 * s->k2, l1 = m1 * s->v1 / d, l2 = m2 * s->v2 / d;
    const float share = a * s->k1 + b * s->k2;
    const float f1 = a * s->v1 - share * l1, f2 = b * s->v2 - share * l2;
    const float x = f1 * s->e1.x + f2 * s->e2.x, y = f1 * s->e1.y + f2 * s->e2.y, z = f1 * s->e1.z + f2 * s->e2.z;
    return x * x + y * y + z * z;
}

// Takes the step (a, b) for the footprint's if it is longer than `way`; the longer way.
INLINE float longer_step(Surface *s, float a, float b, float m1, float m2, float way)
{
    const float squared = squared_way(s, a, b, m1, m2);
    if (!(squared > way))
        return way;
    const float f1 = a * s->v1, f2 = b * s->v2;
    s->step.x = f1 * s->e1.x + f2 * s->e2.x;
    s->step.y = f1 * s->e1.y + f2 * s->e2.y;
    s->step.z = f1 * s->e1.z + f2 * s->e2.z;
    s->share = a * s->k1 + b * s->k2;
    return squared;
}

// Where samples go: the arrays of Samples, the next index, and the end of what this run may write.
typedef struct {
    __global int *triangle;
    __global float *bary1, *bary2, *footprint;
    __global int *texel;
    int at, last;
} Sink;

INLINE void store_lanes(int8 value, __global int *array, int count)
{
    for (int k = 0; k < count; k++)
        array[k] = ((int *)&value)[k];
}

// Up to 8 samples (`number` of them) at screen weights m1, m2.
INLINE void emit8(Sink *sink, Surface *s, float8 m1, float8 m2, int8 texel, int number)
{
    float8 d = s->v0 + m1 * s->k1 + m2 * s->k2;
    d = 1.0f / MAX(d, (float8)(s->least));
    const float8 l1 = m1 * s->v1 * d, l2 = m2 * s->v2 * d;
    const float8 t1 = s->share * l1, t2 = s->share * l2;
    const float8 x = s->step.x - t1 * s->e1.x - t2 * s->e2.x, y = s->step.y - t1 * s->e1.y - t2 * s->e2.y;
    const float8 z = s->step.z - t1 * s->e1.z - t2 * s->e2.z;
    const float8 footprint = sqrt(x * x + y * y + z * z) * d;
    const int at = sink->at;
    if (at + 8 <= sink->last) { // lanes beyond `number` are written again by the next samples of this run
        *(__global loose_int8 *)(sink->triangle + at) = (int8)(s->id);
        *(__global loose_float8 *)(sink->bary1 + at) = l1;
        *(__global loose_float8 *)(sink->bary2 + at) = l2;
        *(__global loose_float8 *)(sink->footprint + at) = footprint;
        *(__global loose_int8 *)(sink->texel + at) = texel;
    } else {
        store_lanes((int8)(s->id), sink->triangle + at, number);
        store_lanes(as_int8(l1), (__global int *)sink->bary1 + at, number);
        store_lanes(as_int8(l2), (__global int *)sink->bary2 + at, number);
        store_lanes(as_int8(footprint), (__global int *)sink->footprint + at, number);
        store_lanes(texel, sink->texel + at, number);
    }
    sink->at = at + number;
}

// The cells of an L, from the table: weights of the piece's corners 1 and 2, and column | row << 16.
INLINE void emit_l(Sink *sink, Surface *s, Piece piece, int level, int word, int width, __global const int *starts,
                   __global const float *cell_1, __global const float *cell_2, __global const int *cell_at)
{
    const float spacing = piece.step / (float)MAX(level, 1), third = piece.step / 3.0f;
    const float c1 = piece.u + third, c2 = piece.v + third;
    float way = longer_step(s, spacing, 0.0f, c1, c2, -1.0f);
    way = longer_step(s, 0.0f, spacing, c1, c2, way);
    longer_step(s, spacing, -spacing, c1, c2, way);
    const Place place = unpack_place(word);
    const int first = starts[level], end = starts[level + 1], origin = place.row * width + place.column;
    for (int k = first; k < end; k += 8) {
        const float8 m1 = piece.u + piece.step * *(__global const loose_float8 *)(cell_1 + k);
        const float8 m2 = piece.v + piece.step * *(__global const loose_float8 *)(cell_2 + k);
        const int8 at = *(__global const loose_int8 *)(cell_at + k);
        emit8(sink, s, m1, m2, origin + place.sign * ((at & 0xFFFF) + (at >> 16) * width), MIN(8, end - k));
    }
}

// Screen weights (of the triangle's corners 1 and 2) of a piece's corner.
INLINE float2 corner_of(Piece piece, int corner)
{
    const float2 at =
        (float2)(corner == 1 ? piece.u + piece.step : piece.u, corner == 2 ? piece.v + piece.step : piece.v);
    return at;
}

// One of the right triangles that the height over the longest edge makes; its longer side lies along the atlas' rows.
// foot: screen weights of the height's foot; along, up: steps of one texel along the base, away from the foot, and up.
INLINE void emit_half(Sink *sink, Surface *s, float2 foot, float2 along, float2 up, int w, int h, int word, int width)
{
    const Place place = unpack_place(word);
    const int p = MAX(w, h), q = MIN(w, h), origin = place.row * width + place.column;
    const float2 across = w > h ? along : up, down = w > h ? up : along;
    const int8 columns = place.sign * (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    for (int row = 0; row <= q; row++) {
        const int length = row_length(p, q, row), start = origin + place.sign * row * width;
        const float m1 = foot.x + (float)row * down.x, m2 = foot.y + (float)row * down.y;
        for (int k = 0; k < length; k += 8) {
            const float8 column = (float)k + IOTA;
            emit8(sink, s, m1 + column * across.x, m2 + column * across.y, start + place.sign * k + columns,
                  MIN(8, length - k));
        }
    }
}

INLINE void emit_halves(Sink *sink, Surface *s, Piece piece, int corner, int4 form, int2 places, int width)
{
    const int next = corner == 2 ? 0 : corner + 1, last = corner == 0 ? 2 : corner - 1;
    const float2 begin = corner_of(piece, corner), end = corner_of(piece, next), apex = corner_of(piece, last);
    const float2 along = (end - begin) / (float)(form.z + form.w);
    const float2 foot = begin + (float)form.z * along, up = (apex - foot) / (float)form.y;
    const float2 centre = (begin + end + apex) / 3.0f;
    const float way = longer_step(s, along.x, along.y, centre.x, centre.y, -1.0f);
    longer_step(s, up.x, up.y, centre.x, centre.y, way);
    if (places.x >= 0)
        emit_half(sink, s, foot, -along, up, form.z, form.y, places.x, width);
    if (places.y >= 0)
        emit_half(sink, s, foot, along, up, form.w, form.y, places.y, width);
}

__kernel void emit_samples(int count, int run, int runs, __global const int *forms, __global const int *places,
                           __global const int *starts, __global const int *firsts, __global const int *parents,
                           __global const int *piece_starts, __global const int *pieces, __global const float *inverse,
                           __global const int *ids, __global const int *indices, __global const float *positions,
                           __global const float *cell_1, __global const float *cell_2, __global const int *cell_at,
                           int width, __global const int *counts, __global const int *offsets, __global int *triangle,
                           __global float *bary1, __global float *bary2, __global float *footprint, __global int *texel)
{
    const int r = get_global_id(0);
    if (r >= runs)
        return;
    Sink sink = {triangle, bary1, bary2, footprint, texel, offsets[r], offsets[r] + counts[r]};
    const int end = MIN(count, (r + 1) * run);
    for (int i = r * run; i < end; i++) {
        const int4 form = vload4(i, forms);
        const int2 at = vload2(i, places);
        if (at.x < 0 && at.y < 0)
            continue;
        const int parent = parents[i];
        const Piece piece = piece_of(pieces[parent], i - piece_starts[parent]);
        Surface surface = surface_of(ids[parent], vload4(parent, inverse), indices, positions);
#if OVERSAMPLING
        if (form.x == OVERSAMPLED) {
            emit_halves(&sink, &surface, piece, firsts[i], form, at, width);
            continue;
        }
#endif
        emit_l(&sink, &surface, piece, form.x, at.x, width, starts, cell_1, cell_2, cell_at);
    }
}
