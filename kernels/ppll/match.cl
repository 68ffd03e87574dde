// Fragments of the last frame in the next one's lists (chapter 5): moved, matched with the new ones, merged.
// Rows: RGBA, normal, eye-space x, y and distance; each pixel's nearest first.
#include "ppll/sort.cl"

#define WORDS 5
#define DISTANCE(rows, at) as_float((rows)[(size_t)(at) * WORDS + 4])
#define IS_REMOVAL(row) ((row)[0] >> 24 == 0) // a transparent fragment says what to remove

INLINE void copy_row(__global const uint *from, __global uint *to)
{
    for (int i = 0; i < WORDS; i++)
        to[i] = from[i];
}

// Each fragment in the new eye space, and its pixel there: -1 outside the picture. counts: fragments per pixel.
// turn: rows of the matrix from the old to the new eye space. lens: pixels per tangent along x and y, and the centre.
__kernel void move_fragments(const int count, __global const uint *rows, const float4 turn_x, const float4 turn_y,
                             const float4 turn_z, const float4 lens, const int width, const int height,
                             const float near, __global uint *moved, __global float *keys, __global int *pixel,
                             __global int *counts)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    __global const uint *row = rows + (size_t)i * WORDS;
    const float x = as_float(row[2]), y = as_float(row[3]), z = -as_float(row[4]);
    const float to_x = ((turn_x.x * x + turn_x.y * y) + turn_x.z * z) + turn_x.w;
    const float to_y = ((turn_y.x * x + turn_y.y * y) + turn_y.z * z) + turn_y.w;
    const float distance = -(((turn_z.x * x + turn_z.y * y) + turn_z.z * z) + turn_z.w);
    const float column = lens.x * to_x / distance + lens.z, line = lens.w - lens.y * to_y / distance;
    const int inside =
        distance > near && distance < 1e30f && column >= 0.0f && column < width && line >= 0.0f && line < height;
    __global uint *to = moved + (size_t)i * WORDS;
    to[0] = row[0];
    to[1] = row[1];
    to[2] = as_uint(to_x);
    to[3] = as_uint(to_y);
    to[4] = as_uint(distance);
    keys[i] = distance;
    pixel[i] = inside ? (int)line * width + (int)column : -1;
    if (inside)
        atomic_inc(counts + pixel[i]);
}

// The fragments' numbers, pixel after pixel, in any order. `cursor` begins as the pixels' first places.
__kernel void list_moved(const int count, __global const int *pixel, __global int *cursor, __global int *numbers)
{
    const int i = get_global_id(0);
    if (i < count && pixel[i] >= 0)
        numbers[atomic_inc(cursor + pixel[i])] = i;
}

__kernel void sort_moved(const int pixels, __global const int *offsets, __global int *numbers,
                         __global const float *keys, __global const uint *moved, __global uint *rows)
{
    const int p = get_global_id(0);
    if (p >= pixels)
        return;
    sort_numbers(numbers + offsets[p], offsets[p + 1] - offsets[p], keys);
    for (int i = offsets[p]; i < offsets[p + 1]; i++)
        copy_row(moved + (size_t)numbers[i] * WORDS, rows + (size_t)i * WORDS);
}

INLINE int colours_differ(const uint a, const uint b, const int tolerance)
{
    int most = 0;
    for (int shift = 0; shift < 32; shift += 8) {
        const int difference = abs_diff((a >> shift) & 255, (b >> shift) & 255);
        most = difference > most ? difference : most;
    }
    return most > tolerance;
}

// What turns a pixel's moved fragments into its new ones, front to back: both lists are walked at once; a moved fragment
// is kept where a new one is about as far (within `share` of the distance) and of about its colour. Returns how many
// entries there are; writes them where `out` is given.
INLINE int walk(__global const uint *moved, int i, const int moved_end, __global const uint *fresh, int j,
                const int fresh_end, const float share, const int tolerance, __global uint *out)
{
    int entries = 0;
    while (i < moved_end || j < fresh_end) {
        const float a = i < moved_end ? DISTANCE(moved, i) : INFINITY;
        const float b = j < fresh_end ? DISTANCE(fresh, j) : INFINITY;
        const int together = i < moved_end && j < fresh_end && fabs(a - b) <= share * b;
        const int kept = together && !colours_differ(moved[(size_t)i * WORDS], fresh[(size_t)j * WORDS], tolerance);
        const int remove = !kept && (together || a < b), insert = !kept && (together || !(a < b));
        if (remove) {
            if (out) {
                __global uint *entry = out + (size_t)entries * WORDS;
                entry[0] = entry[1] = entry[2] = entry[3] = 0;
                entry[4] = as_uint(a);
            }
            entries++;
        }
        if (insert) {
            if (out)
                copy_row(fresh + (size_t)j * WORDS, out + (size_t)entries * WORDS);
            entries++;
        }
        i += kept || remove;
        j += kept || insert;
    }
    return entries;
}

