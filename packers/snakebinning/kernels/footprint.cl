#include "common/elementary.cl"
#include "bins.cl"
#include "pieces.cl"

// How a triangle appears to a camera turned to it (section 3.1), as a shape on its longest edge, and its bin.
// 8 triangles per step up to the projected corners; then each on its own.

#define FLATTEST 3.7320508f // cot 15 degrees
#define OBTUSE -0.22f       // cot 102.5 degrees: how far an angle of a kept triangle may pass 90 degrees
#define UNIT 8.0f           // lengths are stored in 1/8 texel
#define STEEPEST 0.3f       // limit of the perspective's change, see limited_weights
#define OUTSIDE 1.9f        // as in emit.cl: barycentrics stop at one height and so many texels outside
#define REACH 1.42f         // texels beyond an edge that lookups inside touch, at most

#define VIEW_FLOATS 16
#define MOVED_BACK 1
#define SLENDER 2
#define CLIPPED 4
#define KEPT 8
#define POINT 16

#define STAYS 1.125f // texels' worth of longest edge that a point may grow to before it has a shape again

typedef struct {
    float8 x, y, z;
} Vector8;

INLINE float8 dot8(Vector8 a, Vector8 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

INLINE Vector8 cross8(Vector8 a, Vector8 b)
{
    return (Vector8){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

INLINE float8 abs8(float8 a)
{
    return a < 0.0f ? -a : a;
}

// a of length 1, or `otherwise` where it has none. Longer than `shortest` it counts.
INLINE Vector8 normalize8(Vector8 a, float shortest, float3 otherwise)
{
    const float8 length = sqrt(dot8(a, a));
    const int8 usable = length > shortest;
    const float8 scale = 1.0f / (usable ? length : (float8)(1.0f));
    return (Vector8){usable ? a.x * scale : otherwise.x, usable ? a.y * scale : otherwise.y,
                     usable ? a.z * scale : otherwise.z};
}

// Corners on the virtual screen, in texels, their distances along the view direction, and how far it was moved back.
typedef struct {
    float8 x[3], y[3], w[3], back;
} Projected8;

INLINE Projected8 project8(const Vector8 *corner, __global const float *view)
{
    const float3 up = vload3(2, view), right = vload3(3, view);
    Vector8 p[3];
    for (int k = 0; k < 3; k++) {
        p[k].x = (corner[k].x - view[0]) - view[3];
        p[k].y = (corner[k].y - view[1]) - view[4];
        p[k].z = (corner[k].z - view[2]) - view[5];
    }
    const Vector8 middle = {p[0].x + p[1].x + p[2].x, p[0].y + p[1].y + p[2].y, p[0].z + p[1].z + p[2].z};
    const Vector8 n = normalize8(middle, 0.0f, cross3(up, right));
    const Vector8 up8 = {up.x, up.y, up.z};
    const Vector8 across = normalize8(cross8(n, up8), 1e-3f, right), upwards = cross8(across, n);
    Projected8 result;
    result.back = (float8)(0.0f);
    for (int k = 0; k < 3; k++) {
        const float8 x = dot8(p[k], across), y = dot8(p[k], upwards), z = dot8(p[k], n);
        const float8 for_x = abs8(x) * view[13] - z, for_y = abs8(y) * view[14] - z;
        const float8 further = MAX(MAX(for_x, for_y), view[15] - z);
        result.back = MAX(result.back, further);
        result.x[k] = x, result.y[k] = y, result.w[k] = z;
    }
    for (int k = 0; k < 3; k++) {
        result.w[k] += result.back;
        const float8 scale = view[12] / result.w[k];
        result.x[k] *= scale;
        result.y[k] *= scale;
    }
    return result;
}

INLINE float8 doubled_area8(const Projected8 *p)
{
    return abs8((p->x[1] - p->x[0]) * (p->y[2] - p->y[0]) - (p->y[1] - p->y[0]) * (p->x[2] - p->x[0]));
}

// Corner a with the angle alpha, b with beta, c above the edge between them; before and after alpha and beta meet the
// height's foot.
typedef struct {
    float height, before, after;
} Shape;

INLINE Shape shape_on(const float *x, const float *y, int a, int b, int c)
{
    const float ex = x[b] - x[a], ey = y[b] - y[a], cx = x[c] - x[a], cy = y[c] - y[a];
    const float edge = sqrt(ex * ex + ey * ey), inverse = edge > 0.0f ? 1.0f / edge : 0.0f;
    const float before = (ex * cx + ey * cy) * inverse;
    return (Shape){fabs(ex * cy - ey * cx) * inverse, before, edge - before};
}

// a | 4 where b is not the corner after a.
INLINE int roles_of(const float *x, const float *y)
{
    float squared[3]; // of the edge opposite each corner
    for (int k = 0; k < 3; k++) {
        const int i = k == 2 ? 0 : k + 1, j = k == 0 ? 2 : k - 1;
        squared[k] = (x[j] - x[i]) * (x[j] - x[i]) + (y[j] - y[i]) * (y[j] - y[i]);
    }
    int c = 0;
    if (squared[1] > squared[0])
        c = 1;
    if (squared[2] > squared[c])
        c = 2;
    const int i = c == 2 ? 0 : c + 1, j = c == 0 ? 2 : c - 1;
    // The corner nearer to c, which is opposite the other's shorter edge, has the larger angle.
    return squared[j] <= squared[i] ? i : j | 4;
}

// The shape as strips can hold it.
INLINE Shape fitted(Shape s, float highest, float longest, int *flags)
{
    if (s.height > highest) {
        const float scale = highest / s.height;
        s.before *= scale, s.after *= scale, s.height = highest;
        *flags |= CLIPPED;
    }
    s.height = s.height > 1.0f ? s.height : 1.0f;
    s.before = s.before > 0.0f ? s.before : 0.0f;
    s.after = s.after > 0.0f ? s.after : 0.0f;
    if (s.before > FLATTEST * s.height) {
        s.before = FLATTEST * s.height;
        *flags |= SLENDER;
    }
    if (s.before + s.after > longest) {
        s.before = s.before < 0.5f * longest ? s.before : 0.5f * longest;
        s.after = s.after < longest - s.before ? s.after : longest - s.before;
        *flags |= CLIPPED;
    }
    if (s.before + s.after < 1.0f)
        s.after = 1.0f - s.before;
    return s;
}

// Number of edges, cotangents in falling order, that the angle with this cotangent (before / height) passes.
INLINE int angle_index(__constant const float *edges, float before, float height)
{
    int low = 0, high = ANGLES - 1;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (before < edges[middle] * height)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

INLINE int height_index(float height, float scale, int logarithmic)
{
    const float steps = scale * (logarithmic ? log2_1(height) : height - 1.0f);
    return clamp((int)ceil(steps), 0, HEIGHTS - 1);
}

INLINE int3 indices_of(Shape s, __constant const float *edges, float scale, int logarithmic)
{
    return (int3)(angle_index(edges, s.before, s.height), angle_index(edges + BETA_EDGES, s.after, s.height),
                  height_index(s.height, scale, logarithmic));
}

// Inverse distances of the corners as parts of 255, brought towards their mean until the change of the perspective is
// gentle: with q(x, y) the interpolated inverse distance, (|dq/dx| + |dq/dy|) max(q) / min(q)^2 <= STEEPEST per texel.
// Bilinear interpolation between samples is then right within 0.1 texel, and q is positive wherever lookups reach. Nor
// does a barycentric there, up to -REACH / height max(q) / min(q), pass where emit.cl stops it.
INLINE uint limited_weights(const float *w, int a, int b, int c, Shape s)
{
    const float nearest = fmin(fmin(w[0], w[1]), w[2]);
    float q[3];
    for (int k = 0; k < 3; k++)
        q[k] = fmax(nearest / w[k], 1.0f / 255.0f);
    const float mean = (q[0] + q[1] + q[2]) * (1.0f / 3.0f);
    for (int step = 0; step < 8; step++) {
        const float along = (q[b] - q[a]) / (s.before + s.after);
        const float across = (q[c] - q[a] - along * s.before) / s.height;
        const float least = fmin(fmin(q[0], q[1]), q[2]), most = fmax(fmax(q[0], q[1]), q[2]);
        const bool gentle = (fabs(along) + fabs(across)) * most <= STEEPEST * least * least;
        if (gentle && REACH * most <= (s.height + OUTSIDE) * least)
            break;
        const float part = step == 7 ? 0.0f : 0.7f;
        for (int k = 0; k < 3; k++)
            q[k] = mean + part * (q[k] - mean);
    }
    const float scale = 255.0f / fmax(fmax(q[0], q[1]), q[2]);
    uint word = 0;
    for (int k = 0; k < 3; k++)
        word |= (uint)(q[k] * scale + 0.5f) << 8 * k;
    return word;
}

// Of a shape, in texels.
INLINE float area_of(ushort4 length)
{
    return 0.5f / (UNIT * UNIT) * (float)(length.x + length.y) * (float)length.z;
}

// Of all views the projection with the largest area; `largest`: twice that area.
INLINE Projected8 largest_projection(const Vector8 *corner, const int views, __global const float *view,
                                     float8 *largest)
{
    Projected8 best = project8(corner, view);
    *largest = doubled_area8(&best);
    for (int v = 1; v < views; v++) {
        const Projected8 next = project8(corner, view + VIEW_FLOATS * v);
        const float8 area = doubled_area8(&next);
        const int8 better = area > *largest;
        *largest = better ? area : *largest;
        best.back = better ? next.back : best.back;
        for (int k = 0; k < 3; k++) {
            best.x[k] = better ? next.x[k] : best.x[k];
            best.y[k] = better ? next.y[k] : best.y[k];
            best.w[k] = better ? next.w[k] : best.w[k];
        }
    }
    return best;
}

// What a shape must fit, and the edges of the bins.
typedef struct {
    __constant const float *edges;
    float scale;
    int logarithmic;
    float highest, longest, point;
    int near_height, near_angle;
} Fit;

// Whether a triangle, measured with its old roles, is near the bin where it was; then its flags are added.
INLINE int keeps_bin(const float *x, const float *y, const int before, const uint word, const Fit *fit, int *flags)
{
    const int a = word >> 24 & 3, turned = word >> 26 & 1;
    const int after_a = a == 2 ? 0 : a + 1, last = 3 - a - after_a;
    const Shape raw = shape_on(x, y, a, turned ? last : after_a, turned ? after_a : last);
    int of_shape = 0;
    const Shape s = fitted(raw, fit->highest, fit->longest, &of_shape);
    const int3 now = indices_of(s, fit->edges, fit->scale, fit->logarithmic);
    const int3 then = (int3)(before / COLUMN / ANGLES, before / COLUMN % ANGLES, before % COLUMN);
    const int3 d = now - then;
    const int is_near = raw.before >= OBTUSE * s.height && raw.after >= OBTUSE * s.height &&
                        abs(d.x) <= fit->near_angle && abs(d.y) <= fit->near_angle && abs(d.z) <= fit->near_height &&
                        raw.before + raw.after >= fit->point;
    if (is_near)
        *flags |= of_shape | KEPT;
    return is_near;
}

// lengths: before, after, height in 1/8 texel, by triangle; words: weights and, from bit 24 on, roles; bins: by
// triangle, -1 at first; areas in texels, by place in the list. A triangle keeps all three while its bin, measured with
// its old roles, is near its old one. Triangles, but no pieces, whose longest edge is shorter than `point` are points.
__kernel void measure_triangles(int count, __global const int *triangles, __global const float *positions,
                                __global const int *indices, int first_piece, __global const float *pieces, int views,
                                __global const float *view, __constant const float *edges, float scale, int logarithmic,
                                float highest, float longest, float point, int perspective, int near_height,
                                int near_angle, __global int *bins, __global ushort4 *lengths, __global uint *words,
                                __global uchar *notes, __global float *areas)
{
    const int first = 8 * get_global_id(0);
    if (first >= count)
        return;
    Vector8 corner[3];
    for (int lane = 0; lane < 8; lane++) {
        const int triangle = triangles[MIN(first + lane, count - 1)];
        for (int k = 0; k < 3; k++) {
            __global const float *position = corner_of(triangle, k, positions, indices, first_piece, pieces);
            ((float *)&corner[k].x)[lane] = position[0];
            ((float *)&corner[k].y)[lane] = position[1];
            ((float *)&corner[k].z)[lane] = position[2];
        }
    }
    float8 largest;
    const Projected8 best = largest_projection(corner, views, view, &largest);
    const Fit fit = {edges, scale, logarithmic, highest, longest, point, near_height, near_angle};
    for (int lane = 0; lane < 8 && first + lane < count; lane++) {
        const int triangle = triangles[first + lane];
        float x[3], y[3], w[3];
        for (int k = 0; k < 3; k++) {
            x[k] = ((const float *)&best.x[k])[lane], y[k] = ((const float *)&best.y[k])[lane];
            w[k] = ((const float *)&best.w[k])[lane];
        }
        int flags = ((const float *)&best.back)[lane] > 0.0f ? MOVED_BACK : 0;
        const int before = bins[triangle];
        const int was_point = near_height >= 0 && before == POINTS;
        if (near_height >= 0 && before >= 0 && !was_point && keeps_bin(x, y, before, words[triangle], &fit, &flags)) {
            notes[first + lane] = flags;
            areas[first + lane] = area_of(lengths[triangle]);
            continue;
        }
        const int roles = roles_of(x, y), a = roles & 3, after_a = a == 2 ? 0 : a + 1, last = 3 - a - after_a;
        const int b = roles & 4 ? last : after_a, c = roles & 4 ? after_a : last;
        const Shape raw = shape_on(x, y, a, b, c);
        if (triangle < first_piece && raw.before + raw.after < (was_point ? STAYS * point : point)) {
            bins[triangle] = POINTS;
            lengths[triangle] = (ushort4)(0);
            words[triangle] = 0xFFFFFFu | (uint)roles << 24;
            notes[first + lane] = flags | POINT | (was_point ? KEPT : 0);
            areas[first + lane] = 0.5f * ((float *)&largest)[lane];
            continue;
        }
        const Shape s = fitted(raw, highest, longest, &flags);
        const int3 index = indices_of(s, edges, scale, logarithmic);
        const ushort low = (ushort)(UNIT * s.before + 0.5f), high = (ushort)(UNIT * s.after + 0.5f);
        bins[triangle] = bin_of(index.x, index.y, index.z);
        const ushort4 length = (ushort4)(low, low + high < 8 ? 8 - low : high, (ushort)(UNIT * s.height + 0.5f), 0);
        lengths[triangle] = length;
        areas[first + lane] = area_of(length);
        words[triangle] = (perspective ? limited_weights(w, a, b, c, s) : 0xFFFFFFu) | (uint)roles << 24;
        notes[first + lane] = flags;
    }
}
