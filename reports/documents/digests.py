"""Results of commands as the rows that the documents print: medians over the frames, one function per kind of table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import groupby, product
from pathlib import Path
from typing import TypedDict

from shading_atlas_bench.reports.analysis import sweep
from shading_atlas_bench.reports.analysis.claims import (
    CONFIRMED,
    NOT_CONFIRMED,
    NOT_MEASURABLE,
    NOT_MEASURED,
    UNDECIDED,
    Claim,
    Judged,
)
from shading_atlas_bench.reports.documents.kept import ROWS, Parts, Row
from shading_atlas_bench.reports.pages import sweep_words
from shading_atlas_bench.reports.pages.claims_report import short, why_not, write_claims
from shading_atlas_bench.reports.pages.kernels import compare_variants
from shading_atlas_bench.reports.pages.stress import magnitude, matrix
from shading_atlas_bench.reports.store.columns import (
    BY_NAME,
    KERNEL_COLUMNS,
    KEYFRAME,
    MEASURED_STATUSES,
    STRESS_COLUMNS,
    Column,
)
from shading_atlas_bench.reports.store.csv_files import after_keyframe, read_csv, summarise
from shading_atlas_bench.reports.store.data import read_json
from shading_atlas_bench.reports.store.middle import mean, median
from shading_atlas_bench.reports.store.results import FILE as RESULTS
from shading_atlas_bench.reports.store.results import Store

BROKEN_STAGES = ("atlas/lookup", "sas/sides", "metrics/flip", "metrics/delta_e")  # by relaxed arithmetic


class RunResults:
    """The results of one run: medians over its frames, of sizes over those after the keyframe; None where there is no
    value. keys: method and variant of each lane, in the order of the rows."""

    def __init__(self, folder: Path, first: int = 0) -> None:
        """first: the first frame that counts."""
        with Store(folder, must_exist=True) as store:
            self.rows = [r for r in store.rows() if r["frame"] >= first and r["status"] in MEASURED_STATUSES]
            self.statistics = [row for row in store.statistics() if row["frame"] >= first]
            self.scene = next((row["scene"] for row in store.rows()), folder.name)
        self.keys = list(dict.fromkeys((row["method"], row["variant"]) for row in self.rows))

    def median(self, key: tuple[str, str] | None, name: str, coded: bool = False) -> float | None:
        """Of a column: without video coding, or at the rate that the client sees."""
        rows = (
            row for row in self.rows if (row["method"], row["variant"]) == key and (row["codec"] != "none") == coded
        )
        return _median(after_keyframe(name, {row["frame"]: row[name] for row in rows}).values())

    def statistic(self, key: tuple[str, str] | None, name: str) -> float | None:
        """Of a statistic."""
        rows = (row for row in self.statistics if (row["method"], row["variant"]) == key and row["name"] == name)
        return _median(row["value"] for row in rows)

    @property
    def later(self) -> set[int]:
        """The frames after the first of the path."""
        return {row["frame"] for row in self.rows} - {KEYFRAME}

    def mean(
        self, key: tuple[str, str], name: str, coded: bool = False, frames: Collection[int] | None = None
    ) -> float | None:
        """Of a column, over `frames`, by default those after the first."""
        chosen = self.later if frames is None else frames
        rows = (row for row in self.rows if (row["method"], row["variant"]) == key and row["frame"] in chosen)
        return _mean(row[name] for row in rows if (row["codec"] != "none") == coded)

    def mean_statistic(self, key: tuple[str, str], name: str, frames: Collection[int] | None = None) -> float | None:
        """Of a statistic, over `frames`, by default those after the first."""
        chosen = self.later if frames is None else frames
        return _mean(value for frame, value in self._values(key, name).items() if frame in chosen)

    def rebuilt(self, key: tuple[str, str]) -> set[int] | None:
        """The frames after the first in which `rebuilds`, a count of layouts, grew; None without such a count."""
        counts = self._values(key, "rebuilds")
        grew = {frame for frame in self.later & counts.keys() if counts[frame] > counts.get(frame - 1, counts[frame])}
        return grew if counts else None

    def _values(self, key: tuple[str, str], name: str) -> dict[int, float]:
        """A statistic by frame."""
        rows = (row for row in self.statistics if (row["method"], row["variant"]) == key and row["name"] == name)
        return {row["frame"]: row["value"] for row in rows if row["value"] is not None}


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return mean(known) if known else None


def _median(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(median(known)) if known else None


def _ratio(value: float | None, other: float | None) -> float | None:
    return value / other if value is not None and other else None


def sweep_parts(folders: Sequence[Path]) -> Parts:
    """The cells of one sweep, and who wins where."""
    (folder,) = folders
    cells: dict[tuple[str, str], Row] = {}
    points = sweep.read_points(folder)
    coherence = _coherence(folder)
    for point in points:
        of, coded = point.row, point.row["coding"] == "displayed"
        row = cells.setdefault((of["method"], of["varied"]), {"method": of["method"], "varied": of["varied"]})
        end = "" if coded else "_lossless"
        row |= {f"{name}{end}": of[f"{name}_median"] for name in ("flip", "dssim", "psnr")}
        if coded:
            row |= {name: of[name] for name in ("server_ms_median", "server_ms_low", "server_ms_high", "repetitions")}
            row |= {name: of[f"{name}_median"] for name in ("samples", "atlas_mb")}
            row["kbytes"] = of["bytes_total_mean"] and of["bytes_total_mean"] / 1000
            row |= {"status": of["status"], "coherence": coherence.get((of["method"], of["variant"], of["varied"]))}
    winners = []
    for (_, coding), own in sweep.groups(points).items():
        for cost in ("server_ms", "samples", "bytes_total"):
            says = sweep_words.verdict(sweep.candidates(own, cost, "flip")[1], cost, "flip")
            name, unit = sweep_words.COST_NAMES[cost][:2]
            says = says.removeprefix(f"Lowest FLIP error by {name} ({unit}): ")  # which is what the table's head says
            winner = {"coding": sweep_words.CODING_NAMES[coding], "cost": f"{name}, {unit}", "says": says}
            winners.append(winner | {"machine": cost == "server_ms"})
    return {"cells": list(cells.values()), "winners": winners}


def _coherence(folder: Path) -> dict[tuple[str, str, str], float | None]:
    """The median coherence of each cell, by method, variant and what was varied."""
    found = {}
    for cell in sweep.read_sweep(folder)["cells"]:
        varied = " ".join(f"{name}={value}" for name, value in cell["varied"].items())
        key = cell["method"], cell["variant"]
        found[*key, varied] = RunResults(folder / cell["folder"]).median(key, "coherence")
    return found


def transparency_parts(folders: Sequence[Path]) -> Parts:
    """Runs of scenes in pairs, as they are and made opaque: errors side by side, and what is sent and shaded."""
    rows = []
    for seen, opaque in zip(*([RunResults(folder) for folder in folders[k::2]] for k in (0, 1)), strict=True):
        for key in seen.keys:
            row: Row = {"scene": seen.scene, "method": key[0]}
            for end, coded in (("", False), ("_coded", True)):
                own, other = (results.median(key, "flip", coded) for results in (seen, opaque))
                row |= {f"flip{end}": own, f"opaque{end}": other, f"ratio{end}": _ratio(own, other)}
            row["samples"] = _ratio(*(results.median(key, "samples") for results in (seen, opaque)))
            rows.append(row | {"bytes_alpha": seen.median(key, "bytes_alpha", True)})
    return {ROWS: rows}


SWITCHES = {
    "no hysteresis": "hysteresis=false",
    "no spare capacity": "capacity=0",
    "no freezing": "freeze=0",
    "hierarchical mapping": "mapping=hierarchical",
    "linear bins": "logarithmic=false",
    "no perspective": "perspective=false",
    "no slicing": "slicing=0",
    "shading rate 1": "shading_rate=1.0",
}  # of SnakeBinning, flipped one at a time
OURS = {
    "mapping": ("mapping=exact", "mapping=off"),
    "superblock": ("assignment=first", "assignment=best"),
    "enlargement": ("enlarge=paper", "enlarge=exact"),
    "order of orphans": ("orphans=found", "orphans=widest"),
    "points": ("points=false", "points=true"),
    "footprint": ("full_footprint=true", "full_footprint=false"),
}  # where its defaults are not as published: the published value and ours
SETTINGS = {
    "ours": SWITCHES | {f"{label} as published": values[0] for label, values in OURS.items()},
    "published": SWITCHES | {f"{label} of ours": values[1] for label, values in OURS.items()},
}


def switch_parts(folders: Sequence[Path]) -> Parts:
    """Runs of SnakeBinning at our settings and at the published ones, each with one switch flipped at a time, beside
    other methods.

    All means are over the frames after the first, which sends everything; those whose layout was made anew stand apart.
    """
    rows = []
    for (settings, switches), folder in zip(SETTINGS.items(), folders, strict=True):
        results = RunResults(folder)
        ours = [variant for method, variant in results.keys if method == "snakebinning"]
        usual = Counter(part for variant in ours for part in variant.split(","))
        found = {}
        for key in results.keys:
            changed = [part for part in key[1].split(",") if key[1] in ours and usual[part] <= len(ours) / 2]
            labels = [label for label, value in switches.items() if changed[:1] and changed[0].startswith(value)]
            label = (labels or ["none" if key[0] == "snakebinning" else key[0]])[0]
            found[label] = {"settings": settings, "variant": label} | _switched(results, key)
        rows += [found.pop(name) for name in ("none", *switches) if name in found] + list(found.values())
    return {ROWS: rows}


def _switched(results: RunResults, key: tuple[str, str]) -> Row:
    """Means over the frames after the first, and of bytes over those of them that were rebuilt and the others."""
    row: Row = {name: results.mean(key, name) for name in ("samples", "fill", "coherence", "flip", "dssim")}
    row |= {name: results.mean(key, name, coded=True) for name in ("bytes_total", "bytes_video", "bytes_metadata")}
    row |= {name: results.mean_statistic(key, name) for name in ("triangles_moved", "unwritten_lookups", "atlas_full")}
    rebuilt = results.rebuilt(key)
    row["rebuilt"] = None if rebuilt is None else len(rebuilt)
    for end, chosen in (("rebuilt", rebuilt), ("frozen", None if rebuilt is None else results.later - rebuilt)):
        row[f"bytes_{end}"] = results.mean(key, "bytes_total", True, chosen) if chosen else None
        row[f"moved_{end}"] = results.mean_statistic(key, "triangles_moved", chosen) if chosen else None
    return row


def mapping_parts(folders: Sequence[Path]) -> Parts:
    """Runs of SnakeBinning with mapping and without, in several packings: what superblocks take, and in runs that are
    coded, what mapping changes in layouts made anew in every frame and in frozen ones."""
    rows: list[Row] = []
    costs: dict[tuple[str, ...], Row] = {}
    for folder in folders:
        results = RunResults(folder, first=1)
        size = f"{results.rows[0]['width']}x{results.rows[0]['height']}"
        variants = [(dict(part.split("=", 1) for part in key[1].split(",")), key) for key in results.keys]
        found = {tuple(of[n] for n in ("assignment", "orphans", "freeze", "mapping")): key for of, key in variants}
        for assignment, orphans, freeze in dict.fromkeys(place[:3] for place in found):
            off, on = (_packed(results, found.get((assignment, orphans, freeze, value))) for value in ("off", "exact"))
            name = {"scene": results.scene, "size": size, "assignment": assignment, "orphans": orphans}
            if off["bytes"] is None:
                rows.append(name | _areas(off, on))
            else:
                end = "" if float(freeze) == 0 else "_frozen"
                costs.setdefault(tuple(name.values()), name).update(_changes(off, on, end))
    return {ROWS: _by_scene(rows), "costs": _by_scene(costs.values())}


def _by_scene(rows: Iterable[Row]) -> list[Row]:
    """Those of one scene and size together, which several runs may have measured."""
    found = list(rows)
    places = list(dict.fromkeys((row["scene"], row["size"]) for row in found))
    return sorted(found, key=lambda row: places.index((row["scene"], row["size"])))


def _packed(results: RunResults, key: tuple[str, str] | None) -> Row:
    """Texels that superblocks take, and rows of strips in them; what else depends on the packing."""
    row = {name: results.statistic(key, name) for name in ("bins_after_mapping", "triangles_moved", "points")}
    unused, loose = (results.statistic(key, name) for name in ("unallocated", "wasted_in_superblocks"))
    first = results.rows[0]
    row["superblocks"] = None if unused is None else first["atlas_width"] * first["atlas_height"] - unused
    row["strips"] = None if row["superblocks"] is None or loose is None else row["superblocks"] - loose
    return row | {"flip": results.median(key, "flip"), "bytes": results.median(key, "bytes_total", True)}


def _areas(off: Row, on: Row) -> Row:
    """off, on: without and with mapping."""
    row: Row = {"superblocks_off": off["superblocks"], "superblocks": on["superblocks"]}
    for name in ("superblocks", "strips", "bins_after_mapping"):
        ratio = _ratio(on[name], off[name])
        row[f"{name}_freed"] = None if ratio is None else 1 - ratio
    row |= {"triangles_moved_ratio": _ratio(on["triangles_moved"], off["triangles_moved"])}
    # Without points everything has a place at the first step.
    return row | {"flip_ratio": _ratio(on["flip"], off["flip"]), "points": on["points"]}


def _changes(off: Row, on: Row, end: str) -> Row:
    row: Row = {}
    for name in ("triangles_moved", "bytes", "flip"):
        row |= {f"{name}_off{end}": off[name], f"{name}{end}": on[name]}
        row[f"{name}_ratio{end}"] = _ratio(on[name], off[name])
    return row


def strategy_parts(folders: Sequence[Path]) -> Parts:
    """Runs of Tessellated Shading Streaming in several variants: samples, shares, the price of a sample, errors.

    slanted_of_larger: the share of slanted ones among primitives that take more than a texel."""
    rows = []
    for results in map(RunResults, folders):
        variants = [(key, dict(part.split("=", 1) for part in key[1].split(","))) for key in results.keys]
        for key, chosen in sorted(variants, key=lambda variant: float(variant[1]["slanted"])):
            row: Row = {"scene": results.scene, "strategy": chosen["strategy"], "slanted": chosen["slanted"]}
            row["size"] = f"{results.rows[0]['width']}x{results.rows[0]['height']}"
            names = ["scale", "oversampling_share", "oversampling_outside_share", "gather_over_shading"]
            names += ["lpacking_samples", "oversampling_inside", "oversampling_outside"]
            row |= {name: results.statistic(key, name) for name in names}
            primitives, single = (results.statistic(key, name) for name in ("primitives", "single_texels"))
            inside = (row["lpacking_samples"], row["oversampling_inside"])
            row["inside"] = None if None in inside else sum(inside)
            larger = None if primitives is None or single is None else primitives - single
            row["slanted_of_larger"] = _ratio(results.statistic(key, "oversampling_primitives"), larger)
            row |= {name: results.median(key, name, True) for name in ("samples", "dssim", "flip", "bytes_total")}
            rows.append(row | {"flip_lossless": results.median(key, "flip")})
    return {ROWS: rows}


def speed_parts(folders: Sequence[Path]) -> Parts:
    """The two ratios of time that `bench run` prints, per scene and method."""
    rows = []
    for results in map(RunResults, folders):
        for key in results.keys:
            names = ("structs_share", "gather_over_shading")
            rows.append({"scene": results.scene, "method": key[0]} | {n: results.statistic(key, n) for n in names})
    return {ROWS: rows}


def limit_parts(folders: Sequence[Path]) -> Parts:
    """Runs of linked lists as they are by default and in full: what ending them early saves and costs."""
    rows = []
    for results in map(RunResults, folders):
        full = next(key for key in results.keys if "mode=full" in key[1])
        limited = next(key for key in results.keys if key != full)
        row: Row = {"scene": results.scene, "size": f"{results.rows[0]['width']}x{results.rows[0]['height']}"}
        for end, key in (("_full", full), ("", limited)):
            row |= {f"{name}{end}": results.median(key, name) for name in ("bytes_total", "flip", "holes_px")}
        row |= {f"{name}_ratio": _ratio(row[name], row[f"{name}_full"]) for name in ("bytes_total", "flip")}
        rows.append(row | {"server_ratio": _ratio(*(results.median(key, "server_ms") for key in (limited, full)))})
    return {ROWS: rows}


def full_atlas_parts(folders: Sequence[Path]) -> Parts:
    """Runs in atlases of several sizes: what share of the triangles has a place, at which error and with how many
    samples."""
    rows = []
    for results in map(RunResults, folders):
        for key in results.keys:
            row: Row = {
                "atlas": f"{results.rows[0]['atlas_width']}x{results.rows[0]['atlas_height']}",
                "method": key[0],
            }
            row |= {"placed": _ratio(*(results.median(key, f"{name}_triangles") for name in ("placed", "pvs")))}
            rows.append(row | {name: results.median(key, name) for name in ("samples", "flip")})
    return {ROWS: rows}


def equal_parts(folders: Sequence[Path]) -> Parts:
    """Sweeps over the samples per pixel, one per scene: the errors and bytes of every method, and how far the samples
    are from what was asked for where that is more than a twentieth."""
    rows = []
    for folder in folders:
        places = dict.fromkeys(cell["folder"] for cell in sweep.read_sweep(folder)["cells"])
        rows += sorted((_equal(RunResults(folder / place)) for place in places), key=lambda row: row["asked"])
    return {ROWS: rows}


def _equal(results: RunResults) -> Row:
    """One number of samples per pixel."""
    first = results.rows[0]
    asked = {row["method"]: row["sample_budget"] for row in results.rows}
    row: Row = {"scene": results.scene, "asked": max(asked.values()) / (first["width"] * first["height"])}
    off = []
    for key in results.keys:
        method, share = key[0], results.median(key, "samples") / asked[key[0]] - 1
        row |= {f"flip_{method}": results.median(key, "flip"), f"coded_{method}": results.median(key, "flip", True)}
        row[f"kbytes_{method}"] = _ratio(results.median(key, "bytes_total", True), 1000)
        off += [f"{method} {share:+.0%}"] if abs(share) > 0.05 else []
    return row | {"off": ", ".join(off)}


def texel_parts(folders: Sequence[Path]) -> Parts:
    """Runs of Shading Atlas Streaming: its bias, and how many triangles with a place own no texel."""
    rows = []
    for results in map(RunResults, folders):
        (key,) = results.keys
        row: Row = {
            "scene": results.scene,
            "atlas": f"{results.rows[0]['atlas_width']}x{results.rows[0]['atlas_height']}",
        }
        row |= {name: results.statistic(key, name) for name in ("bias", "triangles_without_texel")}
        rows.append(row | {name: results.median(key, name) for name in ("placed_triangles", "samples", "flip")})
    return {ROWS: rows}


class _Density(TypedDict):
    pvs_density: int | float


class _RunFile(TypedDict):
    """What set_parts needs of a run.json."""

    settings: _Density


def set_parts(folders: Sequence[Path]) -> Parts:
    """Runs of one method over densities of the visible set's views: its triangles, what it lacks, and its time."""
    rows: list[Row] = []
    for folder in folders:
        results = RunResults(folder)
        (key,) = results.keys
        size = f"{results.rows[0]['width']}x{results.rows[0]['height']}"
        density = read_json(folder / "run.json", _RunFile)["settings"]["pvs_density"]
        names = ("pvs_triangles", "missing_px", "flip", "pvs_ms")
        rows.append(
            {"scene": results.scene, "size": size, "density": density} | {n: results.median(key, n) for n in names}
        )
    usual = {(row["scene"], row["size"]): row["pvs_ms"] for row in rows if row["density"] == 2}
    return {ROWS: [row | {"time": _ratio(row.pop("pvs_ms"), usual[row["scene"], row["size"]])} for row in rows]}


