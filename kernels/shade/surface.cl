// What shading needs to know of LANES samples, one floatN per attribute. Neighbouring samples mostly share their
// triangle, so each triangle is read once and interpolated for all lanes. Table layouts: shade/tables.py.
#include "shade/vector.cl"
#include "shade/uv_scale.cl"
#include "texture/sample.cl"

#define EXTRAS (NORMAL_MAPS || VERTEX_COLOURS || FURTHER_UVS)
#define EXTRA_ROWS (FURTHER_UVS ? 2 : 1) // float8 per vertex
#define DETAILS (SURFACE_MAPS || OCCLUSION || UNLIT || FURTHER_UVS)
#define MATERIAL_ROWS 3 // floatN per material

#define SURFACE_PARAMETERS                                                                                  \
    __global const float8 *vertices, __global const float8 *extras, __global const int *indices,            \
        __global const int2 *faces, __global const float8 *materials, TEXTURE_PARAMETERS,                   \
        __global const float *lights, __global const float *shadow_maps, __global const float *environment, \
        __global const float *environment_map
#define SURFACE_ARGUMENTS \
    vertices, extras, indices, faces, materials, TEXTURE_ARGUMENTS, lights, shadow_maps, environment, environment_map

// What the lanes' triangles say about their samples. `face` is the unnormalised geometric normal.
typedef struct {
    vectorN position, normal, face;
    floatN u, v, uv_scale;
    vectorN colour;
    floatN base_texture, roughness, metallic, double_sided;
#if NORMAL_MAPS || EMISSIVE
    vectorN emissive;
    floatN emissive_texture, normal_texture, normal_scale;
#endif
#if NORMAL_MAPS
    vectorN tangent;
    floatN bitangent_sign;
#endif
#if DETAILS
    floatN surface_texture, occlusion_texture, occlusion_strength, unlit;
    floatN normal_set, emissive_set, surface_set, occlusion_set;
#endif
#if FURTHER_UVS
    floatN further_u[FURTHER_UVS], further_v[FURTHER_UVS], further_scale[FURTHER_UVS];
#endif
} surfaceN;

// Which set of UVs a texture's slot uses: 0 or 1 + a further one.
#if FURTHER_UVS
#define SET_OF(surface, slot) (surface)->slot##_set
#else
#define SET_OF(surface, slot) (floatN)0.0f
#endif

// Columns i, j and k at three corners, given as the first and the sides from it to the others, interpolated.
#define BETWEEN(i, a, p, q) ((a.s##i + bary1 * p.s##i) + bary2 * q.s##i)
#define BETWEEN3(i, j, k, a, p, q) {BETWEEN(i, a, p, q), BETWEEN(j, a, p, q), BETWEEN(k, a, p, q)}

// What one triangle and its material say about samples of it.
INLINE surfaceN surface_of(const int id, const floatN bary1, const floatN bary2, SURFACE_PARAMETERS)
{
    const int a = indices[3 * id], b = indices[3 * id + 1], c = indices[3 * id + 2];
    const int2 record = faces[id];
    const float8 corner = vertices[a], p = vertices[b] - corner, q = vertices[c] - corner;
    const float8 base = materials[MATERIAL_ROWS * record.x];
    surfaceN s;
    s.position = (vectorN)BETWEEN3(0, 1, 2, corner, p, q);
    s.normal = (vectorN)BETWEEN3(3, 4, 5, corner, p, q);
    s.u = BETWEEN(6, corner, p, q);
    s.v = BETWEEN(7, corner, p, q);
    s.face = (vectorN){p.s1 * q.s2 - p.s2 * q.s1, p.s2 * q.s0 - p.s0 * q.s2, p.s0 * q.s1 - p.s1 * q.s0};
    s.uv_scale = as_float(record.y);
    s.colour = (vectorN){base.s0, base.s1, base.s2};
    s.base_texture = base.s3;
    s.roughness = base.s4;
    s.metallic = base.s5;
    s.double_sided = base.s6;
#if NORMAL_MAPS || EMISSIVE
    const float8 more = materials[MATERIAL_ROWS * record.x + 1];
    s.emissive = (vectorN){more.s0, more.s1, more.s2};
    s.emissive_texture = more.s3;
    s.normal_texture = more.s4;
    s.normal_scale = more.s5;
#endif
#if DETAILS
    const float8 details = materials[MATERIAL_ROWS * record.x + 2];
    s.surface_texture = details.s0;
    s.occlusion_texture = details.s1;
    s.occlusion_strength = details.s2;
    s.unlit = details.s3;
    s.normal_set = details.s4;
    s.emissive_set = details.s5;
    s.surface_set = details.s6;
    s.occlusion_set = details.s7;
#endif
#if EXTRAS
    const float8 extra = extras[EXTRA_ROWS * a];
    const float8 along1 = extras[EXTRA_ROWS * b] - extra, along2 = extras[EXTRA_ROWS * c] - extra;
#endif
#if FURTHER_UVS
    const float8 sets = extras[EXTRA_ROWS * a + 1];
    const float8 sets1 = extras[EXTRA_ROWS * b + 1] - sets, sets2 = extras[EXTRA_ROWS * c + 1] - sets;
    for (int i = 0; i < FURTHER_UVS; i++) {
        const float2 uv = ((const float2 *)&sets)[i];
        const float2 t1 = ((const float2 *)&sets1)[i], t2 = ((const float2 *)&sets2)[i];
        s.further_u[i] = (uv.x + bary1 * t1.x) + bary2 * t2.x;
        s.further_v[i] = (uv.y + bary1 * t1.y) + bary2 * t2.y;
        s.further_scale[i] = uv_scale(p.s012, q.s012, t1, t2);
    }
#endif
#if NORMAL_MAPS
    s.tangent = (vectorN)BETWEEN3(0, 1, 2, extra, along1, along2);
    s.bitangent_sign = BETWEEN(3, extra, along1, along2);
#endif
#if VERTEX_COLOURS
    s.colour = multiplyN(s.colour, (vectorN)BETWEEN3(4, 5, 6, extra, along1, along2));
#endif
    return s;
}

