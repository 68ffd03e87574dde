// The one shading function: `shade8` shades 8 samples, for the reference and for every gather. What a scene lacks is
// compiled out: TEXTURES, WRAP_MODES, NORMAL_MAPS, VERTEX_COLOURS, SPECULAR, ENVIRONMENT_MAP, SURFACE_MAPS, OCCLUSION,
// UNLIT, EMISSIVE, DOUBLE_SIDED, LOCAL_LIGHTS and SHADOWS are 0 or 1, LIGHTS and FURTHER_UVS are how many there are.
#include "shade/surface.cl"
#include "shade/light.cl"
#include "shade/environment.cl"

// A normal this near to its triangle's plane has no side to turn: foliage that is lit like the ground it grows on.
#define IN_PLANE 0.25f

#if DOUBLE_SIDED
// Turn normals to the side of the triangle that is seen.
INLINE void turn8(const surface8 *s, const vector8 face, const vector8 towards, vector8 *n, vector8 *smooth)
{
    const float8 along = abs8(dot8(*smooth, face));
    const int8 turned = s->double_sided > 0.0f && dot8(face, towards) < 0.0f && along > IN_PLANE;
    const float8 side = turned ? (float8)-1.0f : (float8)1.0f;
    *n = scaled8(*n, side);
    *smooth = scaled8(*smooth, side);
}
#endif

#if SPECULAR
// Add what a surface reflects of its surroundings, and of the lights' `sum`, to what it scatters of both: `out`.
// `open`: how much of the surroundings is seen from there.
INLINE vector8 with_reflections8(vector8 out, const vector8 albedo, const surface8 *s, const vector8 n, const vector8 v,
                                 const float8 nv, const float8 rough, const arriving8 *sum, const vector8 blurred,
                                 const float8 open, __global const float *environment,
                                 __global const float *environment_map)
{
    float8 rest;
    const float8 weight = environment_brdf8(rough, nv, &rest), mirrored = 2.0f * nv * n.y - v.y;
    vector8 mirror = {sky_radiance8(environment, 0, mirrored), sky_radiance8(environment, 1, mirrored),
                      sky_radiance8(environment, 2, mirrored)};
#if OCCLUSION
    mirror = scaled8(mirror, open);
#endif
    vector8 around = mixed8(mirror, blurred, rough);
#if ENVIRONMENT_MAP
    const float8 share = map_share8(rough);
    if (any_of8(share > 0.0f)) {
        const vector8 direction = {2.0f * nv * n.x - v.x, mirrored, 2.0f * nv * n.z - v.z};
        vector8 seen = environment8(environment_map, direction, rough);
#if OCCLUSION
        seen = scaled8(seen, open);
#endif
        around = mixed8(around, seen, share);
    }
#endif
    out.x = reflected8(out.x, albedo.x, s->metallic, sum->glossy.x, sum->rim.x, around.x, weight, rest);
    out.y = reflected8(out.y, albedo.y, s->metallic, sum->glossy.y, sum->rim.y, around.y, weight, rest);
    out.z = reflected8(out.z, albedo.z, s->metallic, sum->glossy.z, sum->rim.z, around.z, weight, rest);
    return out;
}
#endif

