"""Published claims: read from a TOML file, measured on the rows of runs, and judged by the rule that the file states.

A measured value is one number per frame: a column, a statistic or a stage of a method (or a sum of some), over or minus
another such value of the same frame, or the exponent with which it grows over several runs. The verdict is about the
median over the frames and its 95 % interval.

The file also states causes of claims that may fail, each with an experiment in which the cause is removed. It is
measured and judged in the same way, and its rule must hold if that is the cause.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any, NotRequired, TypeAlias, TypedDict

from msgspec import Meta

from shading_atlas_bench.errors import BenchError
from shading_atlas_bench.reports.store.columns import BY_NAME, CLAIM_KINDS, MEASURED_STATUSES, MEASURES
from shading_atlas_bench.reports.store.csv_files import median_interval, read_csv
from shading_atlas_bench.reports.store.data import DataError, read_toml
from shading_atlas_bench.reports.store.middle import median
from shading_atlas_bench.reports.store.names import ALLOWED, fits_everywhere
from shading_atlas_bench.reports.store.results import FILE, Store

DEFAULT_FILE = Path(__file__).parents[1] / "claims.toml"
CONFIRMED, NOT_CONFIRMED, UNDECIDED = "confirmed", "not confirmed", "undecided"
NOT_MEASURED, NOT_MEASURABLE = "not measured", "not measurable"
HOLDS, REFUTED, UNTESTED = "holds", "refuted", "untested"
OF_CAUSE = {CONFIRMED: HOLDS, NOT_CONFIRMED: REFUTED}
HALVES = ("first", "second")
TABLES = ("frames", "layers")
OFF_BUDGET = 0.05  # share by which samples may differ from what a run asks for, as packers.budget.TOLERANCE
FEWEST = 6  # values that have a 95 % interval
OPERAND = ("value", "method", "crf", "table", "where", "from", "half", "when")
COMBINED = ("over", "minus", "exponent")
TEXTS = ("id", "paper", "source", "claim", "published", "kind", "why")
OPTIONAL = ("methods", "runs", "measure", "rule", "not_measurable", "undecided")
TEXTS_OF_CAUSE = ("id", "cause", "test")
OPTIONAL_OF_CAUSE = ("claims", "places", "instead", "runs", "measure", "rule", "untested")

Row = dict[str, Any]
Variant = tuple[str, str]
Key = tuple[Any, ...]  # of a value: its frame, and in an experiment with several models and sizes those before it
BEYOND = "Its numbers are beyond floating point."


Entry: TypeAlias = dict[str, Any]  # of claims and causes, whose values are checked one by one, for their sentences
Options: TypeAlias = dict[str, str | bool | int | float | list[str]]


class ClaimsFile(TypedDict):
    """The tables of a file of claims."""

    papers: Annotated[dict[str, str], Meta(min_length=1)]
    runs: Annotated[dict[str, Options], Meta(min_length=1)]
    quick: NotRequired[Options]
    claims: Annotated[list[Entry], Meta(min_length=1)]
    causes: NotRequired[list[Entry]]


class ClaimsError(BenchError, ValueError):
    """A file of claims that cannot be used; the message is one sentence."""


class UnmeasuredError(BenchError, ValueError):
    """A value that the runs do not give; the message is the reason."""


@dataclass(frozen=True)
class Operand:
    """Where a value per frame comes from.

    values: names of columns, statistics or stages (those have a slash), summed. method: as `--method` takes it; empty
    for an experiment whose rows have no method. crf: the rate whose rows count, None for those without video coding.
    where: other columns that rows must match. start: the first frame that counts. half: of the frames, one of HALVES.
    when: statistics and the value that they must have in every frame: otherwise it is not what the claim is about.
    """

    values: tuple[str, ...]
    method: str = ""
    crf: int | None = None
    table: str = TABLES[0]
    where: tuple[tuple[str, Any], ...] = ()
    start: int = 0
    half: str = ""
    when: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Measure:
    """A value per frame: `value`, `value` over or minus `other`, or the exponent of `value` over `other`."""

    value: Operand
    how: str = ""  # "" or one of COMBINED
    other: Operand | None = None


@dataclass(frozen=True)
class Rule:
    """What the measured value must be: above `low`, below `high`, or between both."""

    low: float = -math.inf
    high: float = math.inf

    @property
    def text(self) -> str:
        """The rule in words."""
        if self.low == -math.inf:
            return f"below {self.high:g}"
        return f"above {self.low:g}" if self.high == math.inf else f"between {self.low:g} and {self.high:g}"


@dataclass(frozen=True)
class Claim:
    """A published statement. runs: for each place where it is measured, the runs that takes, the measured value's own
    first. measure and rule are None where it cannot be measured here, and `not_measurable` says why. undecided: what it
    would take where the runs cannot decide it."""

    id: str
    paper: str
    source: str
    claim: str
    published: str
    kind: str
    why: str
    methods: tuple[str, ...]
    runs: tuple[tuple[str, ...], ...] = ()
    measure: Measure | None = None
    rule: Rule | None = None
    not_measurable: str = ""
    undecided: str = ""

    def operands(self) -> list[Operand]:
        """The values that it takes: none, one or two."""
        found = [self.measure.value, self.measure.other] if self.measure else []
        return [operand for operand in found if operand]

    def asked(self) -> set[tuple[str, str]]:
        """Run and method of every value that it takes."""
        if self.measure is None:
            return set()
        value, other = self.measure.value, self.measure.other
        if other is None or self.measure.how == "exponent":
            return {(name, each.method) for each in self.operands() for place in self.runs for name in place}
        return {(place[end], each.method) for place in self.runs for end, each in ((0, value), (-1, other))}

    @property
    def rule_text(self) -> str:
        """What the measured value must be, in words; empty where it cannot be measured."""
        return self.rule.text if self.rule else ""


@dataclass(frozen=True)
class Cause:
    """Why claims may fail. test: how an experiment removes it, in words, or else `untested`: why none can."""

    id: str
    cause: str
    experiments: tuple[Experiment, ...]
    test: str = ""
    untested: str = ""


@dataclass(frozen=True)
class Experiment:
    """claim: what must hold if the cause is the right one, a claim with other runs, methods, measure or rule, at one
    place (the claim itself if nothing can be tested). explains: the places of the claim for which it is the cause."""

    claim: Claim
    explains: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Claims:
    """A file of claims. runs: options of `bench run` by name of the run. quick: options that make them short."""

    papers: dict[str, str]
    runs: dict[str, Options]
    quick: Options
    claims: tuple[Claim, ...]
    causes: tuple[Cause, ...] = ()

    def measured(self) -> list[Claim]:
        """All that runs must give values for: the claims, and those that test causes."""
        tested = [cause for cause in self.causes if not cause.untested]
        return [*self.claims, *(experiment.claim for cause in tested for experiment in cause.experiments)]


# Reading -------------------------------------------------------------------------------------------------------------


def read_claims(file: Path = DEFAULT_FILE) -> Claims:
    """The claims of a TOML file. Raises ClaimsError, saying in a sentence what is wrong and where."""
    try:
        _known(read_toml(file, Entry), ClaimsFile.__annotations__, str(file))
        content = read_toml(file, ClaimsFile)
    except DataError as error:
        raise ClaimsError(str(error)) from error
    for name, options in {**content["runs"], "quick": content.get("quick", {})}.items():
        if not isinstance(options.get("method", []), list):
            raise ClaimsError(f"{file}: {name} has the method {options['method']!r}: give a list.")
    papers, runs = content["papers"], content["runs"]
    for name in runs:
        if not fits_everywhere(name):
            raise ClaimsError(f"{file}: the run {name!r} must have a name of {ALLOWED}.")
    claims = tuple(_claim(entry, papers, runs) for entry in content["claims"])
    causes = tuple(_cause(entry, claims, runs) for entry in content.get("causes", ()))
    for what, entries in (("claims", claims), ("causes", causes)):
        ids = [entry.id for entry in entries]
        twice = next((name for name in ids if ids.count(name) > 1), None)
        if twice:
            raise ClaimsError(f"{file}: two {what} have the id {twice!r}: give each its own.")
    return Claims(papers, runs, content.get("quick", {}), claims, causes)


def _claim(entry: Mapping[str, Any], papers: Mapping[str, str], runs: Mapping[str, Any]) -> Claim:
    where = f"The claim {entry.get('id', '?')!r}"
    _known(entry, (*TEXTS, *OPTIONAL), where)
    for name in TEXTS:
        if not isinstance(entry.get(name), str) or not entry[name]:
            raise ClaimsError(f"{where} lacks {name}, a text.")
    if entry["paper"] not in papers:
        raise ClaimsError(f"{where} names the unknown paper {entry['paper']!r}; known are {', '.join(papers)}.")
    if entry["kind"] not in CLAIM_KINDS:
        raise ClaimsError(f"{where} has the kind {entry['kind']!r}; known are {', '.join(CLAIM_KINDS)}.")
    if not _texts(entry.get("methods")):
        raise ClaimsError(f"{where} lacks methods, a list of the packers that it is about.")
    if not isinstance(entry.get("undecided", ""), str):
        raise ClaimsError(f"{where} has undecided {entry['undecided']!r}: give a text.")
    texts = {name: entry[name] for name in TEXTS} | {"methods": tuple(entry["methods"])}
    given = [name for name in ("runs", "measure", "rule") if name in entry]
    if "not_measurable" in entry:
        if given or not isinstance(entry["not_measurable"], str):
            raise ClaimsError(f"{where} has not_measurable, a text, and so no {' and '.join(given) or 'other value'}.")
        return Claim(**texts, not_measurable=entry["not_measurable"])
    if len(given) < 3:
        raise ClaimsError(f"{where} needs runs, measure and rule, or else not_measurable.")
    found = Claim(
        **texts, runs=_places(entry["runs"], where), measure=_measure(entry["measure"], where),
        rule=_rule(entry, where), undecided=entry.get("undecided", ""),
    )  # fmt: skip
    _check_runs(found, runs, where)
    return found


def _cause(entry: Mapping[str, Any], claims: Sequence[Claim], runs: Mapping[str, Any]) -> Cause:
    where = f"The cause {entry.get('id', '?')!r}"
    _known(entry, (*TEXTS_OF_CAUSE, *OPTIONAL_OF_CAUSE), where)
    for name in (*TEXTS_OF_CAUSE[:2], "untested" if "untested" in entry else "test"):
        if not isinstance(entry.get(name), str) or not entry[name]:
            raise ClaimsError(f"{where} lacks {name}, a text.")
    known = {claim.id: claim for claim in claims if claim.measure}
    if not _texts(entry.get("claims")) or not set(entry["claims"]) <= set(known):
        raise ClaimsError(f"{where} has claims {entry.get('claims')!r}: give ids of claims that are measured.")
    given = [name for name in ("test", "instead", "runs", "measure", "rule") if name in entry]
    if "untested" in entry and given:
        raise ClaimsError(f"{where} has untested, and so no {' and '.join(given)}.")
    found = [experiment for name in entry["claims"] for experiment in _experiments(entry, known[name], where)]
    explained = {place for experiment in found for place in experiment.explains}
    strange = [place for place in entry.get("places", ()) if tuple(place.split("/")) not in explained]
    if strange:
        raise ClaimsError(f"{where} has the place {strange[0]!r}, which is none of its claims' runs.")
    for experiment in found:
        _check_runs(experiment.claim, runs, f"{where}, of {experiment.claim.id!r},")
    return Cause(entry["id"], entry["cause"], tuple(found), entry.get("test", ""), entry.get("untested", ""))


def _experiments(entry: Mapping[str, Any], claim: Claim, where: str) -> list[Experiment]:
    """The claim with what the entry changes: its measure, its rule, and either its runs, or runs and methods instead of
    others at each of its places."""
    instead = entry.get("instead", {})
    if not isinstance(instead, Mapping) or not all(isinstance(value, str) for value in instead.values()):
        raise ClaimsError(f"{where} has instead {instead!r}: give runs or methods and those to take instead.")
    wanted = _places(entry["places"], where) if "places" in entry else claim.runs
    places = tuple(place for place in claim.runs if place in wanted)
    if not places:
        raise ClaimsError(f"{where} has no place of the claim {claim.id!r}: give some of its runs as places.")
    measure = _measure(entry["measure"], where) if "measure" in entry else _instead(claim.measure, instead)
    changed = replace(claim, undecided="", measure=measure, rule=_rule(entry, where) if "rule" in entry else claim.rule)
    if "untested" in entry:
        return [Experiment(changed, places)]
    if "runs" in entry:
        tests = [(place, places) for place in _places(entry["runs"], where)]
    else:
        tests = [(tuple(instead.get(name, name) for name in place), (place,)) for place in places]
    as_it_was = [test for test, explains in tests if test in explains]
    if as_it_was and (changed.measure, changed.rule) == (claim.measure, claim.rule):
        raise ClaimsError(
            f"{where} changes nothing of the claim {claim.id!r} at {'/'.join(as_it_was[0])}: say what, or name places."
        )
    return [Experiment(replace(changed, runs=(test,)), explains) for test, explains in tests]


def _instead(measure: Measure | None, names: Mapping[str, str]) -> Measure | None:
    """The measure with other methods."""
    if measure is None:
        return None

    def other(operand: Operand) -> Operand:
        return replace(operand, method=names.get(operand.method, operand.method))

    return replace(measure, value=other(measure.value), other=measure.other and other(measure.other))


def _known(table: Any, names: Collection[str], where: str) -> None:
    if not isinstance(table, Mapping):
        raise ClaimsError(f"{where} must be a table, not {table!r}.")
    unknown = [name for name in table if name not in names]
    if unknown:
        raise ClaimsError(f"{where} has the unknown entry {unknown[0]!r}; known are {', '.join(names)}.")


def _texts(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(each, str) and each for each in value)


def _places(value: Any, where: str) -> tuple[tuple[str, ...], ...]:
    if not _texts(value):
        raise ClaimsError(f"{where} has runs {value!r}: give a list of names, two or more joined by slashes.")
    return tuple(tuple(text.split("/")) for text in value)


def _check_runs(claim: Claim, known: Mapping[str, Any], where: str) -> None:
    """Raise ClaimsError for runs that do not exist, are too many or few, or lack a method."""
    how = claim.measure.how if claim.measure else ""
    for place in claim.runs:
        unknown = [name for name in place if name not in known]
        if unknown:
            raise ClaimsError(f"{where} needs the unknown run {unknown[0]!r}; known are {', '.join(known)}.")
        wrong = len(place) < 2 if how == "exponent" else len(place) > (2 if how else 1)
        if wrong:
            raise ClaimsError(
                f"{where} has {len(place)} runs in {'/'.join(place)!r}: an exponent takes two or more, over and minus "
                "one or two, a plain value one."
            )
    for name, method in sorted(claim.asked()):
        if method and method not in known[name].get("method", ()):
            raise ClaimsError(f"{where} needs {method}, which the run {name!r} does not make.")


def _rule(entry: Mapping[str, Any], where: str) -> Rule:
    rule = entry["rule"]
    _known(rule, ("above", "below", "between"), f"{where}, rule")
    ends = {name: value if name == "between" else [value] for name, value in rule.items()}
    name, numbers = next(iter(ends.items()), ("", []))
    good = isinstance(numbers, list) and all(type(each) in (int, float) for each in numbers)
    if len(rule) != 1 or not good or len(numbers) != (2 if name == "between" else 1):
        raise ClaimsError(f"{where} has the rule {rule!r}: give above or below a number, or between two.")
    if name == "between" and not numbers[0] < numbers[1]:
        raise ClaimsError(f"{where} has the rule {rule!r}: give the lower number first.")
    if name == "between":
        return Rule(*numbers)
    return Rule(low=numbers[0]) if name == "above" else Rule(high=numbers[0])


def _measure(table: Any, where: str) -> Measure:
    _known(table, (*OPERAND, *COMBINED), f"{where}, measure")
    how = [name for name in COMBINED if name in table]
    if len(how) > 1:
        raise ClaimsError(f"{where} measures with {' and '.join(how)}: give one of them.")
    own = {name: value for name, value in table.items() if name in OPERAND}
    value = _operand(own, f"{where}, measure")
    if not how:
        return Measure(value)
    second = {"value": table["exponent"]} if how == ["exponent"] else table[how[0]]
    _known(second, OPERAND, f"{where}, {how[0]}")
    return Measure(value, how[0], _operand(own | second, f"{where}, {how[0]}"))


def _operand(table: Mapping[str, Any], where: str) -> Operand:
    value, filters = table.get("value", ()), table.get("where", {})
    values = [value] if isinstance(value, str) else value
    checks = [
        (_texts(values), "value", "a column, statistic or stage, or a list of such to add"),
        (isinstance(table.get("method", ""), str), "method", "a text as --method takes it"),
        (type(table.get("crf", 0)) is int, "crf", "a whole number"),
        (table.get("table", TABLES[0]) in TABLES, "table", f"one of {', '.join(TABLES)}"),
        (isinstance(filters, dict), "where", "a table of columns and values"),
        (type(table.get("from", 0)) is int and table.get("from", 0) >= 0, "from", "a frame's number"),
        (table.get("half", "") in ("", *HALVES), "half", f"one of {', '.join(HALVES)}"),
        (isinstance(table.get("when", {}), dict), "when", "a table of statistics and numbers"),
        (bool(table.get("method")) != bool(filters), "method", "a method, or where for an experiment, and not both"),
    ]
    for fine, name, wanted in checks:
        if not fine:
            raise ClaimsError(f"{where} has {name} {table.get(name)!r}: give {wanted}.")
    measured = [name for name in values if name in BY_NAME and BY_NAME[name] not in MEASURES]
    if measured and table.get("method"):
        raise ClaimsError(f"{where} has value {measured[0]!r}: that column is no measure.")
    return Operand(
        tuple(values), table.get("method", ""), table.get("crf"), table.get("table", TABLES[0]),
        tuple(filters.items()), table.get("from", 0), table.get("half", ""), tuple(table.get("when", {}).items()),
    )  # fmt: skip


# Measuring -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RunRows:
    """The rows of one run: of `bench run` its frames, statistics and stages; of an experiment its tables.

    extra: by method, variant and frame, the statistics and the milliseconds of stages by name.
    """

    tables: Mapping[str, Sequence[Row]]
    extra: Mapping[tuple[str, str, int], Mapping[str, float]]

    @classmethod
    def read(cls, folder: Path) -> RunRows:
        """From a folder that `bench run` wrote; raises StoreError for an unreadable one."""
        if not (folder / FILE).is_file():
            return cls({name: _numbers(folder / f"{name}.csv") for name in TABLES}, {})
        with Store(folder, must_exist=True) as store:
            rows, statistics, stages = store.rows(), store.statistics(), store.stages()
        extra: dict[tuple[str, str, int], dict[str, float]] = {}
        for named, value in ((statistics, "value"), (stages, "ms")):
            for row in named:
                if row[value] is not None:
                    name = row.get("stage") or row["name"]
                    extra.setdefault((row["method"], row["variant"], row["frame"]), {})[name] = row[value]
        return cls({TABLES[0]: rows}, extra)

    @property
    def sizes(self) -> list[str]:
        """Sizes of the client's pictures, as 1920x1080, each once."""
        of_rows = (row.get("size") or _size(row) for row in self.tables.get(TABLES[0], ()))
        return list(dict.fromkeys(filter(None, of_rows)))


