"""Runs made in turn: the same code is not told apart, whatever else the machine does, and 10 % more time is found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from shading_atlas_bench.reports.analysis.compare import Comparison
from shading_atlas_bench.reports.analysis.interleaved import Medians, compare_interleaved, judged_by_pairs
from shading_atlas_bench.reports.store.results import Store
from tests.reports.synthetic import COMMON

PAIRS, TIMES = 10, 12
ROW = Comparison(
    method="sas", variant="", label="sas", codec="all", crf=None, metric="", unit="ms", better="lower",
    a=1.0, b=1.0, mean_a=1.0, mean_b=1.0, change=0.0, p=1.0, frames=12, verdict="ambiguous",
)  # fmt: skip


def row_of(number: int) -> Comparison:
    return Comparison(**{**vars(ROW), "metric": f"time {number}"})


def processes(random: np.random.Generator, code: float, loads: np.ndarray) -> list[Medians]:
    """Medians of one process at each load, of times that feel it more or less, beside a reference that feels it."""
    runs: list[Medians] = []
    for load in loads:
        reference = load * random.lognormal(0, 0.02)
        run: Medians = {}
        for number in range(TIMES):
            time = code * 20 * load ** (number / TIMES) * random.lognormal(0, 0.02)
            run["sas", "", "none", None, f"time {number}"] = (time, time / reference)
        runs.append(run)
    return runs


def verdicts(random: np.random.Generator, code: float, spread: float) -> list[str]:
    """Of every time, of `code` against 1; the machine's load drifts from process to process."""
    loads = np.exp(np.cumsum(random.normal(0, spread, 2 * PAIRS)))
    order = np.arange(2 * PAIRS).reshape(PAIRS, 2)
    order[1::2] = order[1::2, ::-1]  # which of both comes first
    first, second = (processes(random, factor, loads[order[:, n]]) for n, factor in enumerate((1.0, code)))
    return [judged_by_pairs(row_of(number), first, second).verdict for number in range(TIMES)]


@pytest.mark.parametrize("spread", [0.0, 0.05, 0.3])
def test_of_20_comparisons_of_the_same_code_at_most_one_tells_it_apart(spread: float) -> None:
    random = np.random.default_rng(5)
    called = sum(set(verdicts(random, 1.0, spread)) != {"ambiguous"} for _ in range(20))
    assert called <= 1


@pytest.mark.parametrize(("code", "verdict"), [(1.1, "worse"), (1 / 1.1, "better")])
def test_a_tenth_is_found(code: float, verdict: str) -> None:
    random = np.random.default_rng(6)
    found = [each for _ in range(20) for each in verdicts(random, code, 0.03)]
    assert set(found) <= {verdict, "ambiguous"}
    assert found.count(verdict) >= 0.9 * len(found)


def one_run(folder: Path, milliseconds: float, flip: float) -> Path:
    with Store(folder) as store:
        for frame in range(12):
            row = COMMON | {"codec": "none", "status": "ok", "server_ms": milliseconds + 0.01 * frame, "flip": flip}
            store.commit_frame("sas", "", frame, [row], [], {"reference_ms": 10.0})
    return folder


def test_times_are_of_all_runs_and_the_rest_of_the_first(tmp_path: Path) -> None:
    first = [one_run(tmp_path / f"a-{n}", 20 + n / 10, 0.1) for n in range(PAIRS)]
    second = [one_run(tmp_path / f"b-{n}", 1.08 * (20 + n / 10), 0.2) for n in range(PAIRS)]
    found = {row.metric: row for row in compare_interleaved(first, second)}
    assert found["flip"].verdict == "worse"
    server = found["server_ms"]
    assert (server.verdict, server.frames) == ("worse", PAIRS)
    assert server.change == pytest.approx(0.08, abs=1e-3)
    assert server.low is not None
    assert server.high is not None
    assert server.change is not None
    assert server.low <= server.change <= server.high
    assert {row.verdict for row in compare_interleaved(first, first)} == {"same", "ambiguous"}


def test_a_time_that_is_the_same_for_every_coding_counts_once() -> None:
    random = np.random.default_rng(9)
    first, second = (processes(random, 1.0, np.ones(PAIRS)) for _ in range(2))
    for run in (*first, *second):
        run |= {(*key[:2], "h264", crf, key[4]): value for key, value in list(run.items()) for crf in (5, 25)}
    assert judged_by_pairs(row_of(0), first, second).frames == PAIRS
