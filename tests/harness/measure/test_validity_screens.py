"""What kernels pass over, NumPy would not report: with everything marked, every frame gets the same verdict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.harness.measure import validity
from shading_atlas_bench.harness.measure.validity import Gaps, Violation
from shading_atlas_bench.kernels.case import INPUTS
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.kernels.validity import cases
from shading_atlas_bench.kernels.validity.lookups import Lookups, LookupScreen, Screened
from shading_atlas_bench.kernels.validity.samples import PlacedSamples, place_samples
from tests.harness.measure.test_validity import Packed, opened, pack_cells, pack_fold

ODD = np.array([np.nan, np.inf, -np.inf, 3e38, -1e6, -7.0, -3.0, -1.001, -1.0, 0.0, 1.0001, 2.0, 40.0], np.float32)


class Everything(LookupScreen):
    """Marks all lookups that are no pixels without a place."""

    def screen(self, lookups: Lookups) -> Screened:
        known = np.isfinite(lookups.place[:, 0]) & (self.row[lookups.triangle] >= 0)
        marked = np.flatnonzero(known | (not lookups.only_known))
        return replace(super().screen(lookups), marked=marked)


def all_far(device: Device, samples: Any, *rest: Any) -> PlacedSamples:
    placed = place_samples(device, samples, *rest)
    return replace(placed, far=device.upload(np.ones(max(samples.count, 1), np.uint8)), distant=samples.count)


def judged(packed: Packed, **options: Any) -> list[Violation]:
    """The verdict of NumPy on everything."""
    with (
        mock.patch.object(validity, "LookupScreen", Everything),
        mock.patch.object(validity, "place_samples", all_far),
        mock.patch.object(validity, "_suspects", lambda strays, *_: strays),
    ):
        return packed.check(**options)


SCREENS = [cases.samples, cases.texels, cases.lookups, cases.walking, cases.nearest]


def spoil_weights(packed: Packed, rng: np.random.Generator, some: np.ndarray) -> None:
    values = rng.choice(ODD, (len(some), 2))
    near = packed.owners.bary + rng.normal(0, rng.choice([1e-3, 0.05, 0.3, 2]), packed.owners.bary.shape)
    changed = np.where(rng.random(values.shape) < 0.5, values, near)
    packed.change(bary=np.where(some[:, None], changed, packed.owners.bary).astype(np.float32))


def spoil_owners(packed: Packed, rng: np.random.Generator, some: np.ndarray) -> None:
    others = rng.integers(0, packed.frame.scene.triangles.count, len(some))
    packed.change(triangle=np.where(some, others, packed.owners.triangle).astype(np.int32))


def spoil_texels(packed: Packed, rng: np.random.Generator, some: np.ndarray) -> None:
    height, width = packed.plane.shape[:2]
    size = height * width
    moved = packed.owners.texel + rng.choice([0, 1, -1, width, -width, 3, size, -size, 1 << 40], len(some))
    packed.change(texel=np.where(some, moved, packed.owners.texel))


def spoil_plane(packed: Packed, rng: np.random.Generator, some: np.ndarray) -> None:
    alpha = packed.plane[..., 3]
    alpha[rng.random(alpha.shape) < some.mean()] = rng.choice([0, 1, 254, 255])


def spoil_list(packed: Packed, rng: np.random.Generator, some: np.ndarray) -> None:
    if rng.random() < 0.5:
        packed.drop(some & (packed.owners.texel < packed.plane[..., 3].size) & (packed.owners.texel >= 0))
    else:
        names = ("texel", "triangle", "bary")
        kept = rng.permutation(np.concatenate([np.arange(len(some)), np.flatnonzero(some)]))
        packed.change(**{name: getattr(packed.owners, name)[kept] for name in names})


def spoil_client(packed: Packed, rng: np.random.Generator, some: np.ndarray) -> None:
    corners = packed.client.corners.astype(np.float64)
    hit = rng.random(len(corners)) < some.mean()
    by = rng.choice([0.1, 0.34, 1, 10, 1e7, np.nan])
    corners[hit] = rng.choice([corners[hit] + by, corners[hit] * by, np.zeros_like(corners[hit])])
    packed.client.corners = corners


def spoil_scene(packed: Packed, rng: np.random.Generator, some: np.ndarray) -> None:
    positions = packed.frame.scene.host.positions
    positions[rng.random(len(positions)) < some.mean()] *= np.float32(rng.choice([0, 1e-20, 100, 1e18]))
    if rng.random() < 0.5:
        packed.frame.pvs = packed.frame.pvs[rng.random(len(packed.frame.pvs)) < 0.7]


SPOILERS: list[Callable[[Packed, np.random.Generator, np.ndarray], None]] = [
    spoil_weights,
    spoil_owners,
    spoil_texels,
    spoil_plane,
    spoil_list,
    spoil_client,
    spoil_scene,
]


def spoiled(seed: int, faults: list[int]) -> tuple[Packed, dict[str, Any]]:
    """A frame with some faults in it, and how it is to be checked."""
    rng = np.random.default_rng(seed)
    packed = pack_fold(rng.choice([0.0, 1.0, 50.0])) if rng.random() < 0.2 else pack_cells(12, rng.choice([1, 2, 5, 8]))
    for fault in faults:
        some = rng.random(len(packed.owners.texel)) < rng.choice([0.01, 0.1, 0.6])
        SPOILERS[fault](packed, rng, some)
    count = packed.frame.scene.triangles.count
    packed.frame.index = int(rng.integers(0, 9))
    packed.payload.unplaced = {int(rng.integers(0, count)): "no room"} if rng.random() < 0.2 else {}
    points = np.where(rng.random((50, 2)) < 0.9, rng.uniform(-0.2, 1.2, (50, 2)), rng.choice(ODD, (50, 2)))
    seen = rng.integers(0, count, 50).astype(np.int32), points.astype(np.float32)
    return packed, {"seen": seen, "budget": (None, 7, 500)[rng.integers(0, 3)]}


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    faults=st.lists(st.integers(0, len(SPOILERS) - 1), max_size=3),
    has_gaps=st.booleans(),
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_all_faults_of_a_frame_are_among_what_is_marked(seed: int, faults: list[int], has_gaps: bool):
    packed, options = spoiled(seed, faults)
    gaps, others = (Gaps(), Gaps()) if has_gaps else (None, None)
    assert packed.check(**options, gaps=gaps) == judged(packed, **options, gaps=others)
    assert not gaps or not others or (gaps.touched, gaps.missing) == (others.touched, others.missing)


def test_frames_with_faults_break_every_rule():
    """The property above is about something."""
    rules: set[str] = set()
    with np.errstate(all="ignore"):
        for seed in range(60):
            packed, options = spoiled(seed, [seed % len(SPOILERS)])
            rules |= packed.rules(**options)
    assert rules == {"placed", "barycentrics", "inside", "single owner", "alpha", "once", "written", "surface"}


def test_sound_frames_have_nothing_marked():
    """Else the screens would save nothing."""
    with mock.patch.object(validity._Lookups, "_examine") as examine:
        assert pack_cells().check() == []
        assert pack_cells(count=16, cell=2).check() == []
    examine.assert_not_called()


@pytest.mark.parametrize("kind", INPUTS)
@pytest.mark.parametrize("case", SCREENS, ids=lambda case: case.name)
@pytest.mark.parametrize("size", [1, 300, 1 << 13])
def test_screens_are_their_twins(device: Device, case: Any, kind: str, size: int):
    for result in case.make(device, kind, size).results():
        np.testing.assert_array_equal(result.found, result.expected)


def test_of_two_samples_in_one_texel_the_last_counts():
    """Whichever a kernel writes last: 4000 samples in each of 16 texels."""
    packed = pack_cells(count=1, cell=4, across=1)
    order = np.tile(np.arange(16), 4000)
    packed.change(**{name: getattr(packed.owners, name)[order] for name in ("texel", "triangle", "bary")})
    atlas = validity._Atlas(opened(), packed.owners, opened().upload(packed.plane), np.ones(1, bool))
    assert not atlas.is_single
    assert sorted(atlas.samples.ravel().tolist()) == list(range(15 * 4000 + 3984, 16 * 4000))


def test_a_client_that_places_corners_and_nothing_else():
    packed = pack_cells()
    locate = packed.client.locate

    def corners_only(triangles: np.ndarray, bary: np.ndarray) -> np.ndarray:
        corner = np.all(np.isin(bary, validity.ANCHORS), axis=1)
        return np.where(corner[:, None], locate(triangles, bary), np.nan)

    with mock.patch.object(packed.client, "locate", corners_only):
        assert "surface" in packed.rules()