def _size(row: Row) -> str:
    width, height = row.get("width"), row.get("height")
    return f"{width:.0f}x{height:.0f}" if width and height else ""


def _numbers(file: Path) -> list[Row]:
    """The rows of a CSV file, numbers as such."""

    def value(text: str) -> Any:
        try:
            return float(text)
        except ValueError:
            return text or None

    if not file.is_file():
        return []
    return [{name: value(text) for name, text in row.items()} for row in read_csv(file)]


def values_of(operand: Operand, run: RunRows, variants: Mapping[str, Variant]) -> dict[Key, float]:
    """The operand's value in each frame. Raises UnmeasuredError where there is none."""
    rows = [row for row in run.tables.get(operand.table, ()) if all(row.get(n) == v for n, v in operand.where)]
    if operand.method:
        method, variant = variants[operand.method]
        rows = [row for row in rows if (row["method"], row["variant"]) == (method, variant)]
        rate = operand.crf
        rows = [row for row in rows if (row["codec"] == "none" if rate is None else row["crf"] == rate)]
        _refuse_failed(rows, operand)
        rows = [row for row in rows if row["status"] in MEASURED_STATUSES]
        _refuse_off_budget(rows, operand)
        _refuse_otherwise(rows, operand, run)
    found: dict[Key, float] = {}
    for row in rows:
        numbers = [number for name in operand.values if (number := _number(name, row, run)) is not None]
        if len(numbers) == len(operand.values) and row.get("frame", operand.start) >= operand.start:
            try:
                found[_key(row, operand)] = math.fsum(numbers)
            except OverflowError:
                raise UnmeasuredError(BEYOND) from None
    if not found:
        of = operand.method or ", ".join(f"{name} {value}" for name, value in operand.where)
        at = f" at CRF {operand.crf}" if operand.crf is not None else ""
        raise UnmeasuredError(f"The run has no {' + '.join(operand.values)} of {of}{at}.")
    return _half(found, operand.half)


