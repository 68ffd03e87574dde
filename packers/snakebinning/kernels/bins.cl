// The bin space (section 3.2): 30 x 30 angles, and 1500 heights in columns padded to whole words of a bit map.
#include "common/wide.cl"

#define ANGLES 30
#define HEIGHTS 1500
#define COLUMN 1504 // bins of a column: heights padded to whole words
#define WORDS 47    // of 32 bins, per column
#define BINS (ANGLES * ANGLES * COLUMN)
#define POINTS HEIGHTS // bin of the triangles that are drawn as one texel: the padding after the first column

// thresholds: cotangents of the lower edges of bins 1 to 29 of alpha, then, from BETA_EDGES on, of beta.
#define BETA_EDGES 32

INLINE int bin_of(int alpha, int beta, int height)
{
    return (alpha * ANGLES + beta) * COLUMN + height;
}
