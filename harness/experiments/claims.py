"""`bench claims`: the runs that the papers' claims need, made or reused, and the table of what they say."""

from __future__ import annotations

import contextlib
import io
import json
import shlex
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any

from shading_atlas_bench.harness.console import TerminalProgress, counted, make_console, make_table, styled
from shading_atlas_bench.harness.errors import InputError, StoppedError
from shading_atlas_bench.harness.plugins import label_of, refuse_code, variant_string
from shading_atlas_bench.harness.run.digest import method_digest, suite_digest
from shading_atlas_bench.harness.run.folder import RUNS, locked
from shading_atlas_bench.harness.run.plan import WITHOUT_EFFECT, duration, expected_pace
from shading_atlas_bench.harness.run.run import run
from shading_atlas_bench.harness.watch.stops import stops_apart
from shading_atlas_bench.harness.workload.methods import find_methods
from shading_atlas_bench.harness.workload.presets import LINKED_LISTS
from shading_atlas_bench.harness.workload.session import workload_hashes
from shading_atlas_bench.harness.workload.settings import Settings, SettingsError, read_settings, settings_of
from shading_atlas_bench.kernels.cache import VERSION
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.reports.analysis.claims import (
    DEFAULT_FILE,
    NOT_CONFIRMED,
    NOT_MEASURED,
    Claims,
    ClaimsError,
    Explained,
    Judged,
    chosen,
    read_claims,
)
from shading_atlas_bench.reports.pages.claims_report import (
    COPY,
    FILE,
    RunState,
    counts_text,
    is_claims,
    measured_text,
    plan_hash,
    read_state,
    write_claims,
)
from shading_atlas_bench.reports.store.csv_files import replace_file
from shading_atlas_bench.reports.store.results import FILE as RESULTS
from shading_atlas_bench.reports.store.results import Store
from shading_atlas_bench.scenes.load import list_scenes, scene_path
from shading_atlas_bench.scenes.model import SceneError
from shading_atlas_bench.scenes.paths import PathError

# The settings that scene, path and head motion follow from.
WORKLOAD = (
    "scene", "unit", "detail", "repair", "decimate", "opaque", "max_texture", "allow_outside", "path", "frames",
    "head_motion", "latency", "seed", "cell_radius",
)  # fmt: skip
COLOURS = {"confirmed": "green", "not confirmed": "red", "undecided": "yellow"}


@dataclass(frozen=True)
class ClaimsRequest:
    """What `bench claims` is asked for. file: claims other than those that come with the suite.
    allow_outside: whether scenes may name files outside of their folders, which the claims themselves cannot say."""

    ids: tuple[str, ...] = ()
    quick: bool = False
    reuse: tuple[Path, ...] = ()
    file: Path | None = None
    device: str | None = None
    allow_outside: bool = False


@dataclass(frozen=True)
class NamedRun:
    """A run that claims need: its options as `bench run` takes them, and the ids of the claims."""

    name: str
    options: dict[str, Any]
    claims: tuple[str, ...]

    @property
    def of_linked_lists(self) -> bool:
        """Whether it is the thesis' experiment, which is no ordinary run."""
        return self.options.get("preset") == LINKED_LISTS

    @property
    def command(self) -> str:
        """The command line that makes it."""
        words = ["bench", "run"]
        for name, value in self.options.items():
            for each in value if isinstance(value, list) else [value]:
                words += [f"--{name.replace('_', '-')}", *([] if each is True else [str(each)])]
        return shlex.join(words)

    def methods(self) -> tuple[str, ...]:
        """The methods that it makes, as --method takes them. Raises SettingsError."""
        if self.of_linked_lists:
            return tuple(self.options.get("method", ("ppll",)))
        return settings_of(self.options).methods

    def settings(self) -> Settings:
        """Its options as settings, the scene's file where it is found. Raises SettingsError or SceneError."""
        settings = settings_of(self.options, source=f"The run {self.name} of the claims")
        return replace(settings, scene=scene_file(settings.scene))


def scene_file(name: str) -> str:
    """A built-in scene or the file meant. Raises SceneError where there is none."""
    path = scene_path(name)
    if name in list_scenes() or path.is_file():
        return str(path)
    raise SceneError(f"There is no scene {name}: let BENCH_SCENES name the folder that has it.")