def _refuse_failed(rows: Sequence[Row], operand: Operand) -> None:
    bad = [row for row in rows if row["status"] not in MEASURED_STATUSES]
    if rows and len(bad) == len(rows):
        raise UnmeasuredError(f"{operand.method}: {bad[0]['status']}: {bad[0]['reason']}")


def _refuse_off_budget(rows: Sequence[Row], operand: Operand) -> None:
    """Samples that are not as many as the run asked for do not compare at equal samples."""
    budgeted = [row for row in rows if row.get("sample_budget") and row.get("samples") is not None]
    shares = [row["samples"] / row["sample_budget"] - 1 for row in budgeted]
    if shares and abs(median(shares)) > OFF_BUDGET:
        raise UnmeasuredError(f"{operand.method} has {median(shares):+.0%} samples against those asked for.")


def _refuse_otherwise(rows: Sequence[Row], operand: Operand, run: RunRows) -> None:
    """Frames in which a statistic has another value than `when` says."""
    for name, wanted in operand.when:
        other = [value for value in (_number(name, row, run) for row in rows) if value not in (None, wanted)]
        if other:
            raise UnmeasuredError(f"{operand.method} has {name} {other[0]:g}, where the claim is about {wanted:g}.")


def _number(name: str, row: Row, run: RunRows) -> float | None:
    if name in row:
        value: float | None = row[name]
        return value
    return run.extra.get((row.get("method", ""), row.get("variant", ""), row.get("frame", -1)), {}).get(name)


