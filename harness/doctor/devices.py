"""`bench doctor --devices`: every kernel on every OpenCL device, each case against its float64 twin.

Each device is examined in a process of its own (harness/doctor/worker.py), and this one watches it: a compiler that
dies or hangs is named, and the other devices are examined all the same.
"""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

from shading_atlas_bench.arithmetic.functions import exp, log
from shading_atlas_bench.harness.cases import find_cases
from shading_atlas_bench.harness.console import make_console, make_table, progress_bars, styled
from shading_atlas_bench.harness.doctor.worker import CaseOutcome
from shading_atlas_bench.harness.errors import InputError, StoppedError
from shading_atlas_bench.harness.watch.ends import SWITCH, TICK, cause_of, overdue_steps
from shading_atlas_bench.harness.watch.processes import python
from shading_atlas_bench.harness.watch.stops import stops_apart
from shading_atlas_bench.kernels.case import INPUTS
from shading_atlas_bench.kernels.device import kernel_names, kernels_digest
from shading_atlas_bench.kernels.journal import VARIABLE, read_journal
from shading_atlas_bench.kernels.runtime.opencl import find_devices, noted_death

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.runtime.opencl import FoundDevice

COMMAND = python("-m", "shading_atlas_bench.harness.doctor.worker")


@dataclass(frozen=True)
class Report:
    """What came out of a device. passed_over: why none of it was examined. ended: why the examination did not come to
    its end. Each None where it is not so."""

    device: FoundDevice
    findings: list[CaseOutcome] = field(default_factory=list)
    passed_over: str | None = None
    ended: str | None = None

    @property
    def wrong(self) -> list[CaseOutcome]:
        """The cases that fail."""
        return [finding for finding in self.findings if finding.wrong]

    @property
    def missing(self) -> list[str]:
        """The kernels that did not run."""
        ran = {kernel for finding in self.findings for kernel in finding.kernels}
        return [name for name in kernel_names() if name not in ran]

    @property
    def status(self) -> str:
        """In a word or two."""
        if self.passed_over:
            return "passed over"
        return "ended" if self.ended else "failed" if self.wrong or self.missing else "ok"

    @property
    def worst(self) -> CaseOutcome | None:
        """The finding with the largest error over its bound, where anything was compared."""
        compared = [(finding.over, finding) for finding in self.findings if finding.over is not None]
        return max(compared, key=lambda pair: pair[0], default=(None, None))[1]

    def speed(self, of: Report | None) -> float | None:
        """How many times as fast as another device: the geometric mean over the cases that both were timed on."""
        times, others = ({f.case: f.milliseconds for f in one.findings if f.milliseconds} for one in (self, of or self))
        ratios = [log(others[case] / times[case]) for case in times if case in others]
        return float(exp(fmean(ratios))) if of and ratios else None


def check_devices(asked: str | None) -> bool:
    """Examine all devices, or those whose platform and name contain `asked`, and print what came out of it.

    False if something fails on one, or if none could be examined. Raises InputError if none matches, and for an
    empty name, and StoppedError when it is interrupted.
    """
    devices = _choose(asked)
    usable = [device for device in devices if device.refused() is None]
    total = len(usable) * len(find_cases()) * len(INPUTS)
    bars = progress_bars(make_console(stderr=True))
    with tempfile.TemporaryDirectory(prefix="bench-") as folder, bars as progress:
        task = progress.add_task("", total=total)

        def tell(device: FoundDevice, now: int, last: str) -> None:
            before = usable.index(device) * len(find_cases()) * len(INPUTS)
            progress.update(task, completed=before + now, description=f"{device.device.name.strip()[:20]}: {last}")

        reports = []
        try:
            with stops_apart():
                for device in devices:
                    refused, place = device.refused(), Path(folder) / device.key
                    reports.append(Report(device, passed_over=refused) if refused else examine(device, place, tell))
        except KeyboardInterrupt:
            show_reports(reports, _default())
            raise StoppedError(f"{len(reports)} of {len(devices)} devices were examined.") from None
    show_reports(reports, _default())
    return bool(usable) and all(report.status in ("ok", "passed over") for report in reports)


def _choose(asked: str | None) -> list[FoundDevice]:
    if asked == "":
        raise InputError("--device is empty: give part of a device's name, or leave it out.")
    found = find_devices()
    if not found:
        raise InputError("No OpenCL device was found: pip install 'pyopencl[pocl]' brings one for any CPU.")
    chosen = [one for one in found if (asked or "").lower() in f"{one.device.platform.name} {one.device.name}".lower()]
    if not chosen:
        known = "; ".join(f"{one.device.name.strip()} on {one.device.platform.name}" for one in found)
        raise InputError(f"No OpenCL device matches {asked!r}, which --device asks for. There are: {known}.")
    return chosen