def reset_parts(folders: Sequence[Path]) -> Parts:
    """What one method sends in the first 12 frames of a run and in all of them, and the frame that sends most."""
    (folder,) = folders
    coded = [row for row in RunResults(folder).rows if row["codec"] != "none"]
    rows = []
    for count in (12, len(coded)):
        (summary,) = summarise(coded[:count])
        largest = max(coded[1:count], key=lambda row: row["bytes_total"])
        sizes = {name: summary[f"bytes_total_{name}"] / 1000 for name in ("median", "mean", "max", "key")}
        sizes |= {"frames": count, "kbit_s": summary["bytes_total_kbit_s"], "largest": largest["frame"]}
        rows.append(sizes | {"max_over_median": sizes["max"] / sizes["median"]})
    return {ROWS: rows}


def thesis_parts(folders: Sequence[Path]) -> Parts:
    """The experiment of the thesis on linked lists: one row per mode and model, means over its frames."""
    (folder,) = folders
    sizes, times = (list(_csv(folder / f"table_{name}.csv")) for name in ("a1", "a2"))
    rows = []
    for size, time in zip(sizes, times, strict=True):
        names = ("ratio", "ratio_shuffled", "ratio_published", "sent_of_built", "bad_pixels")
        row: Row = {name: size[name] for name in ("mode", "model", "size")}
        row |= {name: _float(size[name]) for name in names if name in size}
        rows.append(row | {n: _float(time[n]) for n in ("building_over_opaque", "encoding_over_building", "layers")})
    layers = [row | {"bad_pixels": _float(row["bad_pixels"])} for row in _csv(folder / "layers.csv")]
    return {ROWS: rows, "layers": layers}


