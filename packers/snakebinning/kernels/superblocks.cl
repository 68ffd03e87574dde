#include "bins.cl"
#include "strip.cl"

// Superblock management (section 3.5, algorithm 2), by one work-item: bins to strips, strips to superblocks.

// Entries of `state`.
#define STRIPS 0 // entries in use, with free ones among them
#define SUPERBLOCKS 1
#define CURSOR_X 2 // where the next superblock goes
#define CURSOR_Y 3
#define LEFT 4     // triangles without a slot, because the atlas is full
#define OUTGROWN 5 // counters of events, since the packer began
#define SHRUNK 6
#define COLLAPSED 7
#define ORPHANS 8 // strips in the list of those to place
#define FREE 9    // first free entry, linked by `next`, -1 for none

#define GENEROUS 1.2f // area over what is needed that counts as no waste
#define SNUG 1.3f     // and that a strip may take where another superblock could be made for it, if the atlas is tight

// Which superblock a strip gets.
#define FIRST 0 // the first with room
#define BEST 1  // the widest in which it wastes next to nothing, else the one in which it takes the smallest area
#define TIGHT 2 // the one in which it takes the smallest area, which is a new one where that is not snug
#define NEXT 3  // the first with room, and an orphan the last one made: algorithm 2 as printed

// In which order orphans get theirs.
#define WIDEST 0 // the widest slots first
#define FOUND 1  // as algorithm 2 comes upon them

typedef struct {
    int atlas_width, atlas_height, height; // height of superblocks, the highest in a tight atlas
    float capacity, shrink, collapse;      // room / triangles; shares
    int enlarge, fit, order, frozen, frame;
    int entries, most_blocks; // strips and superblocks that there is room for
    __global Strip *strips;
    __global Superblock *blocks;
    __global int *state, *orphans, *strip_of;
} Manager;

INLINE void push_orphan(Manager m, int strip)
{
    m.orphans[m.state[ORPHANS]++] = strip;
}

// Takes a part of a strip out of its superblock.
INLINE void detach(Manager m, int strip)
{
    __global Strip *s = m.strips + strip;
    __global Superblock *b = m.blocks + s->superblock;
    if (b->first == strip)
        b->first = s->next;
    else {
        int above = b->first;
        while (m.strips[above].next != strip)
            above = m.strips[above].next;
        m.strips[above].next = s->next;
    }
    b->used -= s->rows * s->lines;
    b->strips--;
    b->room = b->height;
    if (b->strips == 0)
        b->peak = 0;
    s->superblock = -1;
}

INLINE void release(Manager m, int strip)
{
    if (m.strips[strip].superblock >= 0)
        detach(m, strip);
    m.strips[strip].bin = -1;
    m.strips[strip].moved_at = m.frame;
    m.strips[strip].next = m.state[FREE];
    m.state[FREE] = strip;
}

// Takes a strip out of the superblocks, and makes one of its parts again.
INLINE void take_out(Manager m, int strip)
{
    __global Strip *s = m.strips + strip;
    if (s->superblock >= 0)
        detach(m, strip);
    while (s->more >= 0) {
        const int part = s->more;
        s->more = m.strips[part].more;
        release(m, part);
    }
}

// Slots of a strip and its further parts.
INLINE int room_of(Manager m, int strip)
{
    int room = 0;
    for (int part = strip; part >= 0; part = m.strips[part].more)
        if (m.strips[part].superblock >= 0)
            room += m.strips[part].rows * m.strips[part].per_row;
    return room;
}

// A strip as it is to be placed: with those of its triangles that have no slot yet.
INLINE Strip rest_of(Manager m, int strip)
{
    Strip s = m.strips[strip];
    s.count -= room_of(m, strip);
    return s;
}

INLINE bool has_entry(Manager m)
{
    return m.state[FREE] >= 0 || m.state[STRIPS] < m.entries;
}

// An entry of the list of strips, -1 if there is none.
INLINE int new_entry(Manager m)
{
    if (!has_entry(m))
        return -1;
    const int strip = m.state[FREE];
    if (strip < 0)
        return m.state[STRIPS]++;
    m.state[FREE] = m.strips[strip].next;
    return strip;
}

// Slots for so many triangles, with room to grow.
INLINE int room_for(Manager m, int count)
{
    return max(count, (int)(m.capacity * count));
}

INLINE int rows_for(Manager m, const Strip *s, int per_row)
{
    return (room_for(m, s->count) + per_row - 1) / per_row;
}

