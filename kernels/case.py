"""What it takes to measure a kernel stage: inputs, a launch, its twin, and formulas for the work of each kernel.

Each folder of kernels, shared ones and a method's, has a `cases.py` with one case per stage; `bench kernels` runs them
all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Bools, Doubles
from shading_atlas_bench.arithmetic.functions import log2
from shading_atlas_bench.kernels.device import METHOD_KERNELS, ROOT

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device

INPUTS = ("typical", "adversarial")
# What formulas may call.
FUNCTIONS = {"log2": log2, "max": max, "min": min}


@dataclass(frozen=True)
class Cost:
    """The work of one kernel in one run of its case, as formulas over the trial's counts.

    items: what it processes. bytes: that it must read and write at least, each once. flops: additions and
    multiplications where they are what it is for, else empty; both are of the algorithm, whatever the compiler does.
    """

    items: str
    bytes: str
    flops: str = ""


@dataclass(frozen=True)
class Result:
    """Values of a launch, found, beside those of the twin, expected: of equal shapes and any numbers, whole ones where
    `found` are."""

    found: Array
    expected: Array


@dataclass(frozen=True)
class Bound:
    """How far results may be from the twin's.

    ulp: the largest error of real values, in units of the last place of float32 that the largest value of the twin has
    in the same Result: kernels err by what they add up, whatever is left of it. spared: the share of real values that
    may err more, where rounding decides between values far apart. wrong: the share of whole values that may differ.
    No bound allows other shapes, or values that are NaN or an infinity on one side only.
    """

    ulp: float = 0.0
    spared: float = 0.0
    wrong: float = 0.0


EXACT = Bound()
NOTHING = "it compares nothing"


@dataclass(frozen=True)
class Distance:
    """How far results are from the twin's. over: the worst error over its bound, up to 1 where all is well; infinite
    where none is allowed. what: that error in words."""

    over: float
    what: str


@dataclass(frozen=True)
class Trial:
    """A case with its input on a device. counts: the formulas' numbers. run: launches everything once.

    results: runs and compares with the twin.
    """

    counts: Mapping[str, float]
    run: Callable[[], object]
    results: Callable[[], list[Result]]


@dataclass(frozen=True)
class Case:
    """A stage to measure. costs: by kernel, file.function in the case's own folder.

    make: the trial for a device, one of INPUTS and a size. size: for timing. checked: for the twin, which is slow.
    bounds: of the error at that size, by input: about twice the error of correctly rounded arithmetic in the order that
    the kernel states, which is the same on every device.
    """

    name: str
    make: Callable[[Device, str, int], Trial]
    costs: Mapping[str, Cost]
    size: int
    checked: int
    bounds: Mapping[str, Bound]


def case(
    costs: Mapping[str, Cost],
    size: int,
    checked: int | None = None,
    *,
    typical: Bound = EXACT,
    adversarial: Bound | None = None,
) -> Callable[[Callable[[Device, str, int], Trial]], Case]:
    """Make a function of a device, an input and a size a case, named after its folder and itself.

    typical, adversarial: what may differ from the twin on these inputs: nothing, unless it is said; the second is like
    the first unless it is said.
    """
    bounds = dict(zip(INPUTS, (typical, typical if adversarial is None else adversarial), strict=True))

    def wrap(make: Callable[[Device, str, int], Trial]) -> Case:
        *_, method, folder, _ = ("", *make.__module__.split("."))
        folder = method if folder == METHOD_KERNELS else folder
        named = {f"{folder}/{kernel}": cost for kernel, cost in costs.items()}
        return Case(f"{folder}/{make.__name__}", make, named, size, checked or size, bounds)

    return wrap


def distance(results: Iterable[Result], bound: Bound) -> Distance:
    """How far results are from the twin's, of the real and the whole values whichever is worse; infinitely for none."""
    ulps: list[Doubles] = []
    differs: list[Bools] = []
    for result in results:
        if result.found.shape != result.expected.shape:
            return Distance(np.inf, _other_shape(result))
        if result.found.dtype.kind != "f":
            differs.append(whole_differ(result))
            continue
        found, expected = (np.asarray(values, np.float64).ravel() for values in (result.found, result.expected))
        if broken := int(broken_values(found, expected).sum()):
            return Distance(np.inf, f"{broken} of {len(found)} values are NaN or an infinity on one side only")
        finite = np.isfinite(expected)
        unit = np.spacing(np.abs(expected[finite]).max(initial=0.0).astype(np.float32)).astype(np.float64)
        ulps.append(np.abs(found[finite] - expected[finite]) / unit)
    if not ulps and not differs:
        return Distance(np.inf, NOTHING)
    return max((_real(ulps, bound), _whole(differs, bound)), key=lambda one: one.over)


def whole_differ(result: Result) -> Bools:
    """Which whole values of a result, of equal shapes, are not the twin's, bool (n); real ones of it are rounded."""
    found, expected = result.found.ravel(), result.expected.ravel()
    if expected.dtype.kind != "f":
        return np.asarray(found != expected)
    rounded = np.rint(expected)
    with np.errstate(invalid="ignore"):  # what does not come back is no value of that type
        whole = rounded.astype(found.dtype)
    return np.asarray((found != whole) | (whole.astype(rounded.dtype) != rounded))


def broken_values(found: Doubles, expected: Doubles) -> Bools:
    """Which values (n) are NaN or an infinity on one side, and not the same on the other, bool (n)."""
    same = (found == expected) | (np.isnan(found) & np.isnan(expected))
    return np.asarray(~(same | (np.isfinite(found) & np.isfinite(expected))))


def _other_shape(result: Result) -> str:
    found, expected = result.found, result.expected
    if found.size != expected.size:
        return f"{found.size} values, where the twin has {expected.size}"
    return f"values of shape {found.shape}, where the twin has {expected.shape}"


def _real(parts: list[Doubles], bound: Bound) -> Distance:
    errors = np.sort(np.concatenate([*parts, np.zeros(1)]))[::-1]
    worst = float(errors[int(bound.spared * (len(errors) - 1))])
    spared = f" for all but {bound.spared:.2%}" if bound.spared else ""
    return Distance(
        _ratio(worst, bound.ulp), f"off by {worst:.4g} ulp of the largest value; the bound is {bound.ulp:g}{spared}"
    )


def _whole(parts: list[Bools], bound: Bound) -> Distance:
    count, total = sum(int(part.sum()) for part in parts), sum(map(len, parts))
    text = f"{count} of {total} whole values differ; the bound is {bound.wrong * total:.4g}"
    return Distance(_ratio(count / max(total, 1), bound.wrong), text)


def _ratio(error: float, bound: float) -> float:
    return error / bound if bound else np.inf if error else 0.0


def cases_in(module: ModuleType) -> list[Case]:
    """The cases that a module holds, in its order."""
    return [value for value in vars(module).values() if isinstance(value, Case)]


def shared_cases() -> list[Case]:
    """The cases of all stages that methods share, folder by folder."""
    files = sorted(ROOT.glob("*/cases.py"))
    return [one for file in files for one in cases_in(import_module(f"{__package__}.{file.parent.name}.cases"))]


def evaluate(formula: str, counts: Mapping[str, float]) -> float:
    """The value of a cost's formula."""
    return float(eval(formula, {"__builtins__": {}}, {**FUNCTIONS, **counts}))  # the suite's own text


def seeded(kind: str) -> np.random.Generator:
    """The random numbers of an input: the same for every device and variant."""
    return np.random.default_rng(INPUTS.index(kind))
