"""An edit of any source that a drawing goes through makes drawings that are kept as good as missing."""

from __future__ import annotations

from functools import _lru_cache_wrapper
from pathlib import Path

import pytest

from shading_atlas_bench.harness.workload import cache_key, pvs
from shading_atlas_bench.packers.sas import patches

MATTERS = (
    "arithmetic/functions.py", "kernels/raster/setup.cl", "kernels/raster/setup.py", "scenes/model.py",
    "packers/interface.py", "harness/workload/views.py",
)  # fmt: skip
OTHER = ("packers/tss/packer.py", "harness/run/loop.py", "kernels/README.md", "reports/pages/html.py")


def planted(root: Path, files: tuple[str, ...]) -> None:
    for name in files:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("one\n", encoding="utf-8")


def changes(file: Path, digest: _lru_cache_wrapper[str]) -> bool:
    """Whether an edit of a file changes the digest, which is taken once per process."""
    digest.cache_clear()
    before = digest()
    file.write_text("another\n", encoding="utf-8")
    digest.cache_clear()
    return digest() != before


@pytest.mark.parametrize(("name", "matters"), [*((n, True) for n in MATTERS), *((n, False) for n in OTHER)])
def test_every_kind_of_source_counts_and_no_method(
    name: str, matters: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planted(tmp_path, MATTERS + OTHER)
    monkeypatch.setattr(cache_key, "ROOT", tmp_path)
    assert changes(tmp_path / name, cache_key.drawing_digest) == matters
    cache_key.drawing_digest.cache_clear()


def test_all_patterns_match_sources_that_there_are() -> None:
    assert [pattern for pattern in cache_key.SOURCES if not any(cache_key.ROOT.glob(pattern))] == []
    assert Path(pvs.__file__).resolve() in {
        file.resolve() for pattern in cache_key.SOURCES for file in cache_key.ROOT.glob(pattern)
    }


@pytest.mark.parametrize("name", ["sas/patches.py", "sas/kernels/layout.py"])
def test_patches_are_found_anew_by_another_method(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    planted(tmp_path, ("packers/sas/patches.py", "packers/sas/kernels/layout.py"))
    monkeypatch.setattr(patches, "__file__", str(tmp_path / "packers/sas/patches.py"))
    assert changes(tmp_path / "packers" / name, patches._sources)
    patches._sources.cache_clear()
