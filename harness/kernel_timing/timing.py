"""`bench kernels`: the time of every kernel against its error, for each build variant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bools, Doubles
from shading_atlas_bench.harness.cases import find_cases
from shading_atlas_bench.harness.console import make_console, make_table, progress_bars, styled, tell_passed_over
from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.measure.noise import noise_warnings
from shading_atlas_bench.harness.workload.settings import RANGES
from shading_atlas_bench.kernels.case import INPUTS, Case, Cost, Result, Trial, broken_values, evaluate, whole_differ
from shading_atlas_bench.kernels.device import VARIANTS, Device
from shading_atlas_bench.kernels.roofline.roofline import Roofline, measure
from shading_atlas_bench.reports.pages.kernels import by_variant, compare_variants, write_kernels

Row = dict[str, Any]


@dataclass(frozen=True)
class TimingRequest:
    """What to measure: kernels (names, or parts of them; all if empty), build variants, timings of each kernel."""

    kernels: tuple[str, ...] = ()
    variants: tuple[str, ...] = tuple(VARIANTS)
    repeat: int = 5
    device: str | None = None


def choose_cases(names: tuple[str, ...]) -> list[Case]:
    """The cases with the kernels named, and of these only their costs; all for no names.

    A name is a folder (raster), a file (raster/setup or setup), a function, or a whole kernel (raster/setup.set_up).
    Raises InputError, with the nearest names, for one that there is not.
    """
    cases = find_cases()
    if not names:
        return cases
    words = {kernel: _names_of(kernel) for case in cases for kernel in case.costs}
    known = set().union(*words.values())
    for name in names:
        if name not in known:
            near = get_close_matches(name, sorted(known), 3, 0.4)
            raise InputError(f"There is no kernel {name!r}." + (f" Near it: {', '.join(near)}." if near else ""))
    chosen = []
    for case in cases:
        costs = {kernel: cost for kernel, cost in case.costs.items() if words[kernel] & set(names)}
        if costs:
            chosen.append(replace(case, costs=costs))
    return chosen


def _names_of(kernel: str) -> set[str]:
    folder, _, rest = kernel.partition("/")
    file, _, function = rest.partition(".")
    return {kernel, folder, f"{folder}/{file}", file, function}


def errors_of(results: list[Result]) -> Row:
    """The error columns of a stage: real numbers by their distance, whole ones by whether they differ."""
    real: list[tuple[Doubles, Doubles, Doubles]] = []
    whole: list[Bools] = []
    for result in results:
        if result.found.shape != result.expected.shape:  # another number of them is that many wrong
            whole.append(np.ones(max(result.found.size, result.expected.size), bool))
        elif result.found.dtype.kind == "f":
            expected = np.asarray(result.expected, np.float64).ravel()
            real.append((result.found.astype(np.float64).ravel(), expected, last_places(expected)))
        else:
            whole.append(whole_differ(result))
    row: Row = dict.fromkeys(("max_error", "mean_error", "p999_error", "max_ulp", "mean_ulp", "p999_ulp", "broken"))
    row |= {"values": 0, "whole_values": None, "misassigned": None}
    if whole:
        row |= {"whole_values": sum(map(len, whole)), "misassigned": int(sum(part.sum() for part in whole))}
    if real:
        found, expected, places = (np.concatenate(parts) for parts in zip(*real, strict=True))
        row |= {"values": len(found)} | _distances(found, expected, places)
    return row


def last_places(values: Doubles) -> Doubles:
    """Units of the last place of float32, float64 (n): of each of values (n), but of at least 2^-10 of the largest,
    because what cancels to nothing has no digits of its own."""
    size = np.abs(values)
    largest = size[np.isfinite(size)].max(initial=0.0)
    size = np.clip(size, 2.0**-10 * largest, 2.0**127)
    places: Doubles = np.spacing(np.nan_to_num(size).astype(np.float32)).astype(np.float64)
    return places


def _distances(found: Doubles, expected: Doubles, places: Doubles) -> Row:
    finite = np.isfinite(found) & np.isfinite(expected)
    broken = int(broken_values(found, expected).sum())
    if not finite.any():
        return {"broken": broken}
    error = np.abs(found - expected)[finite]
    ulp = error / places[finite]
    row: Row = {"broken": broken}
    for name, values in (("error", error), ("ulp", ulp)):
        row |= {
            f"max_{name}": float(values.max()),
            f"mean_{name}": float(values.mean()),
            f"p999_{name}": float(np.quantile(values, 0.999)),
        }
    return row


def measure_case(case: Case, kind: str, devices: dict[str, Device], repeat: int) -> list[Row]:
    """The rows of a case on one input: every kernel in every variant, the variants timed in turn.

    Without the shares of the roofline, which `add_shares` adds.
    """
    errors: dict[str, Row] = {}
    trials: dict[str, Trial] = {}
    for variant, device in devices.items():
        errors[variant] = errors_of(case.make(device, kind, case.checked).results())
        trials[variant] = case.make(device, kind, case.size)
        trials[variant].run()
    times: dict[tuple[str, str], list[float]] = {}
    for _ in range(repeat):
        for variant, device in devices.items():
            with device.record() as record:
                trials[variant].run()
            for kernel in case.costs:
                if kernel in record.kernels:
                    times.setdefault((kernel, variant), []).append(record.kernels[kernel])
    rows = []
    for kernel, cost in case.costs.items():
        for variant, trial in trials.items():
            row: Row = {"kernel": kernel, "case": case.name, "input": kind, "variant": variant}
            spent = times.get((kernel, variant))
            row |= _speed(cost, trial.counts, median(spent) if spent else None) | errors[variant]
            rows.append(row)
    return rows


def _speed(cost: Cost, counts: Mapping[str, float], milliseconds: float | None) -> Row:
    """The columns about work and time; no time where this input does not need the kernel."""
    items = evaluate(cost.items, counts)
    return {
        "ms": milliseconds,
        "items": items,
        "items_formula": cost.items,
        "items_per_s": items * 1e3 / milliseconds if milliseconds else None,
        "bytes": evaluate(cost.bytes, counts),
        "bytes_formula": cost.bytes,
        "flops": evaluate(cost.flops, counts) if cost.flops else None,
        "flops_formula": cost.flops or None,
    }


def add_shares(rows: list[Row], roofline: Roofline) -> None:
    """Add each kernel's share of what the device can do at best."""
    for row in rows:
        for share, work, best in (
            ("copy_share", "bytes", roofline.bandwidth),
            ("arithmetic_share", "flops", roofline.arithmetic),
        ):
            known = row["ms"] and row[work] is not None
            row[share] = row[work] * 1e3 / row["ms"] / best if known else None


