"""Every kernel of Tessellated Shading Streaming against its twin, on a room and on what breaks sloppy code."""

from types import SimpleNamespace

import numpy as np
import pytest

from shading_atlas_bench.kernels.common.rank import rank_by_class_twin
from shading_atlas_bench.kernels.inputs.soups import FAR_EYE as EYE
from shading_atlas_bench.kernels.inputs.soups import far_soup
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.kernels.triangles import Triangles
from shading_atlas_bench.packers.tss.kernels.bins import Bins
from shading_atlas_bench.packers.tss.kernels.emit import CellTable, Placed, emit_primitive_twin, emit_samples
from shading_atlas_bench.packers.tss.kernels.footprint import (
    MOST_PIECES,
    camera_floats,
    measure_triangles,
    measure_triangles_twin,
)
from shading_atlas_bench.packers.tss.kernels.forms import choose_strategies, choose_strategies_twin
from shading_atlas_bench.packers.tss.kernels.layout import Items, lay_out, lay_out_twin, place_items, place_items_twin
from shading_atlas_bench.packers.tss.kernels.locate import UNPLACED, Located, find_piece_twin, locate, locate_twin
from shading_atlas_bench.packers.tss.kernels.perspective import (
    invert_depths,
    invert_depths_twin,
    to_object,
    to_screen,
)
from shading_atlas_bench.packers.tss.kernels.primitives import list_primitives, measure_primitives_twin, piece_corners

RNG = np.random.default_rng(5)
SCALE = 0.83
STAGE = "structs/test"


@pytest.fixture(scope="module")
def known(device) -> SimpleNamespace:
    """Triangles, the camera, and all stages up to the samples."""
    corners = far_soup(RNG)
    view = np.eye(4)
    view[:3, 3] = -EYE
    projection = np.array([[1.2, 0, 0, 0], [0, 1.9, 0, 0], [0, 0, 0, 0.02], [0, 0, -1, 0]])
    camera = camera_floats(view, projection, 240, 152)
    indices = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    triangles = Triangles.upload(device, corners.reshape(-1, 3), indices, np.zeros(len(corners), np.uint8))
    ids = np.flatnonzero(RNG.random(len(corners)) < 0.9).astype(np.int32)
    primitives = list_primitives(device, device.upload(ids), len(ids), triangles, device.upload(camera), SCALE, 3.0)
    bins = Bins.make()
    tables, count = bins.upload(device), primitives.count
    turns = RNG.permutation(count).astype(np.int32)
    forms, items = choose_strategies(device, primitives, SCALE, 3.0, device.upload(turns), tables)
    items_host = items.get()
    ranks, totals = rank_by_class_twin(items_host.reshape(-1), bins.count)
    ranks = ranks.reshape(-1, 2)
    regions, used = lay_out(device, tables, device.upload(totals.astype(np.int32)), 2048)
    listed = Items(device.upload(turns), items, device.upload(ranks.astype(np.int32)))
    places = place_items(device, count, used, listed, tables, regions)
    inverse = invert_depths(device, primitives.depths, primitives.pieces, len(ids), SCALE, STAGE)
    placed = Placed(primitives, forms, places, inverse)
    return SimpleNamespace(**locals())


def test_triangles(device, known):
    depths, pieces = (array.get() for array in (known.primitives.depths, known.primitives.pieces))
    expected, parts = measure_triangles_twin(known.corners[known.ids], known.camera, SCALE, 3.0)
    # float32, eye-relative: 1e-5 of the depths; the height of a sliver to 2e-3 pixels or 1e-3 of it
    np.testing.assert_allclose(depths[:, :3], expected[:, :3], rtol=1e-5, atol=1e-6)
    tall = np.abs(expected[:, 3]) > 0.01
    np.testing.assert_array_equal(np.sign(depths[tall, 3]), np.sign(expected[tall, 3]))
    assert (np.abs(depths[:, 3] - expected[:, 3]) <= 2e-3 + 1e-3 * np.abs(expected[:, 3])).mean() > 0.99
    assert (pieces != parts).mean() < 0.01  # where a quotient lies at a whole number
    assert pieces.max() == MOST_PIECES
    floor = np.flatnonzero(known.ids == 9)
    assert (pieces[floor] == MOST_PIECES).all()


