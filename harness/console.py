"""How what is printed looks: tables without frames in at most 80 columns, progress with the time left; a sentence with
a path in it is one line, which terminals wrap.

All text that others wrote, such as names, reasons and paths, goes through here: a text is printed as it is, never read
as markup, and what would steer the terminal is shown as an escape. Markup is in the templates of `styled` only.
"""

from __future__ import annotations

import re
from string import Formatter
from typing import TYPE_CHECKING

from rich import progress as bars
from rich.console import Console, ConsoleOptions, HighlighterType, JustifyMethod, OverflowMethod, RenderResult
from rich.style import Style
from rich.table import Table
from rich.text import Span, Text

from shading_atlas_bench.errors import visible
from shading_atlas_bench.harness.progress import Progress, Task

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device

WIDEST = 80
NARROWEST = 12  # columns of a method's name where a table needs the room
HOLE = "\N{OBJECT REPLACEMENT CHARACTER}"  # stands for each letter of a value in markup


class Terminal(Console):
    """A console of at most 80 columns, so that output reads the same everywhere, that takes no text for markup."""

    def __init__(self, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, highlight=False, markup=False, emoji=False)
        self.width = min(WIDEST, self.width)

    def render_str(
        self,
        text: str,
        *,
        style: str | Style = "",
        justify: JustifyMethod | None = None,
        overflow: OverflowMethod | None = None,
        emoji: bool | None = None,
        markup: bool | None = None,
        highlight: bool | None = None,
        highlighter: HighlighterType | None = None,
    ) -> Text:
        """Every text that is printed, alone or in a table, passes here: it is as it is, whatever is asked for."""
        shown = visible(text)
        return super().render_str(
            shown, style=style, justify=justify, overflow=overflow, emoji=False, markup=False, highlight=False
        )


def make_console(stderr: bool = False) -> Terminal:
    """A new console, of the streams that there are now."""
    return Terminal(stderr)


def counted(count: int, noun: str) -> str:
    """A number of things, like "1 row" and "2 rows"."""
    return f"{count} {noun}{'s' * (count != 1)}"


def styled(template: str, *values: object, style: str = "") -> Text:
    """A template in rich's markup, its fields `{}` filled with values, each as it is or, of a Text, in its own style.

    Fields may have format specifications and, as in `{!r}`, conversions. `[{style}]` is the style that is given. Raises
    ValueError unless there is one value for each field.
    """
    markup = ""
    filled: list[Text] = []
    given = iter(values)
    parsed = list(Formatter().parse(template))
    if (fields := sum(field not in (None, "style") for _, field, _, _ in parsed)) != len(values):
        raise ValueError(f"The template {template!r} has {fields} fields, and {len(values)} values are given.")
    for literal, field, specification, conversion in parsed:
        markup += literal
        if field == "style":
            markup += style
        elif field is not None:
            value = next(given)
            if conversion:
                value = Formatter().convert_field(value, conversion)
            filled.append(value if isinstance(value, Text) else Text(visible(format(value, specification or ""))))
            markup += HOLE * len(filled[-1])
    text = Text.from_markup(markup, emoji=False)
    places = [place for place, letter in enumerate(text.plain) if letter == HOLE]
    letters = dict(zip(places, "".join(piece.plain for piece in filled), strict=True))
    for piece in filled:
        start = places[0] if places else 0
        text.spans += [Span(span.start + start, span.end + start, span.style) for span in piece.spans]
        places = places[len(piece) :]
    text.plain = "".join(letters.get(place, letter) for place, letter in enumerate(text.plain))
    return text


def tell_passed_over(device: Device) -> None:
    """Say on stderr which device is used where better ones were passed over, and why."""
    for reason in device.passed_over:
        text = styled("[yellow]warning[/] {} Used instead: {}.", reason, device.name)
        make_console(stderr=True).print(text, soft_wrap=True)


class Headed(Table):
    """A table below a bold line, which may be wider than it: rich would wrap a title to the table's width."""

    def __init__(self, heading: str) -> None:
        super().__init__(box=None, pad_edge=False, expand=False)
        self.heading = heading

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        if self.heading:
            yield Text(visible(self.heading), "bold")
        yield from super().__rich_console__(console, options)


def make_table(title: str, *columns: str) -> Headed:
    """A table without rows and frames, with a bold title and columns that fold."""
    table = Headed(title)
    table.caption_justify, table.caption_style = "left", "dim"
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


def folded(label: str, room: int) -> str:
    """A method's label, in lines of at most `room` characters as far as its parts are no longer."""
    lines = [""]
    for part in re.split(r"(?=[@\[=])|(?<=,)", label):
        if lines[-1] and len(lines[-1] + part) > room:
            lines.append("")
        lines[-1] += part
    return "\n".join(lines)


def progress_bars(console: Console) -> bars.Progress:
    """A live display of bars that goes when its work is done; only a terminal has one."""
    columns = (
        _What(),
        bars.BarColumn(bar_width=20),
        bars.MofNCompleteColumn(),
        bars.TextColumn("left:"),
        bars.TimeRemainingColumn(),
    )
    shown = console.is_terminal
    # Seldom: the processor that draws it is the one that is measured.
    return bars.Progress(*columns, console=console, transient=True, auto_refresh=shown, refresh_per_second=4)


class _What(bars.ProgressColumn):
    """What is being done."""

    def render(self, task: bars.Task) -> Text:
        return Text(visible(task.description))


class Bar(Task):
    """A bar of a live display, which ends with the last of them."""

    def __init__(self, shown: bars.Progress, what: str, steps: int | None) -> None:
        self._shown = shown
        self._id = shown.add_task(what, total=steps)

    def doing(self, what: str) -> None:
        """Show this as the bar's description."""
        self._shown.update(self._id, description=what)

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
        self._console.print(styled("[dim]{}[/]", sentence))

    def warn(self, sentence: str) -> None:
        """Print the sentence as a warning."""
        self._console.print(styled("[yellow]warning[/] {}", sentence), soft_wrap=True)

    def task(self, what: str, steps: int | None = None) -> Bar:
        """A bar of so many steps; without their number it only shows that work goes on."""
        return Bar(self._shown, what, steps)
