"""The results of `bench claims`: claims.csv and claims.html, from the runs that its folder names."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from functools import cache
from html import escape
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from typing import Any

from reports.claims import (
    CONFIRMED,
    NOT_CONFIRMED,
    NOT_MEASURABLE,
    NOT_MEASURED,
    UNDECIDED,
    Claims,
    ClaimsError,
    Judged,
    RunRows,
    chosen,
    judge_all,
    read_claims,
)
from reports.columns import CLAIM_COLUMNS, CLAIM_VERDICTS
from reports.csv_files import replace_file, write_csv
from reports.html import caption, facts_list, section
from reports.tables import NONE, number, table

FILE = "claims.json"
COPY = "claims.toml"
KINDS = {CONFIRMED: "yes", NOT_CONFIRMED: "no", UNDECIDED: "open", NOT_MEASURED: "none", NOT_MEASURABLE: "none"}
STYLE = """
.claims :is(td, th) { text-align: left; white-space: normal; }
.claims td:first-child { min-width: 16rem; font-weight: 400; } .claims td[rowspan] + td { min-width: 7rem; }
.claims tbody + tbody { border-top: 1px solid var(--line); }
.claims td.yes, .claims td.no, .claims td.open, .claims td.none { font-weight: 650; }
.claims td.yes, .claims td.no { white-space: nowrap; }
.claims td:has(+ .yes, + .no, + .open, + .none) { white-space: nowrap; }
.yes { color: var(--best-ink); } .no { color: var(--bad); } .open, .none { color: var(--soft); }
.claims code { font-size: .8rem; color: var(--soft); }
.commands td { white-space: normal; overflow-wrap: anywhere; text-align: left; font-size: .82rem; }
"""
PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark"><title>Published claims, shading-atlas benchmark</title>
<link rel="icon" href="data:,"><style>{style}</style></head>
<body><header><p class="eyebrow">Shading-atlas benchmark</p><h1>Published claims, <span>measured here</span></h1>
{facts}</header><main>{body}</main></body></html>
"""


def is_claims(folder: Path) -> bool:
    """Whether the folder was written by `bench claims`."""
    return (folder / FILE).is_file()


def write_claims(folder: Path) -> list[Judged]:
    """Write claims.csv and claims.html into `folder`, from its claims.toml, claims.json and the runs named there.

    Raises ClaimsError or StoreError for what cannot be read.
    """
    try:
        state = json.loads((folder / FILE).read_text(encoding="utf-8"))
    except (OSError, json.JSONDecodeError) as error:
        raise ClaimsError(f"{folder} has no readable {FILE}: give a folder that bench claims wrote.") from error
    claims = chosen(read_claims(folder / COPY), state["ids"])
    problems = {name: run["problem"] for name, run in state["runs"].items() if run["problem"]}
    variants = {spec: tuple(key) for spec, key in state["variants"].items()}

    @cache
    def rows_of(name: str) -> RunRows:
        return RunRows.read(folder / state["runs"][name]["folder"])

    results = judge_all(claims.claims, rows_of, problems, variants)
    write_csv(folder / "claims.csv", CLAIM_COLUMNS, map(as_row, results))
    replace_file(folder / "claims.html", _page(claims, results, state))
    return results


def as_row(result: Judged) -> dict[str, Any]:
    """The row of claims.csv."""
    claim = result.claim
    return {
        "id": claim.id,
        "run": "/".join(result.place),
        "paper": claim.paper,
        "source": claim.source,
        "methods": ", ".join(claim.methods),
        "kind": claim.kind,
        "claim": claim.claim,
        "published": claim.published,
        "measured": result.measured,
        "low": result.low,
        "high": result.high,
        "frames": result.count or None,
        "rule": claim.rule.text if claim.rule else "",
        "verdict": result.verdict,
        "reason": result.reason,
        "why": claim.why,
    }


def measured_text(result: Judged) -> str:
    """The median with its interval, as `0.79 (0.77-0.81)`; empty where nothing was measured."""
    if result.measured is None:
        return ""
    ends = "" if result.low is None else f" ({short(result.low)}{NONE}{short(result.high)})"
    return short(result.measured) + ends


