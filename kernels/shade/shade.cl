// The one shading function: `shade8` shades 8 samples, for the reference and for every gather. What a scene lacks is
// compiled out: TEXTURES, WRAP_MODES, NORMAL_MAPS, VERTEX_COLOURS, SPECULAR, EMISSIVE, DOUBLE_SIDED, LOCAL_LIGHTS and
// SHADOWS are 0 or 1, LIGHTS is how many there are. Table layouts: shade/tables.py.
//
// Attributes are interpolated lane by lane with one float8 per sample, because neighbouring samples mostly share their
// triangle, then turned into one float8 per attribute.
#include "shade/wide_math.cl"
#include "shade/colour.cl"
#include "texture/sample.cl"
#include "shade/shadow_lookup.cl"

#define EXTRAS (NORMAL_MAPS || VERTEX_COLOURS)
#define MATERIAL_FLOATS 16
#define LIGHT_FLOATS 48
#define DIRECTIONAL 0
#define SPOT 2

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

typedef struct {
    float8 x, y, z;
} vector8;

INLINE float8 dot8(vector8 a, vector8 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

INLINE float8 positive8(float8 a)
{
    return (a > 0.0f) ? a : (float8)0.0f;
}

INLINE float8 largest8(float8 a, float8 b)
{
    return (a > b) ? a : b;
}

INLINE float8 magnitude8(float8 a)
{
    return (a > 0.0f) ? a : -a;
}

// a of length 1; `otherwise` where a is zero or not finite. Scaled first, so that tiny vectors do not underflow.
INLINE vector8 unit8(vector8 a, vector8 otherwise)
{
    const float8 largest = largest8(largest8(magnitude8(a.x), magnitude8(a.y)), magnitude8(a.z));
    const int8 usable = largest > 0.0f && largest < 1e30f;
    const float8 scale = 1.0f / (usable ? largest : (float8)1.0f);
    const float8 x = a.x * scale, y = a.y * scale, z = a.z * scale;
    const float8 inverse = inverse_sqrt8(x * x + y * y + z * z);
    const vector8 result = {usable ? x * inverse : otherwise.x, usable ? y * inverse : otherwise.y,
                            usable ? z * inverse : otherwise.z};
    return result;
}

// What the lanes' triangles say about their samples. `face` is the unnormalised geometric normal.
typedef struct {
    vector8 position, normal, face;
    float8 u, v, uv_scale;
#if NORMAL_MAPS
    vector8 tangent;
    float8 bitangent_sign;
#endif
    vector8 colour;
    float8 roughness, metallic, double_sided;
    vector8 emissive;
    float8 base_texture, normal_texture, emissive_texture, normal_scale;
} surface8;

INLINE void fetch8(const int *triangle, const float *bary1, const float *bary2, surface8 *s, SURFACE_PARAMETERS)
{
    float8 point[8], base[8];
    float4 face[8];
#if EXTRAS
    float8 extra[8], w0, w1, w2;
#endif
#if NORMAL_MAPS || EMISSIVE
    float8 more[8], rest;
#endif
    float8 v0, side1, side2, material;
    float4 normal;
    int previous = -1;
    for (int lane = 0; lane < 8; lane++) {
        const int id = triangle[lane];
        if (id != previous) {
            const int a = indices[3 * id], b = indices[3 * id + 1], c = indices[3 * id + 2];
            v0 = vertices[a];
            side1 = vertices[b] - v0;
            side2 = vertices[c] - v0;
            const int2 record = faces[id];
            normal = (float4)(side1.s1 * side2.s2 - side1.s2 * side2.s1, side1.s2 * side2.s0 - side1.s0 * side2.s2,
                              side1.s0 * side2.s1 - side1.s1 * side2.s0, as_float(record.y));
            material = materials[2 * record.x];
#if NORMAL_MAPS || EMISSIVE
            rest = materials[2 * record.x + 1];
#endif
#if EXTRAS
            w0 = extras[a];
            w1 = extras[b] - w0;
            w2 = extras[c] - w0;
#endif
            previous = id;
        }
        point[lane] = v0 + bary1[lane] * side1 + bary2[lane] * side2;
        face[lane] = normal;
        base[lane] = material;
#if NORMAL_MAPS || EMISSIVE
        more[lane] = rest;
#endif
#if EXTRAS
        extra[lane] = w0 + bary1[lane] * w1 + bary2[lane] * w2;
#endif
    }
    s->position = (vector8){COLUMN8(point, 0), COLUMN8(point, 1), COLUMN8(point, 2)};
    s->normal = (vector8){COLUMN8(point, 3), COLUMN8(point, 4), COLUMN8(point, 5)};
    s->u = COLUMN8(point, 6);
    s->v = COLUMN8(point, 7);
    s->face = (vector8){COLUMN8(face, 0), COLUMN8(face, 1), COLUMN8(face, 2)};
    s->uv_scale = COLUMN8(face, 3);
    s->colour = (vector8){COLUMN8(base, 0), COLUMN8(base, 1), COLUMN8(base, 2)};
    s->base_texture = COLUMN8(base, 3);
    s->roughness = COLUMN8(base, 4);
    s->metallic = COLUMN8(base, 5);
    s->double_sided = COLUMN8(base, 6);
#if NORMAL_MAPS || EMISSIVE
    s->emissive = (vector8){COLUMN8(more, 0), COLUMN8(more, 1), COLUMN8(more, 2)};
    s->emissive_texture = COLUMN8(more, 3);
    s->normal_texture = COLUMN8(more, 4);
    s->normal_scale = COLUMN8(more, 5);
#endif
#if NORMAL_MAPS
    s->tangent = (vector8){COLUMN8(extra, 0), COLUMN8(extra, 1), COLUMN8(extra, 2)};
    s->bitangent_sign = COLUMN8(extra, 3);
#endif
#if VERTEX_COLOURS
    s->colour.x *= COLUMN8(extra, 4);
    s->colour.y *= COLUMN8(extra, 5);
    s->colour.z *= COLUMN8(extra, 6);
#endif
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

#if LIGHTS
// Direction to the light and how much of its colour arrives, before the cosine and the shadow. Tables hold distances of
// local lights in scene units and `falloff` = metres per unit squared.
INLINE float8 incident8(__global const float *light, vector8 position, vector8 *direction)
{
#if LOCAL_LIGHTS
    if ((int)light[0] != DIRECTIONAL) {
        const vector8 d = {light[4] - position.x, light[5] - position.y, light[6] - position.z};
        const float8 squared = dot8(d, d);
        const float8 inverse = inverse_sqrt8(largest8(squared, (float8)1e-12f));
        *direction = (vector8){d.x * inverse, d.y * inverse, d.z * inverse};
        float8 arriving = 1.0f / largest8(squared * light[11], (float8)1e-4f);
        if ((int)light[0] == SPOT) {
            const float8 cosine =
                -(direction->x * light[8] + direction->y * light[9] + direction->z * light[10]);
            float8 fade = (cosine - light[12]) * light[13];
            fade = (fade < 1.0f) ? positive8(fade) : (float8)1.0f;
            arriving *= fade * fade * (3.0f - 2.0f * fade);
        }
        return arriving;
    }
#endif
    *direction = (vector8){-light[8], -light[9], -light[10]};
    return 1.0f;
}
#endif

#if SPECULAR
// GGX (Walter 2007) with Hammon's approximation of the correlated Smith masking ("PBR Diffuse Lighting for GGX+Smith
// Microsurfaces", 2017); without the Fresnel term, whose weight (1 - v.h)^5 is returned apart.
INLINE float8 ggx8(vector8 n, vector8 v, vector8 l, float8 nv, float8 nl, float8 alpha, float8 *grazing)
{
    const vector8 h = unit8((vector8){v.x + l.x, v.y + l.y, v.z + l.z}, n);
    const float8 nh = positive8(dot8(n, h)), vh = positive8(dot8(v, h));
    const float8 a2 = alpha * alpha;
    // 1 - nh^2 as |n x h|^2: no cancellation in a narrow highlight.
    const vector8 c = {n.y * h.z - n.z * h.y, n.z * h.x - n.x * h.z, n.x * h.y - n.y * h.x};
    const float8 d = nh * nh * a2 + dot8(c, c);
    const float8 m = 1.0f - vh, m2 = m * m;
    *grazing = m2 * m2 * m;
    const float8 product = 2.0f * nl * nv;
    const float8 masking = 0.5f / (product + (nl + nv - product) * alpha + 1e-6f);
    return a2 * INV_PI / (d * d) * masking;
}

// Environment BRDF: weight of F0 and the rest (Karis 2014, "Physically Based Shading on Mobile").
INLINE float8 environment_brdf8(float8 roughness, float8 nv, float8 *rest)
{
    const float8 smooth = 1.0f - roughness, peak = exp2(-9.28f * nv);
    const float8 squared = smooth * smooth;
    const float8 a = ((squared < peak) ? squared : peak) * smooth + 0.0425f - 0.0275f * roughness;
    *rest = 1.04f * a + 0.022f * roughness - 0.04f;
    return 1.04f - 1.04f * a - 0.572f * roughness;
}
#endif

// Radiance towards the eye at 8 samples. `footprint` in scene units.
INLINE vector8 shade8(const int *triangle, const float *bary1, const float *bary2, float8 footprint, float3 eye,
                      SURFACE_PARAMETERS)
{
    surface8 s;
    fetch8(triangle, bary1, bary2, &s, SURFACE_ARGUMENTS);
    const vector8 upright = {0.0f, 1.0f, 0.0f};
    const vector8 face = unit8(s.face, upright);
    vector8 n = unit8(s.normal, face);
    vector8 smooth = n;
#if NORMAL_MAPS
    n = bumped8(&s, n, footprint, TEXTURE_ARGUMENTS);
#endif
    const vector8 towards = {eye.x - s.position.x, eye.y - s.position.y, eye.z - s.position.z};
#if DOUBLE_SIDED
    const float8 side = (s.double_sided > 0.0f && dot8(face, towards) < 0.0f) ? (float8)-1.0f : (float8)1.0f;
    n = (vector8){n.x * side, n.y * side, n.z * side};
    smooth = (vector8){smooth.x * side, smooth.y * side, smooth.z * side};
#endif
    vector8 albedo = s.colour;
#if TEXTURES
    const vector8 texel = textured8(&s, s.base_texture, footprint, TEXTURE_ARGUMENTS);
    albedo = (vector8){albedo.x * texel.x, albedo.y * texel.y, albedo.z * texel.z};
#endif
    // Irradiance / pi, from the sky first.
    vector8 diffuse = {sky_irradiance8(environment, 0, n.y), sky_irradiance8(environment, 1, n.y),
                       sky_irradiance8(environment, 2, n.y)};
#if SPECULAR
    const vector8 v = unit8(towards, n);
    const float8 nv = largest8(dot8(n, v), (float8)1e-3f);
    const float8 rough = largest8(s.roughness, (float8)0.05f);
    vector8 glossy = {0.0f, 0.0f, 0.0f}, rim = {0.0f, 0.0f, 0.0f};
    const float8 mirrored = 2.0f * nv * n.y - v.y;
#endif
#if LIGHTS
    for (int i = 0; i < LIGHTS; i++) {
        __global const float *light = lights + i * LIGHT_FLOATS;
        vector8 l;
        float8 arriving = incident8(light, s.position, &l);
        const float8 nl = positive8(dot8(n, l));
        arriving *= nl;
        if (!any_of8(arriving > 0.0f))
            continue;
#if SHADOWS
        if (light[SHADOW_SIZE] > 0.0f)
            arriving *= shadow8(light, shadow_maps, s.position.x, s.position.y, s.position.z, smooth.x, smooth.y,
                                smooth.z, l.x, l.y, l.z, arriving > 0.0f);
#endif
        const float8 lambert = arriving * INV_PI;
        diffuse.x += light[16] * lambert;
        diffuse.y += light[17] * lambert;
        diffuse.z += light[18] * lambert;
#if SPECULAR
        float8 grazing;
        arriving *= ggx8(n, v, l, nv, nl, rough * rough, &grazing);
        const float8 edge = arriving * grazing;
        glossy.x += light[16] * arriving;
        glossy.y += light[17] * arriving;
        glossy.z += light[18] * arriving;
        rim.x += light[16] * edge;
        rim.y += light[17] * edge;
        rim.z += light[18] * edge;
#endif
    }
#endif
    vector8 out = {albedo.x * diffuse.x, albedo.y * diffuse.y, albedo.z * diffuse.z};
#if SPECULAR
    // Metals reflect in their base colour and have no diffuse part; everything else reflects 4% (glTF 2.0, appendix B).
    float8 rest;
    const float8 weight = environment_brdf8(rough, nv, &rest);
    const float8 base = 0.04f * (1.0f - s.metallic);
#define REFLECT(c, channel)                                                                                                do {                                                                                                                       const float8 f0 = base + s.metallic * albedo.c;                                                                        const float8 mirror = sky_radiance8(environment, channel, mirrored);                                                   const float8 blurred = sky_irradiance8(environment, channel, n.y);                                                     out.c = out.c * (1.0f - s.metallic) + f0 * (glossy.c - rim.c) + rim.c +                                                        (mirror + (blurred - mirror) * rough) * (f0 * weight + rest);                                              } while (0)
    REFLECT(x, 0);
    REFLECT(y, 1);
    REFLECT(z, 2);
#endif
#if EMISSIVE
    vector8 glow = s.emissive;
#if TEXTURES
    const vector8 pattern = textured8(&s, s.emissive_texture, footprint, TEXTURE_ARGUMENTS);
    glow = (vector8){glow.x * pattern.x, glow.y * pattern.y, glow.z * pattern.z};
#endif
    out = (vector8){out.x + glow.x, out.y + glow.y, out.z + glow.z};
#endif
    return out;
}

// Shades samples run * id .. run * (id + 1), `run` a multiple of 8, into the texels they name.
__kernel void shade_samples(const int count, const int run, __global const int *triangles,
                            __global const float *barys1, __global const float *barys2,
                            __global const float *footprints, __global const int *texel, __global int *target,
                            const float eye_x, const float eye_y, const float eye_z, SURFACE_PARAMETERS)
{
    const int id = get_global_id(0);
    if (id > (count - 1) / run)
        return;
    const int end = LESSER((id + 1) * run, count);
    const float3 eye = (float3)(eye_x, eye_y, eye_z);
    const float exposure = environment[EXPOSURE];
    for (int i = id * run; i < end; i += 8) {
        const int8 used = i + (int8)(0, 1, 2, 3, 4, 5, 6, 7) < count;
        const int8 ids = *(__global const loose_int8 *)(triangles + i);
        int triangle[8], colours[8];
        float bary1[8], bary2[8];
        STORE_INT8(used ? ids : ids.s0, triangle);
        STORE8(*(__global const loose_float8 *)(barys1 + i), bary1);
        STORE8(*(__global const loose_float8 *)(barys2 + i), bary2);
        const float8 footprint = *(__global const loose_float8 *)(footprints + i);
        const vector8 c = shade8(triangle, bary1, bary2, footprint, eye, SURFACE_ARGUMENTS);
        STORE_INT8(packed8(encode8(exposure * c.x), encode8(exposure * c.y), encode8(exposure * c.z)), colours);
        const int last = LESSER(8, count - i);
        for (int lane = 0; lane < last; lane++)
            target[texel[i + lane]] = colours[lane];
    }
}
