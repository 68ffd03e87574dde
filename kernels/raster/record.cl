// A record: one triangle, or one piece of a clipped one, ready to draw; 12 ints:
//   0..5   x, y of three corners in sub-pixels from the image's top left; clockwise on screen (positive area)
//   6..8   depth at the corners, as the bits of floats
//   9      triangle | MASK_BIT where it has an alpha mask
//   10, 11 unused
#include "raster/camera.cl"

#define RECORD 12
#define MASK_BIT (1 << 30)

inline int least(const int a, const int b, const int c) { return min(min(a, b), c); }
inline int most(const int a, const int b, const int c) { return max(max(a, b), c); }

// The first and the last pixel whose centre is not outside [low, high] sub-pixels.
inline int first_pixel(const int low) { return (low + SUBPIXELS / 2 - 1) >> 8; }
inline int last_pixel(const int high) { return (high - SUBPIXELS / 2) >> 8; }

// The pixels (left, top, right, bottom) of the image whose centres lie in a record's box.
inline int4 record_pixels(__global const int *record, const int width, const int height)
{
    return (int4)(max(first_pixel(least(record[0], record[2], record[4])), 0),
                  max(first_pixel(least(record[1], record[3], record[5])), 0),
                  min(last_pixel(most(record[0], record[2], record[4])), width - 1),
                  min(last_pixel(most(record[1], record[3], record[5])), height - 1));
}
