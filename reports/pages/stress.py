"""The stress test's results: the matrix (how far each method came in each test), stress.csv and stress.html."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shading_atlas_bench.reports.pages.style import page_style
from shading_atlas_bench.reports.pages.texts import escape
from shading_atlas_bench.reports.store.columns import STRESS_COLUMNS
from shading_atlas_bench.reports.store.csv_files import replace_file, write_csv
from shading_atlas_bench.reports.store.data import read_file

Row = dict[str, Any]
GOOD = ("ok", "overflow")
COLOURS = ("#0a6ea8", "#c2571a", "#2b8a5b", "#8a4fb0", "#b3261e", "#6b6b00", "#0b7f8f", "#a03070")
CHART = (260, 96)


@dataclass(frozen=True)
class Reach:
    """How far one method came in one test.

    reached: the last magnitude before the first that went wrong, None if that is the first. hardest: the last tried.
    broken: the row that went wrong first, None if none did. refused: whether loading rightly refused all of them.
    """

    reached: float | None
    hardest: float
    broken: Row | None
    refused: bool = False

    @property
    def text(self) -> str:
        """The magnitude reached, with a mark where a harder one went wrong."""
        if self.refused:
            return "refused"
        reached = "none" if self.reached is None else magnitude(self.reached)
        return reached if self.broken is None else f"{reached} !"


def magnitude(value: float) -> str:
    """A magnitude in few characters: 1e6, 0.003, 179."""
    if 1000 <= value < 100_000 and value % 1000:
        return f"{value:.0f}"
    return f"{value:.3g}".replace("e+0", "e").replace("e-0", "e-").replace("e+", "e")


def matrix(rows: Iterable[Row]) -> dict[str, dict[str, Reach]]:
    """By test and then label of a method, in the order of the rows, how far it came."""
    grouped: dict[str, dict[str, list[Row]]] = {}
    for row in rows:
        grouped.setdefault(row["test"], {}).setdefault(row["label"], []).append(row)
    return {test: {label: _reach(cell) for label, cell in cells.items()} for test, cells in grouped.items()}


def _reach(rows: list[Row]) -> Reach:
    reached = None
    ordered = sorted(rows, key=lambda row: row["step"])
    for row in ordered:
        if not row["passed"]:
            return Reach(reached, ordered[-1]["magnitude"], row)
        reached = row["magnitude"]
    return Reach(reached, ordered[-1]["magnitude"], None, all(row["status"] == "refused" for row in ordered))


def write_stress(folder: Path, rows: list[Row], tests: dict[str, str], facts: dict[str, str]) -> None:
    """Write `folder`/stress.csv and stress.html.

    tests: name to what it does to the scene. facts: about the run. Pictures are taken from `folder`/pictures, where
    those of a row are METHOD_TEST_STEP_NAME.png.
    """
    write_csv(folder / "stress.csv", STRESS_COLUMNS, rows)
    found = matrix(rows)
    body = "\n".join([_matrix_section(found, tests), _breaks_section(found, folder), _charts_section(rows, tests)])
    style = page_style()
    replace_file(folder / "stress.html", PAGE.format(style=style + STYLE, facts=_facts(facts), body=body))


PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark"><title>Stress test, Shading Atlas Bench</title>
<link rel="icon" href="data:,"><style>{style}</style></head>
<body><header><p class="eyebrow">Shading Atlas Bench</p><h1>Stress test</h1>{facts}</header>
<main>{body}</main></body></html>
"""
STYLE = """
.reached { text-align: left; } .reached td, .reached th { text-align: left; }
.broken { background: color-mix(in srgb, var(--bad) 14%, transparent); color: var(--bad); font-weight: 600; }
.whole { color: var(--best-ink); }
.shots { display: flex; flex-wrap: wrap; gap: .8rem; margin: .6rem 0 1.6rem; }
.shots figure { margin: 0; } .shots img { display: block; min-width: 320px; max-width: 480px; max-height: 320px;
  image-rendering: pixelated; border: 1px solid var(--line); border-radius: 6px; background: #23262b; }
.shots figcaption, .plot figcaption { font-size: .78rem; color: var(--soft); }
.plots { display: grid; grid-template-columns: repeat(auto-fill, minmax(270px, 1fr)); gap: 1rem; }
.plot { margin: 0; background: var(--card); border: 1px solid var(--line); border-radius: 10px; padding: .6rem .8rem; }
.key span { display: inline-block; margin-right: 1.1rem; font-size: .9rem; }
.key i { display: inline-block; width: .9rem; height: .25rem; margin-right: .4rem; vertical-align: middle; }
"""


def _facts(facts: dict[str, str]) -> str:
    cells = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(text)}</dd></div>" for name, text in facts.items())
    return f'<dl class="facts">{cells}</dl>'


def _labels(found: dict[str, dict[str, Reach]]) -> list[str]:
    return list(dict.fromkeys(label for cells in found.values() for label in cells))


