"""The validator accepts a sound atlas and catches every planted error by the rule that names it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.harness.measure.validity import (
    MARGIN,
    PART,
    SIDES,
    Gaps,
    Violation,
    _Atlas,
    _close_by,
    _distance,
    _Lookups,
    _Table,
    check,
)
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.packers.interface import Client, Owners, Payload

CELL, ACROSS = 8, 4
SIDE = CELL * ACROSS


@cache
def opened() -> Device:
    """As the fixture, where the work is made before a test or in a property's example."""
    return Device.open()


class CornerClient(Client):
    """Looks up by the atlas positions of three corners per triangle; NaN without a place."""

    def __init__(self, corners: np.ndarray) -> None:
        self.corners = corners

    def receive(self, payload: Any) -> None:
        """Never asked for here."""

    def draw(self, view: Any) -> Any:
        """Never asked for here."""

    def locate(self, triangles: np.ndarray, bary: np.ndarray) -> np.ndarray:
        c = self.corners[triangles]
        return c[:, 0] + bary[:, :1] * (c[:, 1] - c[:, 0]) + bary[:, 1:] * (c[:, 2] - c[:, 0])


@dataclass
class Packed:
    """One frame's work and its outcome, for planting errors; plane: uint8 (H, W, 4)."""

    frame: Any
    payload: Payload
    plane: np.ndarray
    owners: Owners
    client: CornerClient

    def rules(self, **options: Any) -> set[str]:
        return {violation.rule for violation in self.check(**options)}

    def check(self, seen: Any = None, budget: int | None = None, gaps: Gaps | None = None) -> list[Violation]:
        visible = seen and (*seen, self.client.locate(*seen))
        payload = replace(self.payload, planes={"atlas": opened().upload(self.plane)})
        return check(self.frame, payload, self.owners, self.client, visible, budget=budget, gaps=gaps)

    def drop(self, gone: np.ndarray) -> None:
        """Unwrite the samples selected by `gone`, in the list and in the plane."""
        keep = ~gone
        self.plane.reshape(-1, 4)[self.owners.texel[gone]] = 0
        self.owners = Owners(self.owners.texel[keep], self.owners.triangle[keep], self.owners.bary[keep])

    def change(self, **values: np.ndarray) -> None:
        self.owners = replace(self.owners, **values)


def pack_cells(count: int = 12, cell: int = CELL, across: int = ACROSS, index: int = 0, seed: int = 0) -> Packed:
    """Random triangles, each in its own square cell: corners inset by half a texel, the whole cell written."""
    side = cell * across
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(3 * count, 3)).astype(np.float32)
    indices = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    pvs = np.arange(count, dtype=np.int32)
    corner = np.stack([pvs % across, pvs // across], axis=1)[:, None] * cell + 0.5
    span = cell - 1
    corners = corner + np.array([[0, 0], [span, 0], [0, span]])
    row, column = (axis.reshape(-1) for axis in np.indices((cell, cell)))
    texel = ((corner[:, :, 1] - 0.5 + row) * side + corner[:, :, 0] - 0.5 + column).astype(np.int64)
    bary = np.stack([column, row], axis=1) / max(span, 1)
    triangle = np.repeat(pvs, cell * cell)
    owners = Owners(texel.reshape(-1), triangle, np.tile(bary, (count, 1)).astype(np.float32))
    plane = np.zeros((side, side, 4), np.uint8)
    plane.reshape(-1, 4)[owners.texel] = (90, 120, 60, 255)
    host = SimpleNamespace(positions=positions, indices=indices)
    scene = SimpleNamespace(host=host, triangles=SimpleNamespace(count=count), device=opened())
    payload = Payload({}, {}, b"", len(owners.texel))
    return Packed(SimpleNamespace(index=index, pvs=pvs, scene=scene), payload, plane, owners, CornerClient(corners))


def pack_fold(slope: float = 1.0) -> Packed:
    """Two triangles that share the diagonal of one 8 x 8 block, folded along it; each texel has its nearer owner."""
    packed = pack_cells(count=1, across=1)
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, slope]], np.float32)
    packed.frame.scene.host = SimpleNamespace(positions=positions, indices=np.array([[0, 1, 2], [3, 2, 1]], np.int32))
    packed.frame.scene.triangles.count = 2
    packed.frame.pvs = np.array([0, 1], np.int32)
    low, high = 0.5, CELL - 0.5
    packed.client.corners = np.array([[[low, low], [high, low], [low, high]], [[high, high], [low, high], [high, low]]])
    beyond = packed.owners.bary.sum(axis=1) > 1
    bary = np.where(beyond[:, None], 1 - packed.owners.bary, packed.owners.bary)
    packed.change(triangle=beyond.astype(np.int32), bary=bary)
    return packed