def needs(wanted: ClaimsRequest) -> tuple[Claims, list[NamedRun]]:
    """The claims asked for, and the runs that they take, in the file's order. Raises InputError."""
    file = wanted.file or DEFAULT_FILE
    try:
        claims = chosen(read_claims(file), wanted.ids)
    except ClaimsError as error:
        raise InputError(str(error)) from error
    given = [options.get("method") for options in (*claims.runs.values(), claims.quick)]
    methods = [spec for specs in given if isinstance(specs, list) for spec in specs]
    operands = [operand.method for claim in claims.measured() for operand in claim.operands()]
    refuse_code([*methods, *operands], str(file), "install it as a package (packers/README.md)")
    found = []
    for name, options in claims.runs.items():
        asking = [claim for claim in claims.measured() if any(name in place for place in claim.runs)]
        ids = tuple(dict.fromkeys(claim.id for claim in asking))
        specs = {method for claim in asking for run, method in claim.asked() if run == name}
        if ids:
            ours: dict[str, Any] = {"device": wanted.device} if wanted.device else {}
            if "allow_outside" in options:
                raise InputError(f"The run {name} of {file} allows files outside: only --allow-outside may do that.")
            if wanted.allow_outside and options.get("preset") != LINKED_LISTS:
                ours["allow_outside"] = True
            quick = claims.quick if wanted.quick else {}
            found.append(NamedRun(name, _shortened(_in_threads(file, options) | ours, quick, specs), ids))
    for named in found:
        _check(named)
    return claims, found


def _in_threads(file: Path, options: dict[str, Any]) -> dict[str, Any]:
    """The options of a run, a file of poses found beside the file of claims."""
    poses = file.parent / str(options.get("path", ""))
    return options | {"path": str(poses)} if poses.is_file() else options


def _check(named: NamedRun) -> None:
    """Raise InputError or SettingsError for options that no run takes; a scene may be missing."""
    if named.of_linked_lists:
        from shading_atlas_bench.harness.experiments.ppll_2014 import experiment_of

        experiment_of(named.options)
        return
    with contextlib.suppress(SceneError):
        named.settings()


def _shortened(options: dict[str, Any], quick: dict[str, Any], specs: set[str]) -> dict[str, Any]:
    """The options with only the methods that are asked about, but for linked lists' own experiment, whose method has
    the parameters; quick options in place of those that they name."""
    if "method" in options and options.get("preset") != LINKED_LISTS:
        options = options | {"method": [spec for spec in options["method"] if spec in specs]}
    return options | {name: value for name, value in quick.items() if name in options}


def variants_of(claims: Claims) -> dict[str, tuple[str, str]]:
    """Name and parameters of each method that the claims name. Raises InputError for an unknown one."""
    specs = {operand.method: None for claim in claims.measured() for operand in claim.operands() if operand.method}
    return {spec: _variant(spec) for spec in specs}


def _variant(spec: str) -> tuple[str, str]:
    (packer,) = find_methods(Settings(methods=(spec,)))
    return packer.name, variant_string(packer)


def run_claims(wanted: ClaimsRequest, out: Path | None) -> bool:
    """Make or reuse the runs into sub-folders of `out` (a new folder below runs/ if None), and write the table; whether
    all was measured that can be. Finished runs are kept, and the same command with the same `out` goes on.

    Raises InputError, StoreError or DeviceError for what cannot be used, and StoppedError when it is interrupted.
    """
    claims, runs = needs(wanted)
    variants = variants_of(claims)
    folder = out or RUNS / (datetime.now().strftime("%Y%m%d-%H%M%S") + "-claims")
    check_folder(folder)
    console = make_console(stderr=True)
    with locked(folder):
        work = ClaimRuns(wanted, folder, runs, variants)
        work.begin()
        for name, run_of in work.state["runs"].items():
            if run_of["note"]:
                console.print(
                    styled("[yellow]note[/] {} is reused from {}, {}.", name, run_of["folder"], run_of["note"])
                )
        console.print(styled("Results go to [bold]{}[/]; the same command with --out {} goes on.", folder, folder))
        stopped = False
        for place, named in enumerate(runs):
            if not work.waits(named):
                continue
            console.print(
                styled("[dim]Run {} of {}:[/] {}  [dim]{}[/]", place + 1, len(runs), named.name, named.command)
            )
            try:
                with stops_apart():
                    work.one(named)
            except (StoppedError, KeyboardInterrupt):
                stopped = True
                break
        results, causes = write_claims(folder)
    show_results(results, causes, folder)
    if stopped:
        raise StoppedError(f"Finished runs are kept: the same command with --out {folder} goes on.")
    verdicts = [*(result.verdict for result in results), *(cause.verdict for cause in causes)]
    return NOT_MEASURED not in verdicts


