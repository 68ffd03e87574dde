"""Loading is linear in what a file holds, in time and in memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

from shading_atlas_bench.scenes.files import SceneFiles
from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import Material
from shading_atlas_bench.scenes.obj import read_obj
from shading_atlas_bench.scenes.raw import RawScene

MEASURED = """
import sys
from shading_atlas_bench.harness.measure.machine import peak_memory
from shading_atlas_bench.scenes.load import load_scene
load_scene(sys.argv[1])
before = peak_memory()
load_scene(sys.argv[2])
print(peak_memory() - before)
"""
PLAIN = 48  # bytes of a triangle in an STL file's arrays: its normal and its corners, float32


def waves(rows: int, path: Path) -> int:
    """An STL file of a wavy sheet, its triangles in no order; returns how many they are."""
    x, y = np.meshgrid(np.arange(rows + 1), np.arange(rows + 1), indexing="ij")
    points = np.stack([x, np.sin(x / 9) * np.cos(y / 7), y], axis=-1).astype("<f4")
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    corners = np.concatenate([np.stack([a, c, b], axis=2), np.stack([a, d, c], axis=2)]).reshape(-1, 3, 3)
    table = np.zeros(len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
    table["corners"] = corners[np.random.default_rng(0).permutation(len(corners))]
    path.write_bytes(bytes(80) + len(table).to_bytes(4, "little") + table.tobytes())
    return len(table)


def test_memory_is_a_few_times_the_files_arrays(tmp_path: Path):
    few, many = (waves(rows, tmp_path / f"{rows}.stl") for rows in (200, 700))
    command = [sys.executable, "-c", MEASURED, str(tmp_path / "200.stl"), str(tmp_path / "700.stl")]
    told = subprocess.run(command, capture_output=True, check=True)
    assert int(told.stdout) < 5 * PLAIN * (many - few)


def materials(count: int, folder: Path) -> Path:
    """An OBJ file of many materials, a triangle each."""
    library = "".join(f"newmtl m{n}\nKd 0.{n % 10} 0.5 0.5\n" for n in range(count))
    (folder / "a.mtl").write_text(library, encoding="utf-8")
    rows = (f"v {n} 0 0\nv {n + 1} 0 0\nv {n} {n % 7 + 1} 0\nusemtl m{n}\nf -3 -2 -1\n" for n in range(count))
    (folder / "a.obj").write_text("mtllib a.mtl\n" + "".join(rows), encoding="utf-8")
    return folder / "a.obj"


def test_many_materials_are_one_part(tmp_path: Path):
    file, raw = materials(500, tmp_path), RawScene(materials=[Material()])
    read_obj(file, SceneFiles(file), raw)
    (part,) = raw.parts
    assert part.materials is not None
    assert part.materials.tolist() == list(range(1, 501))
    scene = load_scene(str(file))
    assert [scene.materials[n].base_colour[0] for n in scene.material_ids[:4]] == [0, 0.1, 0.2, 0.3]
    assert len(scene.positions) == 1500  # of two materials no corner is shared


def test_surfaces_of_two_materials_are_not_smoothed_into_each_other(tmp_path: Path):
    """A sheet with a slight fold, as one material and as two."""
    points = "v 0 0 0\nv 0 0 1\nv 1 0.1 0\nv 1 0.1 1\nv 2 0 0\nv 2 0 1\n"
    for middle, smooth in (("", True), ("usemtl b\n", False)):
        file = tmp_path / "a.obj"
        file.write_text(f"{points}usemtl a\nf 1 2 4 3\n{middle}f 3 4 6 5\n", encoding="utf-8")
        scene = load_scene(str(file))
        upright = np.abs(scene.normals[:, 0]) < 1e-6
        assert len(scene.positions) == (6 if smooth else 8)
        assert upright.any() == smooth


def test_parts_of_several_materials_can_be_decimated(tmp_path: Path, pymeshlab: None):
    """Material by material, as they would be apart."""
    rows = 12
    lines = [f"v {x} {(x * y) % 3 * 0.01} {y}" for x in range(rows) for y in range(rows)]
    for x in range(rows - 1):
        lines.append(f"usemtl m{x * 2 // rows}")
        corner = x * rows + 1
        lines += [f"f {n} {n + 1} {n + rows + 1} {n + rows}" for n in range(corner, corner + rows - 1)]
    (tmp_path / "a.obj").write_text("\n".join(lines), encoding="utf-8")
    whole, half = (load_scene(str(tmp_path / "a.obj"), decimate=ratio) for ratio in (None, 0.5))
    counts = [np.bincount(scene.material_ids) for scene in (whole, half)]
    assert np.abs(counts[1] * 2 - counts[0]).max() <= 4
