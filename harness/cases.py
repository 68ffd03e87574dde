"""The stages that `bench kernels` measures and `bench doctor --devices` checks: shared ones, and all methods' own."""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.plugins import GROUP
from shading_atlas_bench.kernels.case import Case, cases_in, shared_cases
from shading_atlas_bench.kernels.device import METHOD_KERNELS

MODULE = f"{METHOD_KERNELS}.cases"  # in the package of a packer


def find_cases() -> list[Case]:
    """The cases of all stages, folder by folder: a method's are in the module `kernels.cases` of its package, if any.

    Raises InputError where a package's cannot be imported.
    """
    packages = sorted({entry.module for entry in entry_points(group=GROUP)})
    own = [case for package in packages for case in _cases_of(package)]
    return sorted([*shared_cases(), *own], key=lambda case: case.name.partition("/")[0])


def _cases_of(package: str) -> list[Case]:
    """The cases of the packers of one package."""
    try:
        if not getattr(import_module(package), "__path__", None) or not find_spec(f"{package}.{METHOD_KERNELS}"):
            return []
        return cases_in(import_module(f"{package}.{MODULE}")) if find_spec(f"{package}.{MODULE}") else []
    except ImportError as error:
        raise InputError(f"The kernels of the package {package!r} cannot be imported: {error}.") from error