// Free lines of a superblock, below a strip; above: -1 for the top. block: -1 for no gap.
typedef struct {
    int block, above, y, lines;
} Gap;

// Free lines between the strips of a superblock, at most.
INLINE int largest_gap(Manager m, int block)
{
    int end = 0, largest = 0;
    for (int part = m.blocks[block].first; part >= 0; part = m.strips[part].next) {
        largest = max(largest, m.strips[part].y - end);
        end = m.strips[part].y + m.strips[part].rows * m.strips[part].lines;
    }
    return max(largest, m.blocks[block].height - end);
}

// Puts so many rows of a strip, or of a further part of one that is placed, into a gap that holds them; s: its shape.
// Whether there is an entry for them.
INLINE bool insert(Manager m, int strip, Strip s, Gap gap, int rows)
{
    __global Superblock *b = m.blocks + gap.block;
    int last = m.strips[strip].superblock < 0 ? -1 : strip;
    while (last >= 0 && m.strips[last].more >= 0)
        last = m.strips[last].more;
    const int part = last < 0 ? strip : new_entry(m);
    if (part < 0)
        return false;
    s.superblock = gap.block, s.y = gap.y, s.rows = rows, s.per_row = slots_in(&s, b->width);
    s.next = gap.above < 0 ? b->first : m.strips[gap.above].next;
    s.count = last < 0 ? m.strips[strip].count : 0;
    s.more = -1;
    s.moved_at = m.frame;
    m.strips[part] = s;
    if (last >= 0)
        m.strips[last].more = part;
    if (gap.above < 0)
        b->first = part;
    else
        m.strips[gap.above].next = part;
    b->used += rows * s.lines;
    b->strips++;
    b->peak = max(b->peak, b->used);
    b->room = largest_gap(m, gap.block);
    return true;
}

// Puts a strip, or what has no slot of one that is placed, into the first gap of a superblock that holds it; whether
// there is one.
INLINE bool attach(Manager m, int strip, int block)
{
    const Strip s = rest_of(m, strip);
    Superblock b = m.blocks[block];
    const int per_row = slots_in(&s, b.width);
    if (per_row == 0)
        return false;
    const int rows = rows_for(m, &s, per_row), needed = rows * s.lines;
    if (needed > b.room)
        return false;
    int above = -1, below = b.first, end = 0, largest = 0;
    while (below >= 0 && m.strips[below].y - end < needed) {
        largest = max(largest, m.strips[below].y - end);
        end = m.strips[below].y + m.strips[below].rows * m.strips[below].lines;
        above = below;
        below = m.strips[below].next;
    }
    if (below < 0 && b.height - end < needed) {
        m.blocks[block].room = max(largest, b.height - end);
        return false;
    }
    return insert(m, strip, s, (Gap){block, above, end, needed}, rows);
}

// Texels of atlas that a strip should take, and that it would take in a superblock; -1 if it has no room for sure.
INLINE float wanted_area(Manager m, const Strip *s)
{
    return 0.5f * m.capacity * s->count * s->period * s->lines;
}

INLINE float area_in(Manager m, const Strip *s, int block)
{
    if (m.blocks[block].room < s->lines)
        return -1.0f;
    const int per_row = slots_in(s, m.blocks[block].width);
    if (per_row == 0)
        return -1.0f;
    const int lines = rows_for(m, s, per_row) * s->lines;
    return lines > m.blocks[block].room ? -1.0f : (float)lines * m.blocks[block].width;
}

// The superblock for a strip in which it takes at most an area, -1 for none.
INLINE int find_superblock(Manager m, const Strip *s, float most)
{
    const float little = m.fit == BEST ? GENEROUS * wanted_area(m, s) : 0.0f;
    int best = -1, widest = 0;
    float least = 0.0f;
    for (int block = 0; block < m.state[SUPERBLOCKS]; block++) {
        const float area = area_in(m, s, block);
        if (area < 0.0f || area > most)
            continue;
        if (m.fit == FIRST || m.fit == NEXT)
            return block;
        if (area <= little) {
            if (m.blocks[block].width > widest)
                best = block, widest = m.blocks[block].width;
        } else if (widest == 0 && (best < 0 || area < least))
            best = block, least = area;
    }
    return best;
}

