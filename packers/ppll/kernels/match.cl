// Fragments of the last frame in the next one's lists (chapter 5): moved, matched with the new ones, merged.
// Rows: RGBA, normal, eye-space x, y and distance; each pixel's nearest first.
#include "sort.cl"

#define WORDS 5
#define DISTANCE(rows, at) as_float((rows)[(size_t)(at) * WORDS + 4])
#define IS_REMOVAL(row) ((row)[0] >> 24 == 0) // a transparent fragment says what to remove

INLINE void copy_row(__global const uint *from, __global uint *to)
{
    for (int i = 0; i < WORDS; i++)
        to[i] = from[i];
}

// A fragment's x, y and distance in the new eye space. turn: rows of the matrix from the old to the new eye space.
INLINE float3 turned(__global const uint *row, const float4 turn_x, const float4 turn_y, const float4 turn_z)
{
    const float x = as_float(row[2]), y = as_float(row[3]), z = -as_float(row[4]);
    return (float3)(((turn_x.x * x + turn_x.y * y) + turn_x.z * z) + turn_x.w,
                    ((turn_y.x * x + turn_y.y * y) + turn_y.z * z) + turn_y.w,
                    -(((turn_z.x * x + turn_z.y * y) + turn_z.z * z) + turn_z.w));
}

// Each fragment's distance in the new eye space, its pixel there (-1: outside the picture), and how many others of that
// pixel came before it, in any order. counts: fragments per pixel. lens: pixels per tangent along x and y, and the
// centre.
__kernel void move_fragments(const int count, __global const uint *rows, const float4 turn_x, const float4 turn_y,
                             const float4 turn_z, const float4 lens, const int width, const int height,
                             const float near, __global float *keys, __global int *pixel, __global int *earlier,
                             __global int *counts)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const float3 to = turned(rows + (size_t)i * WORDS, turn_x, turn_y, turn_z);
    const float distance = to.z;
    const float column = lens.x * to.x / distance + lens.z, line = lens.w - lens.y * to.y / distance;
    const int inside =
        distance > near && distance < 1e30f && column >= 0.0f && column < width && line >= 0.0f && line < height;
    keys[i] = distance;
    pixel[i] = inside ? (int)line * width + (int)column : -1;
    if (inside)
        earlier[i] = atomic_inc(counts + pixel[i]);
}

// The fragments' numbers, pixel after pixel, in any order.
__kernel void list_moved(const int count, __global const int *pixel, __global const int *earlier,
                         __global const int *offsets, __global int *numbers)
{
    const int i = get_global_id(0);
    if (i < count && pixel[i] >= 0)
        numbers[offsets[pixel[i]] + earlier[i]] = i;
}