def _key(row: Row, operand: Operand) -> Key:
    """What two values must share to be compared: the frame, and what an experiment varies beside it."""
    return (row["frame"],) if operand.method else tuple(row.get(n) for n in ("model", "width", "height", "frame"))


def _half(values: dict[Key, float], half: str) -> dict[Key, float]:
    """The first or second half of the frames, each numbered from 0, so that they compare frame by frame."""
    if not half:
        return values
    frames = sorted({key[-1] for key in values})
    count = len(frames) // 2
    kept = frames[:count] if half == HALVES[0] else frames[len(frames) - count :]
    place = {frame: number for number, frame in enumerate(kept)}
    return {(*key[:-1], place[key[-1]]): value for key, value in values.items() if key[-1] in place}


def measured(what: Measure, runs: Sequence[RunRows], variants: Mapping[str, Variant]) -> list[float]:
    """The value in each frame, sorted by frame. Raises UnmeasuredError where the runs do not give it."""
    if what.other and what.how == "exponent":
        return _exponents(what.value, what.other, runs, variants)
    tops = values_of(what.value, runs[0], variants)
    if what.other is None:
        return [tops[key] for key in sorted(tops)]
    others = values_of(what.other, runs[-1], variants)
    shared = sorted(tops.keys() & others.keys())
    if what.how == "minus":
        found = [tops[key] - others[key] for key in shared]
    else:
        found = [tops[key] / others[key] for key in shared if others[key]]
    if not found:
        raise UnmeasuredError("No frame has both values." if not shared else "What it is compared with is 0.")
    if not all(map(math.isfinite, found)):
        raise UnmeasuredError(BEYOND)
    return found


