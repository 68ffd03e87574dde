"""What `bench sweep` prints: the grid before it runs, and who wins afterwards."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from shading_atlas_bench.harness.console import NARROWEST, counted, folded, make_console, make_table, styled
from shading_atlas_bench.harness.measure.returned import told_skip
from shading_atlas_bench.harness.run.folder import check_folder
from shading_atlas_bench.harness.run.memory import memory_need, processes_with_room, refusal
from shading_atlas_bench.harness.run.plan import duration, expected_pace
from shading_atlas_bench.harness.sweep.grid import make_grid
from shading_atlas_bench.harness.workload.session import open_head_motion, open_path, open_scene
from shading_atlas_bench.harness.workload.skips import skipped_stages
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.reports.analysis.sweep import TOLD, candidates, groups, read_told
from shading_atlas_bench.reports.pages.sweep_words import CODING_NAMES, COST_NAMES, verdict

COLOURS = {"skipped": "dim"}  # of statuses; the others are red

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from shading_atlas_bench.harness.sweep.grid import SweepCell, SweepGrid
    from shading_atlas_bench.harness.sweep.request import SweepRequest
    from shading_atlas_bench.reports.analysis.sweep import Point
    from shading_atlas_bench.scenes.model import Scene


def show_grid(wanted: SweepRequest, out: Path | None) -> bool:
    """Print what `bench sweep` would do; opens every scene, runs no kernel. False where a method cannot say whether a
    scene has something for it to do."""
    check_folder(out)
    grid = make_grid(wanted.settings, wanted.vary)
    open_head_motion(wanted.settings)
    device = Device.open(wanted.settings.device)
    console = make_console()
    seconds, well, workers = 10.0, True, wanted.workers
    for cells in grid.scenes():
        settings = cells[0].settings
        scene = open_scene(settings)
        path = open_path(settings, scene)
        console.print(
            styled(
                "[bold]{}[/]  {:,} triangles, path {}, {} frame{}",
                scene.name,
                scene.triangle_count,
                path.name,
                settings.frames,
                "s" * (settings.frames != 1),
            )
        )
        told = _told_skips(cells, scene)
        for name, status, reason in dict.fromkeys((name, *why) for (name, _), why in told.items() if why):
            console.print(styled("[{style}]{}[/] {}: {}", status, name, reason, style=COLOURS.get(status, "red")))
            well &= status == "skipped"
        console.print(styled("[dim]needs no[/] {}", ", ".join(skipped_stages(scene.features))))
        running = [cell for cell in cells if told[cell.key] is None]
        running, workers = _show_memory(console, running, scene, workers)
        seconds += sum(settings.frames * expected_pace(cell.settings, scene.content_hash) for cell in running)
    console.print(f"device {device.name.strip()}")
    _show_axes(console, grid)
    timing = f", then at most {duration(len(grid.cells) * wanted.rule.budget)} of timing" if wanted.timed else ""
    at_once = f" with {workers} workers" if workers > 1 else ""
    total = duration(seconds / workers)
    console.print(f"about {total}{at_once}{timing}; results in {out or 'a new folder below runs/'}")
    return well


def _show_memory(console: Console, cells: list[SweepCell], scene: Scene, workers: int) -> tuple[list[SweepCell], int]:
    """What the largest cell takes, which have no room, and how many workers run side by side; the cells that have room,
    and that number."""
    if not cells:
        return [], workers
    count = processes_with_room([cell.settings for cell in cells], scene, [cell.packer for cell in cells], workers)
    needs = [memory_need(cell.settings, scene, [cell.packer], 1) for cell in cells]
    console.print(f"at most {max(needs, key=lambda need: need.total)} in a cell")
    if count < workers:
        console.print(styled("[yellow]note[/] memory has room for {} of {} workers", count, workers))
    reasons = [refusal(cell.settings, scene, [cell.packer], count) for cell in cells]
    if refused := [reason for reason in reasons if reason]:
        console.print(styled("[red]failed[/] {}, for lack of memory: {}", counted(len(refused), "cell"), refused[0]))
    return [cell for cell, reason in zip(cells, reasons, strict=True) if not reason], count


def _told_skips(cells: list[SweepCell], scene: Scene) -> dict[tuple[str, str], tuple[str, str] | None]:
    """By method and variant, the status and the reason where it does nothing in the scene. A method that once takes too
    long to say so is not asked again with other parameters."""
    told: dict[tuple[str, str], tuple[str, str] | None] = {}
    late: dict[str, tuple[str, str]] = {}
    for cell in cells:
        name = cell.packer.name
        if cell.key not in told:
            why = told[cell.key] = late.get(name) or told_skip(cell.packer, scene, cell.settings.timeout)
            if why and why[0] == "timeout":
                late[name] = why
    return told


def _show_axes(console: Console, grid: SweepGrid) -> None:
    """What is varied per contender, and what was left out and why."""
    table = make_table(counted(len(grid.cells), "cell"), "method", "cells", "varied")
    for contender in dict.fromkeys(cell.contender for cell in grid.cells):
        own = [cell for cell in grid.cells if cell.contender == contender]
        axes: dict[str, dict[str, None]] = {}
        for axis, text in (item for cell in own for item in cell.varied.items()):
            axes.setdefault(axis, {})[text] = None
        varied = "; ".join(f"{axis} {', '.join(texts)}" for axis, texts in axes.items())
        table.add_row(contender, str(len(own)), varied or "as it is")
    console.print(table)
    if grid.left_out:
        left = make_table("left out", "what", "why")
        for what, why in grid.left_out:
            left.add_row(what, why)
        console.print(left)


def show_sweep(points: list[Point], folder: Path) -> None:
    """Print the cells on each method's front of FLIP over time, who wins where, and what went wrong."""
    console = make_console()
    timed = any(point.row["comparable"] == "yes" for point in points)
    cost, front = ("server_ms", "pareto_time") if timed else ("samples", "pareto_samples")
    for (condition, coding), own in groups(points).items():
        lines = [point for point in own if point.row[front] in ("method", "all")]
        if not lines:
            continue
        what = ", ".join(filter(None, (condition, CODING_NAMES[coding])))
        console.print(styled("[bold]Pareto fronts of FLIP over {}, {}[/]", COST_NAMES[cost][0], what))
        console.print(_front_table(lines, cost, timed, console))
        console.print(verdict(candidates(own, cost, "flip")[1], cost, "flip"))
        console.print()
    _show_troubles(console, points)
    for prefix, word in (*((told, "warning") for told in TOLD), ("rare", "not seen")):
        for text in read_told(folder, prefix):
            console.print(styled("[yellow]{}[/] {}", word, text))
    console.print(styled("[bold]{}/report.html[/]  sweep.csv", folder), soft_wrap=True)


