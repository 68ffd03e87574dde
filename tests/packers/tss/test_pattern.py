"""The equal-spacing pattern and its L against an enumeration in exact fractions; bins and right triangles."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.packers.tss.kernels.bins import LONGEST, Bins
from shading_atlas_bench.packers.tss.kernels.emit import half_texels, row_length
from shading_atlas_bench.packers.tss.kernels.pattern import (
    LEVELS,
    cell_count,
    cells_of,
    locate_in_l_twin,
    triangle_count,
    vertex_count,
)
from shading_atlas_bench.packers.tss.statistics import half_samples, published

EVERY = range(1, LEVELS + 1)


def pattern(level: int) -> set[tuple[Fraction, ...]]:
    """Vertices of the tessellator's pattern: ring k at a smallest weight of 2k / 3l, at q / l along its edges."""
    found = set()
    for ring in range(level // 2 + 1):
        across = Fraction(2 * ring, 3 * level)
        for q in range(ring, level - ring + 1):
            along = Fraction(q, level) - across / 2
            weights = (across, along, 1 - across - along)
            found |= {weights[k:] + weights[:k] for k in range(3)}
    return found


def triangles_by_rings(level: int) -> int:
    """Between an edge of n segments and the next ring's n - 2 lie 2 n - 2 triangles; in an odd level's middle, one."""
    return sum(3 * (2 * n - 2) if n > 1 else 1 for n in range(level, 0, -2))


@pytest.mark.parametrize("level", EVERY)
def test_counts_are_those_of_the_enumeration(level):
    vertices = pattern(level)
    assert vertex_count(level) == len(vertices)
    assert triangle_count(level) == triangles_by_rings(level)
    cells = cells_of(level)
    assert len(cells.column) == cell_count(level) == len(vertices) + cells.copy.sum()
    assert cells.copy.sum() == (level + 1) // 2 <= 32
    near, far = (np.round(cells.weights[~cells.copy] * 3 * level).astype(int)).T
    listed = {
        (1 - Fraction(int(a + b), 3 * level), Fraction(int(a), 3 * level), Fraction(int(b), 3 * level))
        for a, b in zip(near, far, strict=True)
    }
    assert listed == vertices


def test_two_single_texels_share_a_slot_of_two():
    bins = Bins.make()
    assert (bins.width[bins.of_level[0]], bins.height[bins.of_level[0]]) == (2, 1)


def test_published_counts():
    assert (vertex_count(64), cell_count(64)) == (3169, 3201)
    assert published(17, 6) == 86 == half_samples(17, 6)[0]


@pytest.mark.parametrize("level", EVERY)
def test_samples_are_looked_up_where_they_lie(level):
    cells = cells_of(level)
    place = locate_in_l_twin(cells.weights, np.full(len(cells.column), level))
    near, far = cells.weights.T
    own = ~cells.copy & ((np.abs(near - far) > 1e-9) | (near < 1 / 3))  # on the cut either copy will do
    np.testing.assert_allclose(place[own, 0], cells.column[own], atol=1e-9)
    np.testing.assert_allclose(place[own, 1], cells.row[own], atol=1e-9)


@pytest.mark.parametrize("level", EVERY)
def test_two_nested_ls_fit_their_slot_without_overlap(level):
    bins = Bins.make()
    b = bins.of_level[level]
    grid = np.zeros((bins.height[b], bins.width[b]), int)
    cells = cells_of(level)
    np.add.at(grid, (cells.row, cells.column), 1)
    np.add.at(grid, (bins.height[b] - 1 - cells.row, bins.width[b] - 1 - cells.column), 1)
    assert grid.max() == 1
    assert grid.sum() == 2 * cell_count(level)


@settings(max_examples=40, deadline=None)
@given(level=st.integers(1, LEVELS), seed=st.integers(0, 1000))
def test_lookups_in_an_l_touch_written_cells_and_find_their_point(level, seed):
    """Bilinear interpolation of the cells' weights is off by at most a third of a sample's distance."""
    cells, half = cells_of(level), level // 2
    weights = np.full((level + 3, level + 3, 2), np.nan)
    weights[cells.row, cells.column] = cells.weights
    points = np.random.default_rng(seed).dirichlet([0.6] * 3, 400)[:, 1:]
    place = locate_in_l_twin(points, np.full(400, level))
    base = np.floor(np.minimum(place, np.nextafter(level + 1.0, 0))).astype(int)
    fraction = place - base
    found = np.zeros((400, 2))
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        weight = np.where([dx, dy], fraction, 1 - fraction).prod(axis=1)[:, None]
        value = weights[base[:, 1] + dy, base[:, 0] + dx]
        found += np.where(weight > 2e-3, weight * value, 0)
    assert np.isfinite(found).all()
    assert np.abs(found - points).max() * level < 0.36 + 2e-3 * level, half


@settings(max_examples=60, deadline=None)
@given(p=st.integers(1, LONGEST), q=st.integers(1, LONGEST), seed=st.integers(0, 1000))
def test_no_lookup_in_a_right_triangle_touches_an_unwritten_texel(p, q, seed):
    """Random points, and the corners, edges and texel borders where it would happen first."""
    p, q = max(p, q), min(p, q)
    lengths = np.array([row_length(p, q, row) for row in range(q + 1)] + [0])
    rng = np.random.default_rng(seed)
    y = np.concatenate([rng.uniform(0, q, 300), np.arange(q + 1), rng.integers(0, q + 1, 50) - 1e-9])
    y = np.clip(y, 0, q)
    edge = p * (1 - y / q)
    x = np.concatenate([edge * rng.uniform(0, 1, len(y)), edge, np.floor(edge)])
    y = np.tile(y, 3)
    row, column = np.floor(y).astype(int), np.floor(x).astype(int)
    right, below = x - column > 1e-7, y - row > 1e-7
    assert (column + right < lengths[row]).all()
    assert (column + right < lengths[row + below])[below].all()


@settings(max_examples=40, deadline=None)
@given(p=st.integers(1, 200), q=st.integers(1, 200), smaller=st.tuples(st.integers(0, 60), st.integers(0, 60)))
def test_two_nested_right_triangles_fit_their_slot(p, q, smaller):
    """Also when one of them is smaller than the class's largest."""
    p, q = max(p, q), min(p, q)
    bins = Bins.make()
    b = bins.of_size[bins.size_class[q], bins.size_class[p]]
    small_p, small_q = max(p - smaller[0], 1), max(q - smaller[1], 1)
    small_p, small_q = max(small_p, small_q), min(small_p, small_q)
    grid = np.zeros((bins.height[b], bins.width[b]), int)
    for turned, (w, h) in enumerate([(p, q), (small_p, small_q)]):
        column, row = half_texels(w, h)
        at = (grid.shape[0] - 1 - row, grid.shape[1] - 1 - column) if turned else (row, column)
        np.add.at(grid, at, 1)
    assert grid.max() == 1


@pytest.mark.parametrize(("w", "h"), [(1, 1), (5, 1), (17, 6), (40, 40), (96, 31)])
def test_rows_are_those_of_the_other_side(w, h):
    """Row i of either side: min(h + 1, ceil(h (1 - max(0, i - 1) / w)) + 1)."""
    column, row = half_texels(w, h)
    columns = [min(h + 1, -(-h * (w - max(0, i - 1)) // w) + 1) for i in range(w + 1)]
    np.testing.assert_array_equal(np.bincount(column), columns)
    samples, inside, _ = half_samples(w, h)
    assert samples == len(column)
    assert inside == (column * h + row * w <= w * h).sum()
