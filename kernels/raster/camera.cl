// What a camera is to the raster kernels: its eye, and the rows of projection * rotation.
//
// eye is rounded to float32. rows: x in .s0123, y in .s4567, z in .s89ab, w in .scdef, each three factors for (p - eye)
// and a constant, which also makes up for the eye's rounding, so that far from the origin nothing is lost. The x and y
// rows are scaled to sub-pixels (1/256 pixel) right of and below the image's centre, so x / w and y / w only need
// rounding; z / w is the depth (1 at the near plane, towards 0).

#include "common/wide.cl"

#define SUBPIXELS 256
// Vertices farther than this from the image's centre (in sub-pixels; 16383 pixels) are clipped: edge steps then fit
// int32 inside a tile, and rounding by a large float is exact.
#define GUARD 4194048.0f