__kernel void count_differences(const int pixels, __global const int *moved_offsets, __global const uint *moved,
                                __global const int *fresh_offsets, __global const uint *fresh, const float share,
                                const int tolerance, __global int *counts)
{
    const int p = get_global_id(0);
    if (p < pixels)
        counts[p] = walk(moved, moved_offsets[p], moved_offsets[p + 1], fresh, fresh_offsets[p], fresh_offsets[p + 1],
                         share, tolerance, 0);
}

__kernel void write_differences(const int pixels, __global const int *moved_offsets, __global const uint *moved,
                                __global const int *fresh_offsets, __global const uint *fresh, const float share,
                                const int tolerance, __global const int *offsets, __global uint *rows)
{
    const int p = get_global_id(0);
    if (p < pixels)
        walk(moved, moved_offsets[p], moved_offsets[p + 1], fresh, fresh_offsets[p], fresh_offsets[p + 1], share,
             tolerance, rows + (size_t)offsets[p] * WORDS);
}

// Which moved and which inserted fragments stay, and how many per pixel. Removals come front to back, as the fragments
// they mean: the next of the same distance goes. `accepting`: as the thesis describes it instead, the first of all that
// are there so far and no farther off than `share` of the distance, whichever it is.
__kernel void remove_fragments(const int pixels, __global const int *moved_offsets, __global const uint *moved,
                               __global const int *change_offsets, __global const uint *changes, const int accepting,
                               const float share, __global uchar *moved_stays, __global uchar *change_stays,
                               __global int *counts)
{
    const int p = get_global_id(0);
    if (p >= pixels)
        return;
    const int first = moved_offsets[p], end = moved_offsets[p + 1];
    int stay = end - first, next = first;
    for (int i = first; i < end; i++)
        moved_stays[i] = 1;
    for (int c = change_offsets[p]; c < change_offsets[p + 1]; c++) {
        __global const uint *change = changes + (size_t)c * WORDS;
        change_stays[c] = !IS_REMOVAL(change);
        stay += change_stays[c];
        if (change_stays[c])
            continue;
        const float distance = as_float(change[4]), slack = accepting ? share * distance : 0.0f;
        int i = accepting ? first : next, before = change_offsets[p];
        while (i < end && !(moved_stays[i] && fabs(DISTANCE(moved, i) - distance) <= slack))
            i++;
        if (i < end) {
            moved_stays[i] = 0;
            next = i + 1;
            stay--;
            continue;
        }
        while (before < c && !(change_stays[before] && fabs(DISTANCE(changes, before) - distance) <= slack))
            before++;
        if (accepting && before < c) {
            change_stays[before] = 0;
            stay--;
        }
    }
    counts[p] = stay;
}

// The fragments that stay, nearest first; of equal distances the moved ones.
__kernel void merge_fragments(const int pixels, __global const int *moved_offsets, __global const uint *moved,
                              __global const int *change_offsets, __global const uint *changes,
                              __global const uchar *moved_stays, __global const uchar *change_stays,
                              __global const int *offsets, __global uint *rows)
{
    const int p = get_global_id(0);
    if (p >= pixels)
        return;
    int i = moved_offsets[p], c = change_offsets[p];
    for (int to = offsets[p]; to < offsets[p + 1]; to++) {
        while (i < moved_offsets[p + 1] && !moved_stays[i])
            i++;
        while (c < change_offsets[p + 1] && !change_stays[c])
            c++;
        const int from_moved = i < moved_offsets[p + 1] &&
                               (c == change_offsets[p + 1] || DISTANCE(moved, i) <= DISTANCE(changes, c));
        copy_row(from_moved ? moved + (size_t)i++ * WORDS : changes + (size_t)c++ * WORDS, rows + (size_t)to * WORDS);
    }
}