def _exponents(value: Operand, other: Operand, runs: Sequence[RunRows], variants: Mapping[str, Variant]) -> list[float]:
    """In each frame, the slope of the logarithm of the value over that of the other one, through all runs."""
    ys = [values_of(value, run, variants) for run in runs]
    xs = [values_of(other, run, variants) for run in runs]
    shared = sorted(set.intersection(*(set(values) for values in (*xs, *ys))))
    slopes = [_slope([x[key] for x in xs], [y[key] for y in ys]) for key in shared]
    found = [slope for slope in slopes if slope is not None]
    if not found:
        raise UnmeasuredError(f"{' + '.join(other.values)} does not vary between the runs.")
    return found


def _slope(xs: Sequence[float], ys: Sequence[float]) -> float | None:
    """Least squares through the logarithms; None where they have no slope."""
    if min(*xs, *ys) <= 0 or min(xs) == max(xs):
        return None
    x, y = [math.log(v) for v in xs], [math.log(v) for v in ys]
    x0, y0 = fmean(x), fmean(y)
    return sum((a - x0) * (b - y0) for a, b in zip(x, y, strict=True)) / sum((a - x0) ** 2 for a in x)


# Judging -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Judged:
    """A claim at one place. measured, low, high: median and 95 % interval over `count` values, None without. size: of
    the clients' pictures there, as 1920x1080, those compared joined by a slash where they differ."""

    claim: Claim
    place: tuple[str, ...]
    verdict: str
    reason: str
    measured: float | None = None
    low: float | None = None
    high: float | None = None
    count: int = 0
    size: str = ""


