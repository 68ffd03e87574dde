"""The results of `bench claims`: claims.csv, causes.csv and claims.html, from the runs that its folder names."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Sequence
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any, NotRequired, TypedDict

from shading_atlas_bench.reports.analysis.claims import (
    CONFIRMED,
    NOT_CONFIRMED,
    NOT_MEASURABLE,
    NOT_MEASURED,
    REFUTED,
    UNDECIDED,
    Claims,
    ClaimsError,
    Explained,
    Judged,
    RunRows,
    chosen,
    explain_all,
    judge_all,
    read_claims,
)
from shading_atlas_bench.reports.pages.html import caption, facts_list, section
from shading_atlas_bench.reports.pages.style import page_style
from shading_atlas_bench.reports.pages.tables import NONE, number, table
from shading_atlas_bench.reports.pages.texts import escape
from shading_atlas_bench.reports.store.columns import CAUSE_COLUMNS, CLAIM_COLUMNS, CLAIM_VERDICTS
from shading_atlas_bench.reports.store.csv_files import read_csv, replace_file, write_csv
from shading_atlas_bench.reports.store.data import DataError, read_json
from shading_atlas_bench.reports.store.results import FILE as RESULTS
from shading_atlas_bench.reports.store.results import Store

FILE = "claims.json"
COPY = "claims.toml"
CLAIMS_CSV, CAUSES_CSV = "claims.csv", "causes.csv"
WHY = ("measured", "cause", "how", "then", "verdict")  # fields of a line of `why_not`, after those of its claim
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
<meta name="color-scheme" content="light dark"><title>Published claims, Shading Atlas Bench</title>
<link rel="icon" href="data:,"><style>{style}</style></head>
<body><header><p class="eyebrow">Shading Atlas Bench</p><h1>Published claims, <span>measured here</span></h1>
{facts}</header><main>{body}</main></body></html>
"""


def is_claims(folder: Path) -> bool:
    """Whether the folder was written by `bench claims`."""
    return (folder / FILE).is_file()


class RunState(TypedDict):
    """A run that claims need: its command, its folder (below that of the claims, or a reused one), why it has no rows,
    `made`: what its results depend on, and `plan`: a hash of its plan, as from `plan_hash`."""

    command: str
    folder: str
    problem: str | None
    reused: bool
    note: str
    made: list[str] | None
    plan: NotRequired[str | None]  # earlier versions had none


class State(TypedDict):
    """The content of claims.json: what was asked for, and the runs by name."""

    ids: list[str]
    quick: bool
    device: str
    date: str
    variants: dict[str, tuple[str, str]]
    runs: dict[str, RunState]


def read_state(folder: Path) -> State:
    """The content of claims.json. Raises ClaimsError if it is none of `bench claims`."""
    try:
        return read_json(folder / FILE, State)
    except DataError as error:
        raise ClaimsError(f"{folder} has no readable {FILE}: give a folder that bench claims wrote. {error}") from error


def plan_hash(folder: Path) -> str | None:
    """16 hex digits of the plan of a run's results; None for those of an experiment, which has no store. Raises
    StoreError."""
    if not (folder / RESULTS).is_file():
        return None
    with Store(folder, must_exist=True) as store:
        return hashlib.sha256(json.dumps(store.plan(), sort_keys=True).encode()).hexdigest()[:16]


def _place_of(name: str, run: RunState, folder: Path) -> Path:
    """The folder of a run's results. Raises ClaimsError if it holds another's, StoreError if it cannot be read."""
    place = folder / run["folder"]
    other = not run["reused"] and run["folder"] != name
    if other or ("plan" in run and run["plan"] != plan_hash(place)):
        raise ClaimsError(
            f"{folder / FILE} says that the run {name} is in {place}, which is not what it was made as. The same "
            f"`bench claims` with --out {folder} makes it again."
        )
    return place