def _csv(file: Path) -> Iterator[dict[str, str]]:
    yield from read_csv(file)


def _float(text: str) -> float | None:
    return float(text) if text else None


def _typed(file: Path, columns: Sequence[Column]) -> list[Row]:
    """The rows of a CSV file of the suite, None for empty cells."""
    kinds = {column.name: column.type for column in columns}
    return [{name: kinds[name](text) if text else None for name, text in row.items()} for row in _csv(file)]


def stress_parts(folders: Sequence[Path]) -> Parts:
    """How far each method came in each test, with the error at the first and at the hardest magnitude."""
    (folder,) = folders
    rows = _typed(folder / "stress.csv", STRESS_COLUMNS)
    rows = [row | {"label": row["method"]} for row in rows]
    ordered: dict[tuple[str, str], list[Row]] = {(r["test"], r["label"]): [] for r in rows}
    for row in sorted(rows, key=lambda row: row["step"]):
        ordered[row["test"], row["label"]].append(row)
    tests, errors = [], []
    for test, cells in matrix(rows).items():
        first, last = (ordered[test, next(iter(cells))][k] for k in (0, -1))
        span = f"{magnitude(first['magnitude'])} .. {magnitude(last['magnitude'])} {first['unit'] or ''}".strip()
        line: Row = {"test": test, "span": span}
        for label, reach in cells.items():
            of = [row["error"] for row in ordered[test, label]]
            errors.append({"test": test, "label": label, "first": of[0], "last": of[-1], "passed": not reach.broken})
            known = [f"{error:.3f}" for error in (of[0], of[-1]) if error is not None]
            line[label] = f"{', '.join(known) or reach.text}" + f" **{reach.text}**" * bool(reach.broken)
        tests.append(line)
    facts = {"tests": len(tests), "magnitudes": len({(row["test"], row["step"]) for row in rows}), "trials": len(rows)}
    facts["wrong"] = sum(not row["passed"] for row in rows)
    return {ROWS: tests, "errors": errors, "facts": [{"name": name, "value": value} for name, value in facts.items()]}


