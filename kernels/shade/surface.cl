// What shading needs to know of 8 samples: attributes interpolated lane by lane with one float8 per sample, because
// neighbouring samples mostly share their triangle, then turned into one float8 per attribute. Table layouts:
// shade/tables.py.
#include "shade/vector.cl"
#include "texture/sample.cl"

#define EXTRAS (NORMAL_MAPS || VERTEX_COLOURS)

#define SURFACE_PARAMETERS                                                                                             \
    __global const float8 *vertices, __global const float8 *extras, __global const int *indices,                       \
        __global const int2 *faces, __global const float8 *materials, TEXTURE_PARAMETERS,                              \
        __global const float *lights, __global const float *shadow_maps, __global const float *environment
#define SURFACE_ARGUMENTS                                                                                              \
    vertices, extras, indices, faces, materials, TEXTURE_ARGUMENTS, lights, shadow_maps, environment

// Column i of 8 rows.
#define COLUMN8(rows, i)                                                                                               \
    (float8)(rows[0].s##i, rows[1].s##i, rows[2].s##i, rows[3].s##i, rows[4].s##i, rows[5].s##i, rows[6].s##i,         \
             rows[7].s##i)

#define COLUMNS8(rows, i, j, k) {COLUMN8(rows, i), COLUMN8(rows, j), COLUMN8(rows, k)}

// What the lanes' triangles say about their samples. `face` is the unnormalised geometric normal.
typedef struct {
    vector8 position, normal, face;
    float8 u, v, uv_scale;
    vector8 colour;
    float8 base_texture, roughness, metallic, double_sided;
#if NORMAL_MAPS || EMISSIVE
    vector8 emissive;
    float8 emissive_texture, normal_texture, normal_scale;
#endif
#if NORMAL_MAPS
    vector8 tangent;
    float8 bitangent_sign;
#endif
} surface8;

// A triangle's rows of the tables; `normal` is unnormalised, with the UV scale in w.
typedef struct {
    float8 corner, side1, side2, material;
    float4 normal;
#if NORMAL_MAPS || EMISSIVE
    float8 more;
#endif
#if EXTRAS
    float8 extra, extra1, extra2;
#endif
} triangle_rows;

INLINE triangle_rows rows_of(int id, SURFACE_PARAMETERS)
{
    triangle_rows t;
    const int a = indices[3 * id], b = indices[3 * id + 1], c = indices[3 * id + 2];
    const int2 record = faces[id];
    t.corner = vertices[a];
    const float8 p = vertices[b] - t.corner, q = vertices[c] - t.corner;
    t.side1 = p;
    t.side2 = q;
    t.normal = (float4)(p.s1 * q.s2 - p.s2 * q.s1, p.s2 * q.s0 - p.s0 * q.s2, p.s0 * q.s1 - p.s1 * q.s0,
                        as_float(record.y));
    t.material = materials[2 * record.x];
#if NORMAL_MAPS || EMISSIVE
    t.more = materials[2 * record.x + 1];
#endif
#if EXTRAS
    t.extra = extras[a];
    t.extra1 = extras[b] - t.extra;
    t.extra2 = extras[c] - t.extra;
#endif
    return t;
}

// What the samples' triangles and materials say about them.
INLINE surface8 fetch8(const int *triangle, const float *bary1, const float *bary2, SURFACE_PARAMETERS)
{
    float8 point[8], base[8];
    float4 face[8];
#if NORMAL_MAPS || EMISSIVE
    float8 more[8];
#endif
#if EXTRAS
    float8 extra[8];
#endif
    triangle_rows t;
    int previous = -1;
    for (int lane = 0; lane < 8; lane++) {
        if (triangle[lane] != previous) {
            previous = triangle[lane];
            t = rows_of(previous, SURFACE_ARGUMENTS);
        }
        point[lane] = t.corner + bary1[lane] * t.side1 + bary2[lane] * t.side2;
        face[lane] = t.normal;
        base[lane] = t.material;
#if NORMAL_MAPS || EMISSIVE
        more[lane] = t.more;
#endif
#if EXTRAS
        extra[lane] = t.extra + bary1[lane] * t.extra1 + bary2[lane] * t.extra2;
#endif
    }
    surface8 s;
    s.position = (vector8)COLUMNS8(point, 0, 1, 2);
    s.normal = (vector8)COLUMNS8(point, 3, 4, 5);
    s.u = COLUMN8(point, 6);
    s.v = COLUMN8(point, 7);
    s.face = (vector8)COLUMNS8(face, 0, 1, 2);
    s.uv_scale = COLUMN8(face, 3);
    s.colour = (vector8)COLUMNS8(base, 0, 1, 2);
    s.base_texture = COLUMN8(base, 3);
    s.roughness = COLUMN8(base, 4);
    s.metallic = COLUMN8(base, 5);
    s.double_sided = COLUMN8(base, 6);
#if NORMAL_MAPS || EMISSIVE
    s.emissive = (vector8)COLUMNS8(more, 0, 1, 2);
    s.emissive_texture = COLUMN8(more, 3);
    s.normal_texture = COLUMN8(more, 4);
    s.normal_scale = COLUMN8(more, 5);
#endif
#if NORMAL_MAPS
    s.tangent = (vector8)COLUMNS8(extra, 0, 1, 2);
    s.bitangent_sign = COLUMN8(extra, 3);
#endif
#if VERTEX_COLOURS
    s.colour = times8(s.colour, (vector8)COLUMNS8(extra, 4, 5, 6));
#endif
    return s;
}

#if TEXTURES
// Looks `texture` (0 is white) up at the surface's coordinates.
INLINE vector8 textured8(const surface8 *s, float8 texture, float8 footprint, TEXTURE_PARAMETERS)
{
    vector8 result = {1.0f, 1.0f, 1.0f};
    if (any_of8(texture > 0.0f)) {
        int entry[8];
        STORE_INT8(convert_int8(texture), entry);
        texture8(entry, s->u, s->v, footprint * s->uv_scale, &result.x, &result.y, &result.z, TEXTURE_ARGUMENTS);
    }
    return result;
}
#endif

#if NORMAL_MAPS
// The normal map's normal: glTF 2.0, 3.9.3: x along the tangent, y along the bitangent, green up.
INLINE vector8 bumped8(const surface8 *s, vector8 n, float8 footprint, TEXTURE_PARAMETERS)
{
    const int8 mapped = s->normal_texture > 0.0f;
    if (!any_of8(mapped))
        return n;
    const vector8 texel = textured8(s, s->normal_texture, footprint, TEXTURE_ARGUMENTS);
    const float8 x = (2.0f * texel.x - 1.0f) * s->normal_scale;
    const float8 y = (2.0f * texel.y - 1.0f) * s->normal_scale * s->bitangent_sign;
    const float8 z = 2.0f * texel.z - 1.0f;
    const vector8 t = s->tangent;
    const vector8 bump = {x * t.x + y * (n.y * t.z - n.z * t.y) + z * n.x,
                          x * t.y + y * (n.z * t.x - n.x * t.z) + z * n.y,
                          x * t.z + y * (n.x * t.y - n.y * t.x) + z * n.z};
    const vector8 unit = unit8(bump, n);
    const vector8 result = {mapped ? unit.x : n.x, mapped ? unit.y : n.y, mapped ? unit.z : n.z};
    return result;
}
#endif
