"""The stages that `bench kernels` measures and `bench doctor --devices` checks: shared ones, and all methods' own."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.plugins import GROUP
from shading_atlas_bench.kernels.case import INPUTS, NOTHING, Case, Distance, Result, cases_in, distance, shared_cases
from shading_atlas_bench.kernels.device import METHOD_KERNELS

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.interface import Packer

MODULE = f"{METHOD_KERNELS}.cases"  # in the package of a packer


def find_cases() -> list[Case]:
    """The cases of all stages, folder by folder: a method's are in the module `kernels.cases` of its package, if any.

    Raises InputError where a package's cannot be imported.
    """
    packages = sorted({_package(entry.module) for entry in entry_points(group=GROUP)})
    own = [case for package in packages for case in _cases_of(package)]
    return sorted([*shared_cases(), *own], key=lambda case: case.name.partition("/")[0])


def own_cases(packer: type[Packer]) -> list[Case]:
    """The cases of a packer's own kernels: of the package that its module is or lies in; none of a single file's.

    Raises InputError where they cannot be imported.
    """
    return _cases_of(_package(packer.__module__))


def against_twin(device: Device, case: Case, kind: str) -> Distance:
    """How far a case's kernels are from their twin on one of INPUTS; infinitely where a second run gives other values,
    or where there are none on typical input.

    Raises what the case does.
    """
    trial = case.make(device, kind, case.checked)
    trial.run()  # the first leaves something that later ones forget
    results = trial.results()
    if kind == INPUTS[0] and not any(result.found.size for result in results):
        return Distance(np.inf, NOTHING)
    apart = distance(results, case.bounds[kind])
    return apart if _same(results, trial.results()) else Distance(np.inf, "a second run gives other values")


def _same(first: Sequence[Result], second: Sequence[Result]) -> bool:
    """Whether a device gave the same bytes twice."""
    pairs = zip(first, second, strict=True)
    return all(np.array(one.found).tobytes() == np.array(other.found).tobytes() for one, other in pairs)


def _package(module: str) -> str:
    """The package that a module is or lies in; empty for one that stands alone.

    Raises InputError where what it lies in cannot be imported.
    """
    try:
        spec = find_spec(module)
    except ImportError as error:
        raise InputError(f"The packer's module {module!r} cannot be imported: {error}.") from error
    is_plain = spec is not None and spec.submodule_search_locations is None
    return module.rpartition(".")[0] if is_plain else module


def _cases_of(package: str) -> list[Case]:
    """The cases of the packers of one package."""
    try:
        if not package or not find_spec(f"{package}.{METHOD_KERNELS}") or not find_spec(f"{package}.{MODULE}"):
            return []
        return cases_in(import_module(f"{package}.{MODULE}"))
    except ImportError as error:
        raise InputError(f"The kernels of the package {package!r} cannot be imported: {error}.") from error
