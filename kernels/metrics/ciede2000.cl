// The colour difference CIEDE2000 (Sharma, Wu and Dalal 2005), without trigonometric calls: hues stay unit vectors.

#include "common/wide.cl"
#include "metrics/colour.cl"

// CIELAB planes (3) of a picture.
__kernel void lab_planes(const int width, const int height, const int stride, __global const uint *image,
                         __global const float *linear, __global const float *to_xyz, __global float *planes)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int row = get_global_id(0) / pieces;
    if (row >= height)
        return;
    const int column = (get_global_id(0) % pieces) * PIECE;
    const wide3 lab = lab_of(transform(to_xyz, linear_rgb(load_pixels(image, width, row, column), linear)));
    const int size = height * stride;
    __global float *out = planes + plane_offset(stride, row, column);
    vstore16(lab.x, 0, out);
    vstore16(lab.y, 0, out + size);
    vstore16(lab.z, 0, out + 2 * size);
}

// sqrt(c^7 / (c^7 + 25^7)), with c in units of 25.
INLINE float16 chroma_weight(const float16 chroma)
{
    const float16 c = chroma * 0.04f;
    const float16 c2 = c * c;
    const float16 c7 = c2 * c2 * c2 * c;
    return sqrt(c7 / (c7 + 1.0f));
}

// The angle in degrees of the vector (x, y) with x > 0, from the half-angle tangent (error 1e-4).
INLINE float16 degrees_from_axis(const float16 x, const float16 y, const float16 length)
{
    const float16 t = y / (x + length);
    const float16 s = t * t;
    const float16 series =
        1.0f +
        s * (-0.33332977f +
             s * (0.19980379f +
                  s * (-0.14120324f + s * (0.10336555f + s * (-0.06533923f + s * (0.02867911f + s * -0.00600352f))))));
    return 2.0f * 57.2957795f * t * series;
}

// sin of x in 0..pi/3 (error 1e-7).
INLINE float16 small_sine(const float16 x)
{
    const float16 s = x * x;
    return x * (1.0f + s * (-1.0f / 6 + s * (1.0f / 120 + s * (-1.0f / 5040 + s * (1.0f / 362880)))));
}

// The rotation R_T of mean hue (c, s): -sin(2 * 30 exp(-((h - 275) / 25)^2)) times 2 sqrt(C^7 / (C^7 + 25^7)).
INLINE float16 rotation_term(const float16 c, const float16 s, const float16 chroma)
{
    const float cosine = 0.08715574f, sine = -0.99619470f; // of 275 degrees
    const float16 x = c * cosine + s * sine, y = s * cosine - c * sine;
    // Beyond 90 degrees from the axis the term is below 1e-4 of what it is on it; there the angle is taken as 90.
    const float16 angle = x > 0.0f ? degrees_from_axis(larger(x, 1e-6f), y, (float16)(1.0f)) : (float16)(90.0f);
    const float16 share = angle * 0.04f;
    const float16 spread = power_of_2(share * share * -1.44269504f);
    return -2.0f * small_sine(1.04719755f * spread) * chroma_weight(chroma);
}

// Unfused, so that it is exactly 0 for equal and for opposite hues.
INLINE float16 cross_product(const wide3 p, const wide3 q)
{
#pragma OPENCL FP_CONTRACT OFF
    return p.y * q.z - q.y * p.z;
}

