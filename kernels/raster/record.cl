// A record: one triangle, or one piece of a clipped one, ready to draw; 12 ints:
//   0..5   x, y of three corners in sub-pixels from the image's top left; clockwise on screen (positive area)
//   6..8   depth at the corners, as the bits of floats
//   9      triangle | MASK_BIT where it has an alpha mask
//   10, 11 the pixels whose centres its box holds: left | top << 16, right | bottom << 16
#include "raster/camera.cl"

#define RECORD 12
#define MASK_BIT (1 << 30)

INLINE int least(const int a, const int b, const int c)
{
    return MIN(MIN(a, b), c);
}
INLINE int most(const int a, const int b, const int c)
{
    return MAX(MAX(a, b), c);
}

// The first and the last pixel whose centre is not outside [low, high] sub-pixels.
INLINE int first_pixel(const int low)
{
    return (low + SUBPIXELS / 2 - 1) >> 8;
}
INLINE int last_pixel(const int high)
{
    return (high - SUBPIXELS / 2) >> 8;
}

// The pixels (left, top, right, bottom) of the image whose centres lie in a record's box, from its last two ints.
INLINE int4 record_pixels(const int2 packed)
{
    return (int4)(packed.x & 0xffff, packed.x >> 16, packed.y & 0xffff, packed.y >> 16);
}
