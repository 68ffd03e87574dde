"""How what is printed looks: at most 80 columns, tables without frames, progress with the time left."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from rich import progress as bars
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from shading_atlas_bench.harness.progress import Progress, Task

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device

WIDEST = 80
NARROWEST = 12  # columns of a method's name where a table needs the room


def make_console(stderr: bool = False) -> Console:
    """A console of at most 80 columns, so that output reads the same everywhere."""
    console = Console(stderr=stderr, highlight=False)
    return Console(stderr=stderr, highlight=False, width=min(WIDEST, console.width))


def tell_passed_over(device: Device) -> None:
    """Say on stderr which device is used where better ones were passed over, and why."""
    for reason in device.passed_over:
        text = f"[yellow]warning[/] {escape(reason)} Used instead: {escape(device.name)}."
        make_console(stderr=True).print(text, soft_wrap=True)


def make_table(title: str, *columns: str) -> Table:
    """A table without rows and frames, with a bold title and columns that fold."""
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, expand=False)
    table.caption_justify, table.caption_style = "left", "dim"
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


def folded(label: str, room: int) -> str:
    """A method's label as markup, in lines of at most `room` characters as far as its parts are no longer."""
    lines = [""]
    for part in re.split(r"(?=[@\[=])|(?<=,)", label):
        if lines[-1] and len(lines[-1] + part) > room:
            lines.append("")
        lines[-1] += part
    return escape("\n".join(lines))


def progress_bars(console: Console) -> bars.Progress:
    """A live display of bars that goes when its work is done."""
    columns = (
        bars.TextColumn("{task.description}"),
        bars.BarColumn(bar_width=20),
        bars.MofNCompleteColumn(),
        bars.TextColumn("left:"),
        bars.TimeRemainingColumn(),
    )
    return bars.Progress(*columns, console=console, transient=True)


class Bar(Task):
    """A bar of a live display, which ends with the last of them."""

    def __init__(self, shown: bars.Progress, what: str, steps: int | None) -> None:
        self._shown = shown
        self._id = shown.add_task(escape(what), total=steps)

    def doing(self, what: str) -> None:
        """Show this as the bar's description."""
        self._shown.update(self._id, description=escape(what))

    def advance(self, steps: int = 1) -> None:
        """Move the bar on by so many steps."""
        self._shown.advance(self._id, steps)

    def __enter__(self) -> Bar:
        self._shown.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._shown.remove_task(self._id)
        if not self._shown.tasks:
            self._shown.stop()


class TerminalProgress(Progress):
    """Shows everything, on stderr."""

    def __init__(self) -> None:
        self._console = make_console(stderr=True)
        self._shown = progress_bars(self._console)

    def say(self, sentence: str) -> None:
        """Print the sentence dimmed."""
        self._console.print(f"[dim]{escape(sentence)}[/]")

    def warn(self, sentence: str) -> None:
        """Print the sentence as a warning."""
        self._console.print(f"[yellow]warning[/] {escape(sentence)}", soft_wrap=True)

    def task(self, what: str, steps: int | None = None) -> Bar:
        """A bar of so many steps; without their number it only shows that work goes on."""
        return Bar(self._shown, what, steps)
