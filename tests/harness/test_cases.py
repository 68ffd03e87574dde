"""Where the cases of a packer's kernels are looked for: in its class's package and those above it, each once."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from shading_atlas_bench.harness import cases as harness_cases
from shading_atlas_bench.harness.cases import find_cases, own_cases
from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.plugins import load_packer
from shading_atlas_bench.packers.interface import Packer

PACKER = """
from shading_atlas_bench import Packer, Paper

class Mine(Packer):
    name, paper = "mine", Paper("mine", 2026, "")

    def prepare(self, scene): ...

    def pack(self, frame): ...

    def client(self, scene): ...
"""
CASES = """
from shading_atlas_bench.kernels.case import Cost, case

@case({{"{kernel}": Cost("n", "n")}}, size=1)
def {name}(device, kind, size): ...
"""
Written = Callable[[dict[str, str]], type[Packer]]


@pytest.fixture
def written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Written]:
    """Writes files and installs the class Mine of the package that the first of them is in."""

    def write(files: dict[str, str]) -> type[Packer]:
        for name, text in files.items():
            file = tmp_path / name
            file.parent.mkdir(parents=True, exist_ok=True)
            for folder in [folder for folder in file.parents if tmp_path in folder.parents]:
                (folder / "__init__.py").touch()
            file.write_text(text, encoding="utf-8")
        monkeypatch.syspath_prepend(tmp_path)
        (found,) = load_packer(f"{next(iter(files)).partition('/')[0]}:Mine")
        monkeypatch.setattr(harness_cases, "find_packers", lambda: {"mine": type(found)})
        return type(found)

    yield write
    for name in [name for name in sys.modules if name.partition(".")[0] in ("shelf", "fill")]:
        del sys.modules[name]


def test_a_class_deeper_in_a_package_has_the_cases_of_all_packages_above_it(written: Written) -> None:
    packer = written(
        {
            "shelf/__init__.py": "from shelf.impl.packer import Mine",
            "shelf/impl/packer.py": PACKER,
            "shelf/kernels/cases.py": CASES.format(kernel="a.f", name="outer"),
            "shelf/impl/kernels/cases.py": "from shelf.kernels.cases import outer\n"
            + CASES.format(kernel="b.f", name="inner"),
        }
    )
    assert sorted(case.name for case in own_cases(packer)) == ["impl/inner", "shelf/outer"]
    assert {"impl/inner", "shelf/outer"} <= {case.name for case in find_cases()}


@pytest.mark.parametrize(
    ("kernel", "name", "shared"), [("fill.pull", "own", "fill/fill.pull"), ("a.f", "filling", "fill/filling")]
)
def test_a_package_cannot_hide_kernels_or_cases_of_the_suite(
    written: Written, kernel: str, name: str, shared: str
) -> None:
    written({"fill/__init__.py": PACKER, "fill/kernels/cases.py": CASES.format(kernel=kernel, name=name)})
    said = rf"shading_atlas_bench\.kernels\.fill\.cases and fill\.kernels\.cases both measure {shared}: rename"
    with pytest.raises(InputError, match=said):
        find_cases()