def kernel_parts(folders: Sequence[Path]) -> Parts:
    """What build variants cost and gain, the errors of every stage in the default one, and how near each of its kernels
    comes to what the device copies or computes at best."""
    (folder,) = folders
    rows = _typed(folder / "kernels.csv", KERNEL_COLUMNS)
    variants = [row | {name: len(row[name]) for name in ("worse", "better")} for row in compare_variants(rows)]
    errors, broken, seen = [], [], set()
    for row in rows:
        place = row["case"], row["input"], row["variant"]
        if place in seen:
            continue
        seen.add(place)
        if row["variant"] == "default":
            names = ("values", "max_error", "p999_error", "p999_ulp", "whole_values", "misassigned")
            errors.append({"case": row["case"], "input": row["input"]} | {name: row[name] for name in names})
        if row["case"] in BROKEN_STAGES and row["input"] == "typical" and row["variant"] in ("default", "relaxed"):
            broken.append({"case": row["case"], row["variant"]: _wrong_text(row)})
    usual = (row for row in rows if (row["input"], row["variant"]) == ("typical", "default"))
    roofs = [{"kernel": r["kernel"], "share": _nearer(r["copy_share"], r["arithmetic_share"])} for r in usual]
    pairs = groupby(sorted(broken, key=lambda row: row["case"]), lambda row: row["case"])
    broken = [{name: value for row in own for name, value in row.items()} for _, own in pairs]
    facts = {"kernels": len({row["kernel"] for row in rows}), "stages": len({row["case"] for row in rows})}
    named = [{"name": name, "value": value} for name, value in facts.items()]
    return {"variants": variants, "broken": broken, "errors": errors, "roofs": roofs, "facts": named}


