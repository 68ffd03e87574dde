"""The rasteriser beside Mesa's llvmpipe: same ids and depth, and how much faster.

`python -m tests.peers.test_llvmpipe` prints the times of both, drawn in turn, and their ratios.
"""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest

from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.kernels.inputs.soups import NEAR, look_at, perspective
from shading_atlas_bench.kernels.raster.rasteriser import Rasteriser
from shading_atlas_bench.kernels.triangles import Triangles
from tests.conftest import REAL_SCENES
from tests.peers.llvmpipe import Llvmpipe

WIDTH, HEIGHT = 1920, 1080
SCENES = REAL_SCENES / "sponza_crytek", REAL_SCENES / "viking_village"
STREET = {"eye": [-16.0, 5.8, 6.0], "dir": [0.95, -0.05, -0.2], "fov_x_deg": 70}  # between Viking Village's houses
FRAMES = 15


def load(folder: Path) -> tuple[np.ndarray, np.ndarray, dict[str, dict]]:
    """Positions and indices of a scene's folder, and cameras by name, relative to the scene's origin."""
    from shading_atlas_bench.scenes.load import load_scene

    scene = load_scene(str(folder / "scene.glb"))
    known = json.loads((folder / "cameras.json").read_text(encoding="utf-8"))
    cameras = {"its camera": known["cameras"][0]} | ({"a street": STREET} if folder.name == "viking_village" else {})
    pace = 1.4 / 60 / known.get("metres_per_unit", 1)
    placed = {name: {**c, "eye": c["eye"] - scene.origin, "pace": pace} for name, c in cameras.items()}
    return scene.positions, scene.indices, placed


def view_of(camera: dict, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """View and projection of a frame of a walk: 1.4 m/s sideways at 60 Hz and a turn of 0.5 degrees per frame."""
    forward = np.asarray(camera["dir"], np.float64)
    turn = np.radians(0.5 * frame)
    forward = forward * np.cos(turn) + np.cross([0, 1, 0], forward) * np.sin(turn)
    eye = np.asarray(camera["eye"]) + frame * camera["pace"] * np.cross(forward, [0, 1, 0])
    return look_at(eye, eye + forward), perspective(camera["fov_x_deg"], WIDTH / HEIGHT)


@pytest.fixture(scope="module")
def sponza(device):
    if not SCENES[0].is_dir():
        pytest.skip("Crytek Sponza is not here")
    positions, indices, cameras = load(SCENES[0])
    try:
        peer = Llvmpipe(positions, indices, WIDTH, HEIGHT)
    except RuntimeError as error:
        pytest.skip(str(error))
    triangles = Triangles.upload(device, positions, indices, np.zeros(len(indices), np.uint8))
    return peer, Rasteriser(device, triangles), cameras["its camera"]


@pytest.mark.parametrize("frame", [0, 40])
def test_ids_and_depth_agree(sponza, frame):
    peer, rasteriser, camera = sponza
    view, projection = view_of(camera, frame)
    peer.draw(view, projection)
    ids, depths = peer.read()
    seen = rasteriser.draw(view, projection, WIDTH, HEIGHT)
    same = seen.triangle.get() == ids
    assert same.mean() > 0.998  # the rest: samples on edges, and surfaces closer than llvmpipe's depth resolves
    difference = abs(seen.depth.get()[same] - depths[same])
    assert np.quantile(difference, 0.999) < 2**-22  # llvmpipe keeps 24 bits


def measure(name: str, positions: np.ndarray, indices: np.ndarray, camera: dict, device: Device) -> None:
    """Print medians of wall and process time, drawn in turn, standing and walking."""
    triangles = Triangles.upload(device, positions, indices, np.zeros(len(indices), np.uint8))
    rasteriser, peer = Rasteriser(device, triangles), Llvmpipe(positions, indices, WIDTH, HEIGHT)

    def ours(view: np.ndarray, projection: np.ndarray) -> None:
        rasteriser.draw(view, projection, WIDTH, HEIGHT)
        device.finish()

    for motion in ("standing", "walking"):
        times = np.zeros((FRAMES + 2, 2, 2))
        for frame in range(-2, FRAMES):
            camera_now = view_of(camera, frame if motion == "walking" else 0)
            for method, draw in enumerate((peer.draw, ours)):
                wall, process = time.perf_counter(), time.process_time()
                draw(*camera_now)
                times[frame, method] = time.perf_counter() - wall, time.process_time() - process
        theirs, mine = np.median(times[:FRAMES], axis=0) * 1e3
        best = times[:FRAMES].min(axis=0)
        print(
            f"{name}, {motion}: llvmpipe {theirs[0]:.0f} ms ({theirs[1]:.0f} of processor time), "
            f"ours {mine[0]:.1f} ms ({mine[1]:.1f}); {theirs[0] / mine[0]:.1f}x ({theirs[1] / mine[1]:.1f}x), "
            f"best of each {best[0, 0] / best[1, 0]:.1f}x"
        )


def main() -> None:
    """Measure all scenes."""
    device = Device.open()
    print(f"{WIDTH} x {HEIGHT}, near {NEAR}, {device.name}")
    for folder in SCENES:
        positions, indices, cameras = load(folder)
        for name, camera in cameras.items():
            measure(f"{folder.name}, {name}", positions, indices, camera, device)


if __name__ == "__main__":
    main()
