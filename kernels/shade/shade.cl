// The one shading function: `shadeN` shades LANES samples, for the reference and for every gather. What a scene lacks
// is compiled out: TEXTURES, WRAP_MODES, NORMAL_MAPS, VERTEX_COLOURS, SPECULAR, ENVIRONMENT_MAP, SURFACE_MAPS,
// OCCLUSION, UNLIT, EMISSIVE, DOUBLE_SIDED, LOCAL_LIGHTS and SHADOWS are 0 or 1, LIGHTS and FURTHER_UVS are how many
// there are.
#include "shade/surface.cl"
#include "shade/light.cl"
#include "shade/environment.cl"

// A normal this near to its triangle's plane has no side to turn: foliage that is lit like the ground it grows on.
#define IN_PLANE 0.25f

#if DOUBLE_SIDED
// Turn normals to the side of the triangle that is seen.
INLINE void turnN(const surfaceN *s, const vectorN face, const vectorN towards, vectorN *n, vectorN *smooth)
{
    const floatN along = absN(dotN(*smooth, face));
    const intN turned = s->double_sided > 0.0f && dotN(face, towards) < 0.0f && along > IN_PLANE;
    const floatN side = turned ? (floatN)-1.0f : (floatN)1.0f;
    *n = scaledN(*n, side);
    *smooth = scaledN(*smooth, side);
}
#endif

#if SPECULAR
// Add what a surface reflects of its surroundings, and of the lights' `sum`, to what it scatters of both: `out`.
// `open`: how much of the surroundings is seen from there.
INLINE vectorN with_reflectionsN(vectorN out, const vectorN albedo, const surfaceN *s, const vectorN n, const vectorN v,
                                 const floatN nv, const floatN rough, const arrivingN *sum, const vectorN blurred,
                                 const floatN open, __global const float *environment,
                                 __global const float *environment_map)
{
    floatN rest;
    const floatN weight = environment_brdfN(rough, nv, &rest), mirrored = 2.0f * nv * n.y - v.y;
    vectorN mirror = {sky_radianceN(environment, 0, mirrored), sky_radianceN(environment, 1, mirrored),
                      sky_radianceN(environment, 2, mirrored)};
#if OCCLUSION
    mirror = scaledN(mirror, open);
#endif
    vectorN around = mixedN(mirror, blurred, rough);
#if ENVIRONMENT_MAP
    const floatN share = map_shareN(rough);
    if (any_ofN(share > 0.0f)) {
        const vectorN direction = {2.0f * nv * n.x - v.x, mirrored, 2.0f * nv * n.z - v.z};
        vectorN seen = environmentN(environment_map, direction, rough);
#if OCCLUSION
        seen = scaledN(seen, open);
#endif
        around = mixedN(around, seen, share);
    }
#endif
    out.x = reflectedN(out.x, albedo.x, s->metallic, sum->glossy.x, sum->rim.x, around.x, weight, rest);
    out.y = reflectedN(out.y, albedo.y, s->metallic, sum->glossy.y, sum->rim.y, around.y, weight, rest);
    out.z = reflectedN(out.z, albedo.z, s->metallic, sum->glossy.z, sum->rim.z, around.z, weight, rest);
    return out;
}
#endif

// Radiance towards the eye at LANES samples. `footprint` in scene units.
INLINE vectorN shadeN(const int *triangle, const float *bary1, const float *bary2, floatN footprint, float3 eye,
                      SURFACE_PARAMETERS)
{
    surfaceN s = fetchN(triangle, bary1, bary2, SURFACE_ARGUMENTS);
    const vectorN face = normalizeN(s.face, (vectorN){0.0f, 1.0f, 0.0f});
    const vectorN towards = {eye.x - s.position.x, eye.y - s.position.y, eye.z - s.position.z};
    vectorN smooth = normalizeN(s.normal, face), n = smooth;
#if NORMAL_MAPS
    n = bumpedN(&s, n, footprint, TEXTURE_ARGUMENTS);
#endif
#if DOUBLE_SIDED
    turnN(&s, face, towards, &n, &smooth);
#endif
    vectorN albedo = s.colour;
#if TEXTURES
    albedo = multiplyN(albedo, texturedN(&s, s.base_texture, 0.0f, footprint, TEXTURE_ARGUMENTS));
#endif
#if SURFACE_MAPS // roughness in green, metalness in blue (glTF 2.0, 3.9.2)
    const vectorN map = texturedN(&s, s.surface_texture, SET_OF(&s, surface), footprint, TEXTURE_ARGUMENTS);
    s.roughness *= map.y;
    s.metallic *= map.z;
#endif
    vectorN blurred = {sky_irradianceN(environment, 0, n.y), sky_irradianceN(environment, 1, n.y),
                       sky_irradianceN(environment, 2, n.y)};
    floatN open = 1.0f;
#if OCCLUSION // of the light that comes from all around, in red (glTF 2.0, 3.9.3)
    const floatN seen = texturedN(&s, s.occlusion_texture, SET_OF(&s, occlusion), footprint, TEXTURE_ARGUMENTS).x;
    open = 1.0f + s.occlusion_strength * (seen - 1.0f);
    blurred = scaledN(blurred, open);
#endif
    const vectorN none = {0.0f, 0.0f, 0.0f};
    arrivingN sum = {blurred, none, none};
    const vectorN v = normalizeN(towards, n);
    const floatN nv = MAX(dotN(n, v), (floatN)1e-3f), rough = MAX(s.roughness, (floatN)0.05f);
#if LIGHTS
    lightN(s.position, n, smooth, v, nv, rough * rough, &sum, lights, shadow_maps);
#endif
    vectorN out = multiplyN(albedo, sum.diffuse);
#if SPECULAR
    out = with_reflectionsN(out, albedo, &s, n, v, nv, rough, &sum, blurred, open, environment, environment_map);
#endif
#if EMISSIVE
    vectorN glow = s.emissive;
#if TEXTURES
    glow = multiplyN(glow, texturedN(&s, s.emissive_texture, SET_OF(&s, emissive), footprint, TEXTURE_ARGUMENTS));
#endif
    out = (vectorN){out.x + glow.x, out.y + glow.y, out.z + glow.z};
#endif
#if UNLIT
    const intN plain = s.unlit > 0.0f;
    out.x = plain ? shown_asN(albedo.x, environment) : out.x;
    out.y = plain ? shown_asN(albedo.y, environment) : out.y;
    out.z = plain ? shown_asN(albedo.z, environment) : out.z;
#endif
    return out;
}

// Shades samples run * id .. run * (id + 1), `run` a multiple of LANES, into the texels they name.
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
    for (int i = id * run; i < end; i += LANES) {
        const intN used = i + LANE_NUMBERS < count;
        const intN ids = *(__global const loose_intN *)(triangles + i);
        int triangle[LANES], colours[LANES];
        float bary1[LANES], bary2[LANES];
        STORE_INTN(used ? ids : (intN)ids.s0, triangle);
        STOREN(*(__global const loose_floatN *)(barys1 + i), bary1);
        STOREN(*(__global const loose_floatN *)(barys2 + i), bary2);
        const floatN footprint = *(__global const loose_floatN *)(footprints + i);
        const vectorN c = shadeN(triangle, bary1, bary2, footprint, eye, SURFACE_ARGUMENTS);
        STORE_INTN(packedN(encodeN(exposure * c.x), encodeN(exposure * c.y), encodeN(exposure * c.z)), colours);
        const int last = MIN(LANES, count - i);
        for (int lane = 0; lane < last; lane++)
            target[texel[i + lane]] = colours[lane];
    }
}