def bench_kernels(wanted: TimingRequest, out: Path) -> None:
    """Measure, print a table, and write kernels.csv and kernels.html into `out`.

    Raises InputError for unknown kernels and variants, DeviceError for unknown devices.
    """
    cases = choose_cases(wanted.kernels)
    for variant in wanted.variants:
        if variant not in VARIANTS:
            raise InputError(f"There is no build variant {variant!r}: give one of {', '.join(VARIANTS)}.")
    RANGES["repeat"].check(wanted.repeat)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{out} cannot be made ({error.strerror}): give another --out.") from error
    devices = {variant: Device.open(wanted.device, variant) for variant in VARIANTS if variant in wanted.variants}
    reference = devices.get("default") or next(iter(devices.values()))
    tell_passed_over(reference)
    rows, roofline = _measure_all(cases, devices, reference, wanted.repeat)
    about = {
        "Device": reference.name,
        "Driver": reference.description["version"],
        "Copying": f"{roofline.bandwidth / 1e9:.1f} GB/s",
        "Arithmetic": f"{roofline.arithmetic / 1e9:.0f} GFLOP/s",
        "Kernels": str(len({row["kernel"] for row in rows})),
        "Timings": f"median of {wanted.repeat}",
        "Noise": " ".join(noise_warnings()),
    }
    page = write_kernels(out, rows, about, {"bandwidth": roofline.bandwidth, "arithmetic": roofline.arithmetic})
    show_kernels(rows, roofline, page)


