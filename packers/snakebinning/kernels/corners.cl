// Where the corners of a client's triangles lie in the atlas: homogeneous, so that lookups are perspective-correct.

// places, drawn, words: as the server sends them (see place.cl and footprint.cl), by triangle of the client.
__kernel void locate_corners(int count, __global const uint *places, __global const ushort4 *drawn,
                             __global const uint *words, __global float *corners)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const uint place = places[i], word = words[i];
    const float sign = place >> 29 & 1 ? -0.125f : 0.125f;
    const float tip = 0.125f * (place & 0xFFFF) + 0.5f, line = (float)(place >> 16 & 0x1FFF) + 0.5f;
    const int a = word >> 24 & 3, after_a = a == 2 ? 0 : a + 1, last = 3 - a - after_a;
    const int b = word >> 26 & 1 ? last : after_a, c = word >> 26 & 1 ? after_a : last;
    float x[3], y[3];
    x[a] = tip - sign * drawn[i].x, x[b] = tip + sign * drawn[i].y, x[c] = tip;
    y[a] = line, y[b] = line, y[c] = line + sign * drawn[i].z;
    for (int k = 0; k < 3; k++) {
        const float w = 255.0f / (float)max(word >> 8 * k & 255, 1u);
        const float3 corner = place ? (float3)(x[k] * w, y[k] * w, w) : (float3)(NAN);
        vstore3(corner, 3 * i + k, corners);
    }
}