def write_claims(folder: Path) -> tuple[list[Judged], list[Explained]]:
    """Write claims.csv, causes.csv and claims.html into `folder`, from its claims.toml, claims.json and the runs named
    there. Returns the claims and their causes, at every place.

    Raises ClaimsError or StoreError for what cannot be read.
    """
    state = read_state(folder)
    places = {name: _place_of(name, run, folder) for name, run in state["runs"].items() if not run["problem"]}
    claims = chosen(read_claims(folder / COPY), state["ids"])
    problems = {name: run["problem"] for name, run in state["runs"].items() if run["problem"]}

    @cache
    def rows_of(name: str) -> RunRows:
        return RunRows.read(places[name])

    results = judge_all(claims.claims, rows_of, problems, state["variants"])
    causes = explain_all(claims, rows_of, problems, state["variants"])
    write_csv(folder / CLAIMS_CSV, CLAIM_COLUMNS, map(as_row, results))
    write_csv(folder / CAUSES_CSV, CAUSE_COLUMNS, map(as_cause, causes))
    replace_file(folder / "claims.html", _page(claims, results, causes, state))
    return results, causes


def as_row(result: Judged) -> dict[str, Any]:
    """The row of claims.csv."""
    claim = result.claim
    return {
        "id": claim.id,
        "run": "/".join(result.place),
        "size": result.size,
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
        "rule": claim.rule_text,
        "verdict": result.verdict,
        "reason": result.reason,
        "why": claim.why,
    }


def as_cause(each: Explained) -> dict[str, Any]:
    """The row of causes.csv."""
    test = each.test
    return {
        "id": each.cause.id,
        "claim": each.claim,
        "run": "/".join(each.place),
        "cause": each.cause.cause,
        "test": each.cause.test,
        "tested_in": "/".join(test.place) if test else "",
        "size": test.size if test else "",
        "methods": ", ".join(dict.fromkeys(op.method for op in test.claim.operands() if op.method)) if test else "",
        "measured": test and test.measured,
        "low": test and test.low,
        "high": test and test.high,
        "frames": (test and test.count) or None,
        "rule": test.claim.rule_text if test else "",
        "verdict": each.verdict,
        "reason": test.reason if test else each.cause.untested,
    }


def measured_text(result: Judged) -> str:
    """The median with its interval, as `0.79 (0.77-0.81)`; empty where nothing was measured."""
    return interval_text(result.measured, result.low, result.high)


def interval_text(middle: float | None, low: float | None, high: float | None) -> str:
    """A median with its 95 % interval where it has one; empty without a median."""
    if middle is None:
        return ""
    return short(middle) + ("" if low is None or high is None else f" ({short(low)}{NONE}{short(high)})")


def short(value: float) -> str:
    """Three significant digits, never in powers of ten."""
    return number(value) if value and not 0.001 <= abs(value) < 1000 else f"{value:.3g}"


def counts_text(results: Sequence[Judged]) -> str:
    """How many of each verdict, in words."""
    counts = Counter(result.verdict for result in results)
    return ", ".join(f"{counts[verdict]} {verdict}" for verdict in CLAIM_VERDICTS if counts[verdict])


def why_not(folder: Path, method: str) -> list[dict[str, str]]:
    """A method's claims that are not confirmed: what was measured, the causes that were tested and by which command,
    and what came out. From claims.csv and causes.csv in `folder`; raises ClaimsError without them.

    The first line of a claim names it. Where there is no cause, or each is refuted, a line of its own says so.
    """
    rows = [row for row in _read(folder / CLAIMS_CSV) if method in row["methods"].split(", ")]
    causes = _read(folder / CAUSES_CSV)
    lines = []
    for id_, group in groupby((row for row in rows if row["verdict"] == NOT_CONFIRMED), key=lambda row: row["id"]):
        own = {row["run"]: row for row in group}
        found = [row for row in causes if row["claim"] == id_ and row["run"] in own]
        named = next(iter(own.values()))
        lead = {"claim": f"{named['claim']} `{id_}`", "published": named["published"]}
        for line, about in enumerate(_why_lines(own, found)):
            lines.append({"id": id_, "line": str(line), **lead, **dict(zip(WHY, about, strict=True))})
            lead = dict.fromkeys(lead, "")
    return lines


