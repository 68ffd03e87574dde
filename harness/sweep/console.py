"""What `bench sweep` prints: the grid before it runs, and who wins afterwards."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from rich.markup import escape

from harness.console import make_console, make_table
from harness.plan import check_folder, duration, expected_pace
from harness.session import open_head_motion, open_path, open_scene
from harness.skips import skipped_stages
from harness.sweep.grid import make_grid
from kernels.device import Device
from reports.sweep import candidates, groups
from reports.sweep_words import verdict

if TYPE_CHECKING:
    from harness.sweep.run import Wanted
    from reports.sweep import Point


def show_grid(wanted: Wanted, out: Path | None) -> None:
    """Print what `bench sweep` would do; opens the first scene, runs no kernel."""
    check_folder(out)
    grid = make_grid(wanted.settings, wanted.vary)
    settings = grid.cells[0].settings
    scene = open_scene(settings)
    path = open_path(settings, scene)
    open_head_motion(settings)
    device = Device.open(settings.device)
    console = make_console()
    console.print(
        f"[bold]{scene.name}[/]  {scene.triangle_count:,} triangles, path {path.name}, {settings.frames} frames"
    )
    console.print(f"device {device.name.strip()}")
    table = make_table(f"{len(grid.cells)} cells", "method", "cells", "varied")
    for name in dict.fromkeys(cell.packer.name for cell in grid.cells):
        own = [cell for cell in grid.cells if cell.packer.name == name]
        values = {
            axis: dict.fromkeys(c.varied[axis] for c in own if axis in c.varied) for c in own for axis in c.varied
        }
        varied = "; ".join(f"{axis} {', '.join(texts)}" for axis, texts in values.items())
        reason = own[0].packer.skip(scene)
        table.add_row(name, str(len(own)), escape(f"skipped: {reason}" if reason else varied or "as it is"))
    console.print(table)
    if grid.left_out:
        left = make_table("left out", "what", "why")
        for what, why in grid.left_out:
            left.add_row(escape(what), escape(why))
        console.print(left)
    skips = skipped_stages(scene)
    if skips:
        console.print(f"[dim]skipped for this scene[/] {', '.join(skips)}")
    seconds = sum(cell.settings.frames * expected_pace(cell.settings, scene.content_hash) for cell in grid.cells)
    timing = f", then at most {duration(len(grid.cells) * wanted.rule.budget)} of timing" if wanted.timed else ""
    at_once = f" with {wanted.workers} workers" if wanted.workers > 1 else ""
    total = duration(10 + seconds / wanted.workers)
    console.print(f"about {total}{at_once}{timing}; results in {out or 'a new folder below runs/'}")


def show_sweep(points: list[Point], folder: Path) -> None:
    """Print the cells on each method's front of FLIP over time, who wins where, and what went wrong."""
    console = make_console()
    timed = any(point.row["comparable"] == "yes" for point in points)
    cost, front = ("server_ms", "pareto_time") if timed else ("samples", "pareto_samples")
    for (condition, coding), own in groups(points).items():
        lines = [point for point in own if point.row[front] in ("method", "all")]
        if not lines:
            continue
        what = ", ".join(filter(None, (condition, coding)))
        table = make_table(
            f"fronts of FLIP over {cost}, {what}", "method", "parameters", "server ms", "samples", "FLIP"
        )
        for column in table.columns[2:]:
            column.justify, column.no_wrap = "right", True
        for point in sorted(lines, key=lambda point: (point.row["method"], point.row[f"{cost}_median"])):
            row = point.row
            time = f"{row['server_ms_median']:.1f}" if timed else ""
            if timed and row["server_ms_low"] is not None:
                time += f" ±{50 * (row['server_ms_high'] - row['server_ms_low']) / row['server_ms_median']:.0f} %"
            table.add_row(
                row["method"], escape(point.label), time, f"{row['samples_median']:,.0f}", f"{row['flip_median']:.4f}"
            )
        console.print(table)
        console.print(verdict(candidates(own, cost, "flip")[1], cost, "flip"))
        console.print()
    _show_troubles(console, points)
    console.print(f"[bold]{folder}/report.html[/]  sweep.csv", soft_wrap=True)


def _show_troubles(console, points: list[Point]) -> None:
    """How many cells are not ok, with the first reason of each status and method; why timing stopped."""
    cells = {(p.condition, p.row["method"], p.row["variant"], p.row["varied"]): p.row for p in points}.values()
    counts = Counter((row["method"], row["status"]) for row in cells if row["status"] != "ok")
    for (method, status), count in counts.items():
        reason = next(row["reason"] for row in cells if (row["method"], row["status"]) == (method, status))
        colour = "dim" if status == "skipped" else "red"
        console.print(f"[{colour}]{status}[/] {count} cells of {method}: {escape(reason or '')}")
    stops = Counter(row["stop"].partition(":")[0] for row in cells if row["stop"])
    console.print("timing stopped: " + ", ".join(f"{count} {stop}" for stop, count in stops.most_common()))
