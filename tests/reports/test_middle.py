"""Medians and means are those of the standard library, and numbers also where sums are none."""

from __future__ import annotations

import statistics
from pathlib import Path

import numpy as np
import pytest

from shading_atlas_bench.reports.pages.html import write_report
from shading_atlas_bench.reports.pages.tables import number
from shading_atlas_bench.reports.store.csv_files import spread, write_all
from shading_atlas_bench.reports.store.middle import finite, mean, median
from shading_atlas_bench.reports.store.results import Store
from tests.reports.synthetic import COMMON

LARGEST = 1.7976931348623157e308


@pytest.mark.parametrize("count", range(1, 12))
def test_usual_numbers_are_not_touched(count):
    values = np.random.default_rng(count).normal(size=count).tolist()
    assert median(values) == statistics.median(values)
    assert mean(values) == statistics.fmean(values)
    assert median(range(count)) == statistics.median(range(count))


def test_the_largest_have_a_middle():
    assert median([LARGEST, LARGEST]) == LARGEST
    assert median([1e308, 1e308, 1.5e308, -1e308]) == 1e308
    assert mean([LARGEST] * 2) == LARGEST
    assert mean([1e308, 1.2e308, 1.4e308]) == pytest.approx(1.2e308)
    assert all(map(np.isfinite, filter(None, spread([LARGEST] * 7).values())))
    assert finite(LARGEST * 2) is None
    assert number(LARGEST, whole=True) == "1.798e+308"


def test_a_report_of_the_largest_is_made(tmp_path: Path):
    row = COMMON | {"codec": "none", "status": "ok", "server_ms": LARGEST, "gather_ms": LARGEST, "structs_ms": LARGEST}
    with Store(tmp_path) as store:
        for frame in range(8):
            store.commit_frame("mine", "", frame, [row], (), {"waste": LARGEST, "structs_share": LARGEST})
    write_all(tmp_path)
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert "1.798e+308" in page
    assert "inf" not in (tmp_path / "summary.csv").read_text(encoding="utf-8").partition("\n")[2]
