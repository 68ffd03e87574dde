"""Dumped files hold what they promise, in the promised types, and pictures survive exactly."""

from pathlib import Path

import numpy as np
import pytest

from shading_atlas_bench.harness.measure.dump import bary_plane, dump_frame, dump_scene, owner_plane, write_png
from shading_atlas_bench.packers.interface import Owners, View
from shading_atlas_bench.reports.store.names import folder_name
from shading_atlas_bench.scenes.model import Material, Scene


def read_png(path: Path) -> np.ndarray:
    import OpenImageIO

    opened = OpenImageIO.ImageInput.open(str(path))
    assert opened
    pixels = opened.read_image("uint8")
    assert pixels is not None
    return pixels


@pytest.fixture
def frame() -> dict:
    rng = np.random.default_rng(1)
    return {
        "atlas": rng.integers(0, 256, (8, 16, 4), np.uint8),
        "owners": Owners(np.array([0, 17, 127]), np.array([4, 5, 6], np.int32), rng.random((3, 2)).astype(np.float32)),
        "client": rng.integers(0, 256, (6, 10, 3), np.uint8),
        "reference": rng.integers(0, 256, (6, 10, 4), np.uint8),
        "visibility": rng.integers(-1, 9, (6, 10)),
        "novel": View(np.eye(4), np.diag([1.0, 2.0, 3.0, 4.0]), 10, 6),
    }


def test_scene_in_triangle_order(tmp_path: Path):
    positions = np.arange(15, dtype=np.float32).reshape(5, 3)
    indices = np.array([[0, 1, 2], [2, 1, 3], [4, 3, 2]], np.int32)
    zeros = np.zeros((5, 4), np.float32)
    materials = [Material(), Material(double_sided=True, alpha_mode="mask"), Material(alpha_mode="blend")]
    scene = Scene("s", positions, indices, zeros[:, :3], zeros[:, :2], zeros, np.array([1, 0, 2]), materials)
    scene.origin = np.array([1e6, 0.25, -3])
    with np.load(dump_scene(tmp_path / "dump", scene)) as file:
        assert file["positions"].dtype == np.float32
        np.testing.assert_array_equal(file["positions"], positions[indices])
        np.testing.assert_array_equal(file["origin"], scene.origin)
        assert file["double_sided"].tolist() == [True, False, False]
        assert file["masked"].tolist() == [True, False, False]
        assert set(file) == {"positions", "origin", "double_sided", "masked"}


def test_frame_with_an_atlas(tmp_path: Path, frame: dict):
    path = dump_frame(tmp_path, "sas", "a=1", 7, **frame)
    assert path == tmp_path / folder_name("sas", "a=1") / "frame_0007.npz"
    with np.load(path) as file:
        types = {name: (file[name].dtype.name, file[name].shape) for name in file}
        assert types == {
            "atlas": ("uint8", (8, 16, 4)),
            "owner": ("int32", (8, 16)),
            "bary": ("float32", (8, 16, 2)),
            "client": ("uint8", (6, 10, 3)),
            "reference": ("uint8", (6, 10, 3)),
            "visibility": ("int32", (6, 10)),
            "view": ("float64", (4, 4)),
            "projection": ("float64", (4, 4)),
        }
        assert (file["owner"][0, 0], file["owner"][1, 1], file["owner"][7, 15]) == (4, 5, 6)
        assert np.count_nonzero(file["owner"] >= 0) == 3
        np.testing.assert_array_equal(file["bary"][1, 1], frame["owners"].bary[1])
        np.testing.assert_array_equal(file["projection"], frame["novel"].projection)
        for name in ("atlas", "client", "reference"):
            picture = read_png(path.with_name(f"frame_0007_{name}.png"))
            np.testing.assert_array_equal(picture, file[name][..., :3])


def test_frame_of_a_method_without_an_atlas(tmp_path: Path, frame: dict):
    path = dump_frame(tmp_path, "lists", "", 0, **(frame | {"atlas": None, "owners": None}))
    with np.load(path) as file:
        assert set(file) == {"client", "reference", "visibility", "view", "projection"}
    assert not path.with_name("frame_0000_atlas.png").exists()


def test_samples_outside_the_plane_are_left_out():
    owners = Owners(np.array([-1, 3, 4]), np.array([1, 2, 3], np.int32), np.ones((3, 2), np.float32))
    assert owner_plane(owners, 2, 2).tolist() == [[-1, -1], [-1, 2]]
    assert bary_plane(owners, 2, 2).sum() == 2


def test_without_samples_a_plane_is_empty():
    none = Owners(np.empty(0, np.int64), np.empty(0, np.int32), np.empty((0, 2), np.float32))
    assert owner_plane(none, 2, 1).tolist() == [[-1, -1]]


@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (300, 1), (37, 53)])
def test_pictures_survive_exactly(tmp_path: Path, shape: tuple[int, int]):
    rgb = np.random.default_rng(0).integers(0, 256, (*shape, 3), np.uint8)
    write_png(tmp_path / "a.png", rgb[::-1, ::-1])  # a view that is not contiguous
    np.testing.assert_array_equal(read_png(tmp_path / "a.png"), rgb[::-1, ::-1])
    write_png(tmp_path / "b.png", rgb[::-1, ::-1])
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_pictures_that_cannot_be_written_say_so(tmp_path: Path):
    with pytest.raises(OSError, match=r"picture\.png"):
        write_png(tmp_path / "missing" / "picture.png", np.zeros((2, 2, 3), np.uint8))
    with pytest.raises(ValueError, match="float32"):
        write_png(tmp_path / "picture.png", np.zeros((2, 2, 3), np.float32))
    with pytest.raises(ValueError, match=r"uint8 \(2, 2, 4\)"):
        write_png(tmp_path / "picture.png", np.zeros((2, 2, 4), np.uint8))