class ClaimRuns:
    """The runs on their way: what is done, in `folder`/claims.json, from which the table can be made at any time.

    An entry of a run holds its command, its folder (below `folder`, or a reused one), why it has no rows, and `made`,
    what its results depend on.
    """

    def __init__(
        self, wanted: ClaimsRequest, folder: Path, runs: list[NamedRun], variants: dict[str, tuple[str, str]]
    ) -> None:
        self.wanted, self.folder, self.runs, self.variants = wanted, folder, runs, variants
        self.device = Device.open(wanted.device).name
        self.state: dict[str, Any] = {}

    def begin(self) -> None:
        """Take over what an earlier call left, look at the folders to reuse, and write the first state.

        Raises ClaimsError where what it left cannot be read, and InputError for a folder that fits no run.
        """
        before = read_state(self.folder)["runs"] if is_claims(self.folder) else {}
        fitting = self._reusable()
        text = (self.wanted.file or DEFAULT_FILE).read_text(encoding="utf-8")
        replace_file(self.folder / COPY, text)
        entries = {}
        for named in self.runs:
            entry: RunState = {
                "folder": named.name,
                "command": named.command,
                "problem": "It has not been run yet: the same command goes on.",
                "reused": False,
                "note": "",
                "made": None,
            }
            old = before.get(named.name)
            if folder := fitting.get(named.name):
                note = _older(named, folder)
                entry |= {"folder": str(folder), "problem": None, "reused": True, "note": note}
                entry["plan"] = plan_hash(folder)
            elif old and old["made"] == self._made(named) and not old["problem"] and self._is_whole(named, old):
                entry |= {"problem": None, "made": old["made"], "plan": plan_hash(self.folder / named.name)}
            entries[named.name] = entry
        self.state = {
            "ids": list(self.wanted.ids),
            "quick": self.wanted.quick,
            "device": self.device,
            "date": datetime.now().astimezone().isoformat(timespec="minutes"),
            "variants": self.variants,
            "runs": entries,
        }
        self._save()

    def _is_whole(self, named: NamedRun, old: RunState) -> bool:
        """Whether a run that was made is where it was made."""
        place = self.folder / named.name
        same = "plan" not in old or old["plan"] == plan_hash(place)
        return same and (named.of_linked_lists or not _misfit(named, place))

    def _save(self) -> None:
        replace_file(self.folder / FILE, json.dumps(self.state, indent=2) + "\n")

    def _made(self, named: NamedRun) -> list[str]:
        """What the results of a run depend on: options, scene, path, device, kernels, methods."""
        digests = [method_digest(type(packer)) for packer in find_methods(Settings(methods=named.methods()))]
        return [named.command, *_hashes_of(named).values(), self.device, suite_digest(), VERSION, *digests]

    def waits(self, named: NamedRun) -> bool:
        """Whether a run is neither made nor reused yet."""
        return bool(self.state["runs"][named.name]["problem"])

    def one(self, named: NamedRun) -> None:
        """Make a run; what it cannot use becomes the reason why its claims are not measured."""
        entry = self.state["runs"][named.name]
        try:
            self._make(named)
            entry |= {"problem": None, "made": self._made(named), "plan": plan_hash(self.folder / named.name)}
        except (SceneError, PathError, SettingsError) as error:
            entry["problem"] = str(error)
        self._save()

    def _make(self, named: NamedRun) -> None:
        folder = self.folder / named.name
        with contextlib.redirect_stdout(io.StringIO()):  # of each run only its rows matter
            if named.of_linked_lists:
                from shading_atlas_bench.harness.experiments.ppll_2014 import experiment_of, run_experiment

                run_experiment(experiment_of(named.options), folder)
                return
            run(named.settings(), folder, TerminalProgress(), resume=self.folder)

    def _reusable(self) -> dict[str, Path]:
        """For each run that a folder of --reuse fits, that folder. Raises InputError for a folder that fits none."""
        found: dict[str, Path] = {}
        for given in self.wanted.reuse:
            folders = sorted(file.parent for file in given.glob("*/run.json")) if is_claims(given) else [given]
            fitting = {run.name: folder for folder in folders for run in self.runs if not _misfit(run, folder)}
            if not fitting:
                what = f"{self.runs[0].name} has {_misfit(self.runs[0], folders[0])}" if folders else "it has no runs"
                raise InputError(f"{given} has the results of no run that these claims need ({what}).")
            found |= {name: folder.resolve() for name, folder in fitting.items()}
        return found


def _hashes_of(named: NamedRun) -> dict[str, str]:
    """As `workload_hashes`, of linked lists `model_hashes`; empty where a scene cannot be read."""
    try:
        if named.of_linked_lists:
            from shading_atlas_bench.harness.experiments.ppll_2014 import model_hashes

            return model_hashes()
        own = named.settings()
        return _hashes(Settings(**{name: getattr(own, name) for name in WORKLOAD}))
    except (SceneError, PathError, SettingsError):
        return {}


@cache
def _hashes(workload: Settings) -> dict[str, str]:
    return workload_hashes(workload)


