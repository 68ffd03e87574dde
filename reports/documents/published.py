"""Published numbers beside measured ones: at the methods' defaults, as published, and at equal samples."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shading_atlas_bench.reports.documents.digests import RunResults
from shading_atlas_bench.reports.documents.kept import ROWS, DocumentError, Parts, Row
from shading_atlas_bench.reports.store.columns import BY_NAME
from shading_atlas_bench.reports.store.labels import read_labels
from shading_atlas_bench.reports.store.results import Store

FILE = Path(__file__).parents[1] / "published.toml"
CELLS = ("pvs1", "pvs2", "pvs3")  # of SnakeBinning's table 1
TRIANGLES = {"RL": 472_000, "VV": 4_600_000}  # of the published scenes, SnakeBinning's figure 10
STANDS_FOR = {"hall": "RL", "viking_village": "VV", "village": "VV"}  # our scene to the published one
SETTINGS = ("as_published", "default", "equal")
ALIKE = 1.5  # a ratio of measured over published within 1/ALIKE and ALIKE
WORSE_FROM_ONE = "iwssim"  # compared by how much it lacks to 1
TIMED = ("structs_share",)
EXPECTED = ("where", "unit", "compared", "claims")


@dataclass(frozen=True)
class Quantity:
    """A number that a paper has for several methods. values: by method and published scene, one per cell.

    compared: one method, or two of which the first is divided by the second; claims: as many lists of ids, or of
    sections of the document, `#the-section`, that test the cause."""

    paper: str
    name: str
    where: str
    unit: str
    values: dict[str, dict[str, list[float]]]
    compared: list[list[str]]
    claims: list[list[str]]

    def published(self, methods: Sequence[str], scene: str) -> list[float | None]:
        """The number of the first method, over that of the second if there is one, in each cell."""
        found = [self.values[method].get(STANDS_FOR.get(scene, "")) for method in methods]
        if None in found:
            return [None] * len(CELLS)
        return [_over(list(each)) for each in zip(*found, strict=True)]


@dataclass(frozen=True)
class Measured:
    """The runs of one scene and cell. usual: with each method at its defaults and as published; equal: at the samples
    that SnakeBinning has there in its paper."""

    usual: RunResults
    equal: RunResults
    published: dict[str, str]  # method to its variant as published

    def value(self, quantity: Quantity, methods: Sequence[str], setting: str) -> float | None:
        """What was measured of the first method at a setting, over that of the second if there is one; None where it is
        unknown."""
        return _over([self._one(quantity.name, method, setting) for method in methods])

    def _one(self, name: str, method: str, setting: str) -> float | None:
        results = self.equal if setting == "equal" else self.usual
        own = [key for key in results.keys if key[0] == method]
        variant = self.published.get(method)
        chosen = [key for key in own if (key[1] == variant) == (setting == "as_published")] or own
        value = (results.median if name in BY_NAME else results.statistic)(chosen[0] if chosen else None, name)
        return 1 - value if value is not None and name == WORSE_FROM_ONE else value


def read_published(file: Path = FILE) -> list[Quantity]:
    """The published numbers, in the order of the file."""
    content = tomllib.loads(file.read_text(encoding="utf-8"))
    return [
        Quantity(paper, name, **{key: entry.pop(key) for key in EXPECTED}, values=entry)
        for paper, quantities in content.items()
        for name, entry in quantities.items()
    ]  # fmt: skip


def published_parts(folders: Sequence[Path]) -> Parts:
    """Runs in threes of cells, each cell with a run at the methods' settings and one at equal samples: a table per
    paper, and every number by cell.

    Raises DocumentError for another number of runs, and for cells of several scenes taken for those of one.
    """
    if len(folders) % (2 * len(CELLS)):
        raise DocumentError(f"Published numbers take two runs for each of {len(CELLS)} cells of a scene.")
    runs = [_measured(*folders[at : at + 2]) for at in range(0, len(folders), 2)]
    scenes = [runs[at : at + len(CELLS)] for at in range(0, len(runs), len(CELLS))]
    for cells in scenes:
        of = dict.fromkeys(results.scene for cell in cells for results in (cell.usual, cell.equal))
        if len(of) > 1:
            raise DocumentError(
                f"Runs of {' and '.join(of)} are taken for cells of one scene: give them in their order."
            )
    parts: Parts = {"cells": []}
    for quantity in read_published():
        for methods, claims in zip(quantity.compared, quantity.claims, strict=True):
            for cells in scenes:
                numbers = list(_numbers(quantity, methods, cells))
                parts["cells"] += numbers
                parts.setdefault(quantity.paper, []).append(_line(quantity, methods, claims, numbers))
    return parts


def cause_parts(folders: Sequence[Path]) -> Parts:
    """Runs of SnakeBinning as published and at shading rate 1, a cell of a scene each: visible triangles and samples
    beside the published ones, and whether the atlas was full."""
    of = {quantity.name: quantity for quantity in read_published() if quantity.paper == "snakebinning-2021"}
    rows = []
    for place, folder in enumerate(folders):
        results, number = RunResults(folder), place % len(CELLS)
        row: Row = {"scene": results.scene, "cell": CELLS[number]}
        keys = {("shading_rate=1.0" in variant): (method, variant) for method, variant in results.keys}
        for name, quantity, key in (
            ("triangles", of["pvs_triangles"], keys.get(False)),
            ("samples", of["samples"], keys.get(False)),
            ("samples_rate_1", of["samples"], keys.get(True)),
        ):
            value, of_paper = (
                results.median(key, quantity.name),
                quantity.published(["snakebinning"], results.scene)[number],
            )
            full = ", full" if results.statistic(key, "atlas_full") else ""
            row |= {name: value, f"{name}_ratio": _over([value, of_paper]), f"{name}_full": full}
        rows.append(row)
    return {ROWS: rows}


def _measured(usual: Path, equal: Path) -> Measured:
    with Store(usual, must_exist=True) as store:
        published = {
            method: variant for (method, variant), label in read_labels(store).items() if label == f"{method}@published"
        }
    return Measured(RunResults(usual), RunResults(equal), published)


def _numbers(quantity: Quantity, methods: Sequence[str], cells: Sequence[Measured]) -> Iterator[Row]:
    """A row per cell: published, and measured at each setting."""
    scene = cells[0].usual.scene
    for cell, published, measured in zip(CELLS, quantity.published(methods, scene), cells, strict=True):
        row: Row = {"paper": quantity.paper, "quantity": _title(quantity, methods), "scene": scene, "cell": cell}
        row |= {setting: measured.value(quantity, methods, setting) for setting in SETTINGS}
        yield row | {"published": published, "machine": quantity.name.endswith("_ms") or quantity.name in TIMED}


def _line(quantity: Quantity, methods: Sequence[str], claims: Sequence[str], numbers: Sequence[Row]) -> Row:
    """The cells of one scene as the document shows them; those unlike the published one are bold."""
    first = numbers[0]
    row: Row = {name: first[name] for name in ("quantity", "scene", "machine")}
    row["published"] = ", ".join(_short(each["published"]) for each in numbers)
    for setting in SETTINGS:
        row[setting] = ", ".join(_short(each[setting], is_unlike(each, setting)) for each in numbers)
    unlike = any(is_unlike(each, SETTINGS[0]) for each in numbers)
    return row | {"where": quantity.where, "claims": ", ".join(map(_cause, claims)) if unlike else ""}


def _cause(named: str) -> str:
    """A claim's id as code, a section of the same document as a link."""
    return f"[below]({named})" if named.startswith("#") else f"`{named}`"


def is_unlike(row: Row, setting: str) -> bool:
    """Whether what was measured at a setting is not within ALIKE of what was published."""
    published, measured = row["published"], row[setting]
    return bool(published and measured) and not 1 / ALIKE <= measured / published <= ALIKE


def _title(quantity: Quantity, methods: Sequence[str]) -> str:
    return f"{quantity.unit}: {' / '.join(methods)}"


def _over(values: list[float | None]) -> float | None:
    first, *rest = values
    if not rest:
        return first
    return first / rest[0] if first is not None and rest[0] else None


def _short(value: Any, bold: bool = False) -> str:
    if value is None:
        return "-"
    text = f"{value / 1e6:.2f} M" if value >= 1e6 else f"{value:,.0f}" if value >= 1000 else f"{value:.2f}"
    return f"**{text}**" if bold else text
