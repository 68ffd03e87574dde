// Light that arrives at 8 samples, and how their surface reflects it.
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
    vector8 diffuse, glossy, rim;
} arriving8;

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
            const float8 cosine = -(direction->x * light[8] + direction->y * light[9] + direction->z * light[10]);
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
    const vector8 h = normalize8((vector8){v.x + l.x, v.y + l.y, v.z + l.z}, n);
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
    const float8 smooth = 1.0f - roughness, peak = exp2_8(-9.28f * nv);
    const float8 squared = smooth * smooth;
    const float8 a = ((squared < peak) ? squared : peak) * smooth + 0.0425f - 0.0275f * roughness;
    *rest = 1.04f * a + 0.022f * roughness - 0.04f;
    return 1.04f - 1.04f * a - 0.572f * roughness;
}

// One channel of what a surface shows: metals reflect in their base colour and have no matt part, everything else
// reflects 4% (glTF 2.0, appendix B).
INLINE float8 reflected8(float8 matt, float8 albedo, float8 metallic, float8 glossy, float8 rim, float8 around,
                         float8 weight, float8 rest)
{
    const float8 f0 = 0.04f * (1.0f - metallic) + metallic * albedo;
    return matt * (1.0f - metallic) + f0 * (glossy - rim) + rim + around * (f0 * weight + rest);
}
#endif

#if LIGHTS
INLINE void accumulate8(vector8 *sum, __global const float *colour, float8 weight)
{
    sum->x += colour[0] * weight;
    sum->y += colour[1] * weight;
    sum->z += colour[2] * weight;
}

// n: the normal to shade with; smooth: the one to offset shadow lookups along; v, nv: direction to the eye and its
// cosine; alpha: GGX roughness.
INLINE void light8(vector8 position, vector8 n, vector8 smooth, vector8 v, float8 nv, float8 alpha, arriving8 *sum,
                   __global const float *lights, __global const float *shadow_maps)
{
    for (int i = 0; i < LIGHTS; i++) {
        __global const float *light = lights + i * LIGHT_FLOATS;
        vector8 l;
        float8 arriving = incident8(light, position, &l);
        const float8 nl = positive8(dot8(n, l));
        arriving *= nl;
        if (!any_of8(arriving > 0.0f))
            continue;
#if SHADOWS
        if (light[SHADOW_SIZE] > 0.0f)
            arriving *= shadow8(light, shadow_maps, position, smooth, l, arriving > 0.0f);
#endif
        accumulate8(&sum->diffuse, light + LIGHT_COLOUR, arriving * INV_PI);
#if SPECULAR
        float8 grazing;
        arriving *= ggx8(n, v, l, nv, nl, alpha, &grazing);
        accumulate8(&sum->glossy, light + LIGHT_COLOUR, arriving);
        accumulate8(&sum->rim, light + LIGHT_COLOUR, arriving * grazing);
#endif
    }
}
#endif
