// A place in the atlas: column, row << 15, turned << 30.
typedef struct {
    int column, row, sign;
} Place;

INLINE Place unpack_place(int word)
{
    Place place = {word & 0x7FFF, word >> 15 & 0x7FFF, word >> 30 & 1 ? -1 : 1};
    return place;
}

// Texels in row q of a right triangle with p texels to one side and q to the other: what bilinear lookups inside touch.
INLINE int row_length(int p, int q, int row)
{
    if (row == 0)
        return p + 1;
    const int reach = (p * (q - row + 1) + q - 1) / q;
    return MIN(reach, p) + 1;
}