// Radiance towards the eye at 8 samples. `footprint` in scene units.
INLINE vector8 shade8(const int *triangle, const float *bary1, const float *bary2, float8 footprint, float3 eye,
                      SURFACE_PARAMETERS)
{
    surface8 s = fetch8(triangle, bary1, bary2, SURFACE_ARGUMENTS);
    const vector8 face = normalize8(s.face, (vector8){0.0f, 1.0f, 0.0f});
    const vector8 towards = {eye.x - s.position.x, eye.y - s.position.y, eye.z - s.position.z};
    vector8 smooth = normalize8(s.normal, face), n = smooth;
#if NORMAL_MAPS
    n = bumped8(&s, n, footprint, TEXTURE_ARGUMENTS);
#endif
#if DOUBLE_SIDED
    turn8(&s, face, towards, &n, &smooth);
#endif
    vector8 albedo = s.colour;
#if TEXTURES
    albedo = multiply8(albedo, textured8(&s, s.base_texture, 0.0f, footprint, TEXTURE_ARGUMENTS));
#endif
#if SURFACE_MAPS // roughness in green, metalness in blue (glTF 2.0, 3.9.2)
    const vector8 map = textured8(&s, s.surface_texture, SET_OF(&s, surface), footprint, TEXTURE_ARGUMENTS);
    s.roughness *= map.y;
    s.metallic *= map.z;
#endif
    vector8 blurred = {sky_irradiance8(environment, 0, n.y), sky_irradiance8(environment, 1, n.y),
                       sky_irradiance8(environment, 2, n.y)};
    float8 open = 1.0f;
#if OCCLUSION // of the light that comes from all around, in red (glTF 2.0, 3.9.3)
    const float8 seen = textured8(&s, s.occlusion_texture, SET_OF(&s, occlusion), footprint, TEXTURE_ARGUMENTS).x;
    open = 1.0f + s.occlusion_strength * (seen - 1.0f);
    blurred = scaled8(blurred, open);
#endif
    const vector8 none = {0.0f, 0.0f, 0.0f};
    arriving8 sum = {blurred, none, none};
    const vector8 v = normalize8(towards, n);
    const float8 nv = MAX(dot8(n, v), (float8)1e-3f), rough = MAX(s.roughness, (float8)0.05f);
#if LIGHTS
    light8(s.position, n, smooth, v, nv, rough * rough, &sum, lights, shadow_maps);
#endif
    vector8 out = multiply8(albedo, sum.diffuse);
#if SPECULAR
    out = with_reflections8(out, albedo, &s, n, v, nv, rough, &sum, blurred, open, environment, environment_map);
#endif
#if EMISSIVE
    vector8 glow = s.emissive;
#if TEXTURES
    glow = multiply8(glow, textured8(&s, s.emissive_texture, SET_OF(&s, emissive), footprint, TEXTURE_ARGUMENTS));
#endif
    out = (vector8){out.x + glow.x, out.y + glow.y, out.z + glow.z};
#endif
#if UNLIT
    const int8 plain = s.unlit > 0.0f;
    out.x = plain ? shown_as8(albedo.x, environment) : out.x;
    out.y = plain ? shown_as8(albedo.y, environment) : out.y;
    out.z = plain ? shown_as8(albedo.z, environment) : out.z;
#endif
    return out;
}

// Shades samples run * id .. run * (id + 1), `run` a multiple of 8, into the texels they name.
__kernel void shade_samples(const int count, const int run, __global const int *triangles, __global const float *barys1,
                            __global const float *barys2, __global const float *footprints, __global const int *texel,
                            __global int *target, const float eye_x, const float eye_y, const float eye_z,
                            SURFACE_PARAMETERS)
{
    const int id = get_global_id(0);
    if (id > (count - 1) / run)
        return;
    const int end = MIN((id + 1) * run, count);
    const float3 eye = (float3)(eye_x, eye_y, eye_z);
    const float exposure = environment[EXPOSURE];
    for (int i = id * run; i < end; i += 8) {
        const int8 used = i + (int8)(0, 1, 2, 3, 4, 5, 6, 7) < count;
        const int8 ids = *(__global const loose_int8 *)(triangles + i);
        int triangle[8], colours[8];
        float bary1[8], bary2[8];
        STORE_INT8(used ? ids : (int8)ids.s0, triangle);
        STORE8(*(__global const loose_float8 *)(barys1 + i), bary1);
        STORE8(*(__global const loose_float8 *)(barys2 + i), bary2);
        const float8 footprint = *(__global const loose_float8 *)(footprints + i);
        const vector8 c = shade8(triangle, bary1, bary2, footprint, eye, SURFACE_ARGUMENTS);
        STORE_INT8(packed8(encode8(exposure * c.x), encode8(exposure * c.y), encode8(exposure * c.z)), colours);
        const int last = MIN(8, count - i);
        for (int lane = 0; lane < last; lane++)
            target[texel[i + lane]] = colours[lane];
    }
}
