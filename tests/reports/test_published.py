"""Published numbers: what the file must hold, and how they stand beside measured ones."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from shading_atlas_bench.reports.analysis.claims import read_claims
from shading_atlas_bench.reports.documents.kept import DocumentError
from shading_atlas_bench.reports.documents.published import (
    ALIKE,
    CELLS,
    cause_parts,
    is_unlike,
    published_parts,
    read_published,
)
from shading_atlas_bench.reports.store.results import Store
from tests.reports.synthetic import COMMON

DOCUMENT = Path(__file__).parents[2] / "reports" / "PUBLISHED.md"


def test_every_published_number_is_whole_and_its_claims_are_there() -> None:
    claims = {claim.id for claim in read_claims().claims}
    headings = re.findall(r"^## (.*)$", DOCUMENT.read_text(encoding="utf-8"), re.MULTILINE)
    sections = {"#" + re.sub(r"[^a-z0-9 -]", "", heading.lower()).replace(" ", "-") for heading in headings}
    for quantity in read_published():
        assert len(quantity.claims) == len(quantity.compared), quantity.name
        named = {name for names in quantity.claims for name in names}
        assert {name for name in named if not name.startswith("#")} <= claims
        assert {name for name in named if name.startswith("#")} <= sections
        for methods in quantity.compared:
            for scene in ("hall", "viking_village"):
                numbers = quantity.published(methods, scene)
                assert len(numbers) == len(CELLS)
                assert None not in numbers
            assert quantity.published(methods, "sponza_crytek") == [None] * 3


@pytest.mark.parametrize(
    ("name", "methods", "cell", "golden"),
    [
        ("flip", ["snakebinning", "sas"], 0, 11.54 / 13.7),  # SnakeBinning, table 3, RL-PVS1
        ("server_ms", ["snakebinning", "tss"], 2, 47.11 / 56.55),  # table 2, RL-PVS3
        ("structs_share", ["snakebinning"], 1, 4.76 / 43.54),  # table 2, RL-PVS2
    ],
)
def test_ratios_are_those_of_the_printed_tables(name: str, methods: list[str], cell: int, golden: float) -> None:
    (quantity,) = (q for q in read_published() if q.name == name and q.paper == "snakebinning-2021")
    assert quantity.published(methods, "hall")[cell] == pytest.approx(golden, abs=1e-4)


def measured_run(folder: Path, samples: dict[tuple[str, str], float]) -> None:
    with Store(folder) as store:
        for (method, variant), value in samples.items():
            row = COMMON | {"codec": "none", "status": "ok", "scene": "viking_village", "samples": value}
            store.commit_frame(method, variant, 0, [row | {"iwssim": 0.9, "flip": 0.1}])
            end = "@published" if variant == "paper" else ""
            store.notes[f"label/{method}[{variant}]"] = f"{method}{end}"


def test_settings_are_told_apart_and_numbers_unlike_the_published_are_bold(tmp_path: Path) -> None:
    folders = [tmp_path / f"{n:02d}" for n in range(6)]
    for usual, equal in zip(folders[::2], folders[1::2], strict=True):
        both = {("snakebinning", "paper"): 3e6, ("snakebinning", "ours"): 4e6, ("sas", "only"): 4e6}
        measured_run(usual, both)
        measured_run(equal, {("snakebinning", "ours"): 9e6, ("sas", "only"): 9e6})
    parts = published_parts(folders)
    rows = {row["quantity"]: row for row in parts["snakebinning-2021"]}
    row = rows["samples: snakebinning / sas"]
    assert row["published"] == "1.01, 0.75, 0.71"
    assert row["default"] == row["equal"] == "1.00, 1.00, 1.00"
    assert (row["as_published"], row["claims"]) == ("0.75, 0.75, 0.75", "")
    own = rows["samples: snakebinning"]
    assert own["as_published"] == "**3.00 M**, **3.00 M**, **3.00 M**"
    assert own["equal"] == "9.00 M, **9.00 M**, **9.00 M**"
    assert rows["samples: tss"]["as_published"] == "-, -, -"  # did not run
    assert rows["1 - IW-SSIM: snakebinning / sas"]["default"] == "**1.00**, **1.00**, **1.00**"  # 0.47, 0.47, 0.16
    cells = [row for row in parts["cells"] if row["quantity"] == "samples: snakebinning / sas"]
    assert [(row["cell"], row["as_published"]) for row in cells] == [(cell, 0.75) for cell in CELLS]


def test_runs_of_other_scenes_or_numbers_are_refused(tmp_path: Path) -> None:
    folders = [tmp_path / str(n) for n in range(6)]
    for folder in folders:
        measured_run(folder, {("sas", "only"): 4e6})
    with pytest.raises(DocumentError, match="two runs for each of 3 cells"):
        published_parts(folders[:5])
    with Store(folders[4]) as store:
        row = COMMON | {"codec": "none", "status": "ok", "scene": "elsewhere", "samples": 1.0}
        store.commit_frame("another", "", 0, [row])
        assert store.rows()[0]["scene"] == "elsewhere"
    with pytest.raises(DocumentError, match="viking_village and elsewhere"):
        published_parts(folders)


def test_causes_set_both_rates_beside_the_published_numbers(tmp_path: Path) -> None:
    folders = [tmp_path / cell for cell in CELLS]
    for folder in folders:
        rates = {"shading_rate=0.7": 5.74e6, "shading_rate=1.0": 11.48e6}
        measured_run(folder, {("snakebinning", f"a=1,{rate}"): value for rate, value in rates.items()})
    first, *_ = cause_parts(folders)["rows"]
    assert (first["samples"], first["samples_rate_1"]) == (5.74e6, 11.48e6)
    assert (first["samples_ratio"], first["samples_rate_1_ratio"]) == (0.5, 1.0)  # published: 11.48 million
    assert (first["samples_full"], first["samples_rate_1_full"]) == ("", "")
    assert first["triangles_ratio"] is None, "these rows have none"


def test_alike_is_within_the_factor_both_ways() -> None:
    for measured, unlike in ((ALIKE, False), (1 / ALIKE, False), (1.51, True), (0.66, True), (None, False)):
        assert is_unlike({"published": 1.0, "default": measured}, "default") == unlike
    assert not is_unlike({"published": None, "default": 5.0}, "default")