// snug: whether only where it wastes little, if the atlas is tight.
INLINE bool attach_anywhere(Manager m, int strip, bool snug)
{
    const Strip s = rest_of(m, strip);
    if (s.superblock >= 0 && !has_entry(m))
        return false;
    const float most = snug && m.fit == TIGHT ? SNUG * wanted_area(m, &s) : INFINITY;
    for (int block = find_superblock(m, &s, most); block >= 0; block = find_superblock(m, &s, most))
        if (attach(m, strip, block))
            return true; // else its `room` is smaller now
    return false;
}

// Pairs of slots in a row of the superblock in which the strip would be a square.
INLINE int square(Manager m, const Strip *s)
{
    return max(1, (int)(sqrt(wanted_area(m, s)) / s->period + 0.5f));
}

// Width of a superblock in which the strip would be a square, to whole blocks of two slots; wider if the strip would
// be too high, narrower if the atlas ends. 0 if it cannot be, or not for the whole strip.
INLINE int superblock_width(Manager m, const Strip *s, int left, int height, bool whole)
{
    int blocks = square(m, s);
    while (row_width(s, 2 * blocks) < left && rows_for(m, s, 2 * blocks) * s->lines > height)
        blocks += 1 + blocks / 8;
    const int per_row = min(room_for(m, s->count) == 1 ? 1 : 2 * blocks, slots_in(s, left));
    if (per_row == 0 || height < s->lines || (whole && rows_for(m, s, per_row) * s->lines > height))
        return 0;
    return row_width(s, per_row);
}

// Height of a band of superblocks that a strip opens, 0 if the lines left are too few. In a tight atlas it is that of
// the strip as a square: strips come in the order of their lines then, so that those after it are no higher.
INLINE int band_height(Manager m, const Strip *s, int left)
{
    if (m.fit != TIGHT)
        return m.height <= left ? m.height : 0;
    const int lines = rows_for(m, s, 2 * square(m, s)) * s->lines;
    return min(left, min(m.height, lines));
}

// A new superblock for a strip, or for a part of it, next to the last one; -1 if the atlas has no room.
INLINE int create_superblock(Manager m, const Strip *s, bool whole)
{
    __global int *state = m.state;
    if (state[SUPERBLOCKS] == m.most_blocks)
        return -1;
    Superblock b;
    b.x = state[CURSOR_X], b.y = state[CURSOR_Y];
    b.height = b.x > 0 ? m.blocks[state[SUPERBLOCKS] - 1].height : band_height(m, s, m.atlas_height - b.y);
    b.width = superblock_width(m, s, m.atlas_width - b.x, b.height, whole);
    if (b.width == 0 && b.x > 0) {
        b.x = 0, b.y += b.height;
        b.height = band_height(m, s, m.atlas_height - b.y);
        b.width = superblock_width(m, s, m.atlas_width, b.height, whole);
    }
    if (b.width == 0)
        return -1;
    b.first = -1, b.used = b.peak = b.strips = 0, b.room = b.height;
    m.blocks[state[SUPERBLOCKS]] = b;
    state[CURSOR_X] = b.x + b.width, state[CURSOR_Y] = b.y;
    return state[SUPERBLOCKS]++;
}

// The gap in which most of a strip's slots have room. Where it must look at the gaps of a superblock, it notes the
// largest.
INLINE Gap roomiest_gap(Manager m, const Strip *s)
{
    Gap found = {-1, -1, 0, 0};
    int most = 0;
    for (int block = 0; block < m.state[SUPERBLOCKS] && most < s->count; block++) {
        if (m.blocks[block].room < s->lines)
            continue;
        const int per_row = slots_in(s, m.blocks[block].width);
        if (m.blocks[block].room / s->lines * per_row <= most)
            continue;
        int end = 0, above = -1;
        m.blocks[block].room = 0;
        for (int below = m.blocks[block].first;; below = m.strips[below].next) {
            const int lines = (below < 0 ? m.blocks[block].height : m.strips[below].y) - end;
            const int slots = min(s->count, lines / s->lines * per_row);
            m.blocks[block].room = max(m.blocks[block].room, lines);
            if (slots > most)
                most = slots, found = (Gap){block, above, end, lines};
            if (below < 0)
                break;
            above = below, end = m.strips[below].y + m.strips[below].rows * m.strips[below].lines;
        }
    }
    return found;
}