def test_sound_atlases_break_no_rule():
    seen = (np.array([0, 5], np.int32), np.array([[0.2, 0.3], [0.0, 1.0]], np.float32))
    assert pack_cells().check(seen) == []
    assert pack_cells(count=16, cell=2).check() == []
    assert pack_cells(cell=1).check() == []  # one texel per triangle: every lookup finds it
    assert pack_fold().check() == []
    assert pack_fold(slope=50.0).check() == []  # the neighbour's texels are far larger


@pytest.fixture
def half_a_texel() -> Packed:
    """Cells of which only the texels within half a texel of the triangle are written."""
    packed = pack_cells()
    packed.drop(packed.owners.bary.sum(axis=1) > 1.01)
    return packed


def test_declared_gaps_are_counted_and_no_violation(half_a_texel: Packed):
    assert {v.rule for v in half_a_texel.check()} == {"written"}
    gaps = Gaps()
    assert half_a_texel.check(gaps=gaps) == []
    assert gaps.share is not None
    assert 0.02 < gaps.share < 0.2
    assert pack_cells().check(gaps=(none := Gaps())) == []
    assert none.missing == 0
    assert none.touched > 0


def test_declared_gaps_hide_no_other_violation(half_a_texel: Packed):
    inside = int(half_a_texel.owners.texel[np.abs(half_a_texel.owners.bary - [2 / 7, 3 / 7]).max(axis=1).argmin()])
    half_a_texel.drop(half_a_texel.owners.texel == inside)
    (violation,) = half_a_texel.check(gaps=Gaps())
    assert (violation.rule, violation.texels) == ("written", (inside,))


@pytest.mark.parametrize("by", [(1, 0), (0, -1), (0.5, 0.5)])
def test_declared_gaps_do_not_hide_a_client_that_looks_elsewhere(half_a_texel: Packed, by: tuple[float, float]):
    half_a_texel.client.corners = half_a_texel.client.corners + np.array(by)
    assert "surface" in {v.rule for v in half_a_texel.check(gaps=Gaps())}


def test_declared_gaps_do_not_hide_texels_of_another_surface(half_a_texel: Packed):
    half_a_texel.frame.scene.host.positions[3 * 8 : 3 * 9] += 100
    half_a_texel.owners.triangle[half_a_texel.owners.triangle == 7] = 8
    assert (7,) in {v.triangles for v in half_a_texel.check(gaps=Gaps()) if v.rule == "surface"}


def test_empty_work_breaks_no_rule():
    packed = pack_cells()
    packed.drop(np.ones(len(packed.owners.texel), bool))
    packed.frame.pvs = np.zeros(0, np.int32)
    assert packed.check() == []


@settings(max_examples=25, deadline=None)
@given(cell=st.integers(1, 40), across=st.integers(1, 6), seed=st.integers(0, 99), index=st.integers(0, 50))
def test_any_cell_size_is_sound_and_one_missing_touched_texel_is_found(cell: int, across: int, seed: int, index: int):
    packed = pack_cells(across * across, cell, across, index, seed)
    assert packed.check() == []
    inside = packed.owners.bary.sum(axis=1) <= 1
    victim = np.random.default_rng(seed).choice(np.flatnonzero(inside))
    texel, triangle = int(packed.owners.texel[victim]), int(packed.owners.triangle[victim])
    packed.drop(packed.owners.texel == texel)
    (violation,) = packed.check()
    assert (violation.rule, violation.texels, violation.triangles) == ("written", (texel,), (triangle,))


def test_triangle_without_a_place():
    packed = pack_cells()
    packed.client.corners[3] = np.nan
    packed.drop(packed.owners.triangle == 3)
    (violation,) = packed.check()
    assert (violation.rule, violation.count, violation.triangles) == ("placed", 1, (3,))
    packed.payload.unplaced = {3: "the atlas is full"}
    assert packed.check() == []