def _nearer(*shares: float | None) -> float | None:
    return max((share for share in shares if share is not None), default=None)


def _wrong_text(row: Row) -> str:
    """Of whole values the share that is wrong; of others the difference that 99.9 % stay below."""
    if row["whole_values"]:
        return f"{(row['misassigned'] or 0) / row['whole_values']:.2g} of the values wrong"
    return "" if row["p999_error"] is None else f"{row['p999_error']:.1g}"


def claim_parts(folders: Sequence[Path]) -> Parts:
    """Claims with all places where they were measured; values place by place; how many of each verdict; what sets the
    runs see; and for each method why claims are not confirmed."""
    (folder,) = folders
    results, _ = write_claims(folder)
    machine = {result.claim.id: _of_machine(result.claim) for result in results}
    values: list[Row] = [
        {"id": r.claim.id, "run": "/".join(r.place), "measured": r.measured, "low": r.low, "high": r.high}
        | {"verdict": r.verdict, "machine": _of_machine(r.claim)}
        for r in results
    ]
    claims: list[Row] = []
    for _, group in groupby(results, key=lambda result: result.claim.id):
        own = list(group)
        claim = own[0].claim
        row = {"id": claim.id, "claim": claim.claim, "source": f"{claim.paper}, {claim.source}"}
        row |= {"published": claim.published, "rule": claim.rule_text}
        claims.append(row | {"measured": places_text(own), "machine": _of_machine(claim)})
    verdicts = (CONFIRMED, NOT_CONFIRMED, UNDECIDED, NOT_MEASURABLE, NOT_MEASURED)
    counts = {
        (verdict, timed): sum(row["verdict"] == verdict and row["machine"] == timed for row in values)
        for verdict, timed in product(verdicts, (False, True))
    }
    counted: list[Row] = [
        {"verdict": v, "timed": "timed" if t else "exact", "count": n, "machine": t} for (v, t), n in counts.items()
    ]
    why: Parts = {
        f"why-{method}": [row | {"machine": machine[row["id"]]} for row in why_not(folder, method)]
        for method in sorted({name for result in results for name in result.claim.methods})
    }
    return {ROWS: claims, "values": values, "counts": counted, "sets": _visible_sets(folder)} | why


