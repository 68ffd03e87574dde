// Sky radiance, tone mapping and encoding.

#include "shade/wide_math.cl"

#define INV_PI 0.318309886f

// Layout of the environment: linear RGB of zenith, horizon and ground, then the exposure.
#define ZENITH 0
#define HORIZON 3
#define GROUND 6
#define EXPOSURE 9
#define ENVIRONMENT_FLOATS 10

// Radiance of one channel from a direction whose height (y of the unit vector) is given. Just below the horizon the sky
// fades to the ground, so that there is no edge to alias.
INLINE floatN sky_radianceN(__global const float *environment, int channel, floatN height)
{
    const float zenith = environment[ZENITH + channel], horizon = environment[HORIZON + channel];
    const float ground = environment[GROUND + channel];
    floatN up = (height > 0.0f) ? height : (floatN)0.0f;
    floatN down = height * -20.0f;
    down = (down > 0.0f) ? ((down < 1.0f) ? down : (floatN)1.0f) : (floatN)0.0f;
    const floatN sky = horizon + (zenith - horizon) * up;
    return sky + (ground - sky) * down;
}

// Irradiance / pi of one channel on a surface whose normal has the given height, under the sky above without the fade.
// Exact for normals straight up, level and straight down, quadratic in between: integrating the linear gradient against
// the cosine gives the zenith weights 2/3, 2/(3 pi) and 0.
INLINE floatN sky_irradianceN(__global const float *environment, int channel, floatN height)
{
    const floatN ground = 0.5f - 0.5f * height;
    const floatN zenith = 0.212206591f + height * (0.333333333f + height * 0.121126742f);
    return environment[GROUND + channel] * ground + environment[ZENITH + channel] * zenith +
           environment[HORIZON + channel] * (1.0f - ground - zenith);
}

// Tone mapping (Narkowicz 2015, "ACES Filmic Tone Mapping Curve") of scene radiance, then sRGB encoding, 0..255.
INLINE intN encodeN(floatN radiance)
{
    floatN x = (radiance > 0.0f) ? radiance : (floatN)0.0f; // not-a-number becomes black
    x = (x < 1e4f) ? x : (floatN)1e4f;
    x = x * (2.51f * x + 0.03f) / (x * (2.43f * x + 0.59f) + 0.14f);
    x = (x < 1.0f) ? x : (floatN)1.0f;
    // The power 1/2.4 = 5/12 as a polynomial in the fourth root: within 0.0021 of one level.
    const floatN root = x * inverse_sqrtN(x), y = root * inverse_sqrtN(root);
    const floatN power =
        -0.0614829118f +
        y * (0.163491914f + y * (1.24979118f + y * (-0.567404048f + y * (0.280982092f + y * -0.0653834055f))));
    return convert_intN(((x <= 0.0031308f) ? 12.92f * x : power) * 255.0f + 0.5f);
}

// The radiance that exposure and tone mapping turn into a linear colour 0..1: what an unlit surface sends, so that its
// colour is what is seen.
INLINE floatN shown_asN(floatN colour, __global const float *environment)
{
    const floatN y = (colour > 0.0f) ? ((colour < 1.0f) ? colour : (floatN)1.0f) : (floatN)0.0f;
    const floatN a = 2.51f - 2.43f * y, b = 0.03f - 0.59f * y, square = b * b + 0.56f * a * y;
    return (square * inverse_sqrtN(square) - b) / (2.0f * a * environment[EXPOSURE]);
}

INLINE intN packedN(intN r, intN g, intN b)
{
    return r | (g << 8) | (b << 16) | (int)0xff000000;
}
