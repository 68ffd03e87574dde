// Pieces of sliced triangles count on from the scene's triangles (see slices.py).
#include "common/wide.cl"

#define PIECE_FLOATS 16
#define PIECE_BARY 9    // barycentrics 1 and 2 of the corners in the parent
#define PIECE_PARENT 15 // as bits

// Corner `corner` (0..2) of a triangle or piece.
INLINE __global const float *corner_of(int triangle, int corner, __global const float *positions,
                                       __global const int *indices, int first_piece, __global const float *pieces)
{
    return triangle < first_piece ? positions + 3 * (size_t)indices[3 * (size_t)triangle + corner]
                                  : pieces + PIECE_FLOATS * (triangle - first_piece) + 3 * corner;
}
