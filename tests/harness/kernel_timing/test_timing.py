"""bench kernels: what it measures, what it says of errors, and what it refuses."""

import csv

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.kernel_timing.timing import TimingRequest, bench_kernels, choose_cases, errors_of
from shading_atlas_bench.kernels.case import Result
from shading_atlas_bench.reports.pages.kernels import compare_variants
from shading_atlas_bench.reports.store.columns import KERNEL_COLUMNS


def test_errors_are_counted_in_units_of_the_last_place():
    expected = np.array([1.0, 2.0, 1000.0])
    found = (expected + np.array([0, 3, -2]) * np.spacing(expected.astype(np.float32))).astype(np.float32)
    row = errors_of([Result(found, expected)])
    assert row["max_ulp"] == pytest.approx(3)
    assert row["mean_ulp"] == pytest.approx(5 / 3)
    assert row["values"] == 3
    assert row["misassigned"] is None


def test_what_cancels_is_judged_by_the_largest_value():
    row = errors_of([Result(np.array([2e-8, 1.0], np.float32), np.array([0.0, 1.0]))])
    assert row["max_ulp"] < 2**8


def test_what_is_finite_on_one_side_only_is_broken():
    row = errors_of([Result(np.array([np.nan, np.nan, 1, np.inf], np.float32), np.array([np.nan, 1, np.inf, np.inf]))])
    assert row["broken"] == 2
    assert row["max_error"] is None


@given(st.lists(st.integers(0, 255), min_size=1), st.integers(0, 3))
def test_whole_numbers_are_right_or_wrong(values, wrong):
    expected = np.array(values, np.float64) + 0.3
    found = np.rint(expected).astype(np.uint8)
    found[:wrong] ^= 1
    row = errors_of([Result(found, expected)])
    assert row["misassigned"] == min(wrong, len(values))
    assert row["whole_values"] == len(values)


def test_another_number_of_values_is_wrong_altogether():
    row = errors_of([Result(np.zeros(3, np.int32), np.zeros(5, np.int32))])
    assert (row["misassigned"], row["whole_values"]) == (5, 5)


@pytest.mark.parametrize(
    ("name", "kernels"),
    [("scan", {"common/scan.run_sums", "common/scan.run_offsets"}), ("alpha_test", {"texture/mask.alpha_test"})],
)
def test_kernels_are_chosen_by_folder_file_or_function(name, kernels):
    assert {kernel for case in choose_cases((name,)) for kernel in case.costs} == kernels


def test_an_unknown_kernel_names_the_nearest():
    with pytest.raises(InputError, match="alpha_test"):
        choose_cases(("alpha_tst",))


def test_a_row_per_kernel_input_and_variant_and_a_page(tmp_path, capsys):
    bench_kernels(TimingRequest(("smoke", "rank_items"), repeat=1), tmp_path)
    with open(tmp_path / "kernels.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [column.name for column in KERNEL_COLUMNS]
    assert len(rows) == 2 * 2 * 3
    for row in rows:
        assert float(row["ms"]) > 0
        assert float(row["copy_share"]) > 0
    whole = [row for row in rows if row["kernel"] == "common/rank.rank_items"]
    assert {row["misassigned"] for row in whole} == {"0"}
    assert {row["max_ulp"] for row in whole} == {""}
    shown = capsys.readouterr().out
    assert "doctor/smoke" in shown
    assert "relaxed:" in shown
    assert max(map(len, shown.splitlines()[:-1])) <= 80  # the last one is a path
    page = (tmp_path / "kernels.html").read_text(encoding="utf-8")
    assert page.count('<td data-value="doctor/smoke.smoke">') == 6
    assert 'data-figure="roofline"' in page


def test_variants_are_judged_by_stage():
    def row(variant, ms, ulp, wrong=0):
        names = {"kernel": "a/b.c", "case": "a/x", "input": "typical", "variant": variant}
        return names | {"ms": ms, "p999_ulp": ulp, "misassigned": wrong, "broken": 0}

    fast, exact = compare_variants([row("default", 2.0, 4.0), row("relaxed", 1.0, 9.0), row("precise", 4.0, 1.0)])
    assert (fast["variant"], fast["time"], fast["worse"], fast["better"]) == ("relaxed", 0.5, [("a/x", "typical")], [])
    assert (exact["time"], exact["worse"], exact["better"]) == (2.0, [], [("a/x", "typical")])