@pytest.mark.parametrize("unplaced", [{2: "no room"}, {99: "no room"}, {3: ""}])
def test_wrong_list_of_unplaced_triangles(unplaced: dict[int, str]):
    packed = pack_cells()
    packed.client.corners[3] = np.nan
    packed.drop(packed.owners.triangle == 3)
    packed.payload.unplaced = {3: "no room"} | unplaced
    assert packed.rules() == {"placed"}


def test_triangle_placed_twice():
    packed = pack_cells()
    second = packed.owners.triangle == 4  # all of it again, in a cell that is free
    texel = packed.owners.texel[second]
    copy = texel + (3 * CELL * SIDE - texel[0] + 2 * CELL)
    packed.plane.reshape(-1, 4)[copy] = 255
    packed.change(
        texel=np.concatenate([packed.owners.texel, copy]),
        triangle=np.concatenate([packed.owners.triangle, packed.owners.triangle[second]]),
        bary=np.concatenate([packed.owners.bary, packed.owners.bary[second]]),
    )
    (violation,) = packed.check()
    assert (violation.rule, violation.triangles) == ("once", (4,))


@pytest.mark.parametrize(("off", "rules"), [(0.32, set()), (0.35, {"surface"})])
def test_samples_may_be_a_third_of_a_texel_off_and_no_more(off: float, rules: set[str]):
    packed = pack_cells()
    packed.change(bary=packed.owners.bary + np.array([off / (CELL - 1), 0], np.float32))
    assert packed.rules() == rules


@pytest.mark.parametrize(("gap", "rules"), [(0, set()), (1, {"once"})])
def test_lines_along_a_cut_may_be_copies_but_one_line_further_they_are_a_second_place(gap: int, rules: set[str]):
    """More than a third of a triangle's samples lie over a texel from where they are looked up."""
    side = 4
    packed = pack_cells(count=16, cell=side)
    free = np.isin(packed.owners.triangle, [1, 4])  # the cells above and left of triangle 5
    packed.drop(free)
    packed.frame.pvs = np.setdiff1d(packed.frame.pvs, [1, 4]).astype(np.int32)
    own = np.flatnonzero(packed.owners.triangle == 5)
    bary = packed.owners.bary[own]
    width = side * ACROSS
    line, column = (own[(np.abs(bary[:, i] - 1 / 3) < 0.1) & (bary.sum(axis=1) < 1.1)] for i in (1, 0))
    # The triangle's second line goes above its first one, and its second column left of its first one.
    copies = np.concatenate([packed.owners.texel[line] - (2 + gap) * width, packed.owners.texel[column] - (2 + gap)])
    packed.plane.reshape(-1, 4)[copies] = 255
    packed.change(
        texel=np.concatenate([packed.owners.texel, copies]),
        triangle=np.concatenate([packed.owners.triangle, np.full(len(copies), 5, np.int32)]),
        bary=np.concatenate([packed.owners.bary, packed.owners.bary[np.concatenate([line, column])]]),
    )
    assert packed.rules() == rules


def test_the_sides_of_a_point_lie_between_the_directions_of_edges():
    """In a triangle of equal sides, whose edges run at 0, 60, 120 ... degrees, they are at right angles to one each."""
    across = SIDES @ np.array([[1, 0], [1 / 2, np.sqrt(3) / 2]])
    angles = np.degrees(np.arctan2(across[:, 1], across[:, 0])) % 360
    np.testing.assert_allclose(np.sort(angles), [30, 90, 150, 210, 270, 330], atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(across, axis=1), np.linalg.norm(across[0]), rtol=1e-6)


def test_triangles_without_extent_are_where_their_neighbours_are():
    packed = pack_fold()
    packed.frame.scene.host.positions[:] = 0
    assert packed.check() == []


STEP = 1 / 32


def affine_atlas(side: int = 9) -> _Atlas:
    """One triangle that owns every texel; its barycentrics are STEP times the position of the texel's centre."""
    row, column = (axis.ravel() for axis in np.indices((side, side)))
    bary = STEP * np.stack([column + 0.5, row + 0.5], axis=1).astype(np.float32)
    return atlas_of(Owners(row * side + column, np.zeros(side * side, np.int32), bary), side, side)