def short(value: float) -> str:
    """Three significant digits, never in powers of ten."""
    return number(value) if value and not 0.001 <= abs(value) < 1000 else f"{value:.3g}"


def counts_text(results: Sequence[Judged]) -> str:
    """How many of each verdict, in words."""
    counts = Counter(result.verdict for result in results)
    return ", ".join(f"{counts[verdict]} {verdict}" for verdict in CLAIM_VERDICTS if counts[verdict])


def _page(claims: Claims, results: Sequence[Judged], state: dict[str, Any]) -> str:
    facts = {
        "Rows": f"{len(results)}: {counts_text(results)}",
        "Claims": str(len(claims.claims)),
        "Runs": "quick ones" if state["quick"] else "as the file of claims says",
        "Device": state["device"],
        "Date": state["date"].replace("T", " "),
    }
    papers = "".join(_paper(name, title, results) for name, title in claims.papers.items())
    style = files("reports").joinpath("page.css").read_text(encoding="utf-8")
    return PAGE.format(
        style=style + STYLE, facts=facts_list(facts), body=papers + _out_of_reach(results) + _runs(state)
    )


def _paper(name: str, title: str, results: Sequence[Judged]) -> str:
    own = [result for result in results if result.claim.paper == name and result.claim.measure]
    if not own:
        return ""
    head = "".join(f"<th>{text}</th>" for text in ("claim", "published", "run", "measured here", "verdict"))
    groups = [list(group) for _, group in groupby(own, key=lambda result: result.claim.id)]
    return section(
        name,
        title,
        caption(
            "What is measured is a median over the frames with its 95 % interval. A claim is confirmed if the interval "
            "lies wholly in the range that stands below the published value, not confirmed if wholly outside of it, "
            "and else undecided."
        ),
        f'<div class="scroll" tabindex="0"><table class="claims"><thead><tr>{head}</tr></thead>'
        f"{''.join(map(_body, groups))}</table></div>",
    )


def _body(results: Sequence[Judged]) -> str:
    """One claim, with a line for each place."""
    claim, rows = results[0].claim, len(results)
    about = f"{claim.source}; {claim.kind}; {', '.join(claim.methods)}"
    first = (
        f'<td rowspan="{rows}">{escape(claim.claim)}<small>{escape(about)}</small><small>{escape(claim.why)}</small>'
        f"<code>{escape(claim.id)}</code></td>"
        f'<td rowspan="{rows}">{escape(claim.published)}<small>{escape(claim.rule.text)}</small></td>'
    )
    lines = [
        f"<td>{escape(' / '.join(result.place))}</td><td>{escape(measured_text(result)) or NONE}</td>"
        f'<td class="{KINDS[result.verdict]}">{result.verdict}<small>{escape(_unclear(result))}</small></td>'
        for result in results
    ]
    return "<tbody>" + "".join(f"<tr>{first * (not place)}{line}</tr>" for place, line in enumerate(lines)) + "</tbody>"


def _unclear(result: Judged) -> str:
    """The reason, where value and range do not say it."""
    return result.reason if result.low is None else ""


def _out_of_reach(results: Sequence[Judged]) -> str:
    lines = [
        [r.claim.claim, f"{r.claim.paper}, {r.claim.source}", r.claim.published, r.reason]
        for r in results
        if r.verdict == NOT_MEASURABLE
    ]
    if not lines:
        return ""
    text = table(["claim", "source", "published", "why not"], lines, texts=4).replace(
        'class="words', 'class="claims words'
    )
    return section("unmeasurable", "Not measurable here", text)


def _runs(state: dict[str, Any]) -> str:
    lines = []
    for name, run in state["runs"].items():
        made = ", ".join(filter(None, (f"reused: {run['folder']}", run["note"]))) if run["reused"] else "run"
        lines.append([name, run["command"], run["problem"] or made])
    text = table(["run", "command", "how"], lines, texts=3).replace('class="words', 'class="commands words')
    return section("runs", "Runs", caption("The commands that measure the claims."), text)
