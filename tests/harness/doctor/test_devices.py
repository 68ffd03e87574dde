"""bench doctor --devices: what it says of devices that are well, that err, that abort and that hang."""

import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from shading_atlas_bench.harness.cases import against_twin, find_cases
from shading_atlas_bench.harness.cli.main import app
from shading_atlas_bench.harness.doctor import devices as device_check
from shading_atlas_bench.harness.doctor.devices import Report, check_devices, show_reports
from shading_atlas_bench.harness.doctor.worker import CaseOutcome, examine_case
from shading_atlas_bench.harness.kernel_timing.timing import errors_of
from shading_atlas_bench.kernels.case import EXACT, INPUTS, Bound, Case, Result, Trial, distance
from shading_atlas_bench.kernels.device import Device, kernel_names
from shading_atlas_bench.kernels.runtime.opencl import FoundDevice

CASES = {case.name: case for case in find_cases()}
SMALL = "sas/bias"
# A process whose devices "one" and "two" are both the default one; on "one" a case ends as the first argument says.
PLANTED = """
import os, sys, threading
from dataclasses import replace
import numpy as np
from shading_atlas_bench.harness.doctor import worker as device_worker
from shading_atlas_bench.harness.watch import watchdog
from shading_atlas_bench.kernels.case import EXACT, INPUTS, Case, Result, Trial
from shading_atlas_bench.kernels.device import Device

ending, small = sys.argv[1], sys.argv[2]
del sys.argv[1:3]
found, cases, limit = Device.open().found, device_worker.find_cases(), device_worker.time_limit

def hang():
    lock = threading.Lock()
    lock.acquire()
    lock.acquire()

def make(device, kind, size):
    if sys.argv[1] == "one":
        os.abort() if ending == "abort" else hang()
    return Trial({}, lambda: None, lambda: [Result(np.zeros(1), np.zeros(1))])

planted = Case("planted/case", make, {}, 1, 1, dict.fromkeys(INPUTS, EXACT))
watchdog.GRACE = 0.1
device_worker.time_limit = lambda seconds, what: limit(0.1 if what.startswith("planted") else seconds, what)
device_worker.find_devices = lambda: [replace(found, key=key) for key in ("one", "two")]
device_worker.find_cases = lambda: [*(case for case in cases if case.name == small), planted]
device_worker.Device.remember_built = lambda self: None
device_worker.main()
"""


def fake(name: str, key: str, refused: str | None = None) -> FoundDevice:
    """A device that is only looked at."""
    platform = SimpleNamespace(name="A platform", version="OpenCL 3.0 of a rather long version")
    device: Any = SimpleNamespace(name=name, platform=platform)

    class Fake(FoundDevice):
        def refused(self) -> str | None:
            return refused

    return Fake(device, key)


def well(milliseconds: float = 1.0) -> list[CaseOutcome]:
    """Findings of a device on which every kernel ran."""
    return [
        CaseOutcome("a/case", "typical", 0.5, None, tuple(kernel_names()), milliseconds),
        CaseOutcome("a/case", "adversarial", 0.75, None, (), None),
    ]


def checked(monkeypatch: pytest.MonkeyPatch, reports: list[Report], asked: str | None = None) -> bool:
    """What `check_devices` says where examining the devices gives these reports."""
    by_key = {report.device.key: report for report in reports}
    monkeypatch.setattr(device_check, "find_devices", lambda: [report.device for report in reports])
    monkeypatch.setattr(device_check, "examine", lambda device, folder, tell: by_key[device.key])
    return check_devices(asked)


def test_devices_that_are_well(monkeypatch, capsys):
    reports = [Report(fake("first", "a"), well()), Report(fake("second", "b"), well(2.0))]
    assert checked(monkeypatch, reports) is True
    shown = capsys.readouterr().out
    total = len(kernel_names())
    first, second = (next(line for line in shown.splitlines() if line.startswith(n)) for n in ("first", "second"))
    assert first.split()[1:] == [f"{total}/{total}", "0", "of", "2", "0.75", "1.00", "ok"]
    assert second.split()[-2:] == ["0.50", "ok"]
    assert "a/case" in shown
    assert max(map(len, shown.splitlines())) <= 80


def test_a_case_that_fails_is_named_with_its_input(monkeypatch, capsys):
    bad = replace(well()[1], over=4.0, wrong="off by 8 ulp; the bound is 2")
    assert checked(monkeypatch, [Report(fake("first", "a"), [well()[0], bad])]) is False
    shown = capsys.readouterr().out
    assert "1 of 2" in shown
    assert "4.00" in shown
    assert "a/case, adversarial: off by 8 ulp; the bound is 2" in shown