def atlas_of(owners: Owners, width: int, height: int) -> _Atlas:
    return _Atlas(opened(), owners, opened().zeros((height, width, 4), np.uint8), np.ones(3, bool))


def test_points_towards_neighbours_are_where_they_are_said_to_be():
    atlas, texel = affine_atlas(), np.array([4 * 9 + 4])
    found = list(atlas.towards_neighbours(np.zeros(1, np.int32), atlas.owners.bary[texel], texel))
    for point, at in found:
        np.testing.assert_allclose(point, STEP * at, atol=1e-6)
    steps = {tuple(np.rint((at[0] - 4.5) / PART).astype(int).tolist()) for _, at in found}
    assert steps == {(a, b) for a in (-2, -1, 1, 2) for b in (-2, -1, 1, 2) if abs(a) != abs(b)}


@pytest.mark.parametrize(("off", "smooth"), [(0, True), (0.45, True), (0.55, False)])
def test_a_sample_is_smooth_within_half_a_step_of_its_neighbours_plane(off: float, smooth: bool):
    atlas, texel = affine_atlas(), np.array([4 * 9 + 4])
    atlas.owners.bary[texel, 0] += off * STEP
    assert atlas.is_smooth(texel, np.zeros(1, np.int32)).tolist() == [smooth]
    assert not atlas.is_smooth(texel, np.ones(1, np.int32)).any()  # nothing there is another triangle's


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 999), height=st.integers(1, 12), width=st.integers(1, 12))
def test_samples_near_by_are_those_of_the_triangle_within_three_texels(seed: int, height: int, width: int):
    rng = np.random.default_rng(seed)
    listed = np.flatnonzero(rng.random(height * width) < 0.7)
    triangle, bary = rng.integers(0, 3, len(listed)).astype(np.int32), rng.uniform(-1.5, 1.5, (len(listed), 2))
    bary[rng.random(len(listed)) < 0.1] = 1 / 3
    atlas = atlas_of(Owners(listed, triangle, bary.astype(np.float32)), width, height)
    asked = rng.integers(0, 3, height * width).astype(np.int32)
    found = atlas.near_inside(np.arange(height * width), asked).reshape(height, width)
    inside = (bary >= 0).all(axis=1) & (bary.sum(axis=1) <= 1)
    for row, column in np.ndindex(height, width):
        apart = np.maximum(abs(listed // width - row), abs(listed % width - column))
        own = triangle == asked[row * width + column]
        assert found[row, column] == (inside & own & (apart <= 1 + MARGIN)).any()


def test_a_texel_is_as_large_as_the_map_from_the_atlas_stretches_it():
    """The largest singular value of the map, but no more than the longest edge."""
    packed, rng = pack_cells(), np.random.default_rng(0)
    packed.frame.pvs = np.array([1, 4, 7], np.int32)
    corners = rng.uniform(0, 30, (3, 3, 2))
    corners[2] = [(0, 0), (1, 1), (2, 2.01)]  # with hardly any area
    table = _Table(packed.frame, np.concatenate([corners, corners.mean(axis=1, keepdims=True)], axis=1))
    for row, triangle in enumerate(packed.frame.pvs):
        points = packed.frame.scene.host.positions[3 * triangle : 3 * triangle + 3].astype(np.float64)
        to_surface, to_atlas = ((part[1:] - part[0]).T for part in (points, corners[row]))
        stretch = np.linalg.svd(to_surface @ np.linalg.inv(to_atlas))[1][0]
        longest = max(np.linalg.norm(points[i] - points[j]) for i, j in ((0, 1), (1, 2), (2, 0)))
        assert table.texel_size[row] == pytest.approx(min(stretch, longest), rel=1e-6)


def around(atlas: _Atlas, touched: list[int]) -> tuple[_Lookups, np.ndarray, np.ndarray]:
    """A lookup between columns 4 and 5 and rows 4 and 5: the samples there, of which those numbers are touched."""
    samples = np.array([[4 * 9 + 4], [4 * 9 + 5], [5 * 9 + 4], [5 * 9 + 5]])
    frame = pack_cells().frame
    table = _Table(frame, np.zeros((len(frame.pvs), 4, 2)))
    return _Lookups(frame, atlas, table, None), samples, np.isin(np.arange(4), touched)[:, None]


@pytest.mark.parametrize(
    ("touched", "across", "down"),
    [
        ([0, 1, 2, 3], (STEP, 0), (0, STEP)),
        ([0, 1], (STEP, 0), (0, STEP)),  # at right angles
        ([2, 3], (STEP, 0), (0, STEP)),
        ([1, 3], (-STEP, 0), (0, STEP)),
        ([0, 2], (-STEP, 0), (0, STEP)),
    ],
)
def test_steps_from_texel_to_texel_are_those_between_touched_samples(touched, across, down):
    lookups, *four = around(affine_atlas(), touched)
    np.testing.assert_allclose(lookups._steps(*four)[0], np.transpose([across, down]), atol=1e-7)


@pytest.mark.parametrize(("copy", "of"), [(0, 1), (1, 0), (2, 3), (3, 2), (0, 2), (2, 0), (1, 3), (3, 1)])
def test_a_sample_that_is_a_copy_of_another_hides_no_step(copy: int, of: int):
    atlas = affine_atlas()
    lookups, samples, touched = around(atlas, [0, 1, 2, 3])
    atlas.owners.bary[samples[copy]] = atlas.owners.bary[samples[of]]
    steps = np.abs(lookups._steps(samples, touched)[0])
    assert (steps.sum(axis=0) >= STEP * (1 - 1e-5)).all()


def test_a_distance_is_the_texels_whose_steps_make_it_up():
    rng = np.random.default_rng(0)
    steps, texels = rng.normal(size=(50, 2, 2)), rng.normal(size=(50, 2))
    off = np.einsum("nbt,nt->nb", steps, texels)
    np.testing.assert_allclose(_distance(off, steps), np.abs(texels).max(axis=1), rtol=1e-9)


@pytest.mark.parametrize(("twist", "torn"), [(0, False), (1.9, False), (2.1, True), (-0.6, False), (-0.7, True)])
def test_four_samples_are_torn_where_they_twist_by_over_half_of_their_range(twist: float, torn: bool):
    """Barycentrics of 0, 1, 1 and 2 + twist, whose range is 2 + twist."""
    atlas = affine_atlas()
    lookups, samples, _ = around(atlas, [])
    atlas.owners.bary[samples[:, 0]] = np.array([[0], [1], [1], [2 + twist]], np.float32)
    assert lookups._torn(samples).tolist() == [torn]


class Clamping(CornerClient):
    """Looks up what lies outside a triangle at its nearest weights inside."""

    def locate(self, triangles: np.ndarray, bary: np.ndarray) -> np.ndarray:
        weights = np.maximum(np.column_stack([1 - bary.sum(axis=1), bary]), 0)
        return super().locate(triangles, (weights / weights.sum(axis=1, keepdims=True))[:, 1:])


@pytest.mark.parametrize(("off", "close"), [(0.0, True), (2.9, True), (3.1, False)])
def test_a_sample_far_outside_is_close_by_where_its_nearest_point_inside_is(off: float, close: bool):
    """Weights 5.5, 0.5 and -5 become 11/12, 1/12 and 0: of 48 texels along the first edge 4."""
    client = Clamping(np.array([[[0, 0], [48, 0], [0, 48]]]))
    centre = np.array([[4, off]])
    assert _close_by(np.zeros(1, np.int32), np.array([[0.5, -5]], np.float32), centre, client).tolist() == [close]


def test_samples_and_lookups_outside_the_atlas():
    packed = pack_cells()
    packed.client.corners[0] -= 1.0
    assert "inside" in packed.rules()
    packed = pack_cells()
    packed.owners.texel[0] = SIDE * SIDE
    assert "inside" in packed.rules()
    packed = pack_cells(cell=2)
    packed.client.corners[5] += 1e6
    assert "inside" in packed.rules()


@pytest.mark.parametrize("same_triangle", [False, True])
def test_two_owners_of_one_texel(same_triangle: bool):
    packed = pack_cells()
    first = 0 if same_triangle else CELL * CELL
    extra = {"texel": [9 * SIDE], "triangle": [first // CELL**2], "bary": [[0.1, 0.1]]}
    old = packed.owners
    packed.change(**{name: np.concatenate([getattr(old, name), np.array(v)]) for name, v in extra.items()})
    packed.change(triangle=packed.owners.triangle.astype(np.int32), bary=packed.owners.bary.astype(np.float32))
    (violation,) = (v for v in packed.check() if v.rule == "single owner")
    assert (violation.count, violation.texels) == (1, (9 * SIDE,))


@pytest.mark.parametrize("by", [(1, 0), (0, -2), (0.5, 0.5)])
def test_client_that_looks_in_the_wrong_place(by: tuple[float, float]):
    packed = pack_cells()
    packed.client.corners[5] = packed.client.corners[5] + np.array(by)
    assert "surface" in packed.rules()


def test_samples_of_the_wrong_point():
    packed = pack_cells()
    mirrored = packed.owners.triangle == 7
    packed.owners.bary[mirrored] = packed.owners.bary[mirrored][:, ::-1]
    violations = packed.check()
    assert {v.rule for v in violations} == {"surface", "once"}
    assert {v.triangles for v in violations} == {(7,)}


def test_texels_of_another_surface():
    packed = pack_cells(cell=16)
    packed.frame.scene.host.positions[3 * 8 : 3 * 9] += 100
    packed.owners.triangle[packed.owners.triangle == 7] = 8
    (violation,) = (v for v in packed.check() if v.rule == "surface")
    assert violation.triangles == (7,)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e6, 3.0])
def test_barycentrics_that_are_not_finite_or_far_outside(value: float):
    packed = pack_cells()
    packed.owners.bary[70, 1] = value
    texels = [v.texels for v in packed.check() if v.rule == "barycentrics"]
    assert texels == [(int(packed.owners.texel[70]),)]


@pytest.mark.parametrize("triangle", [-1, 12])
def test_triangle_that_does_not_exist(triangle: int):
    packed = pack_cells()
    packed.owners.triangle[5] = triangle
    assert packed.rules() == {"barycentrics"}


@pytest.mark.parametrize(("texel", "alpha"), [(SIDE * SIDE - 1, 255), (0, 0), (0, 254), (SIDE * SIDE - 1, 1)])
def test_alpha_that_does_not_match_the_list(texel: int, alpha: int):
    packed = pack_cells()
    packed.plane.reshape(-1, 4)[texel, 3] = alpha
    (violation,) = packed.check()
    assert (violation.rule, violation.texels) == ("alpha", (texel,))


def test_nan_in_a_plane():
    packed = pack_cells()
    packed.plane = packed.plane.astype(np.float32)
    packed.plane[2, 3, 1] = np.nan
    (violation,) = packed.check()
    assert (violation.rule, violation.texels) == ("finite", (2 * SIDE + 3,))


def test_a_visible_point_alone_finds_a_gap():
    packed = pack_cells(count=1, cell=300, across=1)
    row, column = 101, 100  # between the points of the grid of so large a triangle
    packed.drop(packed.owners.texel == row * 300 + column)
    point = np.array([[column / 299, row / 299]], np.float32)
    assert packed.rules(seen=(np.zeros(1, np.int32), point)) == {"written"}


def test_within_a_budget_all_triangles_have_their_turn():
    packed = pack_cells(count=400, across=20)
    gone = (packed.owners.triangle % 40 == 0) & (np.abs(packed.owners.bary - [3 / 7, 0]).max(axis=1) < 0.01)
    packed.drop(gone)
    found: set[int] = set()
    for index in range(20):
        packed.frame.index = index
        for violation in packed.check(budget=5000):
            assert violation.rule == "written"
            found.update(violation.triangles)
    assert found == set(range(0, 400, 40))


def test_method_without_an_atlas_has_only_its_list_checked():
    packed = pack_cells()
    assert check(packed.frame, Payload({}, {}, b"", 0), None, packed.client) == []
    payload = Payload({}, {}, b"", 0, unplaced={1: ""})
    assert [v.rule for v in check(packed.frame, payload, None, packed.client)] == ["placed"]


def test_two_checks_of_one_frame_agree():
    packed = pack_cells()
    packed.drop(packed.owners.bary[:, 0] == 0)
    assert packed.check(budget=500) == packed.check(budget=500) != []
