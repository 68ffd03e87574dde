"""The methods of a run, imported and made: that runs anybody's code, which has a time for it and no more."""

from __future__ import annotations

import inspect
from pathlib import Path

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.plugins import SPEC, load_packer, packer_names, variant_string
from shading_atlas_bench.harness.watch.watchdog import answer_within
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.packers.interface import Packer

LEAST = 10.0  # seconds that importing and making a packer may always take: libraries do, however short packing is
USUAL = Settings.timeout


def making_limit(timeout: float) -> float:
    """The seconds that importing or making a packer may take where one packing may take `timeout`."""
    return max(timeout, LEAST)


def load_in_time(spec: str, timeout: float = USUAL) -> list[Packer]:
    """The packers that a `--method` argument means, see plugins.load_packer.

    Raises InputError for one that cannot be used, and for one that does not let itself be imported and made in time.
    """
    parts = SPEC.fullmatch(spec.strip())
    alone = packer_names() if parts and parts["target"].strip() == "all" else []  # so that the one that hangs is named
    found: list[Packer] = []
    for one in (*alone, spec):
        with answer_within(making_limit(timeout), one, "importing and making it"):
            try:
                found = load_packer(one)
            except ValueError as error:
                raise InputError(str(error)) from error
    return found


def installed_in_time() -> dict[str, type[Packer]]:
    """All installed packers by name. Raises InputError as `load_in_time`."""
    return {name: type(packer) for name in packer_names() for packer in load_in_time(name)}


def find_methods(settings: Settings) -> list[Packer]:
    """The packers of `--method`, each once, in the order given. Raises InputError."""
    found: dict[tuple[str, str], Packer] = {}
    places: dict[str, str] = {}
    for spec in settings.methods:
        for packer in load_in_time(spec, settings.timeout):
            place = f"{Path(inspect.getfile(type(packer))).resolve()}:{type(packer).__qualname__}"
            if places.setdefault(packer.name, place) != place:
                raise InputError(
                    f"Two packers are called {packer.name!r}: {places[packer.name]} and {place}. Give one another name."
                )
            found.setdefault((packer.name, variant_string(packer)), packer)
    return list(found.values())