def test_a_kernel_that_never_ran_is_named(monkeypatch, capsys):
    first, second = well()
    without = replace(first, kernels=first.kernels[1:])
    assert checked(monkeypatch, [Report(fake("first", "a"), [without, second])]) is False
    assert f"these kernels did not run: {kernel_names()[0]}" in capsys.readouterr().out


def test_a_device_that_cannot_be_used_is_passed_over(monkeypatch, capsys):
    refused = Report(fake("small", "s", "small has no double precision."), passed_over="small has no double precision.")
    assert checked(monkeypatch, [refused, Report(fake("first", "a"), well())]) is True
    shown = capsys.readouterr().out
    assert "passed over" in shown
    assert "small has no double precision." in shown
    assert checked(monkeypatch, [refused]) is False  # nothing was examined


def test_only_devices_with_the_name(monkeypatch, capsys):
    reports = [Report(fake("first", "a"), well()), Report(fake("second", "b"), well())]
    assert checked(monkeypatch, reports, "SECOND") is True
    shown = capsys.readouterr().out
    assert "first" not in shown
    assert "1.00" not in shown  # the default device was not timed


def test_every_column_fits_with_long_names(capsys):
    long = max(CASES, key=len)
    finding = CaseOutcome(long, "typical", np.inf, "off", (), 1.0)
    show_reports([Report(fake("NVIDIA A Very Long Name Of A Card, 80 GB", "a"), 118 * [finding])], "a")
    table = capsys.readouterr().out.partition("failed: ")[0]
    assert max(map(len, table.splitlines())) <= 80
    assert long in table
    assert "118 of 118" in table


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--device", "x"], "--devices"),
        (["--devices", "--device", "no such"], "no such"),
        (["--devices", "--device", ""], "--device is empty"),
    ],
)
def test_arguments_that_cannot_be_used(arguments, sentence):
    ended = CliRunner().invoke(app, ["doctor", *arguments])
    assert ended.exit_code == 2
    assert sentence in ended.output


@pytest.mark.parametrize(("answer", "code"), [(True, 0), (False, 1)])
def test_exit_codes(monkeypatch, answer, code):
    monkeypatch.setattr(device_check, "check_devices", lambda asked: answer)
    assert CliRunner().invoke(app, ["doctor", "--devices"]).exit_code == code


def planted(case: Case, change) -> Case:
    """The case with the results of its kernels changed."""

    def make(device: Device, kind: str, size: int) -> Trial:
        trial = case.make(device, kind, size)
        return replace(trial, results=lambda: [replace(r, found=change(r)) for r in trial.results()])

    return replace(case, make=make)


def small(name: str) -> Case:
    return replace(CASES[name], size=1 << 10, checked=1 << 10)


@pytest.mark.parametrize("kind", INPUTS)
@pytest.mark.parametrize("name", ["doctor/polynomial", "atlas/location", "snakebinning/splitting"])
def test_an_error_of_four_bounds_is_caught(device, name, kind):
    case = small(name)
    finding = examine_case(device, case, kind)
    assert finding.wrong is None
    assert finding.over is not None
    assert 0 <= finding.over <= 1
    assert set(case.costs) <= set(finding.kernels)
    assert (finding.milliseconds is not None) == (kind == "typical")

    def off(result: Result) -> np.ndarray:
        if result.found.dtype.kind != "f":
            return result.found
        found = result.found.astype(np.float64)
        found.flat[3] += 4 * max(case.bounds[kind].ulp, 1) * np.spacing(np.float32(np.abs(result.expected).max()))
        return found

    finding = examine_case(device, planted(case, off), kind)
    assert finding.over is not None
    assert finding.wrong
    assert finding.over > 2
    assert "ulp of the largest value; the bound is" in finding.wrong


def test_a_whole_number_too_many_is_caught(device):
    finding = examine_case(
        device, planted(small("common/scan"), lambda r: r.found + (r.found == r.found[-1])), "typical"
    )
    assert finding.over == np.inf
    assert finding.wrong
    assert "whole values differ" in finding.wrong


def test_other_values_in_a_second_run_are_caught(device):
    runs = iter(range(9))
    finding = examine_case(device, planted(small("roofline/copying"), lambda r: r.found + 0 * next(runs)), "typical")
    assert finding.wrong is None
    free = replace(small("roofline/copying"), bounds=dict.fromkeys(INPUTS, Bound(100)))
    runs = iter(np.float32(1e-7) * np.arange(9))
    finding = examine_case(device, planted(free, lambda r: r.found + next(runs)), "typical")
    assert finding.wrong == "a second run gives other values"


def test_a_case_that_raises_is_a_failure(device):
    def make(device: Device, kind: str, size: int) -> Trial:
        raise RuntimeError("first line\nsecond line " + 1000 * "x")

    finding = examine_case(device, replace(CASES[SMALL], make=make), "typical")
    assert finding.wrong
    assert finding.wrong.startswith("first line second line " + 3 * "x")
    assert len(finding.wrong) < 320
    assert finding.over is None


