"""What it takes to measure a kernel stage: inputs, a launch, its twin, and formulas for the work of each kernel.

Each folder of kernels has a `cases.py` with one case per stage; `bench kernels` runs them all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from arithmetic.functions import log2
from kernels.device import ROOT

if TYPE_CHECKING:
    from kernels.device import Device

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
    """Values of a launch beside those of the twin, of equal shape; whole numbers where `found` are."""

    found: np.ndarray
    expected: np.ndarray


@dataclass(frozen=True)
class Trial:
    """A case with its input on a device. counts: the formulas' numbers. run: launches everything once.

    results: runs and compares with the twin.
    """

    counts: Mapping[str, float]
    run: Callable[[], Any]
    results: Callable[[], list[Result]]


@dataclass(frozen=True)
class Case:
    """A stage to measure. costs: by kernel, file.function in the case's own folder.

    make: the trial for a device, one of INPUTS and a size. size: for timing. checked: for the twin, which is slow.
    """

    name: str
    make: Callable[[Device, str, int], Trial]
    costs: Mapping[str, Cost]
    size: int
    checked: int


def case(
    costs: Mapping[str, Cost], size: int, checked: int | None = None
) -> Callable[[Callable[[Device, str, int], Trial]], Case]:
    """Make a function of a device, an input and a size a case, named after its folder and itself."""

    def wrap(make: Callable[[Device, str, int], Trial]) -> Case:
        folder = make.__module__.split(".")[-2]
        named = {f"{folder}/{kernel}": cost for kernel, cost in costs.items()}
        return Case(f"{folder}/{make.__name__}", make, named, size, checked or size)

    return wrap


def find_cases() -> list[Case]:
    """The cases of all folders, by name."""
    modules = [import_module(f"kernels.{file.parent.name}.cases") for file in sorted(ROOT.glob("*/cases.py"))]
    return [value for module in modules for value in vars(module).values() if isinstance(value, Case)]


def evaluate(formula: str, counts: Mapping[str, float]) -> float:
    """The value of a cost's formula."""
    return float(eval(formula, {"__builtins__": {}}, {**FUNCTIONS, **counts}))  # the suite's own text


def seeded(kind: str) -> np.random.Generator:
    """The random numbers of an input: the same for every device and variant."""
    return np.random.default_rng(INPUTS.index(kind))
