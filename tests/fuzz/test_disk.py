"""Files of the cache, stores and folders of runs that something else changed: healed, equal, or refused in words."""

from __future__ import annotations

import os
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.progress import Progress
from shading_atlas_bench.harness.run import folder as folders
from shading_atlas_bench.harness.run import plan
from shading_atlas_bench.harness.workload import pvs, walks
from shading_atlas_bench.harness.workload.environment import cached_environment_map
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.harness.workload.shadows import cached_shadow_maps
from shading_atlas_bench.harness.workload.views import CellFrustum, Pose, ViewCell
from shading_atlas_bench.kernels.cache import cache_root
from shading_atlas_bench.kernels.shade.environment import SHAPE
from shading_atlas_bench.kernels.shade.shadow import ROW_FLOATS, ShadowMaps
from shading_atlas_bench.packers.sas import patches
from shading_atlas_bench.reports.store.csv_files import write_all
from shading_atlas_bench.reports.store.database import StoreError
from shading_atlas_bench.reports.store.results import FILE, Store
from shading_atlas_bench.scenes.cache import fetch
from shading_atlas_bench.scenes.cache import store as store_scene
from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import Scene
from shading_atlas_bench.scenes.paths import make_path
from tests.fuzz.cases import fuzzed, nothing_beside
from tests.harness.workload.test_cache_heals import flat, grid_file, parts_of
from tests.reports.synthetic import PLAN, make_store

PAGE = 4096  # bytes of a page of SQLite
KINDS = ("scene", "patches", "visible set", "pace", "walk", "shadows", "environment map")
CHANGES = ("flip", "cut", "begin", "insert", "overwrite", "remove", "swap", "zeros", "pages")
DAMAGES = (*["bytes"] * 8, "other", "folder", "full", "pipe", "nowhere", "self", "device", "up")


@dataclass
class Kind:
    """One kind of cached thing. use: its value, from the cache or made and cached. whole: the file as first written."""

    use: Callable[[], Any]
    made: list[str]
    file: Path
    fresh: Any
    whole: bytes


def made_by(value: Any, made: list[str]) -> Callable[..., Any]:
    """A function that gives the value, and notes that it was called."""

    def make(*_: object) -> Any:
        made.append("made")
        return value

    return make


def users(scene: Scene, root: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, tuple[Callable[[], Any], list[str]]]:
    """How each kind is used, without a device: what it would draw is given."""
    rng = np.random.default_rng(4)
    device: Any = SimpleNamespace(
        found=SimpleNamespace(key="key"), variant="default", upload=lambda a: a, download=lambda a: a.tobytes()
    )
    made: dict[str, list[str]] = {name: [] for name in KINDS}

    def cached_scene() -> dict[str, Any]:
        found = fetch(root / "scenes" / "key")
        if found is None:
            made["scene"].append("made")
            store_scene(root / "scenes" / "key", scene)
        return flat(found or scene)

    maps, rows = rng.random(500, np.float32), rng.random((1, ROW_FLOATS), np.float32)
    lit = replace(scene, lights=[None])  # type: ignore[list-item]  # only their number counts here
    drawn = ShadowMaps(maps, rows)  # type: ignore[arg-type]  # on the host, so that no device is needed
    draw_shadows = made_by(drawn, made["shadows"])

    found = patches.find_patches(scene.positions, scene.indices)
    monkeypatch.setattr(patches, "find_patches", made_by(found, made["patches"]))
    seen = pvs.PotentiallyVisibleSet(np.arange(0, 288, 2, dtype=np.int32), 9, 9, 1.25)
    monkeypatch.setattr(pvs, "_draw", made_by(seen, made["visible set"]))
    server: Any = SimpleNamespace(host=scene, device=device)
    pose, frustum = Pose(np.zeros(3), np.array([0, 0, 0, 1.0])), CellFrustum.around(ViewCell(0.1, 50), 40, 96, 54)

    monkeypatch.setattr(walks, "make_path", made_by(make_path(scene, "walk", 12, 0), made["walk"]))
    around = made_by(rng.random(SHAPE, np.float32), made["environment map"])
    session: Any = SimpleNamespace(settings=Settings(), scene=SimpleNamespace(host=scene))
    guess = plan.expected_pace(session.settings, "nothing")

    def pace() -> float:
        if plan.expected_pace(session.settings, scene.content_hash) == guess:
            made["pace"].append("made")
            plan.remember_pace(session, 345.678, 3)
        return plan.expected_pace(session.settings, scene.content_hash)

    uses: dict[str, Callable[[], Any]] = {
        "scene": cached_scene,
        "patches": lambda: vars(patches._from_cache(root / "patches" / "key", scene)),
        "visible set": lambda: vars(pvs.potentially_visible(server, pose, 0.1, frustum, 0.01, 2.0)),
        "pace": pace,
        "walk": lambda: parts_of(walks.cached_path(scene, "walk", 12, 0)),
        "shadows": lambda: vars(cached_shadow_maps(device, lit, draw_shadows)),
        "environment map": lambda: cached_environment_map(device, scene, around),
    }
    return {name: (use, made[name]) for name, use in uses.items()}


