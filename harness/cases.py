"""The stages that `bench kernels` measures and `bench doctor --devices` checks: shared ones, and all methods' own."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib import import_module
from importlib.util import find_spec
from itertools import accumulate
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.plugins import find_packers
from shading_atlas_bench.harness.watch.watchdog import answer_within
from shading_atlas_bench.kernels.case import INPUTS, NOTHING, Case, Distance, Result, cases_in, distance, shared_cases
from shading_atlas_bench.kernels.device import METHOD_KERNELS

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.interface import Packer

MODULE = f"{METHOD_KERNELS}.cases"  # in the package of a packer
LIMIT = 60.0  # seconds for importing all of them


def find_cases() -> list[Case]:
    """The cases of all stages, folder by folder: those that methods share, and every installed packer's own.

    Raises InputError where a packer or its package's cases cannot be imported, and where two cases have one name, or
    measure kernels of one name.
    """
    with answer_within(LIMIT, "An installed packer", "importing it with its cases"):
        try:
            modules = {packer.__module__ for packer in find_packers().values()}
        except ValueError as error:
            raise InputError(str(error)) from error
        packages = {package for module in modules for package in _packages(module)}
        found = [*shared_cases(), *_cases_of(packages)]
    named: dict[str, Case] = {}
    for case in found:
        for name in (case.name, *case.costs):
            if (other := named.setdefault(name, case)) is not case:
                raise InputError(
                    f"{other.make.__module__} and {case.make.__module__} both measure {name}: rename the package of "
                    "one, or its case or its kernel's file."
                )
    return sorted(found, key=lambda case: case.name.partition("/")[0])


def own_cases(packer: type[Packer]) -> list[Case]:
    """The cases of a packer's own kernels: in the module `kernels.cases` of the package that its class's module is or
    lies in, and of those above it; none of a single file's.

    Raises InputError where they cannot be imported.
    """
    return _cases_of(_packages(packer.__module__))


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


def _packages(module: str) -> list[str]:
    """The package that a module is or lies in and those above it; none for one that stands alone.

    Raises InputError where what it lies in cannot be imported.
    """
    try:
        spec = find_spec(module)
    except ImportError as error:
        raise InputError(f"The packer's module {module!r} cannot be imported: {error}.") from error
    is_plain = spec is not None and spec.submodule_search_locations is None
    names = list(accumulate(module.split("."), "{}.{}".format))
    return names[:-1] if is_plain else names


def _cases_of(packages: Iterable[str]) -> list[Case]:
    """The cases of packages, each once."""
    found: dict[int, Case] = {}  # one package's module may import another's
    for package in sorted(packages):
        try:
            if find_spec(f"{package}.{METHOD_KERNELS}") and find_spec(f"{package}.{MODULE}"):
                found |= {id(case): case for case in cases_in(import_module(f"{package}.{MODULE}"))}
        except ImportError as error:
            raise InputError(f"The kernels of the package {package!r} cannot be imported: {error}.") from error
    return list(found.values())