def _matrix_section(found: dict[str, dict[str, Reach]], tests: dict[str, str]) -> str:
    labels = _labels(found)
    head = "".join(f"<th>{escape(label)}</th>" for label in labels)
    lines = []
    for test, cells in found.items():
        hardest = next(iter(cells.values())).hardest
        columns = "".join(_matrix_cell(cells.get(label)) for label in labels)
        what = f"<th>{escape(test)}<small>{escape(tests.get(test, ''))}</small></th>"
        lines.append(f"<tr>{what}<td>{magnitude(hardest)}</td>{columns}</tr>")
    return (
        '<section><h2>How far each method came</h2><p class="caption">The last magnitude before the first one that '
        "went wrong. Right is: valid, the same bytes when packed again and with other work-groups, and a picture that "
        "shows the surfaces of a float64 rendering. An atlas too small is right where every triangle left out is named."
        f'</p><div class="scroll"><table class="reached"><thead><tr><th>test</th><th>hardest</th>{head}</tr></thead>'
        f"<tbody>{''.join(lines)}</tbody></table></div></section>"
    )


def _matrix_cell(reach: Reach | None) -> str:
    if reach is None:
        return "<td></td>"
    if reach.broken is None:
        return f'<td class="whole">{escape(reach.text)}</td>'
    reached = "none" if reach.reached is None else magnitude(reach.reached)
    reason, status = escape(reach.broken["reason"]), escape(reach.broken["status"])
    return f'<td class="broken" title="{reason}">{reached}<small>then {status}</small></td>'


def _breaks_section(found: dict[str, dict[str, Reach]], folder: Path) -> str:
    parts = []
    for test, cells in found.items():
        for label, reach in cells.items():
            if row := reach.broken:
                parts.append(
                    f"<h3>{escape(label)}, {escape(test)} {magnitude(row['magnitude'])} {escape(row['unit'])}</h3>"
                    f'<p class="caption"><span class="bad">{escape(row["status"])}</span> {escape(row["reason"])}</p>'
                    f'<div class="shots">{_shots(row, folder)}</div>'
                )
    text = "".join(parts) or '<p class="caption">Nothing went wrong.</p>'
    return f"<section><h2>What went wrong</h2>{text}</section>"


def _shots(row: Row, folder: Path) -> str:
    figures = []
    stem = picture_stem(row)
    for path in sorted((folder / "pictures").glob(f"{stem}_*.png")):
        name = path.stem.removeprefix(f"{stem}_")
        data = base64.b64encode(read_file(path)).decode()
        figures.append(
            f'<figure><img alt="{escape(name)}" src="data:image/png;base64,{data}">'
            f"<figcaption>{escape(name)}</figcaption></figure>"
        )
    return "".join(figures)


def picture_stem(row: Row) -> str:
    """The beginning of the names of a row's pictures."""
    return f"{row['folder']}_{row['test']}_{row['step']}"


def _charts_section(rows: list[Row], tests: dict[str, str]) -> str:
    """A small chart per test: error over magnitude, a line per method."""
    labels = list(dict.fromkeys(row["label"] for row in rows))
    colours = {label: COLOURS[i % len(COLOURS)] for i, label in enumerate(labels)}
    key = "".join(f'<span><i style="background:{colours[label]}"></i>{escape(label)}</span>' for label in labels)
    plots = []
    for test in dict.fromkeys(row["test"] for row in rows):
        chosen = [row for row in rows if row["test"] == test]
        if any(row["error"] is not None for row in chosen):
            plots.append(_plot(test, chosen, colours))
    return (
        '<section><h2>Error over magnitude</h2><p class="caption">Mean FLIP of the last frame, drawn by the client '
        "from the payload without a lossy codec, against a float64 rendering (for masked and blended surfaces "
        f'against the forward renderer); from mild to hard.</p><p class="key">{key}</p>'
        f'<div class="plots">{"".join(plots)}</div></section>'
    )


def _plot(test: str, rows: list[Row], colours: dict[str, str]) -> str:
    width, height = CHART
    steps = sorted({(row["step"], row["magnitude"]) for row in rows})
    place = {step: 30 + i * (width - 40) / max(1, len(steps) - 1) for i, (step, _) in enumerate(steps)}
    top = max(max(row["error"] for row in rows if row["error"] is not None), 1e-4)
    lines = []
    for label, colour in colours.items():
        points = [(place[r["step"]], 8 + (height - 28) * (1 - r["error"] / top), r)
                  for r in rows if r["label"] == label and r["error"] is not None]  # fmt: skip
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y, _ in points)
        lines.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
        lines += [
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.4" fill="{colour}"><title>{escape(label)} at '
            f"{magnitude(r['magnitude'])}: {r['error']:.4f}</title></circle>"
            for x, y, r in points
        ]
    low, high = magnitude(steps[0][1]), magnitude(steps[-1][1])
    unit = f" ({escape(rows[0]['unit'])})" if rows[0]["unit"] else ""
    words = (
        f'<text x="2" y="14">{top:.2g}</text><text x="2" y="{height - 18}">0</text>'
        f'<text x="30" y="{height - 2}">{low}</text>'
        f'<text x="{width - 8}" y="{height - 2}" text-anchor="end">{high}</text>'
    )
    return (
        f'<figure class="plot"><svg viewBox="0 0 {width} {height}" width="100%" font-size="9" fill="currentColor">'
        f"{''.join(lines)}{words}</svg><figcaption>{escape(test)}{unit}</figcaption></figure>"
    )
