"""Cached shadow maps are those of the scene that asks for them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.harness.workload.shadows import cached_shadow_maps
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.kernels.shade.shadow import ROW_FLOATS, ShadowMaps
from shading_atlas_bench.scenes.features import content_digest
from shading_atlas_bench.scenes.model import Camera, Light, Scene

SPOT = Light("spot", (1.0, 1.0, 1.0), cone=30.0)
CORNERS = np.eye(3, dtype=np.float32)
SCENE = Scene(
    "one triangle", CORNERS, np.array([[0, 1, 2]], np.int32), CORNERS, CORNERS[:, :2], np.ones((3, 4), np.float32),
    np.zeros(1, np.int32), [], lights=[SPOT], content_hash="a",
)  # fmt: skip


class Drawing:
    """Counts how often it is drawn; every time there are other maps."""

    def __init__(self, device: Device) -> None:
        self.device, self.times = device, 0

    def __call__(self) -> ShadowMaps:
        self.times += 1
        maps = np.arange(100, dtype=np.float32) + self.times
        return ShadowMaps(self.device.upload(maps), np.full((1, ROW_FLOATS), self.times, np.float32))


@pytest.fixture
def draw(device: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Drawing:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return Drawing(device)


def test_maps_are_drawn_once(device: Device, draw: Drawing) -> None:
    drawn, kept = (cached_shadow_maps(device, SCENE, draw) for _ in range(2))
    assert draw.times == 1
    np.testing.assert_array_equal(kept.maps.get(), drawn.maps.get())
    np.testing.assert_array_equal(kept.rows, drawn.rows)


@pytest.mark.parametrize(
    "change",
    [
        {"lights": [replace(SPOT, cone=31.0)]},
        {"lights": [replace(SPOT, direction=(1.0, 0.0, 0.0))]},
        {"cameras": [Camera((0.0, 1.0, 0.0), (0.0, 0.0, -1.0))]},
        {"metres_per_unit": 0.01},
    ],
    ids=str,
)
def test_another_scene_has_its_own(device: Device, draw: Drawing, change: dict[str, Any]) -> None:
    for scene in (SCENE, replace(SCENE, **change), SCENE):
        scene.content_hash = content_digest(scene)
        cached_shadow_maps(device, scene, draw)
    assert draw.times == 2


def test_another_program_draws_its_own(device: Device, draw: Drawing, monkeypatch: pytest.MonkeyPatch) -> None:
    for times, digest in enumerate(("one", "another"), 1):
        monkeypatch.setattr("shading_atlas_bench.harness.workload.cache_key.drawing_digest", lambda now=digest: now)
        cached_shadow_maps(device, SCENE, draw)
        cached_shadow_maps(device, SCENE, draw)
        assert draw.times == times


def test_rounding_otherwise_draws_its_own(device: Device, draw: Drawing) -> None:
    cached_shadow_maps(device, SCENE, draw)
    other = Device(device.found, "contracted")
    drawn = Drawing(other)
    cached_shadow_maps(other, SCENE, drawn)
    assert drawn.times == 1


def test_a_scene_without_a_hash_is_not_cached(device: Device, draw: Drawing) -> None:
    for _ in range(2):
        cached_shadow_maps(device, replace(SCENE, content_hash=""), draw)
    assert draw.times == 2