def judge(values: Sequence[float], rule: Rule) -> tuple[str, str, float, float | None, float | None]:
    """Verdict, reason, median, and the ends of its interval."""
    middle = median(values)
    low, high = median_interval(sorted(values))
    if low is None or high is None:
        text = f"{len(values)} values have no 95 % interval: it takes {FEWEST}."
        return UNDECIDED, text, middle, None, None
    if rule.low < low and high < rule.high:
        return CONFIRMED, f"The interval is {rule.text}.", middle, low, high
    if high <= rule.low or low >= rule.high:
        return NOT_CONFIRMED, f"The interval is not {rule.text}.", middle, low, high
    return UNDECIDED, f"The interval is only partly {rule.text}.", middle, low, high


def judge_all(
    claims: Sequence[Claim],
    rows_of: Callable[[str], RunRows],
    problems: Mapping[str, str],
    variants: Mapping[str, Variant],
) -> list[Judged]:
    """Every claim at every place.

    rows_of: a run's rows by its name. problems: runs without rows, and why. variants: name and parameters of methods.
    """
    found = []
    for claim in claims:
        if claim.measure is None or claim.rule is None:
            found.append(Judged(claim, (), NOT_MEASURABLE, claim.not_measurable))
            continue
        for place in claim.runs:
            lacking = next((name for name in place if name in problems), None)
            if lacking:
                found.append(Judged(claim, place, NOT_MEASURED, problems[lacking]))
                continue
            runs = [rows_of(name) for name in place]
            try:
                values = measured(claim.measure, runs, variants)
            except UnmeasuredError as error:
                found.append(Judged(claim, place, NOT_MEASURED, str(error)))
                continue
            verdict, reason, middle, low, high = judge(values, claim.rule)
            if verdict == UNDECIDED and claim.undecided:
                reason = claim.undecided
            size = "/".join(dict.fromkeys(", ".join(run.sizes) for run in runs))
            found.append(Judged(claim, place, verdict, reason, middle, low, high, len(values), size))
    return found