__kernel void sort_moved(const int pixels, __global const int *offsets, __global int *numbers,
                         __global const float *keys, __global const uint *rows, const float4 turn_x,
                         const float4 turn_y, const float4 turn_z, __global uint *moved)
{
    const int p = get_global_id(0);
    if (p >= pixels)
        return;
    sort_numbers(numbers + offsets[p], offsets[p + 1] - offsets[p], keys);
    for (int i = offsets[p]; i < offsets[p + 1]; i++) {
        __global const uint *row = rows + (size_t)numbers[i] * WORDS;
        __global uint *to = moved + (size_t)i * WORDS;
        const float3 at = turned(row, turn_x, turn_y, turn_z);
        to[0] = row[0];
        to[1] = row[1];
        to[2] = as_uint(at.x);
        to[3] = as_uint(at.y);
        to[4] = as_uint(at.z);
    }
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

// What turns a pixel's moved fragments into its new ones, front to back: both lists are walked at once; a moved
// fragment is kept where a new one is about as far (within `share` of the distance) and of about its colour. An entry
// is the number of a new fragment to insert, or ~ that of a moved one to remove; each pixel's lie where moved and new
// ones together would have room. counts: entries per pixel.
__kernel void find_differences(const int pixels, __global const int *moved_offsets, __global const uint *moved,
                               __global const int *fresh_offsets, __global const uint *fresh, const float share,
                               const int tolerance, __global int *entries, __global int *counts)
{
    const int p = get_global_id(0);
    if (p >= pixels)
        return;
    int i = moved_offsets[p], j = fresh_offsets[p];
    const int moved_end = moved_offsets[p + 1], fresh_end = fresh_offsets[p + 1], first = i + j;
    int at = first;
    while (i < moved_end || j < fresh_end) {
        const float a = i < moved_end ? DISTANCE(moved, i) : INFINITY;
        const float b = j < fresh_end ? DISTANCE(fresh, j) : INFINITY;
        const int together = i < moved_end && j < fresh_end && fabs(a - b) <= share * b;
        const int kept = together && !colours_differ(moved[(size_t)i * WORDS], fresh[(size_t)j * WORDS], tolerance);
        const int remove = !kept && (together || a < b), insert = !kept && (together || !(a < b));
        if (remove)
            entries[at++] = ~i;
        if (insert)
            entries[at++] = j;
        i += kept || remove;
        j += kept || insert;
    }
    counts[p] = at - first;
}

__kernel void write_differences(const int pixels, __global const int *moved_offsets, __global const uint *moved,
                                __global const int *fresh_offsets, __global const uint *fresh,
                                __global const int *entries, __global const int *offsets, __global uint *rows)
{
    const int p = get_global_id(0);
    if (p >= pixels)
        return;
    __global const int *entry = entries + moved_offsets[p] + fresh_offsets[p];
    for (int to = offsets[p]; to < offsets[p + 1]; to++, entry++) {
        __global uint *row = rows + (size_t)to * WORDS;
        if (*entry >= 0) {
            copy_row(fresh + (size_t)*entry * WORDS, row);
            continue;
        }
        row[0] = row[1] = row[2] = row[3] = 0;
        row[4] = moved[(size_t)~*entry * WORDS + 4];
    }
}

// Which moved and which inserted fragments of a pixel stay; returns how many. Removals come front to back, as the
// fragments they mean: the next of the same distance goes. `accepting`: as the thesis describes it instead, the first
// of all that are there so far and no farther off than `share` of the distance, whichever it is.
INLINE int remove_some(const int first, const int end, __global const uint *moved, const int first_change,
                       const int end_change, __global const uint *changes, const int accepting, const float share,
                       __global uchar *moved_stays, __global uchar *change_stays)
{
    int stay = end - first, next = first;
    for (int i = first; i < end; i++)
        moved_stays[i] = 1;
    for (int c = first_change; c < end_change; c++) {
        __global const uint *change = changes + (size_t)c * WORDS;
        change_stays[c] = !IS_REMOVAL(change);
        stay += change_stays[c];
        if (change_stays[c])
            continue;
        const float distance = as_float(change[4]), slack = accepting ? share * distance : 0.0f;
        int i = accepting ? first : next, before = first_change;
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
    return stay;
}

// Write a pixel's fragments that stay, nearest first; of equal distances the moved ones.
INLINE void merge_some(int i, const int end, __global const uint *moved, int c, const int end_change,
                       __global const uint *changes, __global const uchar *moved_stays,
                       __global const uchar *change_stays, const int to_first, const int to_end, __global uint *rows)
{
    for (int to = to_first; to < to_end; to++) {
        while (i < end && !moved_stays[i])
            i++;
        while (c < end_change && !change_stays[c])
            c++;
        const int from_moved = i < end && (c == end_change || DISTANCE(moved, i) <= DISTANCE(changes, c));
        copy_row(from_moved ? moved + (size_t)i++ * WORDS : changes + (size_t)c++ * WORDS, rows + (size_t)to * WORDS);
    }
}

// The changes of one pixel after the other applied in three steps: which fragments stay, and how many; where they go;
// the rows.
__kernel void remove_fragments(const int pixels, __global const int *moved_offsets, __global const uint *moved,
                               __global const int *change_offsets, __global const uint *changes, const int accepting,
                               const float share, __global uchar *moved_stays, __global uchar *change_stays,
                               __global int *counts)
{
    const int p = get_global_id(0);
    if (p < pixels)
        counts[p] = remove_some(moved_offsets[p], moved_offsets[p + 1], moved, change_offsets[p], change_offsets[p + 1],
                                changes, accepting, share, moved_stays, change_stays);
}

__kernel void merge_fragments(const int pixels, __global const int *moved_offsets, __global const uint *moved,
                              __global const int *change_offsets, __global const uint *changes,
                              __global const uchar *moved_stays, __global const uchar *change_stays,
                              __global const int *offsets, __global uint *rows)
{
    const int p = get_global_id(0);
    if (p < pixels)
        merge_some(moved_offsets[p], moved_offsets[p + 1], moved, change_offsets[p], change_offsets[p + 1], changes,
                   moved_stays, change_stays, offsets[p], offsets[p + 1], rows);
}

// All at once, of changes that are known to give as many fragments per pixel as the new lists have: one is inserted for
// each that no kept one stands for.
__kernel void apply_differences(const int pixels, __global const int *moved_offsets, __global const uint *moved,
                                __global const int *change_offsets, __global const uint *changes,
                                __global uchar *moved_stays, __global uchar *change_stays, __global const int *offsets,
                                __global uint *rows)
{
    const int p = get_global_id(0);
    if (p >= pixels)
        return;
    const int first = moved_offsets[p], end = moved_offsets[p + 1];
    const int first_change = change_offsets[p], end_change = change_offsets[p + 1];
    remove_some(first, end, moved, first_change, end_change, changes, 0, 0.0f, moved_stays, change_stays);
    merge_some(first, end, moved, first_change, end_change, changes, moved_stays, change_stays, offsets[p],
               offsets[p + 1], rows);
}
