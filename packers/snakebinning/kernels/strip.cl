// A strip: the triangles of a bin one after the other, folded into rows of a superblock (sections 3.2 and 3.5). Lengths
// `...8` are in 1/8 texel. A triangle stands in its slot with the tip at the slot's tip, and its longest edge on the
// centres of the slot's first line; every second slot is turned by 180 degrees. A point, whose lengths are 0, has one
// texel. What does not fit into one place lies in several, each with whole rows: the strip and its further parts.
#include "common/wide.cl"

typedef struct {
    int bin;                       // -1 for an entry that is free
    int count;                     // triangles in it and its further parts; 0 in these
    int superblock;                // -1 for none
    int y, rows;                   // first line of texels, and rows of slots
    int per_row;                   // slots in a row
    int next;                      // the strip below it in the superblock, -1 for none
    int before8, after8, height8;  // the largest triangle
    int inset, extent;             // column of its corner with alpha in the slot, and last column of the slot
    int lines;                     // of texels in a row of slots
    int odd, period;               // columns from a slot to where the turned one mirrors it, and to the next pair
    int texels;                    // of a slot
    int need_before8, need_after8; // of this frame's triangles
    int native;                    // whether these are the bin's own
    int base;                      // triangles in it that keep their slots
    int moved_at;                  // frame in which all of them got their slots
    int more;                      // its next part, -1 for none
} Strip;

typedef struct {
    int x, y, width, height;
    int first; // strip with the smallest y, -1 for none
    int used;  // lines of texels in strips
    int peak;  // most of them since it was empty
    int room;  // no gap has more lines
    int strips;
} Superblock;

#define HALF_PIXEL 1 // `enlarge` as in the paper; 0 is exact

// Columns [x, y] of line `line` of a slot that a triangle needs, whose foot of the height is `tip8` from the slot's
// column `inset`. Exact: those that bilinear lookups inside it touch, which is those less than one texel away in both
// directions. As in the paper: those inside the triangle with its sides moved out by half a texel.
INLINE int2 needed_columns(int tip8, int before8, int after8, int height8, int inset, int line, int enlarge)
{
    if (enlarge == HALF_PIXEL && height8 > 0) {
        const float out_before = 4.0f * sqrt(1.0f + (float)before8 * before8 / ((float)height8 * height8));
        const float out_after = 4.0f * sqrt(1.0f + (float)after8 * after8 / ((float)height8 * height8));
        const float up = 8.0f * line / height8;
        const float first = (tip8 - before8) + up * before8 - out_before,
                    last = tip8 + after8 - up * after8 + out_after;
        return (int2)(inset + (int)ceil(first * 0.125f), inset + (int)floor(last * 0.125f));
    }
    const uint above = line > 0 ? line - 1 : 0, height = max(height8, 1);
    const int first8 = tip8 - before8 + (int)(8u * before8 * above / height);
    const int last8 = tip8 + after8 - (int)(8u * after8 * above / height);
    return (int2)(inset + (first8 >> 3), inset + ((last8 + 7) >> 3));
}

INLINE int lines_of(int height8)
{
    return ((height8 + 7) >> 3) + 1;
}

// Columns of `n` slots in a row, and how many slots fit into `width`.
INLINE int row_width(const Strip *s, int n)
{
    return (n - 1) / 2 * s->period + ((n & 1) ? s->extent : s->odd) + 1;
}

INLINE int slots_in(const Strip *s, int width)
{
    const int odd = width > s->extent ? 2 * ((width - s->extent - 1) / s->period) + 1 : 0;
    const int even = width > s->odd ? 2 * ((width - s->odd - 1) / s->period) + 2 : 0;
    return max(odd, even);
}

// The slot's shape from the largest triangle: lengths in 1/8 texel.
INLINE void set_shape(Strip *s, int before8, int after8, int height8, int enlarge)
{
    s->before8 = before8, s->height8 = height8;
    // Ends on a texel's centre.
    s->after8 = height8 == 0 ? 0 : max(after8 + ((8 - ((before8 + after8) & 7)) & 7), 8 - before8);
    s->lines = lines_of(height8);
    const int2 bottom = needed_columns(before8, before8, s->after8, height8, 0, 0, enlarge);
    s->inset = -bottom.x, s->extent = bottom.y - bottom.x;
    // Slot and turned slot may share columns where one of them needs none of a line, as above a tip.
    int most = s->extent - 1, least = s->extent, widest = 0, texels = 0;
    for (int line = 0; line < s->lines; line++) {
        const int2 here = needed_columns(before8, before8, s->after8, height8, s->inset, line, enlarge);
        const int2 there = needed_columns(before8, before8, s->after8, height8, s->inset, s->lines - 1 - line, enlarge);
        if (here.y < here.x)
            continue;
        texels += here.y - here.x + 1;
        widest = max(widest, here.y - here.x + 1);
        if (there.y < there.x)
            continue;
        most = max(most, here.y + there.y);
        least = min(least, here.x + there.x);
    }
    s->odd = most + 1, s->period = max(most + 2 - least, widest), s->texels = texels;
}