// Gives a strip that has room nowhere as a whole parts: in what the atlas has left, then in gaps, the roomiest first.
// Returns the number of triangles that have no slot then.
INLINE int place_in_parts(Manager m, int strip)
{
    Strip s = rest_of(m, strip);
    s.count = room_for(m, s.count);
    m.capacity = 1.0f;
    while (s.count > 0) {
        const int block = create_superblock(m, &s, false);
        const Gap gap = block >= 0 ? (Gap){block, -1, 0, m.blocks[block].height} : roomiest_gap(m, &s);
        if (gap.block < 0)
            break;
        const int per_row = slots_in(&s, m.blocks[gap.block].width);
        const int rows = min((s.count + per_row - 1) / per_row, gap.lines / s.lines);
        if (!insert(m, strip, s, gap, rows))
            break;
        s.count -= rows * per_row;
    }
    return max(0, m.strips[strip].count - room_of(m, strip));
}

// The strip of a bin that has none.
INLINE int new_strip(Manager m, int bin)
{
    const int strip = new_entry(m);
    m.strips[strip].bin = bin;
    m.strips[strip].more = -1;
    m.strips[strip].superblock = -1;
    m.strips[strip].count = m.strips[strip].base = m.strips[strip].native = 0;
    m.strips[strip].need_before8 = m.strips[strip].need_after8 = 0;
    m.strips[strip].before8 = m.strips[strip].after8 = 0;
    m.strips[strip].moved_at = m.frame;
    m.strip_of[bin] = strip;
    return strip;
}

// The frame's triangles per strip, and how wide those of the strip's own bin are; if it has none, those mapped to it.
INLINE void collect(Manager m, int used_count, __global const int *used, __global const int *map,
                    __global const int *counts, __global const int *widest)
{
    for (int i = 0; i < m.state[STRIPS]; i++) {
        __global Strip *s = m.strips + i;
        s->count = s->base = m.frozen ? s->count : 0;
        if (!m.frozen)
            s->moved_at = m.frame;
        s->need_before8 = s->need_after8 = s->native = 0;
    }
    for (int i = 0; i < used_count; i++) {
        const int bin = used[i], target = map[bin], native = bin == target;
        const int known = m.strip_of[target];
        __global Strip *s = m.strips + (known >= 0 ? known : new_strip(m, target));
        s->count += counts[bin];
        if (native)
            s->native = 1, s->need_before8 = widest[2 * bin], s->need_after8 = widest[2 * bin + 1];
        else if (!s->native) {
            s->need_before8 = max(s->need_before8, widest[2 * bin]);
            s->need_after8 = max(s->need_after8, widest[2 * bin + 1]);
        }
    }
}

// Whether those of a strip's own bin are wider than it by more than an eighth.
INLINE bool too_narrow(const Strip *s)
{
    return s->native && (8 * s->need_before8 > 9 * s->before8 + 32 || 8 * s->need_after8 > 9 * s->after8 + 32);
}

// Shrinks a placed strip, or takes it out and makes it an orphan: one that is too small, or that is in parts and needs
// less room. In a frozen frame, in which nothing moves, what has no slot in it is an orphan.
INLINE void update(Manager m, int strip)
{
    const Strip s = m.strips[strip];
    const int room = room_of(m, strip);
    const bool sparse = !m.frozen && s.count < m.shrink * room;
    if (s.count > room || (!m.frozen && too_narrow(&s)) || (sparse && s.more >= 0)) {
        if (!m.frozen)
            take_out(m, strip);
        push_orphan(m, strip);
        m.state[OUTGROWN]++;
    } else if (sparse) {
        const int rows = rows_for(m, &s, s.per_row);
        if (rows >= s.rows)
            return;
        m.blocks[s.superblock].used -= (s.rows - rows) * s.lines;
        m.blocks[s.superblock].room = m.blocks[s.superblock].height;
        m.strips[strip].rows = rows;
        m.state[SHRUNK]++;
    }
}

// Superblocks whose use has dropped below a share of their highest become empty; empty ones at the end cease to exist.
INLINE void collapse(Manager m)
{
    for (int block = 0; block < m.state[SUPERBLOCKS]; block++) {
        if (m.blocks[block].strips == 0 || m.blocks[block].used >= m.collapse * m.blocks[block].peak)
            continue;
        while (m.blocks[block].first >= 0) {
            const int strip = m.strip_of[m.strips[m.blocks[block].first].bin];
            take_out(m, strip);
            push_orphan(m, strip);
        }
        m.state[COLLAPSED]++;
    }
    while (m.state[SUPERBLOCKS] > 0 && m.blocks[m.state[SUPERBLOCKS] - 1].strips == 0) {
        m.state[SUPERBLOCKS]--;
        m.state[CURSOR_X] = m.blocks[m.state[SUPERBLOCKS]].x;
        m.state[CURSOR_Y] = m.blocks[m.state[SUPERBLOCKS]].y;
    }
}

