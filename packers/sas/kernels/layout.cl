// A block's place in one word, and the classes of blocks; layout.py describes both.
#include "common/wide.cl"
#include "sizes.cl"

typedef struct {
    int x, y; // texel of the upper left corner
    int w, h; // log2 of the sides
} Block;

INLINE int trailing_zeros(int value)
{
    return (int)popcount((uint)((value & -value) - 1));
}

INLINE uint pack_location(Block block)
{
    return (uint)(2 * block.x + (1 << block.w)) | (uint)(2 * block.y + (1 << block.h)) << 16;
}

INLINE Block unpack_location(uint word)
{
    const int cx = (int)(word & 0xFFFF), cy = (int)(word >> 16);
    Block block;
    block.w = trailing_zeros(cx);
    block.h = trailing_zeros(cy);
    block.x = (cx - (1 << block.w)) / 2;
    block.y = (cy - (1 << block.h)) / 2;
    return block;
}

// The level of a side of `steps` eighths at a bias of `bias` eighths.
INLINE int level_at(int steps, int bias, int top)
{
    return min((max(steps - bias, 0) + STEPS - 1) / STEPS, top);
}

// Blocks of one size form a class; `top` is log2 of a superblock's side, the largest level.
INLINE int size_class(int w, int h, int top)
{
    return h * (top + 1) + w;
}