INLINE float16 ciede2000(const wide3 p, const wide3 q)
{
    const float16 mean_ab = 0.5f * (sqrt(p.y * p.y + p.z * p.z) + sqrt(q.y * q.y + q.z * q.z));
    const float16 stretch = 1.5f - 0.5f * chroma_weight(mean_ab);
    const float16 pa = stretch * p.y, qa = stretch * q.y;
    const float16 pc = sqrt(pa * pa + p.z * p.z), qc = sqrt(qa * qa + q.z * q.z);
    const float16 both = pc * qc;
    const int16 grey = both < 1e-12f;
    const float16 safe = grey ? (float16)(1.0f) : both;
    // Cosine and sine of the hue difference, times both chromas. The sign of the sine decides which way round the mean
    // hue lies, so it comes from a and b before the stretch, where opposite hues cancel exactly.
    const float16 dot_pq = pa * qa + p.z * q.z;
    const float16 cross_pq = stretch * cross_product(p, q);
    // 2 sqrt(C1 C2) sin(dh / 2), from the sine where the cosine is safe to add, else from the cosine.
    const float16 near_hue = 1.41421356f * cross_pq / sqrt(larger(safe + dot_pq, 0.5f * safe));
    const float16 far_hue = sqrt(larger(2.0f * (safe - dot_pq), 0.0f));
    const float16 hue_size = dot_pq > -0.5f * safe ? fabs(near_hue) : far_hue;
    const float16 dh = grey ? (float16)(0.0f) : (cross_pq < 0.0f ? -hue_size : hue_size);

    // Mean hue as a unit vector: the sum of both hues, or, for nearly opposite ones, at right angles to their
    // difference.
    const float16 pi = 1.0f / larger(pc, 1e-12f), qi = 1.0f / larger(qc, 1e-12f);
    const float16 px = pa * pi, py = p.z * pi, qx = qa * qi, qy = q.z * qi;
    const float16 sx = px + qx, sy = py + qy, dx = px - qx, dy = py - qy;
    // For exactly opposite hues the standard takes (h1 + h2) / 2: the larger angle less 90 degrees.
    const int16 first_is_larger = (py < 0.0f) || (py == 0.0f && px < 0.0f && qy >= 0.0f);
    const int16 turn = cross_pq == 0.0f ? first_is_larger : (cross_pq < 0.0f);
    const int16 opposite = dot_pq < -0.5f * safe;
    const float16 hx = opposite ? (turn ? dy : -dy) : sx;
    const float16 hy = opposite ? (turn ? -dx : dx) : sy;
    const float16 scale = 1.0f / sqrt(larger(hx * hx + hy * hy, 1e-20f));
    const float16 c = grey && hx == 0.0f && hy == 0.0f ? (float16)(1.0f) : hx * scale;
    const float16 s = hy * scale;

    // cos(h - 30), cos 2h, cos(3h + 6) and cos(4h - 63) by the addition theorems.
    const float16 c2 = c * c - s * s, s2 = 2.0f * c * s;
    const float16 c3 = c2 * c - s2 * s, s3 = s2 * c + c2 * s;
    const float16 c4 = c2 * c2 - s2 * s2, s4 = 2.0f * c2 * s2;
    const float16 t = 1.0f - 0.17f * (0.86602540f * c + 0.5f * s) + 0.24f * c2 +
                      0.32f * (0.99452190f * c3 - 0.10452846f * s3) - 0.20f * (0.45399050f * c4 + 0.89100652f * s4);
    const float16 mean_chroma = 0.5f * (pc + qc);
    const float16 light = 0.5f * (p.x + q.x) - 50.0f;
    const float16 l = (q.x - p.x) / (1.0f + 0.015f * light * light / sqrt(20.0f + light * light));
    const float16 chroma = (qc - pc) / (1.0f + 0.045f * mean_chroma);
    const float16 hue = dh / (1.0f + 0.015f * mean_chroma * t);
    const float16 sum = l * l + chroma * chroma + hue * hue + rotation_term(c, s, mean_chroma) * chroma * hue;
    return sqrt(larger(sum, 0.0f));
}

// The difference of two rows of CIELAB planes, for tests: a, b are (3, count) with count a multiple of 16.
__kernel void differences(const int count, __global const float *a, __global const float *b, __global float *out)
{
    const int i = get_global_id(0) * PIECE;
    if (i >= count)
        return;
    const wide3 p = {vload16(0, a + i), vload16(0, a + count + i), vload16(0, a + 2 * count + i)};
    const wide3 q = {vload16(0, b + i), vload16(0, b + count + i), vload16(0, b + 2 * count + i)};
    vstore16(ciede2000(p, q), 0, out + i);
}

// The sum over each piece of the difference between a picture and the CIELAB planes of the reference.
__kernel void difference_sums(const int width, const int height, const int stride, __global const uint *image,
                              __global const float *linear, __global const float *to_xyz,
                              __global const float *reference, __global float *partial)
{
    const int pieces = (width + PIECE - 1) / PIECE;
    const int id = get_global_id(0);
    const int row = id / pieces;
    if (row >= height)
        return;
    const int column = (id % pieces) * PIECE;
    const int size = height * stride;
    __global const float *in = reference + plane_offset(stride, row, column);
    const wide3 p = {vload16(0, in), vload16(0, in + size), vload16(0, in + 2 * size)};
    const wide3 q = lab_of(transform(to_xyz, linear_rgb(load_pixels(image, width, row, column), linear)));
    partial[id] = sum_of_lanes(inside_only(ciede2000(p, q), column, 0, width));
}