// What the samples' triangles and materials say about them: one triangle after the other, each for all lanes at once.
INLINE surfaceN fetchN(const int *triangle, const float *bary1, const float *bary2, SURFACE_PARAMETERS)
{
    const intN ids = LOAD_INTN(triangle);
    surfaceN s = surface_of(triangle[0], LOADN(bary1), LOADN(bary2), SURFACE_ARGUMENTS);
    for (uint left = bits_ofN(ids != triangle[0]); left;) {
        const int id = triangle[31 - (int)clz(left & (0u - left))];
        const intN lanes = ids == id;
        const surfaceN other = surface_of(id, LOADN(bary1), LOADN(bary2), SURFACE_ARGUMENTS);
        UNROLL
        for (int i = 0; i < (int)(sizeof(surfaceN) / sizeof(floatN)); i++)
            ((floatN *)&s)[i] = lanes ? ((const floatN *)&other)[i] : ((floatN *)&s)[i];
        left &= ~bits_ofN(lanes);
    }
    return s;
}

#if TEXTURES
// Looks `texture` (0 is white) up at the surface's coordinates, those of `set`.
INLINE vectorN texturedN(const surfaceN *s, floatN texture, floatN set, floatN footprint, TEXTURE_PARAMETERS)
{
    vectorN result = {1.0f, 1.0f, 1.0f};
    if (any_ofN(texture > 0.0f)) {
        floatN u = s->u, v = s->v, scale = s->uv_scale;
#if FURTHER_UVS
        for (int i = 0; i < FURTHER_UVS; i++) {
            const intN chosen = set == (float)(i + 1);
            u = chosen ? s->further_u[i] : u;
            v = chosen ? s->further_v[i] : v;
            scale = chosen ? s->further_scale[i] : scale;
        }
#endif
        textureN(convert_intN(texture), u, v, footprint * scale, &result.x, &result.y, &result.z, TEXTURE_ARGUMENTS);
    }
    return result;
}
#endif

#if NORMAL_MAPS
// The normal map's normal: glTF 2.0, 3.9.3: x along the tangent, y along the bitangent, green up.
INLINE vectorN bumpedN(const surfaceN *s, vectorN n, floatN footprint, TEXTURE_PARAMETERS)
{
    const intN mapped = s->normal_texture > 0.0f;
    if (!any_ofN(mapped))
        return n;
    const vectorN texel = texturedN(s, s->normal_texture, SET_OF(s, normal), footprint, TEXTURE_ARGUMENTS);
    const floatN x = (2.0f * texel.x - 1.0f) * s->normal_scale;
    const floatN y = (2.0f * texel.y - 1.0f) * s->normal_scale * s->bitangent_sign;
    const floatN z = 2.0f * texel.z - 1.0f;
    const vectorN t = s->tangent;
    const vectorN bump = {x * t.x + y * (n.y * t.z - n.z * t.y) + z * n.x,
                          x * t.y + y * (n.z * t.x - n.x * t.z) + z * n.y,
                          x * t.z + y * (n.x * t.y - n.y * t.x) + z * n.z};
    const vectorN unit = normalizeN(bump, n);
    const vectorN result = {mapped ? unit.x : n.x, mapped ? unit.y : n.y, mapped ? unit.z : n.z};
    return result;
}
#endif
