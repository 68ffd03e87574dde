"""The grid of a sweep: which method runs with which parameters and settings, in which order."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.plugins import label_of, nearest, parse_value, value_text, variant_string
from shading_atlas_bench.harness.watch.watchdog import answer_within
from shading_atlas_bench.harness.workload.methods import find_methods, making_limit
from shading_atlas_bench.harness.workload.settings import CELLS, Settings, SettingsError, parse_pair, parse_size
from shading_atlas_bench.packers.interface import Packer

Values = dict[str, Any]


@dataclass(frozen=True)
class Setting:
    """A setting of a run that can be varied. read: a value's text to fields of Settings.

    work: whether it sets the work to be done, so that only cells which agree in it can be compared; the others are
    choices, and mean nothing to a method without an atlas.
    """

    read: Callable[[str], Values]
    work: bool
    example: str


def _read_size(text: str) -> Values:
    width, height = parse_size(text, "--vary size", "960x540")
    return {"width": width, "height": height}


def _read_atlas(text: str) -> Values:
    width, height = parse_size(text, "--vary atlas", "2048x1024 or 2048", square=True)
    return {"atlas_width": width, "atlas_height": height}


def _read_samples(text: str) -> Values:
    return {"samples_per_pixel": _read_number("samples")(text)["samples"]}


def _read_cell(text: str) -> Values:
    cell = CELLS.get(text)
    radius, fov = (cell.radius, cell.fov) if cell else parse_pair(text.replace(":", "/"), "/", "--vary cell", "0.1/90")
    return {"cell_radius": radius, "cell_fov": fov}


def _read_crf(text: str) -> Values:
    crf = int(_read_number("crf", int)(text)["crf"])
    return {"crf": (crf,), "display_crf": crf}


def _read_number(name: str, kind: type = float) -> Callable[[str], Values]:
    def read(text: str) -> Values:
        try:
            return {name: kind(text)}
        except ValueError:
            what = "a whole number" if kind is int else "a number"
            raise SettingsError(f"--vary {name} has the value {text!r}: give {what}.") from None

    return read


SETTINGS = {
    "atlas": Setting(_read_atlas, False, "1024,2048x1024"),
    "samples": Setting(_read_samples, False, "1,2,4"),
    "crf": Setting(_read_crf, False, "15,25,35"),
    "cell": Setting(_read_cell, True, "0.08/80,0.2/125,pvs1"),
    "size": Setting(_read_size, True, "480x270,960x540"),
    "fov": Setting(_read_number("fov"), True, "60,90"),
    "latency": Setting(_read_number("latency"), True, "20,50,100"),
    "pvs_density": Setting(_read_number("pvs_density"), True, "1,2"),
    "scene": Setting(lambda text: {"scene": text}, True, "hall,village"),
}
ALIASES = {"display_crf": "crf", "density": "pvs_density"}


@dataclass(frozen=True)
class SweepCell:
    """One cell of the grid: a method with its parameters, under one set of settings.

    contender: what the method is called without what is varied, so that two settings of one method compete.
    varied: what was varied, by name, as text; only what concerns this method. work: the part of it that sets the work.
    """

    contender: str
    packer: Packer
    settings: Settings
    varied: dict[str, str]
    work: dict[str, str]

    @property
    def key(self) -> tuple[str, str]:
        """Method and variant."""
        return self.packer.name, variant_string(self.packer)

    def fresh(self) -> Packer:
        """A packer of these parameters and no past."""
        return type(self.packer)(**{name: getattr(self.packer, name) for name in self.packer.parameters})


@dataclass(frozen=True)
class SweepGrid:
    """All cells, and combinations that were left out, each with its reason."""

    cells: list[SweepCell]
    left_out: list[tuple[str, str]]

    def folders(self) -> dict[Settings, str]:
        """The folder of the run of each set of settings, numbered in the order of the grid."""
        found: dict[Settings, str] = {}
        for cell in self.cells:
            if cell.settings not in found:
                words = [f"{name}_{value}" for name, value in cell.varied.items() if name in SETTINGS]
                slug = re.sub(r"[^A-Za-z0-9.]+", "_", "-".join(words) or "defaults")[:60].rstrip(".")
                found[cell.settings] = f"cells/{len(found):03d}-{slug}"
        return found

    def scenes(self) -> list[list[SweepCell]]:
        """The cells of each scene, in the order of the grid."""
        by_scene: dict[str, list[SweepCell]] = {}
        for cell in self.cells:
            by_scene.setdefault(cell.settings.scene, []).append(cell)
        return list(by_scene.values())


def shuffled(cells: list[SweepCell], seed: int, turn: int) -> list[SweepCell]:
    """The cells in a random order, another one each turn, so that a machine that drifts favours nobody."""
    return random.Random(f"{seed}/{turn}").sample(cells, len(cells))


def make_grid(settings: Settings, vary: Iterable[str]) -> SweepGrid:
    """The grid of `--vary` arguments, NAME=V1,V2,... or NAME for a parameter's own sweep values.

    Without any, each parameter of each method takes its sweep values in turn, the others at their defaults.
    Settings apply to every method that they concern, a parameter only to the methods that have it.

    Raises InputError or SettingsError for unknown names and unusable values.
    """
    packers = find_methods(settings)
    axes = read_axes(vary, packers)
    if "crf" in axes and settings.codec != "h264":
        raise SettingsError(f"--vary crf is for --codec h264, not {settings.codec}: leave it out.")
    settings = replace(settings, crf=(settings.display_crf,), repeat=1, dump=False)
    if not axes:
        return _once(_one_by_one(packers, settings), [])
    found: list[SweepCell] = []
    left_out: list[tuple[str, str]] = []
    for name in axes:
        without = [p.name for p in packers if not (_concerns(name, p) if name in SETTINGS else name in p.parameters)]
        for method in dict.fromkeys(without):
            why = "it has no atlas" if name in SETTINGS else "it has no such parameter"
            left_out.append((f"{method}, {name}", f"{why}: run once for this axis"))
    combinations = [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]
    for packer in packers:
        for combination in combinations:
            try:
                found.append(_cell(packer, settings, combination))
            except SettingsError as error:
                left_out.append((", ".join(f"{name}={value}" for name, value in combination.items()), str(error)))
    left_out = list(dict.fromkeys(left_out))
    _refuse_useless(axes, found, left_out)
    return _once(found, left_out)


def read_axes(vary: Iterable[str], packers: list[Packer]) -> dict[str, list[str]]:
    """The values of each `--vary` by name, as text; a name that is given again adds values.

    Raises InputError for unknown names, and for those without values.
    """
    parameters = {name: packer.parameters[name] for packer in packers for name in packer.parameters}
    axes: dict[str, list[str]] = {}
    for argument in vary:
        name, equals, text = (part.strip() for part in argument.partition("="))
        name = ALIASES.get(name, name)
        if name not in SETTINGS and name not in parameters:
            known = [*SETTINGS, *sorted(parameters)]
            raise InputError(
                f"--vary {name or argument!r}: no setting or parameter has this name.{nearest(name, known)}"
            )
        values = _split_cells(text) if name == "cell" else [part.strip() for part in text.split(",") if part.strip()]
        if not values and not equals and name in parameters:
            values = [value_text(value) for value in parameters[name].sweep]
        if not values:
            example = SETTINGS[name].example if name in SETTINGS else "V1,V2"
            raise InputError(f"--vary {argument} has no values: give {name}={example}.")
        axes.setdefault(name, []).extend(values)
    return {name: list(dict.fromkeys(values)) for name, values in axes.items()}


def _split_cells(text: str) -> list[str]:
    """View cells: presets, RADIUS/FOV or RADIUS:FOV, or RADIUS,FOV, where the comma also separates cells."""
    parts = [part.strip() for part in text.split(",") if part.strip()]
    cells: list[str] = []
    while parts:
        part = parts.pop(0)
        if part not in CELLS and not re.search("[/:]", part):
            if not parts or parts[0] in CELLS or re.search("[/:]", parts[0]):
                raise InputError(f"--vary cell={text}: {part!r} is half a cell; give RADIUS/FOV like 0.1/90.")
            part = f"{part}/{parts.pop(0)}"
        cells.append(part)
    return cells


def _concerns(name: str, packer: Packer) -> bool:
    return SETTINGS[name].work or packer.atlas


def _cell(packer: Packer, settings: Settings, combination: dict[str, str]) -> SweepCell:
    """The cell of a combination of texts; of choices that mean nothing to a method, the settings stay as they are."""
    fields: Values = {}
    parameters = {name: getattr(packer, name) for name in packer.parameters}
    varied: dict[str, str] = {}
    for name, text in combination.items():
        if name in SETTINGS and _concerns(name, packer):
            fields |= SETTINGS[name].read(text)
        elif name not in SETTINGS and name in parameters:
            parameters[name] = _parameter(packer, name, text)
        else:
            continue
        varied[name] = text
    work = {name: text for name, text in varied.items() if name in SETTINGS and SETTINGS[name].work}
    contender = label_of(packer, [name for name in combination if name not in SETTINGS])
    with answer_within(making_limit(settings.timeout), packer.name, "making it"):
        made = _made(packer, parameters)
    return SweepCell(contender, made, replace(settings, **fields), varied, work)


def _parameter(packer: Packer, name: str, text: str) -> bool | int | float | str:
    try:
        return parse_value(packer.name, name, packer.parameters[name], text)
    except ValueError as error:
        raise InputError(str(error)) from error


def _made(packer: Packer, parameters: Values) -> Packer:
    try:
        return type(packer)(**parameters)
    except ValueError as error:
        raise InputError(str(error)) from error


def _one_by_one(packers: list[Packer], settings: Settings) -> list[SweepCell]:
    """Each packer as it is, then with one parameter at a time at each of its sweep values."""
    found = []
    for packer in packers:
        own, contender = {name: getattr(packer, name) for name in packer.parameters}, label_of(packer)
        found.append(SweepCell(contender, packer, settings, {}, {}))
        for name, parameter in packer.parameters.items():
            for value in parameter.sweep:
                if value != own[name]:
                    varied = {name: value_text(value)}
                    found.append(SweepCell(contender, _made(packer, own | {name: value}), settings, varied, {}))
    return found


def _once(cells: list[SweepCell], left_out: list[tuple[str, str]]) -> SweepGrid:
    """Each method, variant and settings once, in their order. What two contenders have is of the one in which nothing
    is varied, else of the first; the other's is left out."""
    owners: dict[tuple[tuple[str, str], Settings], SweepCell] = {}
    for cell in sorted(cells, key=lambda cell: bool(cell.varied)):
        owners.setdefault((cell.key, cell.settings), cell)
    shared = []
    for cell in cells:
        owner = owners[cell.key, cell.settings]
        if owner.contender != cell.contender:
            varied = ", ".join(f"{name}={text}" for name, text in cell.varied.items())
            shared.append((f"{cell.contender}, {varied}", f"it is a cell of {owner.contender}"))
    return SweepGrid([cell for cell in cells if owners[cell.key, cell.settings] is cell], left_out + shared)


def _refuse_useless(axes: dict[str, list[str]], cells: list[SweepCell], left_out: list[tuple[str, str]]) -> None:
    """Raise for a value of a setting that no combination can use, with the reason."""
    for name in axes:
        for value in axes[name]:
            reasons = [why for what, why in left_out if f"{name}={value}" in what.split(", ")]
            if reasons and not any(cell.varied.get(name) == value for cell in cells):
                raise SettingsError(f"--vary {name}={value} cannot be used: {reasons[0]}")