def _visible_sets(folder: Path) -> list[Row]:
    """Triangles of the first visible set of each run below a folder."""
    rows = []
    for run in sorted(file.parent for file in folder.glob(f"*/{RESULTS}")):
        first = next((row for row in RunResults(run).rows if row["pvs_triangles"]), None)
        if first:
            rows.append({"run": run.name, "triangles": first["pvs_triangles"]})
    return rows


def places_text(results: Sequence[Judged]) -> str:
    """All places of a claim with value, interval and verdict."""
    texts = []
    for r in results:
        if not r.place:
            return f"{r.verdict}: {r.reason}"
        ends = "" if r.low is None or r.high is None else f" ({short(r.low)} to {short(r.high)})"
        value = "" if r.measured is None else f" {short(r.measured)}{ends}"
        size = f" ({r.size})" if r.size else ""
        texts.append(f"{' / '.join(r.place)}{size}{value} **{r.verdict}**")
    return "<br>".join(texts)


def _of_machine(claim: Claim) -> bool:
    """Whether the value of a claim holds a time: a column of times, a stage, or a statistic made of them."""
    names = [name for operand in claim.operands() for name in operand.values]
    return any(_is_time(name) for name in names)


def _is_time(name: str) -> bool:
    known = BY_NAME.get(name)
    return "/" in name or name.endswith(("_ms", "over_shading")) or (known is not None and known.kind == "time")
