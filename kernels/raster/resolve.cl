// From visibility to shading samples: one per covered pixel, in row order.
#include "raster/camera.cl"

__kernel void covered_per_row(const int width, const int height, __global const int *triangles, __global int *counts)
{
    const int y = get_global_id(0);
    if (y >= height)
        return;
    __global const int *row = triangles + (size_t)y * width;
    int8 wide = 0;
    int x = 0;
    for (; x + 8 <= width; x += 8)
        wide -= *(__global const loose_int8 *)(row + x) >= 0;
    const int4 four = wide.lo + wide.hi;
    int count = four.x + four.y + four.z + four.w;
    for (; x < width; x++)
        count += row[x] >= 0;
    counts[y] = count;
}

__kernel void list_covered(const int width, const int height, __global const int *triangles,
                           __global const int *offsets, __global int *triangle, __global int *texel)
{
    const int y = get_global_id(0);
    if (y >= height)
        return;
    int at = offsets[y];
    for (int x = 0; x < width; x++) {
        const int seen = triangles[(size_t)y * width + x];
        if (seen >= 0) {
            triangle[at] = seen;
            texel[at++] = y * width + x;
        }
    }
}

// Barycentrics and footprints of 8 samples per item. Corners are taken as 2D homogeneous points relative to the pixel's
// centre, h = (x - px w, y - py w): their cross products are the barycentrics up to scale, also behind the camera, and
// small differences stay exact (the homogeneous rasterisation of Olano and Greer 1997, shifted to each pixel).
__kernel void sample_covered(const int count, const int width, const int height, const float4 eye, const float16 rows,
                             __global const float *positions, __global const int *indices, __global const int *triangle,
                             __global const int *texel, __global float *bary1, __global float *bary2,
                             __global float *footprint)
{
    const int first = get_global_id(0) * 8;
    if (first >= count)
        return;
    float8 corners[9], px, py;
    for (int lane = 0; lane < 8; lane++) {
        const int sample = MIN(first + lane, count - 1), row = texel[sample] / width;
        const size_t seen = triangle[sample];
        ((float *)&px)[lane] = (texel[sample] - row * width) * SUBPIXELS + SUBPIXELS / 2 - width * (SUBPIXELS / 2);
        ((float *)&py)[lane] = row * SUBPIXELS + SUBPIXELS / 2 - height * (SUBPIXELS / 2);
        for (int i = 0; i < 3; i++)
            for (int axis = 0; axis < 3; axis++)
                ((float *)&corners[3 * i + axis])[lane] = positions[3 * (size_t)indices[3 * seen + i] + axis];
    }
    float8 x[3], y[3], z[3], u[3], v[3], w[3];
    for (int i = 0; i < 3; i++) {
        x[i] = corners[3 * i] - eye.s0;
        y[i] = corners[3 * i + 1] - eye.s1;
        z[i] = corners[3 * i + 2] - eye.s2;
        w[i] = ((rows.sc * x[i] + rows.sd * y[i]) + rows.se * z[i]) + rows.sf;
        u[i] = (((rows.s0 * x[i] + rows.s1 * y[i]) + rows.s2 * z[i]) + rows.s3) - px * w[i];
        v[i] = (((rows.s4 * x[i] + rows.s5 * y[i]) + rows.s6 * z[i]) + rows.s7) - py * w[i];
    }
    const float8 a0 = u[1] * v[2] - v[1] * u[2], a1 = u[2] * v[0] - v[2] * u[0], a2 = u[0] * v[1] - v[0] * u[1];
    const float8 sum = (a0 + a1) + a2, size = MAX(sum, -sum);
    const int8 sound = (size > 1e-30f) & (size < 1e30f);
    const float8 scale = 1.0f / (sound ? sum : (float8)1.0f);
    float8 b1 = sound ? a1 * scale : (float8)(1.0f / 3), b2 = sound ? a2 * scale : (float8)(1.0f / 3);
    // Derivatives per pixel: moving the pixel's centre changes u by -w (along x) and v by -w (along y).
    const float8 step = SUBPIXELS * scale;
    const float8 x0 = v[1] * w[2] - w[1] * v[2], x1 = v[2] * w[0] - w[2] * v[0], x2 = v[0] * w[1] - w[0] * v[1];
    const float8 y0 = w[1] * u[2] - u[1] * w[2], y1 = w[2] * u[0] - u[2] * w[0], y2 = w[0] * u[1] - u[0] * w[1];
    const float8 along_x = (x0 + x1) + x2, along_y = (y0 + y1) + y2;
    const float8 b1x = (x1 - b1 * along_x) * step, b2x = (x2 - b2 * along_x) * step;
    const float8 b1y = (y1 - b1 * along_y) * step, b2y = (y2 - b2 * along_y) * step;
    float8 square_x = 0.0f, square_y = 0.0f;
    for (int axis = 0; axis < 3; axis++) {
        const float8 *p = axis == 0 ? x : axis == 1 ? y : z;
        const float8 e1 = p[1] - p[0], e2 = p[2] - p[0];
        const float8 dx = b1x * e1 + b2x * e2, dy = b1y * e1 + b2y * e2;
        square_x += dx * dx;
        square_y += dy * dy;
    }
    b1 = MAX(b1, 0.0f);
    b1 = MIN(b1, 1.0f);
    b2 = MAX(b2, 0.0f);
    b2 = MIN(b2, 1.0f - b1);
    const float8 longer = sqrt(MAX(square_x, square_y));
    *(__global float8 *)(bary1 + first) = b1;
    *(__global float8 *)(bary2 + first) = b2;
    *(__global float8 *)(footprint + first) = (sound & (longer < 1e30f)) ? longer : (float8)0.0f;
}