def _front_table(points: list[Point], cost: str, timed: bool, console: Console) -> Table:
    """The cells on fronts, contender by contender, in order of their cost."""
    headings = ("method", "parameters", "server ms", "kB/frame", "kbit/s", "samples", "FLIP")
    found = []
    for point in sorted(points, key=lambda point: (point.row["contender"], point.row[f"{cost}_median"])):
        row = point.row
        time = f"{row['server_ms_median']:.1f}" if timed else ""
        if timed and row["server_ms_low"] is not None:
            time += f" ±{50 * (row['server_ms_high'] - row['server_ms_low']) / row['server_ms_median']:.0f} %"
        sent = [("bytes_total_mean", 1e-3, "{:,.1f}"), ("bytes_total_kbit_s", 1, "{:,.0f}")]
        sizes = ["" if row[name] is None else form.format(row[name] * scale) for name, scale, form in sent]
        samples, flip = f"{row['samples_median']:,.0f}", f"{row['flip_median']:.4f}"
        found.append((row["contender"], point.label, time, *sizes, samples, flip))
    table = make_table("", *headings)
    for column in table.columns[2:]:
        column.justify, column.no_wrap = "right", True
    widths = [max(map(len, column)) for column in zip(headings, *found, strict=True)]
    room = console.width - sum(widths[1:]) - 2 * (len(widths) - 1)
    for contender, label, *cells in found:
        table.add_row(folded(contender, max(room, NARROWEST)), label, *cells)
    return table


def _show_troubles(console: Console, points: list[Point]) -> None:
    """How many cells are not ok, with the first reason of each status and contender; why timing stopped."""
    cells = {(p.condition, p.row["method"], p.row["variant"], p.row["varied"]): p.row for p in points}.values()
    counts = Counter((row["contender"], row["status"]) for row in cells if row["status"] != "ok")
    for (contender, status), count in counts.items():
        reason = next(row["reason"] for row in cells if (row["contender"], row["status"]) == (contender, status))
        colour = COLOURS.get(status, "red")
        cells_of = f"{counted(count, 'cell')} of {contender}"
        console.print(styled("[{style}]{}[/] {}: {}", status, cells_of, reason or "", style=colour))
    stops = Counter(row["stop"].partition(":")[0] for row in cells if row["stop"])
    console.print("timing stopped: " + ", ".join(f"{count} {stop}" for stop, count in stops.most_common()))