def _misfit(named: NamedRun, folder: Path) -> str:
    """Why the results in a folder are not those of a run; empty where they are."""
    if named.of_linked_lists or not (folder / RESULTS).is_file() or not (folder / "run.json").is_file():
        return "no results of bench run"
    try:
        own, theirs = named.settings(), read_settings(folder / "run.json")
    except SceneError as error:
        return str(error)
    ours, other = own.to_json(), theirs.to_json()
    apart = {*WITHOUT_EFFECT, "crf", "device", "scene"}
    if own.codec == "none":  # every run also shows its planes without loss
        apart |= {"codec", "display_crf"}
    names = [name for name in ours if name not in apart and ours[name] != other[name]]
    if Path(own.scene).resolve() != Path(theirs.scene).resolve():
        names.append("scene")
    if not set(own.crfs) <= set(theirs.crfs):
        names.append("crf")
    if names:
        return "other " + ", ".join(names)
    wanted = {(packer.name, variant_string(packer)): label_of(packer) for packer in find_methods(own)}
    with Store(folder) as store:
        finished, plan = store.finished(), store.plan() or {}
    hashes = _hashes_of(named)
    if not hashes or any(plan.get(name, value) != value for name, value in hashes.items()):
        return "another scene or path of the same name"
    lacking = sorted(label for key, label in wanted.items() if (*key, own.frames - 1) not in finished)
    return f"no finished {', '.join(lacking)}" if lacking else ""


def _older(named: NamedRun, folder: Path) -> str:
    """What a reader must know of a reused run; empty if today's program would give the same numbers."""
    with Store(folder, must_exist=True) as store:
        plan = store.plan() or {}
    packers = find_methods(Settings(methods=named.methods()))
    made = {f"{packer.name}[{variant_string(packer)}]": method_digest(type(packer)) for packer in packers}
    known = plan.get("methods")
    same_methods = isinstance(known, dict) and known | made == known
    same = plan.get("suite") == suite_digest() and same_methods and _hashes_of(named).keys() <= plan.keys()
    return "" if same and plan.get("version") == VERSION else "made by another program"


def check_folder(folder: Path) -> None:
    """Raise InputError for a folder that holds something else already."""
    if folder.is_file():
        raise InputError(f"{folder} is a file: give a folder for --out.")
    if folder.is_dir() and not is_claims(folder) and any(entry.name != ".lock" for entry in folder.iterdir()):
        raise InputError(f"The folder {folder} holds other things than claims: give a new or empty one for --out.")


def show_needs(wanted: ClaimsRequest, out: Path | None) -> None:
    """Print the claims, and the runs that they take with their commands; runs nothing."""
    if out:
        check_folder(out)
    claims, runs = needs(wanted)
    variants_of(claims)
    console = make_console()
    table = make_table(counted(len(claims.claims), "claim"), "id", "published", "runs")
    for claim in claims.claims:
        places = ", ".join("/".join(place) for place in claim.runs)
        table.add_row(claim.id, claim.published, places or "not measurable here")
    console.print(table)
    console.print()
    seconds = 0.0
    for named in runs:
        about: object = ""
        try:
            if not named.of_linked_lists:
                settings = named.settings()
                seconds += settings.frames * expected_pace(settings, "") * len(settings.methods)
        except SceneError as error:
            about = styled("  [yellow]not measured[/]: {}", error)
        console.print(styled("[bold]{}[/]  {}{}", named.name, counted(len(named.claims), "claim"), about))
        console.print(styled("  [dim]{}[/]", named.command))
    console.print(f"about {duration(seconds)} on a quiet machine, more for scenes of millions of triangles")


def show_results(results: list[Judged], causes: list[Explained], folder: Path) -> None:
    """Print each claim with a line for each place where it was measured, causes of it that were tested, and how many of
    each verdict."""
    console = make_console()
    for id_, group in groupby(results, key=lambda result: result.claim.id):
        places = list(group)
        claim = places[0].claim
        rule = f", must be {claim.rule.text}" if claim.rule else ""
        console.print(styled("[bold]{}[/]  [dim]published {}{}[/]", id_, claim.published, rule))
        for result in places:
            verdict = styled("[{style}]{}[/]", result.verdict, style=COLOURS.get(result.verdict, "dim"))
            where = f"{'/'.join(result.place)} {result.size}"
            console.print(styled("  {:<36} {:<24} {}", where, measured_text(result), verdict), soft_wrap=True)
            if result.verdict == NOT_CONFIRMED:
                for each in causes:
                    if (each.claim, each.place) == (id_, result.place):
                        console.print(
                            styled("    [dim]because of {}?[/] {}", each.cause.id, each.verdict), soft_wrap=True
                        )
    tests = [cause.test for cause in causes if cause.test]
    for reason in dict.fromkeys(result.reason for result in (*results, *tests) if result.verdict == NOT_MEASURED):
        console.print(styled("[yellow]not measured[/] {}", reason))
    console.print(counts_text(results))
    console.print(styled("[bold]{}/claims.html[/]  claims.csv  causes.csv", folder), soft_wrap=True)
