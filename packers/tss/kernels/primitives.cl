#include "camera.cl"
#include "piece.cl"

// The primitives of a frame: triangles, and the pieces of those that are too large.

__kernel void count_pieces(int count, __global const int *pieces, __global int *numbers)
{
    const int i = get_global_id(0);
    if (i < count)
        numbers[i] = pieces[i] * pieces[i];
}

__kernel void list_pieces(int count, __global const int *numbers, __global const int *starts, __global int *parents)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    for (int k = 0; k < numbers[i]; k++)
        parents[starts[i] + k] = i;
}

// shapes: level, base, height and foot on screen. firsts: the corner where the longest edge begins. 8 per step.
__kernel void measure_primitives(int count, __global const int *parents, __global const int *starts,
                                 __global const int *pieces, __global const float *depths, __global const int *ids,
                                 __global const int *indices, __global const float *positions,
                                 __global const float *camera, __global float *shapes, __global int *firsts)
{
    const int first = 8 * get_global_id(0);
    if (first >= count)
        return;
    Points8 p[3];
    float8 u, v, step, inverse[3];
    for (int k = 0; k < 8; k++) {
        const int i = MIN(first + k, count - 1), parent = parents[i];
        const size_t id = ids[parent];
        for (int j = 0; j < 3; j++) {
            __global const float *position = positions + 3 * (size_t)indices[3 * id + j];
            ((float *)&p[j].x)[k] = position[0];
            ((float *)&p[j].y)[k] = position[1];
            ((float *)&p[j].z)[k] = position[2];
        }
        const Piece piece = piece_of(pieces[parent], i - starts[parent]);
        const float3 w = inverse_depths(vload4(parent, depths), pieces[parent], 1.0f);
        ((float *)&u)[k] = piece.u, ((float *)&v)[k] = piece.v, ((float *)&step)[k] = piece.step;
        ((float *)&inverse[0])[k] = w.x, ((float *)&inverse[1])[k] = w.y, ((float *)&inverse[2])[k] = w.z;
    }
    for (int j = 0; j < 3; j++)
        p[j] = from_eye(p[j], camera);
    float8 x[3], y[3];
    int8 bounded = (int8)(0);
    for (int j = 0; j < 3; j++) {
        const float8 a = j == 1 ? u + step : u, b = j == 2 ? v + step : v;
        const float8 w0 = (1.0f - a - b) * inverse[0], w1 = a * inverse[1], w2 = b * inverse[2], sum = w0 + w1 + w2;
        const float8 l0 = w0 / sum, l1 = w1 / sum, l2 = w2 / sum;
        const Points8 at = {l0 * p[0].x + l1 * p[1].x + l2 * p[2].x, l0 * p[0].y + l1 * p[1].y + l2 * p[2].y,
                            l0 * p[0].z + l1 * p[1].z + l2 * p[2].z};
        const float8 depth = bounded_depth(at, camera, &bounded);
        x[j] = camera[SCALE_X] * along(at, camera + RIGHT) / depth;
        y[j] = camera[SCALE_Y] * along(at, camera + UP) / depth;
    }
    const Shape8 s = shape_of(x, y);
    for (int k = 0; k < 8 && first + k < count; k++) {
        __global float *shape = shapes + 4 * (size_t)(first + k);
        shape[0] = ((float *)&s.level)[k];
        shape[1] = ((float *)&s.base)[k];
        shape[2] = ((float *)&s.height)[k];
        shape[3] = ((float *)&s.foot)[k];
        firsts[first + k] = ((int *)&s.first)[k];
    }
}
