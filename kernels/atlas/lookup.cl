// A client's picture from its atlas: bilinear lookups, 8 pixels per step.

// Bytes of the texel at each lane's column and row (clamped to the atlas) into r, g, b.
inline void fetch(__global const uchar *plane, int width, int height, int8 column, int8 row, float8 *r, float8 *g,
                  float8 *b) {
    const int8 at = clamp(row, 0, height - 1) * width + clamp(column, 0, width - 1);
    int texel[8];
    float red[8], green[8], blue[8];
    vstore8(at, 0, texel);
    for (int k = 0; k < 8; k++) {
        const float3 colour = convert_float3(vload3(texel[k], plane));
        red[k] = colour.x;
        green[k] = colour.y;
        blue[k] = colour.z;
    }
    *r = vload8(0, red);
    *g = vload8(0, green);
    *b = vload8(0, blue);
}

inline float8 blend(float8 a, float8 b, float8 c, float8 d, float8 fx, float8 fy) {
    const float8 upper = a + fx * (b - a), lower = c + fx * (d - c);
    return upper + fy * (lower - upper) + 0.5f;
}

// A sample's triangle counts through the client's list; `ids` are the scene's. Pixels of triangles without a place stay
// as they are.
__kernel void look_up(int count, __global const int *triangle, __global const float *bary1,
                      __global const float *bary2, __global const int *texel, __global const float *corners,
                      __global const int *ids, __global const uchar *plane, int width, int height,
                      __global uchar *rgb, __global int *drawn) {
    const int first = 8 * get_global_id(0);
    if (first >= count) return;
    float c[6][8];
    for (int k = 0; k < 8; k++) {
        const int t = triangle[min(first + k, count - 1)];
        for (int j = 0; j < 6; j++) c[j][k] = corners[6 * t + j];
    }
    const float8 b1 = vload8(0, bary1 + first), b2 = vload8(0, bary2 + first);
    const float8 x0 = vload8(0, c[0]), y0 = vload8(0, c[1]);
    const float8 x = x0 + b1 * (vload8(0, c[2]) - x0) + b2 * (vload8(0, c[4]) - x0) - 0.5f;
    const float8 y = y0 + b1 * (vload8(0, c[3]) - y0) + b2 * (vload8(0, c[5]) - y0) - 0.5f;
    const int8 placed = x == x;  // corners without a place are NaN
    const float8 left = placed ? floor(x) : 0.0f, above = placed ? floor(y) : 0.0f;
    const float8 fx = x - left, fy = y - above;
    const int8 column = convert_int8(left), row = convert_int8(above);
    float8 red[4], green[4], blue[4];
    for (int k = 0; k < 4; k++)
        fetch(plane, width, height, column + (k & 1), row + (k >> 1), &red[k], &green[k], &blue[k]);
    uchar r[8], g[8], b[8];
    int seen[8];
    vstore8(convert_uchar8_sat(blend(red[0], red[1], red[2], red[3], fx, fy)), 0, r);
    vstore8(convert_uchar8_sat(blend(green[0], green[1], green[2], green[3], fx, fy)), 0, g);
    vstore8(convert_uchar8_sat(blend(blue[0], blue[1], blue[2], blue[3], fx, fy)), 0, b);
    vstore8(placed, 0, seen);
    for (int k = 0; k < 8 && first + k < count; k++)
        if (seen[k]) {
            vstore4((uchar4)(r[k], g[k], b[k], 255), texel[first + k], rgb);
            drawn[texel[first + k]] = ids[triangle[first + k]];
        }
}