def examine(device: FoundDevice, folder: Path, tell: Callable[[FoundDevice, int, str], None]) -> Report:
    """Examine a device in a process of its own until that ends, or hangs and is ended.

    folder: new, for what the process writes. tell: is told the device, how many findings there are, and the last case.
    """
    folder.mkdir()
    journal, lines, log_file = (folder / name for name in ("journal", "findings", "log"))
    environment = os.environ | {VARIABLE: str(journal), SWITCH: "1"}
    # The other end of its standard input closes with this process, however that ends; then it ends too.
    hung: list[dict[str, Any]] = []
    with (
        log_file.open("wb") as output,
        subprocess.Popen(
            [*COMMAND, device.key, str(lines)], stdin=subprocess.PIPE, stdout=output, stderr=output, env=environment
        ) as child,
    ):
        try:
            while not hung:
                try:
                    child.wait(TICK)
                    break
                except subprocess.TimeoutExpired:
                    hung = overdue_steps(read_journal(journal))
                findings = list(_read(lines))
                tell(device, len(findings), findings[-1].case if findings else "starting")
        finally:
            child.kill()
            code = child.wait()
    ended = _why(code, hung, read_journal(journal), log_file) if hung or code else None
    return Report(device, list(_read(lines)), ended=ended)


def _read(lines: Path) -> Iterator[CaseOutcome]:
    """The findings so far; the last line may be half written."""
    text = lines.read_text(encoding="utf-8") if lines.is_file() else ""
    for line in text.splitlines(keepends=True):
        if line.endswith("\n"):
            yield CaseOutcome(**json.loads(line))


def _why(code: int, hung: list[dict[str, Any]], state: dict[str, Any] | None, log_file: Path) -> str:
    """Why an examination ended before its end, in one sentence."""
    steps = list(state["steps"].values()) if state else []
    building = list(state["building"].values()) if state else []
    at = ", ".join(f"in {step['what']}" for step in hung or steps) or "starting"
    if building:
        at += f", while it built {building[0]['what']}"
    if hung:
        return f"it did not end {at}."
    how = f"died ({cause_of(code)})" if code < 0 or code > 0xFF else f"ended with exit code {code}"
    said = log_file.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return f"its process {how} {at}." + (f" Its last words: {said[-1].strip()[:200]}" if said else "")


def show_reports(reports: list[Report], default: str | None) -> None:
    """Print a row for each device, and a line for whatever fails. default: the key of the one whose speed is 1."""
    console, total = make_console(), len(kernel_names())
    table = make_table("bench doctor --devices", "device", "kernels", "failed", "error/bound", "speed", "status")
    for column in table.columns[1:]:
        column.no_wrap = True
    reference = next((report for report in reports if report.device.key == default), None)
    colours = {"ok": "green", "passed over": "yellow"}
    for report in reports:
        status, worst, speed = report.status, report.worst, report.speed(reference)
        cells = ["", "", "", ""]
        if not report.passed_over:
            over = f"{worst.over:.2f}\n{worst.case}" if worst else ""
            failed = f"{len(report.wrong)} of {len(report.findings)}"
            cells = [f"{total - len(report.missing)}/{total}", failed, over, "" if speed is None else f"{speed:.2f}"]
        name = f"{report.device.device.name.strip()}\n{report.device.platform}"
        table.add_row(name, *cells, styled("[{style}]{}[/]", status, style=colours.get(status, "red")))
    console.print(table)
    console.print(
        styled(
            "[dim]failed: of the cases, each on two inputs. error/bound: the worst error over what its case allows. "
            "speed: against the default device, geometric mean over the cases.[/]"
        )
    )
    for report in reports:
        for line in _lines(report):
            console.print(f"{report.device.name}: {line}", soft_wrap=True)


def _default() -> str | None:
    """The key of the device that is used where none is asked for."""
    digest = kernels_digest()
    usable = (one for one in find_devices() if one.refused() is None and noted_death(one.key, digest) is None)
    return next((one.key for one in usable), None)


def _lines(report: Report) -> Iterator[str]:
    """Why a device was passed over, and what fails on it."""
    if report.passed_over:
        yield report.passed_over
    for finding in report.wrong:
        yield f"{finding.case}{', ' if finding.input else ''}{finding.input}: {finding.wrong}"
    if report.ended:
        yield report.ended
    elif report.missing and not report.passed_over:
        yield f"these kernels did not run: {', '.join(report.missing)}"