def test_work_groups_change_no_depth(device, known, monkeypatch):
    ids, camera = device.upload(known.ids), device.upload(known.camera)
    monkeypatch.setattr(device, "local_size", 7)
    depths, pieces = measure_triangles(device, ids, len(known.ids), known.triangles, camera, SCALE, 3.0, STAGE)
    assert depths.get().tobytes() == known.primitives.depths.get().tobytes()
    assert pieces.get().tobytes() == known.primitives.pieces.get().tobytes()


def test_perspective_is_bounded_and_has_an_inverse(known):
    depths, pieces = known.primitives.depths.get(), known.primitives.pieces.get()
    expected = invert_depths_twin(depths, pieces, SCALE)
    np.testing.assert_allclose(known.inverse.get()[:, :3], expected, rtol=1e-6)
    assert expected.max() == 1
    bary = RNG.dirichlet([1, 1, 1], len(expected))[:, 1:]
    np.testing.assert_allclose(to_object(to_screen(bary, expected), expected), bary, atol=1e-9)
    # equation 5: with true depths, what is even on screen
    corner = np.array([[-1.0, -1, -2], [1, -1, -5], [0, 1, -9]])
    screen = corner[:, :2] / -corner[:, 2:]
    middle = to_object(np.full((1, 2), 1 / 3), 1 / -corner[None, :, 2])[0]
    point = np.array([1 - middle.sum(), *middle]) @ corner
    np.testing.assert_allclose(point[:2] / -point[2], screen.mean(axis=0))


def test_pieces_tile_their_triangle():
    for n in (1, 2, 5, 16):
        index = np.arange(n * n)
        corners = piece_corners(np.full(n * n, n), index)
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        np.testing.assert_allclose(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], 1 / n**2)
        number, local = find_piece_twin(corners.mean(axis=1), np.full(n * n, n))
        np.testing.assert_array_equal(number, index)
        np.testing.assert_allclose(local, 1 / 3, atol=1e-9)


def test_a_point_beside_its_triangle_is_beside_an_outer_piece():
    """Beyond the side opposite to corner 0, where no piece is turned."""
    number, local = find_piece_twin(np.array([[0.6, 0.5], [0.8, 0.3]]), np.array([1, 2]))
    assert number.tolist() == [0, 2]
    np.testing.assert_allclose(local, [[0.6, 0.5], [0.6, 0.6]])


def test_primitives(known):
    primitives = known.primitives
    parents, starts, pieces = primitives.parents.get(), primitives.starts.get(), primitives.pieces.get()
    np.testing.assert_array_equal(parents, np.repeat(np.arange(len(known.ids)), pieces**2))
    index = np.arange(primitives.count) - starts[parents]
    inverse = invert_depths_twin(primitives.depths.get(), pieces, 1.0)[parents]
    corners = known.corners[known.ids][parents]
    expected = measure_primitives_twin(corners, pieces[parents], index, inverse, known.camera)
    shapes, firsts = primitives.shapes.get(), primitives.firsts.get()
    # Positions on screen agree to 2e-3 pixels (float32 at 240 pixels): lengths to twice that, heights of slivers too.
    for column, name, slack in ((0, "level", 0.25), (1, "base", 4e-3), (2, "height", 8e-3)):
        error = np.abs(shapes[:, column] - expected[name])
        assert (error <= slack + 1e-4 * expected[name]).mean() > 0.995, name
    clear = expected["base"] > 1
    assert (firsts == expected["first"])[clear].mean() > 0.97  # the others have two longest edges
    assert (np.abs(shapes[:, 3] - expected["foot"])[clear & (firsts == expected["first"])] < 1e-2).mean() > 0.99


@pytest.mark.parametrize("threshold", [0.0, 3.0, float("inf")])
@pytest.mark.parametrize("scale", [1.0, SCALE, 0.01])
def test_forms(device, known, threshold, scale):
    primitives, count = known.primitives, known.primitives.count
    turns = device.upload(np.arange(count, dtype=np.int32))
    forms, items = choose_strategies(device, primitives, scale, threshold, turns, known.tables)
    cut = primitives.pieces.get()[primitives.parents.get()] > 1
    expected, expected_items = choose_strategies_twin(primitives.shapes.get(), cut, scale, threshold, known.bins)
    np.testing.assert_array_equal(forms.get(), expected)
    np.testing.assert_array_equal(items.get(), expected_items)
    kinds = np.sign(expected[:, 0])
    assert set(kinds) <= {0.0: {0, -1}, 3.0: {-1, 0, 1}, float("inf"): {0, 1}}[threshold]