def test_distances():
    expected = np.array([1.0, 1e-3, 8.0])
    ulp = np.spacing(np.float32(8))
    off = Result((expected + np.array([0, 3 * ulp, 0])).astype(np.float32), expected)
    assert distance([off], Bound(6)).over == pytest.approx(0.5, rel=1e-3)  # in units of the largest value
    assert distance([off], EXACT).over == np.inf
    assert distance([off], Bound(1, spared=0.4)).over < 0.1
    assert distance([Result(np.array([np.nan]), np.array([1.0]))], Bound(1e30, spared=1)).over == np.inf
    assert distance([Result(np.array([np.nan, 1]), np.array([np.nan, 1]))], EXACT).over == 0
    assert distance([Result(np.zeros(3), np.zeros(4))], Bound(1e30)).over == np.inf
    whole = Result(np.array([1, 2, 3, 4]), np.array([1, 2, 3, 5]))
    assert distance([whole], Bound(1e30, wrong=0.125)).over == 2
    assert distance([whole, off], Bound(1, wrong=0.5)).over == pytest.approx(3, rel=1e-3)


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (np.array([np.inf]), np.array([-np.inf])),
        (np.array([np.nan]), np.array([np.inf])),
        (np.array([np.inf]), np.array([np.nan])),
        (np.zeros((2, 3)), np.zeros((3, 2))),
        (np.zeros((2, 3), np.int32), np.zeros(6, np.int32)),
        (np.array([2**60 + 1], np.uint64), np.array([2**60], np.uint64)),
        (np.array([2**60 + 1], np.uint64), np.array([2.0**60])),
        (np.array([2**63], np.uint64), np.array([-(2**63)], np.int64)),
        (np.array([0], np.int32), np.array([np.nan])),
        (np.array([0], np.int32), np.array([2.0**32])),
        (np.array([True]), np.array([2.0])),
    ],
)
def test_values_that_are_not_the_same_differ(found, expected):
    assert distance([Result(found, expected)], EXACT).over == np.inf
    row = errors_of([Result(found, expected)])
    assert row["broken"] or row["misassigned"]


@pytest.mark.parametrize("values", [[np.inf, -np.inf, np.nan, 1.0], [2**60 + 1, 0], [True, False]])
def test_the_same_values_are_no_distance_apart(values):
    assert distance([Result(np.array(values), np.array(values))], EXACT).over == 0


def test_whole_values_are_compared_with_rounded_ones():
    assert distance([Result(np.array([3, -2]), np.array([2.6, -2.4]))], EXACT).over == 0


@pytest.mark.parametrize(
    ("results", "kinds"),
    [([], INPUTS), ([Result(np.zeros((0, 3)), np.zeros((0, 3))), Result(np.arange(0), np.arange(0))], INPUTS[:1])],
)
def test_a_case_that_compares_nothing_fails(device, results, kinds):
    empty = replace(CASES[SMALL], make=lambda *_: Trial({}, lambda: None, lambda: results))
    for kind in INPUTS:
        assert (against_twin(device, empty, kind).what == "it compares nothing") == (kind in kinds)


@pytest.mark.parametrize("kind", INPUTS)
@pytest.mark.parametrize("name", CASES)
def test_every_bound_can_fail(name, kind):
    """Below 1 % of the largest value, and of the whole values; but for terms that cancel, and what rounding decides."""
    bound = CASES[name].bounds[kind]
    assert 0 <= bound.wrong < 0.01
    assert bound.ulp < 2**16 or (name, kind) == ("doctor/polynomial", "adversarial")
    assert bound.spared < 0.01 or (name, kind) == ("metrics/lab_differences", "adversarial")
    assert bound.spared < 0.5


@pytest.mark.parametrize(
    ("ending", "said"),
    [("abort", "died (SIGABRT) in planted/case, typical"), ("hang", "it did not end in planted/case, typical")],
)
def test_a_process_that_aborts_or_hangs_is_named_and_others_go_on(monkeypatch, capsys, device, ending, said):
    monkeypatch.setattr(device_check, "COMMAND", (sys.executable, "-c", PLANTED, ending, SMALL))
    monkeypatch.setattr(
        device_check, "find_devices", lambda: [replace(device.found, key=key) for key in ("one", "two")]
    )
    monkeypatch.setattr(device_check, "kernel_names", lambda: sorted(CASES[SMALL].costs))
    assert check_devices(None) is False
    shown = capsys.readouterr().out
    rows = [line.split()[-1] for line in shown.splitlines() if "3/3" in line]
    assert rows == ["ended", "ok"]
    assert said in shown
