// Shapes: 8 records of a tile made ready to draw at once, one per lane, because everything here is the same for each.
#include "raster/coverage.cl"

#pragma OPENCL EXTENSION cl_khr_fp64 : enable

typedef struct {
    int8 left, top, right, bottom;      // the tile's pixels that the boxes hold
    int8 id;                            // triangle | MASK_BIT
    int8 along_x[3], along_y[3], at[3]; // edges, as in Edge, at the tile's first pixel
    double8 rise_x, rise_y;             // depth per sub-pixel
    int8 corner_x, corner_y;
    float8 depth, nearest, farthest; // depth: at the first corner
    float8 slope_x, slope_y;         // depth per pixel
} Shapes;

// One round of a transposition: rotates the bits of (row, column) right by one.
INLINE void shuffle_rows(const int8 *from, int8 *to, const int count)
{
    for (int i = 0; i < count / 2; i++) {
        to[i] = (int8)(from[2 * i].even, from[2 * i + 1].even);
        to[i + count / 2] = (int8)(from[2 * i].odd, from[2 * i + 1].odd);
    }
}

// 8 records as they are stored.
typedef struct {
    int8 rows[8], rest[4];
} Fetched;

// The records listed at `numbers`, of which there are `count`; beyond, the last again.
INLINE void fetch_records(Fetched *fetched, __global const int *records, const int *numbers, const int count)
{
    UNROLL
    for (int i = 0; i < 8; i++) {
        __global const int *at = records + (size_t)numbers[MIN(i, count - 1)] * RECORD;
        fetched->rows[i] = *(__global const loose_int8 *)at;
        ((int4 *)fetched->rest)[i] = *(__global const loose_int4 *)(at + 8);
    }
}

// Their fields, one record per lane.
INLINE void fields_of(Fetched *fetched, int8 *fields)
{
    int8 turned[8];
    shuffle_rows(fetched->rows, turned, 8);
    shuffle_rows(turned, fetched->rows, 8);
    shuffle_rows(fetched->rows, fields, 8);
    shuffle_rows(fetched->rest, turned, 4);
    shuffle_rows(turned, fields + 8, 4);
}

INLINE void set_edge(Shapes *shapes, const int i, const int8 ax, const int8 ay, const int8 bx, const int8 by,
                     const int2 centre)
{
    const int8 along_x = ay - by, along_y = bx - ax;
    const int8 owned = (along_x > 0) | ((along_x == 0) & (along_y > 0));
    const long8 value = convert_long8(along_x) * convert_long8(centre.x - ax) +
                        convert_long8(along_y) * convert_long8(centre.y - ay) - convert_long8(owned + 1);
    const long8 scaled = value >> 8, capped = MIN(scaled, (long8)FAR_EDGE);
    shapes->along_x[i] = along_x;
    shapes->along_y[i] = along_y;
    shapes->at[i] = convert_int8(MAX(capped, (long8)-FAR_EDGE));
}

// `origin` is the tile's first pixel, of the image.
INLINE void set_shapes(Shapes *shapes, const int8 *record, const int2 origin)
{
    const int8 ax = record[0], ay = record[1], bx = record[2], by = record[3], cx = record[4], cy = record[5];
    const float8 da = as_float8(record[6]), db = as_float8(record[7]), dc = as_float8(record[8]);
    const int2 centre = origin * SUBPIXELS + SUBPIXELS / 2;
    shapes->id = record[9];
    const int8 left = (record[10] & 0xffff) - origin.x, top = (record[10] >> 16) - origin.y;
    const int8 right = (record[11] & 0xffff) - origin.x, bottom = (record[11] >> 16) - origin.y;
    shapes->left = MAX(left, 0);
    shapes->top = MAX(top, 0);
    shapes->right = MIN(right, TILE - 1);
    shapes->bottom = MIN(bottom, TILE - 1);
    set_edge(shapes, 0, ax, ay, bx, by, centre);
    set_edge(shapes, 1, bx, by, cx, cy, centre);
    set_edge(shapes, 2, cx, cy, ax, ay, centre);
    const double8 abx = convert_double8(bx - ax), aby = convert_double8(by - ay);
    const double8 acx = convert_double8(cx - ax), acy = convert_double8(cy - ay);
    const double8 rise_b = convert_double8(db) - convert_double8(da),
                  rise_c = convert_double8(dc) - convert_double8(da);
    const double8 scale = 1.0 / (abx * acy - aby * acx); // both products are exact
    shapes->rise_x = (rise_b * acy - rise_c * aby) * scale;
    shapes->rise_y = (rise_c * abx - rise_b * acx) * scale;
    shapes->corner_x = ax;
    shapes->corner_y = ay;
    shapes->depth = da;
    shapes->slope_x = convert_float8(shapes->rise_x * SUBPIXELS);
    shapes->slope_y = convert_float8(shapes->rise_y * SUBPIXELS);
    const float8 nearer = MAX(db, dc), farther = MIN(db, dc);
    shapes->nearest = MAX(da, nearer);
    shapes->farthest = MIN(da, farther);
}