def _why_lines(own: dict[str, dict[str, str]], causes: list[dict[str, str]]) -> list[tuple[str, ...]]:
    """For each cause of a claim, what was measured where it is one, and what its experiment gave; then the places
    for which none is left. own: the claim's rows by place."""

    def measured(places: Sequence[str]) -> str:
        return "<br>".join(
            f"{place} ({own[place]['size']}) {_interval(own[place])}, not {own[place]['rule']}" for place in places
        )

    lines: list[tuple[str, ...]] = []
    for _, group in groupby(sorted(causes, key=lambda row: row["id"]), key=lambda row: row["id"]):
        tests = list(group)
        then = [
            f"{row['tested_in']} ({row['size']}) {_interval(row)}, must be {row['rule']}"
            for row in tests
            if row["tested_in"]
        ]
        verdicts = dict.fromkeys(row["verdict"] for row in tests)
        if len(verdicts) > 1:
            verdicts = dict.fromkeys(f"{row['run']} {row['verdict']}" for row in tests)
        how = f"{tests[0]['test']}: `bench claims --id {tests[0]['claim']}`" if then else tests[0]["reason"]
        cells = (tests[0]["cause"], how, "<br>".join(dict.fromkeys(then)), "<br>".join(verdicts))
        lines.append((measured(list(dict.fromkeys(row["run"] for row in tests))), *cells))
    open_to = {row["run"] for row in causes if row["verdict"] != REFUTED}
    rest = [place for place in own if place not in open_to]
    if rest:
        lines.append((measured(rest), "no cause found", "", "", ""))
    return lines


def _interval(row: dict[str, str]) -> str:
    return interval_text(*(float(row[name]) if row[name] else None for name in ("measured", "low", "high")))


def _read(file: Path) -> list[dict[str, str]]:
    try:
        return read_csv(file)
    except DataError as error:
        raise ClaimsError(str(error)) from error


def _page(claims: Claims, results: Sequence[Judged], causes: Sequence[Explained], state: State) -> str:
    facts = {
        "Rows": f"{len(results)}: {counts_text(results)}",
        "Claims": str(len(claims.claims)),
        "Runs": "quick ones" if state["quick"] else "as the file of claims says",
        "Device": state["device"],
        "Date": state["date"].replace("T", " "),
    }
    papers = "".join(_paper(name, title, results) for name, title in claims.papers.items())
    style = page_style()
    return PAGE.format(
        style=style + STYLE,
        facts=facts_list(facts),
        body=papers + _causes(results, causes) + _out_of_reach(results) + _runs(state),
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
        f'<td rowspan="{rows}">{escape(claim.published)}<small>{escape(claim.rule_text)}</small></td>'
    )
    lines = [
        f"<td>{escape(' / '.join(result.place))}<small>{escape(result.size)}</small></td>"
        f"<td>{escape(measured_text(result)) or NONE}</td>"
        f'<td class="{KINDS[result.verdict]}">{result.verdict}<small>{escape(_unclear(result))}</small></td>'
        for result in results
    ]
    return "<tbody>" + "".join(f"<tr>{first * (not place)}{line}</tr>" for place, line in enumerate(lines)) + "</tbody>"


def _unclear(result: Judged) -> str:
    """The reason, where value and range do not say it."""
    return result.reason if result.low is None else ""


def _causes(results: Sequence[Judged], causes: Sequence[Explained]) -> str:
    """What was tested as the cause of rows that are not confirmed."""
    failed = {(result.claim.id, result.place) for result in results if result.verdict == NOT_CONFIRMED}
    lines = []
    for each in causes:
        if (each.claim, each.place) in failed:
            test, where = each.test, f"{each.claim}, {'/'.join(each.place)}"
            then = each.cause.untested
            if test:
                then = f"{'/'.join(test.place)} {measured_text(test)}, must be {test.claim.rule_text}"
            lines.append([where, f"{each.cause.cause} ({each.cause.id})", each.cause.test or NONE, then, each.verdict])
    if not lines:
        return ""
    text = table(["claim and run", "cause", "tested how", "measured then", "verdict"], lines, texts=5)
    about = caption(
        "Each cause is removed by an experiment, and the claim measured again: its rule must then hold if that is the "
        "cause. One that holds need not be the only one."
    )
    return section("causes", "Why not", about, text.replace('class="words', 'class="claims words'))


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


def _runs(state: State) -> str:
    lines = []
    for name, run in state["runs"].items():
        made = ", ".join(filter(None, (f"reused: {run['folder']}", run["note"]))) if run["reused"] else "run"
        lines.append([name, run["command"], run["problem"] or made])
    text = table(["run", "command", "how"], lines, texts=3).replace('class="words', 'class="commands words')
    return section("runs", "Runs", caption("The commands that measure the claims."), text)