@pytest.mark.parametrize("width", [16, 100, 2048])
def test_layout(device, known, width):
    totals = np.bincount(known.items_host[known.items_host >= 0], minlength=known.bins.count).astype(np.int32)
    regions, used = lay_out(device, known.tables, device.upload(totals), width)
    expected, rows = lay_out_twin(known.bins, totals.astype(np.int64), width)
    assert used == rows
    np.testing.assert_array_equal(regions.get(), expected)
    assert (used == -1) == (known.bins.width[totals > 0].max() > width)


def test_places_do_not_overlap(known):
    expected = place_items_twin(
        known.items_host.reshape(-1), known.ranks.reshape(-1), known.bins.width, known.bins.height,
        known.regions.get(), known.used,
    ).reshape(-1, 2)  # fmt: skip
    np.testing.assert_array_equal(known.places.get(), expected[known.turns])
    placed = expected[known.items_host >= 0]
    assert (placed >= 0).all()
    assert len(np.unique(placed)) == len(placed)


@pytest.mark.parametrize("runs", [None, 1, 37])
def test_samples(device, known, runs):
    found = emit_samples(device, known.placed, known.triangles, CellTable.upload(device), 2048, runs)
    names = ("triangle", "bary1", "bary2", "footprint", "texel")
    arrays = {name: getattr(found, name).get()[: found.count] for name in names}
    assert len(np.unique(arrays["texel"])) == found.count
    expected = samples_twin(known)
    np.testing.assert_array_equal(arrays["triangle"], expected["triangle"])
    np.testing.assert_array_equal(arrays["texel"], expected["texel"])
    for name in ("bary1", "bary2"):  # float32 with a denominator of at least a quarter of the least weight
        np.testing.assert_allclose(arrays[name], expected[name], atol=3e-5, rtol=1e-4)
    longest = np.linalg.norm(known.corners - np.roll(known.corners, 1, axis=1), axis=2).max(axis=1)
    error = np.abs(arrays["footprint"] - expected["footprint"]) / np.maximum(longest[expected["triangle"]], 1e-6)
    assert np.quantile(error, 0.999) < 2e-4  # but for steps that are equally long


def samples_twin(known) -> dict[str, np.ndarray]:
    """All samples, primitive by primitive."""
    parents, starts = known.primitives.parents.get(), known.primitives.starts.get()
    pieces, firsts = known.primitives.pieces.get(), known.primitives.firsts.get()
    forms, places, inverse = known.forms.get(), known.places.get(), known.inverse.get()[:, :3].astype(np.float64)
    parts = []
    for i in range(known.primitives.count):
        row = parents[i]
        piece, triangle = (int(pieces[row]), int(i - starts[row])), int(known.ids[row])
        decided = (int(firsts[i]), forms[i], places[i], 2048)
        parts.append(emit_primitive_twin(triangle, known.corners[triangle], inverse[row], piece, *decided))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def test_locations(device, known):
    """Places of random points, to 1/100 texel; at cuts rounding decides between copies far apart."""
    primitives, n = known.primitives, 3000
    forms, places, firsts = known.forms.get(), known.places.get(), known.primitives.firsts.get()
    halves = forms[:, 0] < 0
    size = forms[:, 2] | forms[:, 3] << 10 | forms[:, 1] << 20
    records = np.where(
        halves[:, None],
        np.stack([-1 - firsts, places[:, 0], places[:, 1], size], axis=1),
        np.stack([forms[:, 0], places[:, 0], 0 * size, 0 * size], axis=1),
    ).astype(np.int32)
    records[::50, 0] = UNPLACED
    triangle = RNG.integers(0, len(known.ids), n).astype(np.int32)
    bary = RNG.dirichlet([1, 1, 1], n)[:, 1:].astype(np.float32)
    b1, b2 = bary.T
    samples = Samples.upload(device, triangle, b1, b2, np.zeros(n, np.float32), np.arange(n, dtype=np.int32))
    located = Located(known.inverse, primitives.pieces, primitives.starts, device.upload(records))
    found = locate(device, samples, located, STAGE).get()[:, :n].T
    inverse, pieces = known.inverse.get()[:, :3], primitives.pieces.get()
    place = locate_twin(bary, inverse[triangle], pieces[triangle], primitives.starts.get()[triangle], records)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(place))
    placed = np.isfinite(place[:, 0])
    assert 0.9 < placed.mean() < 1
    assert (np.abs(found - place)[placed].max(axis=1) < 0.01).mean() > 0.99
