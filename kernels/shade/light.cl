// Light that arrives at samples, and how their surface reflects it.
#include "shade/vector.cl"
#include "shade/colour.cl"
#include "shade/shadow_lookup.cl"

#define LIGHT_FLOATS 48
#define LIGHT_COLOUR 16
#define DIRECTIONAL 0
#define SPOT 2

// What arrives from the lights: irradiance / pi, and what the surface's microfacets reflect of it: all of it, and the
// part to which grazing angles add.
typedef struct {
    vectorN diffuse, glossy, rim;
} arrivingN;

#if LIGHTS
// Direction to the light and how much of its colour arrives, before the cosine and the shadow. Tables hold distances of
// local lights in scene units and `falloff` = metres per unit squared.
INLINE floatN incidentN(__global const float *light, vectorN position, vectorN *direction)
{
#if LOCAL_LIGHTS
    if ((int)light[0] != DIRECTIONAL) {
        const vectorN d = {light[4] - position.x, light[5] - position.y, light[6] - position.z};
        const floatN squared = dotN(d, d);
        const floatN inverse = inverse_sqrtN(largestN(squared, (floatN)1e-12f));
        *direction = (vectorN){d.x * inverse, d.y * inverse, d.z * inverse};
        floatN arriving = 1.0f / largestN(squared * light[11], (floatN)1e-4f);
        if ((int)light[0] == SPOT) {
            const floatN cosine = -(direction->x * light[8] + direction->y * light[9] + direction->z * light[10]);
            floatN fade = (cosine - light[12]) * light[13];
            fade = (fade < 1.0f) ? positiveN(fade) : (floatN)1.0f;
            arriving *= fade * fade * (3.0f - 2.0f * fade);
        }
        return arriving;
    }
#endif
    *direction = (vectorN){-light[8], -light[9], -light[10]};
    return 1.0f;
}
#endif

#if SPECULAR
// GGX (Walter 2007) with Hammon's approximation of the correlated Smith masking ("PBR Diffuse Lighting for GGX+Smith
// Microsurfaces", 2017); without the Fresnel term, whose weight (1 - v.h)^5 is returned apart.
INLINE floatN ggxN(vectorN n, vectorN v, vectorN l, floatN nv, floatN nl, floatN alpha, floatN *grazing)
{
    const vectorN h = normalizeN((vectorN){v.x + l.x, v.y + l.y, v.z + l.z}, n);
    const floatN nh = positiveN(dotN(n, h)), vh = positiveN(dotN(v, h));
    const floatN a2 = alpha * alpha;
    // 1 - nh^2 as |n x h|^2: no cancellation in a narrow highlight.
    const vectorN c = {n.y * h.z - n.z * h.y, n.z * h.x - n.x * h.z, n.x * h.y - n.y * h.x};
    const floatN d = nh * nh * a2 + dotN(c, c);
    const floatN m = 1.0f - vh, m2 = m * m;
    *grazing = m2 * m2 * m;
    const floatN product = 2.0f * nl * nv;
    const floatN masking = 0.5f / (product + (nl + nv - product) * alpha + 1e-6f);
    return a2 * INV_PI / (d * d) * masking;
}

// Environment BRDF: weight of F0 and the rest (Karis 2014, "Physically Based Shading on Mobile").
INLINE floatN environment_brdfN(floatN roughness, floatN nv, floatN *rest)
{
    const floatN smooth = 1.0f - roughness, peak = exp2_N(-9.28f * nv);
    const floatN squared = smooth * smooth;
    const floatN a = ((squared < peak) ? squared : peak) * smooth + 0.0425f - 0.0275f * roughness;
    *rest = 1.04f * a + 0.022f * roughness - 0.04f;
    return 1.04f - 1.04f * a - 0.572f * roughness;
}

// One channel of what a surface shows: metals reflect in their base colour and have no matt part, everything else
// reflects 4% (glTF 2.0, appendix B).
INLINE floatN reflectedN(floatN matt, floatN albedo, floatN metallic, floatN glossy, floatN rim, floatN around,
                         floatN weight, floatN rest)
{
    const floatN f0 = 0.04f * (1.0f - metallic) + metallic * albedo;
    return matt * (1.0f - metallic) + f0 * (glossy - rim) + rim + around * (f0 * weight + rest);
}
#endif

#if LIGHTS
INLINE void accumulateN(vectorN *sum, __global const float *colour, floatN weight)
{
    sum->x += colour[0] * weight;
    sum->y += colour[1] * weight;
    sum->z += colour[2] * weight;
}

// n: the normal to shade with; smooth: the one to offset shadow lookups along; v, nv: direction to the eye and its
// cosine; alpha: GGX roughness.
INLINE void lightN(vectorN position, vectorN n, vectorN smooth, vectorN v, floatN nv, floatN alpha, arrivingN *sum,
                   __global const float *lights, __global const float *shadow_maps)
{
    for (int i = 0; i < LIGHTS; i++) {
        __global const float *light = lights + i * LIGHT_FLOATS;
        vectorN l;
        floatN arriving = incidentN(light, position, &l);
        const floatN nl = positiveN(dotN(n, l));
        arriving *= nl;
        if (!any_ofN(arriving > 0.0f))
            continue;
#if SHADOWS
        if (light[SHADOW_SIZE] > 0.0f)
            arriving *= shadowN(light, shadow_maps, position, smooth, l, arriving > 0.0f);
#endif
        accumulateN(&sum->diffuse, light + LIGHT_COLOUR, arriving * INV_PI);
#if SPECULAR
        floatN grazing;
        arriving *= ggxN(n, v, l, nv, nl, alpha, &grazing);
        accumulateN(&sum->glossy, light + LIGHT_COLOUR, arriving);
        accumulateN(&sum->rim, light + LIGHT_COLOUR, arriving * grazing);
#endif
    }
}
#endif
