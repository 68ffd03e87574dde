#include "camera.cl"
#include "limits.cl"

// Depths and number of pieces of each triangle; 8 triangles per step.

#define MOST_PIECES 16.0f  // along an edge
#define LEAST_HEIGHT 16.0f // texels, of a slanted triangle's pieces: most samples of lower ones lie outside

INLINE float8 length_of(Points8 a, Points8 b)
{
    const float8 x = a.x - b.x, y = a.y - b.y, z = a.z - b.z;
    return sqrt(x * x + y * y + z * z);
}

// The level and height of a triangle if all of it were as near as its nearest point may be: at least the distance of
// its plane, and of its farthest corner less its longest edge.
INLINE float8 level_nearby(const Points8 *p, __global const float *camera, float8 *height)
{
    const Points8 a = {p[1].x - p[0].x, p[1].y - p[0].y, p[1].z - p[0].z};
    const Points8 b = {p[2].x - p[0].x, p[2].y - p[0].y, p[2].z - p[0].z};
    const Points8 n = {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    const float8 twice = sqrt(n.x * n.x + n.y * n.y + n.z * n.z);
    const float8 off = n.x * p[0].x + n.y * p[0].y + n.z * p[0].z;
    const float8 plane = (off < 0.0f ? -off : off) / (twice > 0.0f ? twice : (float8)(1.0f));
    const Points8 eye = {(float8)(0.0f), (float8)(0.0f), (float8)(0.0f)};
    float8 farthest = (float8)(0.0f), longest = (float8)(0.0f);
    for (int k = 0; k < 3; k++) {
        const float8 distance = length_of(p[k], eye), edge = length_of(p[k], p[k == 2 ? 0 : k + 1]);
        farthest = MAX(distance, farthest);
        longest = MAX(edge, longest);
    }
    float8 distance = MAX(plane, farthest - longest);
    distance = MAX(distance, (float8)(camera[NEAR]));
    const float8 scale = camera[SCALE_X] / distance;
    *height = scale * twice / (longest > 0.0f ? longest : (float8)(1.0f));
    return sqrt(twice * (2.0f / 3.0f)) * scale;
}

// depths: of the three corners, and the height in pixels, negative where the triangle leaves the view. pieces: along an
// edge. threshold: as in choose_strategies.
__kernel void measure_triangles(int count, __global const int *ids, __global const int *indices,
                                __global const float *positions, __global const float *camera, float scale,
                                float threshold, __global float *depths, __global int *pieces)
{
    const int first = 8 * get_global_id(0);
    if (first >= count)
        return;
    Points8 p[3];
    for (int k = 0; k < 8; k++) {
        const int id = ids[MIN(first + k, count - 1)];
        for (int j = 0; j < 3; j++) {
            __global const float *position = positions + 3 * (size_t)indices[3 * (size_t)id + j];
            ((float *)&p[j].x)[k] = position[0];
            ((float *)&p[j].y)[k] = position[1];
            ((float *)&p[j].z)[k] = position[2];
        }
    }
    float8 x[3], y[3], depth[3];
    int8 bounded = (int8)(0);
    for (int j = 0; j < 3; j++) {
        p[j] = from_eye(p[j], camera);
        depth[j] = bounded_depth(p[j], camera, &bounded);
        x[j] = camera[SCALE_X] * along(p[j], camera + RIGHT) / depth[j];
        y[j] = camera[SCALE_Y] * along(p[j], camera + UP) / depth[j];
    }
    const Shape8 shape = shape_of(x, y);
    float8 nearby_height;
    const float8 nearby = level_nearby(p, camera, &nearby_height);
    const float8 level = bounded && nearby > shape.level ? nearby : shape.level;
    const float8 wanted = scale * MAX(level / LEVELS, shape.base / LONGEST);
    const float8 most = scale * (bounded ? nearby_height : shape.height) / LEAST_HEIGHT;
    const float8 fewer = shape.base > threshold * shape.height && most < wanted ? floor(most) : ceil(wanted);
    const float8 along_edge = clamp(fewer, 1.0f, MOST_PIECES);
    const float8 height = bounded ? -shape.height : shape.height;
    for (int k = 0; k < 8 && first + k < count; k++) {
        __global float *row = depths + 4 * (size_t)(first + k);
        for (int j = 0; j < 3; j++)
            row[j] = ((float *)&depth[j])[k];
        row[3] = ((float *)&height)[k];
        pieces[first + k] = (int)((float *)&along_edge)[k];
    }
}
