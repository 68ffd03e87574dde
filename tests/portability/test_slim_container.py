"""A slim container has no OpenGL, X11 or OpenMP libraries: a run needs none, and mesh repair names what it lacks."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from shading_atlas_bench.scenes.system_libraries import LIBRARIES

ROOT = Path(__file__).parents[2]
SMALL = ("--frames", "1", "--size", "160x90", "--atlas", "256x256", "--crf", "25", "--detail", "40000")
WITHOUT = """\
import sys
from importlib import metadata

def version(name):
    if name == "pymeshlab":
        raise metadata.PackageNotFoundError(name)
    return metadata.distribution(name).version

metadata.version = version
sys.modules["pymeshlab"] = None
from shading_atlas_bench.harness.cli.main import main
main()
"""

needs_pymeshlab = pytest.mark.skipif(find_spec("pymeshlab") is None, reason="pymeshlab is not installed")


@pytest.fixture(scope="module")
def slim(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment in which the loader finds an empty file in place of each library."""
    if sys.platform != "linux":
        pytest.skip("only on Linux do slim containers lack these libraries")
    folder = tmp_path_factory.mktemp("hidden")
    for name in LIBRARIES:
        (folder / name).touch()
    return os.environ | {"LD_LIBRARY_PATH": str(folder)}


def bench(environment: dict[str, str], *arguments: str, code: str = "") -> subprocess.CompletedProcess:
    start = ["-c", code] if code else ["-m", "shading_atlas_bench.harness.cli.main"]
    command = [sys.executable, *start, *arguments]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=300)


def test_the_libraries_are_hidden_here(slim: dict[str, str]):
    code = f"""
import ctypes
for name in {[*LIBRARIES]}:
    try:
        ctypes.CDLL(name)
    except OSError:
        print(name)
"""
    hidden = subprocess.run([sys.executable, "-c", code], env=slim, capture_output=True, text=True, check=True).stdout
    assert hidden.split() == [*LIBRARIES]


def test_a_default_run_needs_none_of_them_nor_pymeshlab(slim: dict[str, str], tmp_path: Path):
    done = bench(slim, "run", "--method", "all", *SMALL, "--out", str(tmp_path / "run"), code=WITHOUT)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "report.html").is_file()


@pytest.mark.parametrize("option", [("--repair",), ("--decimate", "0.5")])
@needs_pymeshlab
def test_mesh_repair_names_the_library_and_its_package(option: tuple[str, ...], slim: dict[str, str], tmp_path: Path):
    done = bench(slim, "run", "--scene", str(sheet(tmp_path)), *option, "--out", str(tmp_path / "run"))
    assert done.returncode == 2
    *_, said = done.stderr.splitlines()
    assert said.startswith("bench: --repair and --decimate need the system library lib")
    assert any(f"{name} for pymeshlab: install {LIBRARIES[name]} (" in said for name in LIBRARIES)
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("option", [("--repair",), ("--decimate", "0.5")])
def test_without_pymeshlab_it_is_named_and_how_to_install_it(option: tuple[str, ...], tmp_path: Path):
    scene = str(sheet(tmp_path))
    done = bench({**os.environ}, "run", "--scene", scene, *option, "--out", str(tmp_path / "run"), code=WITHOUT)
    assert done.returncode == 2
    *_, said = done.stderr.splitlines()
    assert said == "bench: --repair and --decimate need pymeshlab: pip install -e '.[repair]' brings it."
    assert "Traceback" not in done.stderr


@needs_pymeshlab
def test_a_library_that_only_a_filter_needs_is_found_missing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """pymeshlab itself can be imported without libOpenGL, and then lacks filters."""
    from shading_atlas_bench.scenes.load import load_scene
    from shading_atlas_bench.scenes.model import SceneError

    if sys.platform != "linux":
        pytest.skip("the filters are looked at on Linux only")

    def fail(name: str) -> None:
        raise OSError("libOpenGL.so.0: cannot open shared object file: No such file or directory")

    monkeypatch.setattr(ctypes, "CDLL", fail)
    with pytest.raises(SceneError, match=r"libOpenGL\.so\.0 for pymeshlab: install libopengl0 "):
        load_scene(str(sheet(tmp_path)), repair=True)


def sheet(folder: Path) -> Path:
    """A square of 8x8 cells as an OBJ file."""
    file = folder / "sheet.obj"
    points = [f"v {x} {y} 0" for y in range(9) for x in range(9)]
    cells = [1 + 9 * y + x for y in range(8) for x in range(8)]
    file.write_text("\n".join([*points, *(f"f {n} {n + 1} {n + 10} {n + 9}" for n in cells)]), encoding="utf-8")
    return file
