"""Results of an edited program never mix with older ones: whichever source is edited, a digest changes."""

import shutil
import sys
from pathlib import Path

import pytest

from shading_atlas_bench.harness.plugins import load_packer
from shading_atlas_bench.harness.run import digest
from shading_atlas_bench.harness.run.digest import SHARED, method_digest, suite_digest
from shading_atlas_bench.packers.interface import Packer
from shading_atlas_bench.packers.sas import ShadingAtlasStreaming

SUITE, METHOD = "suite", "method"


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A copy of the suite's sources, as whose the digests are taken."""
    root = tmp_path / "suite"
    for name in SHARED:
        shutil.copytree(digest.ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(digest, "ROOT", root)
    return root


def _digests() -> dict[str, str]:
    suite_digest.cache_clear()
    found = {SUITE: suite_digest(), METHOD: method_digest(ShadingAtlasStreaming)}
    suite_digest.cache_clear()
    return found


@pytest.mark.parametrize(
    ("file", "changes"),
    [
        ("packers/sas/patches.py", {METHOD}),
        ("packers/sas/kernels/layout.py", {METHOD}),
        ("packers/sas/kernels/layout.cl", {METHOD}),
        ("packers/tss/message.py", set()),
        ("packers/tss/kernels/emit.cl", set()),
        ("packers/budget.py", {SUITE}),
        ("packers/geometry.py", {SUITE}),
        ("kernels/raster/setup.py", {SUITE}),
        ("kernels/common/elementary.cl", {SUITE}),
        ("arithmetic/functions.py", {SUITE}),
        ("scenes/paths.py", {SUITE}),
        ("harness/measure/codecs.py", {SUITE}),
        ("harness/measure/verification/pictures.py", {SUITE}),
        ("packers/sas/README.md", set()),
    ],
)
def test_an_edit_changes_the_digest_of_what_goes_through_it(tree, file, changes):
    before = _digests()
    with (tree / file).open("a", encoding="utf-8") as source:
        source.write("\n")
    after = _digests()
    assert {name for name in after if after[name] != before[name]} == changes


@pytest.mark.parametrize("file", ["packers/sas/added.py", "packers/sas/kernels/added.cl"])
def test_files_that_come_go_or_are_renamed_count(tree, file):
    before = _digests()[METHOD]
    (tree / file).write_text("", encoding="utf-8")
    added = _digests()[METHOD]
    (tree / file).rename((tree / file).with_stem("renamed"))
    assert len({before, added, _digests()[METHOD]}) == 3


def test_what_moves_from_one_file_to_its_neighbour_counts(tree):
    first, second = (tree / "packers" / "sas" / name for name in ("a.py", "b.py"))
    first.write_text("x = 1\n", encoding="utf-8")
    second.write_text("", encoding="utf-8")
    before = _digests()[METHOD]
    first.write_text("", encoding="utf-8")
    second.write_text("x = 1\n", encoding="utf-8")
    assert _digests()[METHOD] != before


PACKER = """
from shading_atlas_bench import Packer, Paper
from shading_atlas_bench.packers.{base} import {base_class}

class Mine({base_class}):
    name, paper = "mine", Paper("mine", 2026, "")

    def prepare(self, scene): ...

    def pack(self, frame): ...

    def client(self, scene): ...
"""
PLAIN = PACKER.format(base="interface", base_class="Packer")
PACKAGE = ("__init__.py", "cells.py", "t.json", "kernels/__init__.py", "kernels/k.cl", "kernels/k.inl", "README.md")
OTHERS = ("impl/__pycache__/old.pyc", ".#packer.py", ".cache/k.bin")


@pytest.fixture
def written(tmp_path, monkeypatch):
    """Writes files and imports from among them: a function of their names, and of the packer's module or file."""

    def write(files, target, packer=PLAIN):
        for name in files:
            file = tmp_path / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(packer if file.name == "packer.py" else "", encoding="utf-8")
        monkeypatch.syspath_prepend(tmp_path)
        (found,) = load_packer(f"{tmp_path / target if target.endswith('.py') else target}:Mine")
        return type(found)

    yield write
    for name in [name for name in sys.modules if name.partition(".")[0] in ("shelf", "packer")]:
        del sys.modules[name]


def _changes(packer: type[Packer], file: Path) -> bool:
    before = method_digest(packer)
    file.write_bytes(file.read_bytes() + b"\n")
    return method_digest(packer) != before


@pytest.mark.parametrize(
    ("edited", "counts"),
    [
        *((name, name != "README.md") for name in PACKAGE),
        ("impl/packer.py", True),
        *((name, False) for name in OTHERS),
    ],
)
@pytest.mark.parametrize("target", ["shelf.impl.packer", "shelf/impl/packer.py"])
def test_a_package_counts_from_its_top_folder_on(written, tmp_path, target, edited, counts):
    files = [*PACKAGE, "impl/__init__.py", "impl/packer.py", *OTHERS]
    packer = written([f"shelf/{name}" for name in files], target)
    assert _changes(packer, tmp_path / "shelf" / edited) == counts


@pytest.mark.parametrize("edited", ["helper.py", "impl/k.cl"])
def test_a_namespace_package_counts_whole(written, tmp_path, edited):
    packer = written(["shelf/packer.py", "shelf/helper.py", "shelf/impl/k.cl"], "shelf.packer")
    assert _changes(packer, tmp_path / "shelf" / edited)


@pytest.mark.parametrize(
    ("edited", "counts"),
    [
        ("packer.py", True),
        ("other.py", True),
        ("own.clh", True),
        ("kernels/k.cl", True),
        ("kernels/deep/t.json", True),
        ("README.md", False),
        ("t.json", False),
        ("letters/k.cl", False),
    ],
)
@pytest.mark.parametrize("target", ["packer", "packer.py"])
def test_a_single_file_counts_with_sources_and_kernels_beside_it(written, tmp_path, target, edited, counts):
    files = ["packer.py", "other.py", "own.clh", "kernels/k.cl", "kernels/deep/t.json", "README.md", "t.json"]
    packer = written([*files, "letters/k.cl"], target)
    assert _changes(packer, tmp_path / edited) == counts


@pytest.mark.parametrize(
    ("edited", "counts"),
    [
        ("packers/sas/packer.py", True),
        ("packers/sas/kernels/emit.cl", True),
        ("packers/sas/README.md", False),
        ("packers/tss/packer.py", False),
        ("packers/budget.py", False),  # it is in the suite's
    ],
)
def test_a_method_that_another_is_derived_from_counts(written, tree, edited, counts):
    base = PACKER.format(base="sas", base_class="ShadingAtlasStreaming")
    assert _changes(written(["packer.py"], "packer.py", base), tree / edited) == counts


def test_kernels_behind_a_link_count_and_links_in_circles_end(written, tmp_path):
    (tmp_path / "shelf").mkdir()
    (tmp_path / "shelf" / "kernels").symlink_to(tmp_path / "real", target_is_directory=True)
    packer = written(["shelf/__init__.py", "shelf/packer.py", "real/k.cl"], "shelf.packer")
    (tmp_path / "real" / "up").symlink_to(tmp_path / "shelf", target_is_directory=True)
    assert _changes(packer, tmp_path / "real" / "k.cl")


@pytest.mark.parametrize("target", ["shelf.packer", "shelf/packer.py"])
def test_locks_and_folders_named_like_sources_do_not_matter(written, tmp_path, target):
    """Emacs keeps a link to nowhere beside a file that it edits."""
    packer = written(["shelf/packer.py", "shelf/kernels/notes.h/k.txt"], target)
    before = method_digest(packer)
    for name in (".#packer.py", "kernels/.#k.cl", "gone.cl"):
        (tmp_path / "shelf" / name).symlink_to("somebody@somewhere.1234")
    (tmp_path / "shelf" / "odd.cl").mkdir()
    assert method_digest(packer) == before


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ("", r"^The class Mine lies in .*packer\.py, which is no file: install it as a folder\.$"),
        (
            "open(__file__)",
            r"^The module 'shelf\.packer' cannot be imported: NotADirectoryError: .*py' \(packer\.py, line 13\)\.$",
        ),
    ],
)
def test_a_packer_in_a_zip_is_refused(written, tmp_path, more, sentence):
    file = tmp_path / "shelf" / "packer.py"
    file.parent.mkdir()
    file.write_text(PLAIN + more, encoding="utf-8")
    zipped = shutil.make_archive(str(tmp_path / "zipped"), "zip", tmp_path, "shelf")
    shutil.rmtree(file.parent)
    sys.path.insert(0, zipped)
    try:
        with pytest.raises(ValueError, match=sentence):
            written([], "shelf.packer")
    finally:
        sys.path.remove(zipped)