@dataclass(frozen=True)
class Explained:
    """A cause of a claim at one of its places, with what its experiment gave. verdict: HOLDS where its rule holds."""

    cause: Cause
    claim: str
    place: tuple[str, ...]
    verdict: str
    test: Judged | None = None


def explain_all(
    claims: Claims,
    rows_of: Callable[[str], RunRows],
    problems: Mapping[str, str],
    variants: Mapping[str, Variant],
) -> list[Explained]:
    """Every cause at every place that it explains, in the order of the claims; arguments as of `judge_all`."""
    found = []
    for cause in claims.causes:
        for experiment in cause.experiments:
            test = None if cause.untested else judge_all([experiment.claim], rows_of, problems, variants)[0]
            verdict = OF_CAUSE.get(test.verdict, test.verdict) if test else UNTESTED
            found += [Explained(cause, experiment.claim.id, place, verdict, test) for place in experiment.explains]
    order = {(claim.id, place): n for n, (claim, place) in enumerate((c, p) for c in claims.claims for p in c.runs)}
    return sorted(found, key=lambda each: order[each.claim, each.place])


def chosen(claims: Claims, ids: Sequence[str]) -> Claims:
    """Only the claims with these ids (all without any), and their causes. Raises ClaimsError for an unknown one."""
    known = {claim.id: claim for claim in claims.claims}
    for name in ids:
        if name not in known:
            from difflib import get_close_matches

            close = get_close_matches(name, known, n=1)
            guess = f" Did you mean {close[0]!r}?" if close else ""
            raise ClaimsError(f"There is no claim {name!r}.{guess} bench claims --dry-run lists them all.")
    if not ids:
        return claims
    causes = [
        replace(cause, experiments=tuple(each for each in cause.experiments if each.claim.id in ids))
        for cause in claims.causes
    ]
    kept = tuple(cause for cause in causes if cause.experiments)
    return replace(claims, claims=tuple(known[name] for name in ids), causes=kept)
