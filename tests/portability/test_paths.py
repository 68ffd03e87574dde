"""Paths of Windows in what users type and in what scene files name, and names that Windows' file systems take."""

from __future__ import annotations

import json
from pathlib import Path, PureWindowsPath
from typing import Any

import pytest

from shading_atlas_bench.harness.plugins import SPEC, find_packers, load_packer, variant_string
from shading_atlas_bench.harness.sweep.grid import make_grid, read_axes
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.reports.analysis.claims import ClaimsError, read_claims
from shading_atlas_bench.reports.store.names import fits_everywhere, folder_name

FORBIDDEN = set('<>:"/\\|?*') | {chr(code) for code in range(32)}
OWN = "from packers.sas import ShadingAtlasStreaming\n\nclass Mine(ShadingAtlasStreaming):\n    name = {!r}\n"
SCENES = [r"C:\scenes\a hall.glb", r"\\server\share\x.glb", r"D:y.obj", "hall"]


def valid_on_windows(path: str) -> bool:
    return all(
        part and not FORBIDDEN & set(part) and part[-1] not in ". " and not PureWindowsPath(part).is_reserved()
        for part in path.split("/")
    )


@pytest.mark.parametrize("values", [None, "reuse=true", ""])
@pytest.mark.parametrize("file", [r"C:\my packers\mine.py", r"C:\a[1]\mine.py", r"..\mine.py", "/home/a[b]/mine.py"])
def test_a_method_in_a_file_is_told_from_its_parameters(file: str, values: str | None):
    spec = f"{file}:Mine" + ("" if values is None else f"[{values}]")
    assert (match := SPEC.fullmatch(spec))
    assert match.groups() == (f"{file}:Mine", None, values)


def test_a_packer_in_a_folder_with_brackets_is_found(tmp_path: Path):
    file = tmp_path / "packers [1]" / "mine.py"
    file.parent.mkdir()
    file.write_text(OWN.format("mine"), encoding="utf-8")
    packer: Any  # of a class that only the file has
    (packer,) = load_packer(f"{file}:Mine[superblock=256]")
    assert (packer.name, packer.superblock) == ("mine", 256)
    with pytest.raises(ValueError, match=r"mine\.py is a file: name the packer's class in it"):
        load_packer(str(file))


def test_a_file_of_windows_that_is_missing_is_named_whole():
    with pytest.raises(ValueError, match=r"^There is no file C:\\packers\\mine\.py to take a packer from"):
        load_packer(r"C:\packers\mine.py:Mine")
    with pytest.raises(ValueError, match=r"^C:\\packers\\mine\.py is a file: name the packer's class in it"):
        load_packer(r"C:\packers\mine.py")


def test_scenes_of_windows_are_values_of_vary():
    axes = read_axes([f"scene={','.join(SCENES)}", "cell=0.1:90,0.2/125"], load_packer("sas"))
    assert axes == {"scene": SCENES, "cell": ["0.1:90", "0.2/125"]}


def test_folders_of_a_sweep_are_valid_on_windows():
    wide = ["scene=" + ",".join(SCENES), "fov=59.,60", "cell=pvs1,0.2:125", "atlas=512x256", "reuse=true,false"]
    folders = make_grid(Settings(methods=("sas",)), wide).folders()
    assert len(set(folders.values())) == len(folders) == len(SCENES) * 2 * 2
    assert [name for name in folders.values() if not valid_on_windows(name)] == []


def test_folders_of_methods_are_valid_on_windows():
    for packer in (kind() for kind in find_packers().values()):
        assert valid_on_windows(folder_name(packer.name, variant_string(packer)))


@pytest.mark.parametrize("name", ["sas", "my method", "a.b-c_d+e", "größe", "1", "console", "lpt"])
def test_usual_names_fit(name: str):
    assert fits_everywhere(name)
    assert valid_on_windows(name)


@pytest.mark.parametrize(
    "name", ["", "a/b", "a\\b", "a:b", "a?", "a.", "a ", "..", ".a", "NUL", "con.x", "Com1", "a\n"]
)
def test_names_that_some_system_refuses_do_not_fit(name: str, tmp_path: Path):
    assert not fits_everywhere(name)
    (tmp_path / "mine.py").write_text(OWN.format(name), encoding="utf-8")
    with pytest.raises(ValueError, match="which files cannot have"):
        load_packer(f"{tmp_path / 'mine.py'}:Mine")
    run = f"[papers]\na = 'b'\n[runs.{json.dumps(name)}]\nframes = 2\n[[claims]]\nid = 'c'\n"
    (tmp_path / "claims.toml").write_text(run, encoding="utf-8")
    with pytest.raises(ClaimsError, match="must have a name of letters"):
        read_claims(tmp_path / "claims.toml")
