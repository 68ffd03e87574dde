"""Results of an edited program never mix with older ones: whichever source is edited, a digest changes."""

import shutil
from pathlib import Path

import pytest

from shading_atlas_bench.harness.run import digest
from shading_atlas_bench.harness.run.digest import SHARED, method_digest, suite_digest
from shading_atlas_bench.packers.sas import ShadingAtlasStreaming

SUITE, METHOD = "suite", "method"


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A copy of the suite's sources, as whose the digests are taken."""
    for name in SHARED:
        shutil.copytree(digest.ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(digest, "ROOT", tmp_path)
    monkeypatch.setattr(digest.inspect, "getfile", lambda _: str(tmp_path / "packers" / "sas" / "__init__.py"))
    return tmp_path


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


@pytest.mark.parametrize(
    ("layout", "edited", "counts"),
    [
        (["packer.py", "own.cl", "other.py"], "own.cl", True),
        (["packer.py", "own.cl", "other.py"], "packer.py", True),
        (["packer.py", "own.cl", "other.py"], "other.py", False),
        (["__init__.py", "packer.py", "kernels/own.cl", "kernels/launch.py"], "kernels/own.cl", True),
        (["__init__.py", "packer.py", "kernels/own.cl", "kernels/launch.py"], "kernels/launch.py", True),
    ],
)
def test_a_plugin_is_its_package_or_its_file_with_the_kernels_beside_it(tmp_path, monkeypatch, layout, edited, counts):
    for name in layout:
        file: Path = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.write_text("", encoding="utf-8")
    monkeypatch.setattr(digest.inspect, "getfile", lambda _: str(tmp_path / "packer.py"))
    before = method_digest(ShadingAtlasStreaming)
    (tmp_path / edited).write_text("// edited\n", encoding="utf-8")
    assert (method_digest(ShadingAtlasStreaming) != before) == counts
