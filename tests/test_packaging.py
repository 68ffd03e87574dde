"""What is installed is whole, and the command line answers at once."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
NAME = "shading_atlas_bench"
PACKAGES = ("arithmetic", "kernels", "scenes", "packers", "harness", "reports")
FILES = ("pyproject.toml", "README.md", "LICENSE", "CITATION.cff", "CHANGELOG.md")
PICTURES = (".jpg", ".png", ".svg")  # of the documentation
HEAVY = ("pyopencl", "trimesh", "pymeshlab", "OpenImageIO", "colour", "av", "plotly", "scipy", "lz4", "sqlite3")


def run_python(code: str, folder: Path) -> str:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """A wheel built from a copy of the sources, so that no earlier build can add to it."""
    copy = tmp_path_factory.mktemp("sources")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, copy / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / NAME, copy / NAME, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    for name in FILES:
        shutil.copy(ROOT / name, copy / name)
    run_python("from setuptools import build_meta; build_meta.build_wheel('dist')", copy)
    (path,) = (copy / "dist").glob("*.whl")
    return zipfile.ZipFile(path)


def test_the_wheel_ships_every_file_of_the_packages(wheel: zipfile.ZipFile):
    sources = {
        f"{NAME}/{path.relative_to(ROOT).as_posix()}"
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.suffix not in PICTURES
    }
    assert any(name.endswith(".cl") for name in sources)
    assert sources - set(wheel.namelist()) == set()


def test_the_wheel_says_that_it_is_typed(wheel: zipfile.ZipFile):
    assert f"{NAME}/py.typed" in wheel.namelist()


def test_the_wheel_has_the_licence_the_command_and_the_packers(wheel: zipfile.ZipFile):
    names = wheel.namelist()
    assert any(name.endswith("licenses/LICENSE") for name in names)
    (entries,) = (wheel.read(name).decode() for name in names if name.endswith("entry_points.txt"))
    assert "bench = shading_atlas_bench.__main__:main" in entries
    assert "[shading_atlas_packers]" in entries
    assert [name for name in names if name.startswith("tests/")] == []


def test_the_version_is_the_same_everywhere(wheel: zipfile.ZipFile):
    (metadata,) = (wheel.read(name).decode() for name in wheel.namelist() if name.endswith("/METADATA"))
    version = re.findall(r"^Version: (.+)$", metadata, re.MULTILINE)[0]
    assert re.search(
        rf"^version: {re.escape(version)}$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert re.search(rf"^## {re.escape(version)}$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert f'VERSION = "{version}"' in (ROOT / "kernels" / "cache.py").read_text(encoding="utf-8")


def test_the_tested_versions_are_ones_that_are_asked_for():
    """constraints.txt is of Python 3.11 on Linux, with what CONTRIBUTING.md sets up."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    asked = [Requirement(text) for text in [*project["dependencies"], *extras["test"], *extras["dev"], *extras["docs"]]]
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    tested = {canonicalize_name(name): version for name, _, version in (line.partition("==") for line in lines)}
    system = {"python_version": "3.11", "sys_platform": "linux", "platform_machine": "x86_64"}
    needed = [one for one in asked if one.marker is None or one.marker.evaluate(system)]
    assert len(needed) > 20
    assert [str(one) for one in needed if not one.specifier.contains(tested[canonicalize_name(one.name)])] == []


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["compare", "--help"]])
def test_help_imports_nothing_heavy(arguments: list[str], tmp_path: Path):
    code = f"""
import sys
sys.argv = ["bench", *{arguments!r}]
from shading_atlas_bench.harness.cli.main import main
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
print("HEAVY", sorted(set({HEAVY!r}) & set(sys.modules)))
"""
    output = run_python(code, tmp_path)
    assert "Usage" in output
    assert output.splitlines()[-1] == "HEAVY []"


@pytest.mark.skipif(sys.platform == "win32", reason=".ci/run is for bash")
def test_the_readme_states_the_commands_that_ci_runs():
    """`.ci/run` takes its commands from the README's marked blocks, so the two cannot drift apart."""
    done = subprocess.run([ROOT / ".ci" / "run", "--show"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert 'pip install -e ".[test]" && pytest' in done.stdout.splitlines()


def test_a_clone_without_links_says_how_to_clone(tmp_path: Path):
    """As Git makes it on Windows, where links need a permission: text files in their place."""
    (tmp_path / NAME).mkdir()
    shutil.copy(ROOT / NAME / "__init__.py", tmp_path / NAME)
    for name in PACKAGES:
        (tmp_path / NAME / name).write_text(f"../{name}", encoding="utf-8")
    code = f"""
try:
    import {NAME}
except ImportError as error:
    print(error)
"""
    assert "git clone -c core.symlinks=true" in run_python(code, tmp_path).splitlines()[0]