// Fits a strip's slots to its triangles, before it is placed; in a frozen frame these are those before and the new
// ones.
INLINE void reshape(Manager m, int strip, __global const int *tops)
{
    Strip s = m.strips[strip];
    const int before8 = m.frozen ? max(s.need_before8, s.before8) : s.need_before8;
    const int after8 = m.frozen ? max(s.need_after8, s.after8) : s.need_after8;
    set_shape(&s, before8, after8, tops[s.bin % COLUMN], m.enlarge);
    m.strips[strip] = s;
}

// Eight times the logarithm to base 2, rounded down.
INLINE int width_class(int width)
{
    const int whole = 31 - clz(width);
    return 8 * whole + ((width << 3 >> whole) & 7);
}

// By what orphans are placed, the highest first: the width of their slots in eighths of powers of two, or in a tight
// atlas their lines, whatever the order asked for (see band_height).
INLINE int place_class(Manager m, __global const Strip *s)
{
    if (m.fit == TIGHT)
        return s->lines;
    return m.order == WIDEST ? width_class(s->extent + 1) : 0;
}

// Puts an orphan into a superblock that is there; made: the last one that an orphan got new in this frame, or -1.
INLINE bool attach_orphan(Manager m, int strip, int made)
{
    if (m.fit == NEXT)
        return made >= 0 && attach(m, strip, made);
    return attach_anywhere(m, strip, true);
}

// Orphans by their class, equal ones in the order of the list: into a superblock that has room, else into a new one,
// else in parts. So superblocks hold strips of about their width, or bands those of about their lines.
INLINE void place_orphans(Manager m, __global const int *tops)
{
    __global int *state = m.state;
    int highest = 0, made = -1;
    for (int i = 0; i < state[ORPHANS]; i++) {
        if (m.strips[m.orphans[i]].superblock < 0)
            reshape(m, m.orphans[i], tops);
        highest = max(highest, place_class(m, m.strips + m.orphans[i]));
    }
    for (int class = highest, lower = -1; class >= 0; class = lower) {
        lower = -1;
        for (int i = 0; i < state[ORPHANS]; i++) {
            const int strip = m.orphans[i], own = place_class(m, m.strips + strip);
            if (own < class)
                lower = max(lower, own);
            if (own != class || attach_orphan(m, strip, made))
                continue;
            const Strip s = rest_of(m, strip);
            const int block = create_superblock(m, &s, true);
            if (block >= 0)
                attach(m, strip, block), made = block;
            else if (!attach_anywhere(m, strip, false))
                state[LEFT] += place_in_parts(m, strip);
        }
    }
}

// frozen: triangles join strips, and none that has a slot moves. used: bins with triangles, ascending. map: target of
// each bin. tops: height of each bin of heights in 1/8 texel.
__kernel void manage(int frame, int frozen, int used_count, __global const int *used, __global const int *map,
                     __global const int *counts, __global const int *widest, __global const int *tops, int atlas_width,
                     int atlas_height, int height, float capacity, float shrink, float share, int enlarge, int fit,
                     int order, int entries, int most_blocks, __global Strip *strips, __global Superblock *blocks,
                     __global int *state, __global int *orphans, __global int *strip_of)
{
    if (get_global_id(0) > 0)
        return;
    const Manager m = {atlas_width, atlas_height, height,  capacity,    shrink, share,  enlarge, fit,     order,
                       frozen,      frame,        entries, most_blocks, strips, blocks, state,   orphans, strip_of};
    state[ORPHANS] = state[LEFT] = 0;
    collect(m, used_count, used, map, counts, widest);
    for (int i = 0; i < state[STRIPS]; i++) {
        if (strips[i].bin < 0 || strip_of[strips[i].bin] != i)
            continue;
        if (strips[i].count == 0) {
            take_out(m, i);
            strip_of[strips[i].bin] = -1;
            release(m, i);
        } else if (strips[i].superblock >= 0)
            update(m, i);
        else {
            reshape(m, i, tops);
            if (!attach_anywhere(m, i, true))
                push_orphan(m, i);
        }
    }
    if (!frozen)
        collapse(m);
    place_orphans(m, tops);
}