@pytest.fixture(scope="module")
def kinds(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Kind]]:
    """Every kind, written once into a cache of its own."""
    place = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setenv("XDG_CACHE_HOME", str(place / "own"))
        root, found = cache_root(), {}
        for name, (use, made) in users(load_scene(str(grid_file(place))), root, monkeypatch).items():
            before = set(root.rglob("*"))
            fresh = use()
            (file,) = (path for path in set(root.rglob("*")) - before if path.is_file())
            found[name] = Kind(use, made, file, fresh, file.read_bytes())
        yield found


def changed(data: bytes, draw: st.DataObject) -> bytes:
    """Bytes with one thing about them changed."""
    size = len(data)
    at = st.integers(0, max(0, size - 1)) | st.integers(0, min(size, 200)) | st.integers(max(0, size - 200), size)
    first, last = sorted((draw.draw(at), draw.draw(at)))
    how = draw.draw(st.sampled_from(CHANGES))
    if how == "flip" and size:
        bits = bytearray(data)
        bits[min(first, size - 1)] ^= draw.draw(st.integers(1, 255))
        return bytes(bits)
    few = draw.draw(st.binary(min_size=1, max_size=16))
    half = (first + last) // 2
    page, other = (place // PAGE * PAGE for place in (first, last))
    return {
        "cut": data[:first],
        "begin": data[first:],
        "insert": data[:first] + few + data[first:],
        "overwrite": data[:first] + few + data[first + len(few) :],
        "remove": data[:first] + data[last:],
        "swap": data[:first] + data[half:last] + data[first:half] + data[last:],
        "zeros": data[:first] + bytes(last - first) + data[last:],
        "pages": data[:page] + data[other : other + PAGE] + data[page + PAGE :],
    }.get(how, data)


def damage(file: Path, whole: bytes, others: list[bytes], draw: st.DataObject) -> None:
    """Put something else in a file's place: other bytes, those of another file, or no file."""
    how = draw.draw(st.sampled_from(DAMAGES))
    if how == "bytes":
        for _ in range(draw.draw(st.integers(1, 3))):
            whole = changed(whole, draw)
        file.write_bytes(whole)
        return
    file.unlink()
    if how == "other":
        file.write_bytes(draw.draw(st.sampled_from(others)))
    elif how in ("folder", "full"):
        file.mkdir()
        if how == "full":
            (file / "within").write_bytes(b"1")
    elif how == "pipe" and hasattr(os, "mkfifo"):
        os.mkfifo(file)
    else:
        target = {"nowhere": file.parent / "nowhere", "self": file, "device": Path("/dev/zero")}.get(how, file.parent)
        file.symlink_to(target)


def put_back(file: Path, whole: bytes) -> None:
    """The file as it was."""
    if file.is_dir() and not file.is_symlink():
        shutil.rmtree(file)
    elif os.path.lexists(file):
        file.unlink()
    file.write_bytes(whole)


@fuzzed
@given(name=st.sampled_from(KINDS), draw=st.data())
def test_cached_files_heal(kinds: dict[str, Kind], name: str, draw: st.DataObject):
    kind = kinds[name]
    put_back(kind.file, kind.whole)
    damage(kind.file, kind.whole, [other.whole for other in kinds.values() if other is not kind], draw)
    whole = kind.file.is_file() and kind.file.read_bytes() == kind.whole
    kind.made.clear()
    with nothing_beside(kind.file.parent), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # which says that it is made again
        np.testing.assert_equal(kind.use(), kind.fresh)
        assert len(kind.made) == (not whole)
        np.testing.assert_equal(kind.use(), kind.fresh)
    assert len(kind.made) == (not whole), "the file was not good again"


def content_of(folder: Path) -> tuple[Any, ...]:
    """All that a store holds. Raises StoreError."""
    with Store(folder, must_exist=True) as store:
        tables = (store.rows(), store.stages(), store.statistics(), store.repeats())
        return store.plan(), store.finished(), dict(store.notes), tables


def answer_of(ask: Callable[[], Any]) -> tuple[Any, str]:
    """What is found, None where it is refused, and the sentence that says why."""
    try:
        return ask(), ""
    except (StoreError, InputError) as error:
        return None, str(error)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, tuple[Any, ...], dict[str, bytes]]:
    """A store's bytes, all that it holds, and its CSV files."""
    folder = tmp_path_factory.mktemp("store")
    make_store(folder, frames=2)
    write_all(folder)
    return (folder / FILE).read_bytes(), content_of(folder), {f.name: f.read_bytes() for f in folder.glob("*.csv")}


