"""Hashes of what the suite computes on the host: `python -m tests.portability.values` prints them as JSON."""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from shading_atlas_bench.harness.workload.prediction import predict
from shading_atlas_bench.harness.workload.pvs import cell_eyes
from shading_atlas_bench.harness.workload.views import CellFrustum, Pose, ViewCell, client_view, confined
from shading_atlas_bench.kernels.metrics.flip import Filters, largest_colour_difference
from shading_atlas_bench.kernels.metrics.iwssim import decorrelation
from shading_atlas_bench.kernels.metrics.mse import psnr
from shading_atlas_bench.kernels.metrics.ssim import window
from shading_atlas_bench.kernels.raster.camera import Camera
from shading_atlas_bench.kernels.shade.environment import environment_map
from shading_atlas_bench.kernels.shade.shadow import shadow_camera
from shading_atlas_bench.kernels.shade.tables import light_rows
from shading_atlas_bench.kernels.texture.mipmap import srgb_to_linear
from shading_atlas_bench.packers.budget import BudgetedRate
from shading_atlas_bench.packers.interface import View
from shading_atlas_bench.packers.snakebinning.kernels.bins import HeightBins, edge_table
from shading_atlas_bench.packers.snakebinning.kernels.footprint import pack_views
from shading_atlas_bench.packers.snakebinning.kernels.slices import slice_dominating
from shading_atlas_bench.packers.tss.kernels.footprint import camera_floats
from shading_atlas_bench.scenes.head_motion import HeadMotion
from shading_atlas_bench.scenes.lights import add_lights
from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import Scene
from shading_atlas_bench.scenes.paths import CameraPath, make_path
from shading_atlas_bench.scenes.standing import decide
from tests.scenes.glb_files import Glb

SMALL = {"hall": 40_000, "village": 130_000, "shells": 2_000}  # triangles


