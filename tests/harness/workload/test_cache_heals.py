"""Whatever is damaged in the cache is made again: the value is a fresh one's, and the file is good afterwards."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.harness.run import plan
from shading_atlas_bench.harness.workload import pvs, upload, walks
from shading_atlas_bench.harness.workload.environment import cached_environment_map
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.harness.workload.views import CellFrustum, Pose, ViewCell
from shading_atlas_bench.kernels.cache import cache_root
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.kernels.shade.environment import SHAPE
from shading_atlas_bench.packers.sas import patches
from shading_atlas_bench.scenes import load
from shading_atlas_bench.scenes.model import Light, Scene
from shading_atlas_bench.scenes.paths import CameraPath

SIDE = 12  # cells per side of the meshes that are cached here


@dataclass
class Kind:
    """One kind of cached thing. use: its value, from the cache or made and cached. made: how often it was made."""

    folder: Path
    use: Callable[[], Any]
    made: list[str]

    @property
    def file(self) -> Path:
        (file,) = self.folder.iterdir()
        return file


def grid_file(folder: Path) -> Path:
    """A bumpy grid of 2 * SIDE * SIDE triangles in front of the origin."""
    rng = np.random.default_rng(0)
    number = np.arange((SIDE + 1) ** 2).reshape(SIDE + 1, -1) + 1
    points = [(x / 3 - 2, y / 3 - 2, -3 + rng.uniform(0, 0.3)) for y in range(SIDE + 1) for x in range(SIDE + 1)]
    corners = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    lines = ["v {} {} {}".format(*point) for point in points] + ["f {} {} {} {}".format(*face) for face in corners]
    (folder / "grid.obj").write_text("\n".join(lines), encoding="utf-8")
    return folder / "grid.obj"


def flat(scene: Scene) -> dict[str, Any]:
    """A scene as values that NumPy compares."""
    return vars(scene) | {
        name: [vars(entry) for entry in getattr(scene, name)] for name in ("textures", "animations", "materials")
    }


def parts_of(path: CameraPath) -> dict[str, Any]:
    """A path as values that NumPy compares."""
    return vars(path) | {"beyond": None if path.beyond is None else vars(path.beyond)}


def counted(monkeypatch: pytest.MonkeyPatch, module: Any, name: str, made: list[str]) -> None:
    real = getattr(module, name)

    def counting(*arguments: Any) -> Any:
        made.append(name)
        return real(*arguments)

    monkeypatch.setattr(module, name, counting)


@pytest.fixture(params=["scene", "patches", "visible set", "pace", "walk", "shadows", "environment map"])
def kind(request: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, device: Device) -> Kind:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    made: list[str] = []
    file, root = str(grid_file(tmp_path)), cache_root()
    if request.param == "scene":
        counted(monkeypatch, load, "_load_file", made)
        return Kind(root / "scenes", lambda: flat(load.load_scene(file, cache=cache_root() / "scenes")), made)
    scene = load.load_scene(file)
    if request.param == "patches":
        counted(monkeypatch, patches, "find_patches", made)
        return Kind(root / "patches", lambda: vars(patches.cached_patches(scene)), made)
    if request.param == "walk":
        counted(monkeypatch, walks, "make_path", made)
        return Kind(root / "walks", lambda: parts_of(walks.cached_path(scene, "walk", 12, 0)), made)
    if request.param == "shadows":
        counted(monkeypatch, upload, "_drawn_shadow_maps", made)
        scene = replace(scene, lights=[Light("spot", (1, 1, 1), cone=40.0)])
        triangles = upload.upload_triangles(device, scene)

        def maps() -> dict[str, np.ndarray]:
            found = upload._shadow_maps(device, scene, triangles, None)
            return {"maps": found.maps.get(), "rows": found.rows}

        return Kind(root / "shadows", maps, made)
    if request.param == "environment map":

        def draw() -> np.ndarray:
            made.append("map")
            return np.random.default_rng(4).random(SHAPE, np.float32)

        return Kind(root / "environments", lambda: cached_environment_map(device, scene, draw), made)
    if request.param == "visible set":
        counted(monkeypatch, pvs, "_draw", made)
        server, pose = upload.upload_scene(device, scene), Pose(np.zeros(3), np.array([0, 0, 0, 1.0]))
        frustum = CellFrustum.around(ViewCell(0.1, 50), 40, 96, 54)
        return Kind(root / "pvs", lambda: pvs.potentially_visible(server, pose, 0.1, frustum, 0.01, 2.0).ids, made)
    session: Any = SimpleNamespace(settings=Settings(), scene=SimpleNamespace(host=scene))
    guess = plan.expected_pace(session.settings, scene.content_hash)

    def pace() -> float:
        """What a run leaves for the next where that would only have a guess."""
        if plan.expected_pace(session.settings, scene.content_hash) == guess:
            made.append("pace")
            plan.remember_pace(session, 345.678, 3)
        return plan.expected_pace(session.settings, scene.content_hash)

    return Kind(root / "pace", pace, made)


def flipped(at: Callable[[int], int], bit: int = 0) -> Callable[[Path], None]:
    def damage(file: Path) -> None:
        data = bytearray(file.read_bytes())
        data[at(len(data))] ^= 1 << bit
        file.write_bytes(data)

    return damage


def flipped_anywhere(seed: int) -> Callable[[Path], None]:
    rng = np.random.default_rng(seed)
    return flipped(lambda size: int(rng.integers(size)), int(rng.integers(8)))


def rewritten(change: Callable[[bytes], bytes]) -> Callable[[Path], object]:
    return lambda file: file.write_bytes(change(file.read_bytes()))


def replaced(make: Callable[[Path], Any]) -> Callable[[Path], None]:
    def damage(file: Path) -> None:
        file.unlink()
        make(file)

    return damage


DAMAGE = {
    "first byte": flipped(lambda size: 0),
    "header": flipped(lambda size: 5, 3),
    "last byte": flipped(lambda size: size - 1, 7),
    "within": flipped(lambda size: size // 4),
    **{f"byte {seed}": flipped_anywhere(seed) for seed in range(12)},
    "empty": rewritten(lambda data: b""),
    "half": rewritten(lambda data: data[: len(data) // 2]),
    "all but one": rewritten(lambda data: data[:-1]),
    "garbage behind": rewritten(lambda data: data + b"garbage"),
    "zeros behind": rewritten(lambda data: data + bytes(64)),
    "zeros": rewritten(lambda data: bytes(len(data))),
    "missing": replaced(lambda file: None),
    "folder": replaced(lambda file: file.mkdir()),
    "full folder": replaced(lambda file: (file / "within").mkdir(parents=True)),
    "pipe": replaced(lambda file: os.mkfifo(file)),
    "dangling link": replaced(lambda file: file.symlink_to(file.parent / "nowhere")),
    "unreadable": lambda file: file.chmod(0),
}


def assert_heals(kind: Kind, damage: Callable[[Path], None]) -> None:
    """Assert that a damaged file is noticed, made again with the same value, and good from then on."""
    fresh = kind.use()
    assert len(kind.made) == 1
    name = kind.file.name
    damage(kind.file)
    missing = not os.path.lexists(kind.folder / name)
    with warnings.catch_warnings(record=True, action="always") as said:
        np.testing.assert_equal(kind.use(), fresh)
    assert len(kind.made) == 2
    assert [" was damaged: it is " in str(one.message) for one in said] == [True] * (not missing)
    np.testing.assert_equal(kind.use(), fresh)
    assert len(kind.made) == 2, "the file was not good again"


@pytest.mark.parametrize("damage", DAMAGE)
def test_what_is_damaged_is_made_again(kind: Kind, damage: str):
    if damage == "unreadable" and (os.name != "posix" or os.geteuid() == 0):
        pytest.skip("root reads everything, and so does Windows")
    if damage == "pipe" and not hasattr(os, "mkfifo"):
        pytest.skip("there are no pipes with names here")
    assert_heals(kind, DAMAGE[damage])


def test_a_reader_that_does_not_check_is_seen(kind: Kind, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("zlib.crc32", lambda *_: 0)
    with pytest.raises(AssertionError):
        assert_heals(kind, DAMAGE["within"])


def test_a_cache_that_cannot_be_made_only_takes_time(kind: Kind, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    fresh = kind.use()
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    made = len(kind.made)
    with pytest.warns(UserWarning, match="cannot be"):
        assert_value_or_guess(kind, fresh)
    assert_value_or_guess(kind, fresh)  # what was said is not said again
    assert len(kind.made) == made + 2


@contextmanager
def full_disk() -> Iterator[None]:
    """No file of this process may grow beyond 8 bytes: writing fails as it does on a full disk, after some bytes."""
    resource = pytest.importorskip("resource", reason="files can be limited under Unix only")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_only_takes_time_and_leaves_nothing_behind(kind: Kind):
    fresh = kind.use()
    kind.file.unlink()
    with full_disk(), pytest.warns(UserWarning, match="File too large"):
        assert_value_or_guess(kind, fresh)
    assert list(kind.folder.iterdir()) == []
    np.testing.assert_equal(kind.use(), fresh)
    assert len(kind.made) == 3
    np.testing.assert_equal(kind.use(), fresh)
    assert len(kind.made) == 3


def assert_value_or_guess(kind: Kind, fresh: Any) -> None:
    """The same value without a cache; only a pace, which cannot be made again at once, is then a guess."""
    value = kind.use()
    if kind.folder.name == "pace":
        assert value > 0
    else:
        np.testing.assert_equal(value, fresh)