def _measure_all(
    cases: list[Case], devices: dict[str, Device], reference: Device, repeat: int
) -> tuple[list[Row], Roofline]:
    """All rows, and the roofline they are shares of, with progress."""
    roofline, rows = measure(reference), []
    with progress_bars(make_console(stderr=True)) as progress:
        task = progress.add_task("", total=len(cases) * len(INPUTS))
        for case in cases:
            for kind in INPUTS:
                progress.update(task, description=f"{case.name}, {kind}")
                rows += measure_case(case, kind, devices, repeat)
                progress.advance(task)
            # A roof is the best ever seen: where others use the machine too, one moment's would be too low.
            again = measure(reference)
            roofline = Roofline(max(roofline.bandwidth, again.bandwidth), max(roofline.arithmetic, again.arithmetic))
    add_shares(rows, roofline)
    return rows, roofline


def show_kernels(rows: list[Row], roofline: Roofline, page: Path) -> None:
    """Print one line per kernel, and what the variants cost and gain."""
    console = make_console()
    table = make_table("kernels", "kernel", "ms", "M/s", "copy", "arith", "typical", "hard", "relaxed")
    for column in table.columns[1:]:
        column.justify, column.no_wrap = "right", True
    groups, file = by_variant(rows), ""
    for kernel in dict.fromkeys(row["kernel"] for row in rows):
        typical, hard = (groups.get((kernel, kind), {}) for kind in INPUTS)
        first = typical.get("default") or next(iter(typical.values()))
        other = hard.get("default") or next(iter(hard.values()))
        fast = typical.get("relaxed")
        ratio = fast["ms"] / first["ms"] if fast and fast["ms"] and first["ms"] else None
        speed = (_percent(first["copy_share"]), _percent(first["arithmetic_share"]))
        if file != (file := kernel.rpartition(".")[0]):
            table.add_row(styled("[bold]{}[/]", file))
        milliseconds = "" if first["ms"] is None else f"{first['ms']:.3g}"
        rate = "" if first["items_per_s"] is None else f"{first['items_per_s'] / 1e6:,.4g}"
        errors = (_wrong(first), _wrong(other), "" if ratio is None else f"x{ratio:.2f}")
        table.add_row(f"  {kernel.rpartition('.')[2]}", milliseconds, rate, *speed, *errors)
    console.print(table)
    console.print(
        styled(
            "[dim]M/s: million items per second. copy, arith: share of {:.1f} GB/s copied and of "
            "{:.0f} GFLOP/s, measured in this run. typical, hard: 99.9-percentile error in each value's "
            "own ULP, or share of misassigned values (%). relaxed: time over the default's.[/]",
            roofline.bandwidth / 1e9,
            roofline.arithmetic / 1e9,
        )
    )
    for found in compare_variants(rows):
        worse, better = len(found["worse"]), len(found["better"])
        console.print(
            f"{found['variant']}: {found['time']:.2f} times the default's time; of {found['stages']} stages and inputs "
            f"it errs clearly more in {worse}, clearly less in {better}."
        )
    console.print(styled("[bold]{}[/]  kernels.csv", page), soft_wrap=True)


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.0f}%"


def _wrong(row: Row) -> str:
    """The error in a few characters."""
    if row["misassigned"] or row["p999_ulp"] is None:
        return f"{100 * (row['misassigned'] or 0) / max(row['whole_values'] or 1, 1):.2g}%"
    return f"{row['p999_ulp']:.3g}"