def digest(*values: object) -> str:
    """16 hex digits over the exact bytes of arrays, and over whatever else prints exactly."""
    found = hashlib.blake2b(digest_size=8)
    for value in values:
        found.update(value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
    return found.hexdigest()


def scene_hashes(name: str, detail: int | None) -> Iterator[tuple[str, str]]:
    """Of a built-in scene, of the paths in it, and of the same as if it came from a file without lights and route."""
    label = f"{name} {detail or 'default'}"
    scene = load_scene(name, detail=detail)
    yield label, scene.content_hash
    for path in ("walk", "orbit", "turntable"):
        yield f"{label} {path}", make_path(scene, path).hash
    if detail:
        bare = replace(scene, lights=[], route=None)
        add_lights(bare)
        yield f"{label} found lights", digest(bare.lights, bare.exposure)
        yield f"{label} found walk", make_path(bare, "walk", seed=1).hash
        standing = decide(replace(bare, cameras=[]))
        yield f"{label} found viewpoint", digest(standing.place, standing.reason, standing.camera)
        yield f"{label} host", digest(*host_values(scene, make_path(scene, "walk")))


def host_values(scene: Scene, path: CameraPath) -> Iterator[object]:
    """What goes to kernels and clients of a frame: cameras, views, predictions, shadows, slices."""
    poses = [Pose(path.positions[k], path.orientations[k]) for k in range(40)]
    frustum = CellFrustum.around(ViewCell(), 60.0, 320, 180)
    server = frustum.server_view(poses[0], 0.02)
    guesses = predict(path.times_ms[:40], poses, [33.0, 100.0], scene.metres_per_unit)
    client = client_view(guesses[1], 60.0, 320, 180, 0.02)
    held, _ = confined(poses[0], guesses[1], 0.05, frustum, client)
    eyes = [view for eye in cell_eyes(poses[3], 0.08) for view in frustum.frusta(eye, 0.02, 30.0)]
    views: list[View] = [server, client, client_view(held, 60.0, 320, 180, 0.02), *eyes]
    yield from (part for view in views for part in (view.view, view.projection, view.matrix, view.eye, view.width))
    for view in views:
        camera = Camera.of(view.view, view.projection, view.width, view.height)
        yield from (camera.eye, camera.rows, camera.project(scene.positions[::97]))
        yield from (camera_floats(view.view, view.projection, view.width, view.height),)
        yield pack_views([(view.view, view.projection, view.width)], 0.7)
    casters: Any = SimpleNamespace(host_positions=scene.positions, host_indices=scene.indices)
    for light in scene.lights:
        yield shadow_camera(light, casters, poses[0].position, scene.metres_per_unit).row(0)
    yield light_rows(scene.lights, scene.metres_per_unit)
    corners = scene.positions[scene.indices[:64]].astype(np.float64)
    cut = slice_dominating(np.arange(64), corners, [client.matrix], server.matrix, 0.1, 0.001)
    yield from (cut.parents, cut.bary, cut.corners)


def table_hashes() -> Iterator[tuple[str, str]]:
    """Of tables and of numbers that only the host computes."""
    motion = HeadMotion.synthetic(seed=3)
    yield "head motion", digest(*(part for t in range(0, 4000, 90) for part in motion.offset(float(t), 80.0)))
    filters = Filters.at(67.02)
    yield "FLIP", digest(filters.taps, filters.yellow_share, largest_colour_difference())
    spread = np.outer(np.arange(1, 12), np.arange(3, 14)) % 7 / 3
    yield "IW-SSIM", digest(*decorrelation((spread[:, None] * spread).sum(axis=2)))
    yield "SSIM and PSNR", digest(window(), *(psnr(error) for error in np.linspace(0.1, 900, 50)))
    yield "environment map", digest(environment_map(lambda direction: (direction[:, ::-1] > 0.3).astype(np.float64)))
    heights = HeightBins(777.0)
    yield "SnakeBinning", digest(edge_table(), heights.scale, heights.tops())
    rates: list[float] = []

    def count(rate: float) -> int:
        rates.append(rate)
        return int(1e6 * rate * rate + 3e4 * rate)

    BudgetedRate().meet(70_000, count)
    yield "rates", digest(rates)
    yield "sRGB", digest(srgb_to_linear(np.arange(256) / 255))


def file_hashes() -> Iterator[tuple[str, str]]:
    """Of a glTF file with turned nodes, a skin, an animated camera and a turned texture."""
    turn = [0.1825742, 0.3651484, 0.5477226, 0.7302967]
    glb = Glb(
        nodes=[
            {"rotation": turn, "scale": [1, 2, 0.5], "children": [1, 2, 3]},
            {"mesh": 0, "translation": [0.1, 0.2, 0.3], "rotation": turn},
            {"mesh": 1, "skin": 0},
            {"camera": 0, "translation": [0, 1, 3], "rotation": turn},
            {"rotation": turn, "translation": [0.3, 0, 0.1]},
        ],
        cameras=[{"type": "perspective", "perspective": {"yfov": 0.9, "znear": 0.1}}],
    )
    weights: dict[str, np.ndarray] = {
        "JOINTS_0": np.zeros((4, 4), np.uint8),
        "WEIGHTS_0": np.tile(np.array([0.7, 0.1, 0.1, 0.1], np.float32), (4, 1)),
    }
    glb.json["meshes"] = [{"primitives": [glb.square()]}, {"primitives": [glb.square(**weights)]}]
    bind = np.linspace(-0.4, 0.9, 16, dtype=np.float32).reshape(1, 4, 4)
    glb.json["skins"] = [{"joints": [4], "inverseBindMatrices": glb.accessor(bind)}]
    times = np.array([0, 0.4, 1.1], np.float32)
    turns = np.array([turn, [0, 0, 0, 1], [0.5, 0.5, 0.5, 0.5]], np.float32)
    keys = {"input": glb.accessor(times), "output": glb.accessor(turns)}
    glb.json["animations"] = [
        {"channels": [{"sampler": 0, "target": {"node": 3, "path": "rotation"}}], "samplers": [keys]}
    ]
    with tempfile.TemporaryDirectory() as folder:
        scene = load_scene(glb.write(Path(folder) / "a.glb"))
    yield "glTF", scene.content_hash
    yield "glTF animation", digest(scene.animations[0].positions, scene.animations[0].orientations)
    yield "glTF orbit", make_path(scene, "orbit").hash


def main() -> None:
    """Print the hashes as JSON: of the scenes named, small or whole, and of all else."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--whole", action="store_true", help="of the default detail, too")
    found = dict(table_hashes()) | dict(file_hashes())
    for name, detail in SMALL.items():
        for size in (detail, None)[: 1 + parser.parse_args().whole]:
            found |= scene_hashes(name, size)
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
