"""The methods' READMEs name files that there are, and each file of a method in the table of its sections."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
METHODS = [path.parent for path in sorted((ROOT / "packers").glob("*/packer.py"))]
FILE = r"(?:[\w.-]+/)*[\w.-]+\.(?:cl|py)"
STAGES = ("structs/", "gather/")


def document(method: Path) -> str:
    return (method / "README.md").read_text(encoding="utf-8")


def located(method: Path, name: str) -> Path:
    """The file of a name: of the method, else of the repository, by its path in either."""
    own = method / name
    return own if own.is_file() else ROOT / name


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_every_file_has_its_section(method: Path):
    """The table names each file, and no other of the method."""
    files = {path for path in method.rglob("*.*") if path.suffix in (".py", ".cl") and path.name != "__init__.py"}
    table = document(method).partition("## Sections and files\n")[2].partition("\n## ")[0].partition("\n### ")[0]
    named = {located(method, name) for name in re.findall(rf"`({FILE})`", table)}
    assert {path for path in named if path.is_relative_to(method)} == files


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_files_that_are_named_are_there(method: Path):
    """Wherever they are named, in text and in drawings; and paths in backticks that are no stage's name."""
    text = document(method)
    names = re.findall(rf"(?<![\w./-]){FILE}\b", text)
    names += [name for name in re.findall(r"`([\w-]+/[\w./-]+)`", text) if not name.startswith(STAGES)]
    assert [name for name in names if not located(method, name).is_file()] == []


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_what_is_named_behind_a_file_is_in_it(method: Path):
    """As in `kernels/footprint.cl` (`keeps_bin`)."""
    found = re.findall(rf"`({FILE})` \(((?:`\w+`(?:, )?)+)\)", document(method))
    assert found
    lost = [(file, name) for file, names in found for name in re.findall(r"\w+", names)
            if not re.search(rf"\b{name}\b", located(method, file).read_text(encoding="utf-8"))]  # fmt: skip
    assert lost == []


def test_headers_are_included_where_the_table_says():
    method = ROOT / "packers" / "tss"
    rows = re.findall(rf"^\| `({FILE})` \| [^|]+ \| ([^|]+) \|$", document(method), re.MULTILINE)
    assert len(rows) == 4
    for header, kernels in rows:
        line = f'#include "{Path(header).name}"\n'
        including = {path for path in method.rglob("*.cl") if line in path.read_text(encoding="utf-8")}
        assert {located(method, name) for name in re.findall(rf"`({FILE})`", kernels)} == including
