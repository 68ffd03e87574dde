"""Examines one OpenCL device, in a process of its own: `bench doctor --devices` starts it, because compilers abort.

Every case runs on both inputs, against its twin and a second time; its typical input is timed at full size. What came
out of each is one JSON line in a file, and the journal says what is being done.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, TextIO

from shading_atlas_bench.harness.cases import against_twin, find_cases
from shading_atlas_bench.harness.watch.ends import end_with_supervisor
from shading_atlas_bench.harness.watch.watchdog import PackTimeoutError, time_limit
from shading_atlas_bench.kernels.case import INPUTS
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.kernels.runtime.opencl import find_devices

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.case import Case

LIMIT = 180.0  # seconds for opening a device, and for each case with all that it compiles
TIMINGS = 3
LONGEST = 300  # letters of an error


@dataclass(frozen=True)
class CaseOutcome:
    """What a device made of a case on one input.

    over: the worst error over its bound; None if nothing could be compared. wrong: what must not be, in words; None
    where all is well. kernels: those that ran, by their names. milliseconds: of device time at the case's full size,
    for the typical input only.
    """

    case: str
    input: str
    over: float | None = None
    wrong: str | None = None
    kernels: tuple[str, ...] = ()
    milliseconds: float | None = None


def main() -> None:
    """Examine the device whose key is the first argument, and write findings into the file that is the second."""
    end_with_supervisor()
    key, file = sys.argv[1:]
    with Path(file).open("w", encoding="utf-8", buffering=1) as lines:
        examine_device(key, lines)


def examine_device(key: str, lines: TextIO) -> None:
    """Write a line for every case and input, or one if the device cannot be opened."""
    try:
        with time_limit(LIMIT, "opening it"):
            device = Device(next(found for found in find_devices() if found.key == key))
    except Exception as error:
        _write(lines, CaseOutcome("opening it", "", wrong=_sentence(error)))
        return
    well = True
    for case in find_cases():
        for kind in INPUTS:
            finding = examine_case(device, case, kind)
            _write(lines, finding)
            well &= finding.wrong is None
    if well:
        device.remember_built()


def examine_case(device: Device, case: Case, kind: str) -> CaseOutcome:
    """Run a case on one of its inputs, and judge it; never raises."""
    over, wrong, milliseconds, record = None, None, None, None
    try:
        with time_limit(LIMIT, f"{case.name}, {kind}"), device.record() as record:
            apart = against_twin(device, case, kind)
            over, wrong = apart.over, apart.what if apart.over > 1 else None
            if kind == INPUTS[0]:
                milliseconds = _time(device, case, kind)
    except PackTimeoutError:
        wrong = f"it did not end within {LIMIT:.0f} s"
    except Exception as error:
        wrong = _sentence(error)
    return CaseOutcome(case.name, kind, over, wrong, tuple(record.kernels) if record else (), milliseconds)


def _time(device: Device, case: Case, kind: str) -> float:
    """Milliseconds of device time that the kernels of a case take, the median of TIMINGS."""
    trial, spent = case.make(device, kind, case.size), []
    trial.run()
    for _ in range(TIMINGS):
        with device.record() as record:
            trial.run()
        spent.append(sum(record.kernels.values()))
    return median(spent)


def _sentence(error: Exception) -> str:
    """The beginning of an error's text, in one line."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def _write(lines: TextIO, finding: CaseOutcome) -> None:
    lines.write(json.dumps(asdict(finding)) + "\n")


if __name__ == "__main__":
    main()