def content_then_tables(folder: Path) -> Any:
    """All that a store holds, read before its CSV files are written."""
    content = content_of(folder)
    write_all(folder)
    return content


@fuzzed
@given(draw=st.data())
def test_stores_hold_what_was_written_or_are_refused(kept: tuple[Any, ...], draw: st.DataObject):
    whole, content, tables = kept
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"
        folder.mkdir()
        (folder / FILE).write_bytes(whole)
        damage(folder / FILE, whole, [b"", b"SQLite format 3\0", tables["frames.csv"]], draw)
        if draw.draw(st.booleans()):
            (folder / f"{FILE}-journal").write_bytes(draw.draw(st.binary(max_size=600)))
        with nothing_beside(folder):
            found, said = answer_of(lambda: content_then_tables(folder))
        if found is None:
            assert "\n" not in said
        else:
            assert found == content
            assert {file.name: file.read_bytes() for file in folder.glob("*.csv")} == tables


@fuzzed
@given(draw=st.data())
def test_whatever_lies_below_runs_a_run_has_a_folder(kept: tuple[Any, ...], draw: st.DataObject):
    whole, here = kept[0], Path.cwd()
    with tempfile.TemporaryDirectory() as place:
        beside = Path(place) / "work"
        beside.mkdir()
        os.chdir(beside)
        try:
            with nothing_beside(beside):
                fill_runs(whole, draw)
                found, said = answer_of(lambda: folders.folder_for(PLAN, "hall", Progress()))
                if found is None:
                    assert "\n" not in said
                    assert not Path("runs").is_dir()
                    return
                with folders.locked(found):
                    assert found.parent == Path("runs")
                    assert not any(found.glob("[!.]*")) or content_of(found) == kept[1]
        finally:
            os.chdir(here)


def fill_runs(whole: bytes, draw: st.DataObject) -> None:
    """A folder runs/ with finished, damaged and other runs, or something else of that name."""
    what = draw.draw(st.sampled_from(["runs"] * 8 + ["file", "nowhere", "self", "pipe"]))
    runs = Path("runs")
    if what == "file":
        runs.write_bytes(b"")
    elif what in ("nowhere", "self"):
        runs.symlink_to({"nowhere": "/nonexistent/runs", "self": "runs"}[what])
    elif what == "pipe" and hasattr(os, "mkfifo"):
        os.mkfifo(runs)
    else:
        for number in range(draw.draw(st.integers(1, 3))):
            folder = runs / f"20300101-00000{number}-hall"
            folder.mkdir(parents=True)
            (folder / FILE).write_bytes(whole)
            if draw.draw(st.booleans()):
                damage(folder / FILE, whole, [b""], draw)
            if draw.draw(st.booleans()):
                (folder / "report.html").write_bytes(b"")
