"""`bench check`: the conformance kit, what every packer must pass, check by check.

A check is a function of the kit that returns results; `@check(name)` adds it to CHECKS. The test-suite runs the same
ones on every packer.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from shading_atlas_bench.harness.cases import MODULE, against_twin, own_cases
from shading_atlas_bench.harness.conformance.catalogue import (
    CATALOGUE,
    facing,
    grid,
    room,
    scattered,
    scene_of,
    still,
    walk,
)
from shading_atlas_bench.harness.conformance.fuzz import find_failure, save_soup
from shading_atlas_bench.harness.conformance.trial import (
    Stage,
    TrialCase,
    TrialResult,
    result_of,
    try_isolation,
    try_method,
)
from shading_atlas_bench.harness.console import counted, make_console, styled, tell_passed_over
from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.measure.machine import load
from shading_atlas_bench.harness.measure.returned import CheckedPacker, read_payload
from shading_atlas_bench.harness.watch.stops import stops_apart
from shading_atlas_bench.harness.watch.watchdog import time_limit
from shading_atlas_bench.kernels.case import INPUTS
from shading_atlas_bench.packers.interface import Packer, Parameter
from shading_atlas_bench.reports.pages.stress import magnitude

if TYPE_CHECKING:
    from shading_atlas_bench.harness.workload.session import Session
    from shading_atlas_bench.kernels.device import Device

SCENES = {"hall": 40_000, "village": 130_000, "shells": 2_000}  # triangles: the fewest that they can have
SIZE, ATLAS = (160, 90), (512, 512)
# Tests of the stress catalogue with the magnitude that every packer must bear.
BEARABLE = {
    "world-offset": 1e6,
    "float32-offset": 1e6,
    "scale-up": 1e6,
    "scale-down": 1e-6,
    "slivers": 1e-6,
    "zero-area": 100,
    "duplicated": 8,
    "sub-pixel": 0.001,
    "screen-filling": 1e4,
    "fan": 1000,
    "one-patch": 64,
    "equal-depth": 64,
    "near-plane": 0,
    "behind": 1e4,
    "wide-view": 170,
    "narrow-view": 2,
    "motion": 0,
    "teleport": 1e3,
    "empty-frames": 2,
}
BENCHMARK = 10.0  # seconds
SKIPPED = "skipped: "  # how the sentence of a check begins that had nothing to check
EXAMPLES, THOROUGH = 100, 1000


class Kit:
    """A packer's class with its parameters, and the stages that checks share; those are kept for the next packer."""

    def __init__(self, device: Device, packer: Packer, stages: dict[str, Stage] | None = None) -> None:
        self.device, self.kind = device, type(packer)
        self.parameters = {name: getattr(packer, name) for name in packer.parameters}
        self._stages = {} if stages is None else stages

    def make(self) -> Packer:
        """A packer without a past."""
        return self.kind(**self.parameters)

    def stage(self, key: str, make: Callable[[], Stage]) -> Stage:
        """The stage of a key, made once."""
        if key not in self._stages:
            self._stages[key] = make()
        return self._stages[key]

    def scene(self, name: str) -> Stage:
        """Two frames of a walk through a built-in scene, with their own visible sets."""
        return self.stage(name, lambda: _frames_of(self.session(name)))

    def session(self, name: str) -> Session:
        """A built-in scene of few triangles, on this kit's device."""
        from shading_atlas_bench.harness.workload.session import open_session
        from shading_atlas_bench.harness.workload.settings import Settings

        wide, high = SIZE
        settings = Settings(scene=name, detail=SCENES[name], path="orbit" if name == "shells" else "walk", frames=2,
                            width=wide, height=high, atlas_width=ATLAS[0], atlas_height=ATLAS[1])  # fmt: skip
        return open_session(settings, self.device)

    def case(self, key: str, make: Callable[[], TrialCase]) -> TrialResult:
        """What comes out of a case."""
        return try_method(self.stage(key, lambda: Stage.of(self.device, make())), self.make, again=1)


def _frames_of(session: Session) -> Stage:
    works = [session.source.work(index) for index in range(session.settings.frames)]
    return Stage(session.scene, [work.frame for work in works], [work.novel for work in works], exact=False)


Run: TypeAlias = Callable[[Kit], TrialResult]


@dataclass(frozen=True)
class Check:
    """A check: its name, what it means, and the function that runs it on a kit.

    patience: times the limit of a check that it may take.
    """

    name: str
    what: str
    run: Run
    patience: int = 1


CHECKS: dict[str, Check] = {}


def check(name: str, what: str, patience: int = 1) -> Callable[[Run], Run]:
    """Register a check."""

    def add(run: Run) -> Run:
        CHECKS[name] = Check(name, what, run, patience)
        return run

    return add


@check("parameters", "every parameter's default and sweep can be used, and unknown ones are refused")
def parameters(kit: Kit) -> TrialResult:
    """Invalid where a parameter is no Parameter, objects to a value of its own or lacks a meaning, and where an unknown
    one is taken."""
    for name, parameter in kit.kind.parameters.items():
        if not isinstance(parameter, Parameter):
            return TrialResult("invalid", f"{name} is no packers.interface.Parameter.")
        for value in (parameter.default, *parameter.sweep):
            if objection := parameter.objection(value):
                return TrialResult(
                    "invalid", f"Of the parameter {name}, {value!r} is a default or in the sweep, and it {objection}."
                )
        if not parameter.meaning:
            return TrialResult("invalid", f"The parameter {name} lacks its meaning.")
    try:
        kit.kind(no_such_parameter=1)
    except ValueError:
        return TrialResult("ok")
    return TrialResult("invalid", "A parameter that does not exist is not refused with a ValueError.")


def _scene_check(name: str) -> None:
    @check(f"valid on {name}", f"two frames of {name}, with their potentially visible sets")
    def valid(kit: Kit) -> TrialResult:
        return try_method(kit.scene(name), kit.make, again=0)


for _name in SCENES:
    _scene_check(_name)


@check("isolated", "clients hold nothing of the server, and show what they receive and nothing else")
def isolated(kit: Kit) -> TrialResult:
    """What comes out of the first built-in scene whose client is not isolated, else of the last."""
    for name in SCENES:
        found = try_isolation(kit.scene(name), kit.make)
        if not found.good:
            break
    return found


@check("deterministic", "two frames of the hall packed again, and again with other work-groups, to the same bytes")
def deterministic(kit: Kit) -> TrialResult:
    """What comes out of two frames of the hall, packed twice more."""
    return try_method(kit.scene("hall"), kit.make, again=2)


@check("picture", "the client shows the surfaces that a float64 rendering shows, at a FLIP of at most 0.1")
def picture(kit: Kit) -> TrialResult:
    """What comes out of the room; inaccurate where the client's picture has a mean FLIP above 0.1."""
    found = kit.case("room", _room)
    if found.good and found.error is not None and found.error > 0.1:
        return replace(found, status="inaccurate", sentence=f"The client's picture has a FLIP of {found.error:.3f}.")
    return found


def _room() -> TrialCase:
    scene = scene_of(room())
    return TrialCase(scene, walk(scene), atlas=ATLAS)


@check("kernels", "each of its own kernels against its float64 twin, on typical and adversarial input", patience=5)
def kernels(kit: Kit) -> TrialResult:
    """Inaccurate where a kernel of the method's own package is beyond its bound; ok where there are none."""
    own = own_cases(kit.kind)
    if not own:
        return TrialResult("ok", f"{SKIPPED}{kit.kind.__module__} is in no package with a module {MODULE}.")
    for stage in own:
        for kind in INPUTS:
            apart = against_twin(kit.device, stage, kind)
            if apart.over > 1:
                return TrialResult("inaccurate", f"The kernels of {stage.name}, on {kind} input: {apart.what}.")
    return TrialResult("ok")


@check("empty set", "a frame in which nothing is visible, between two others, and as the first")
def empty_set(kit: Kit) -> TrialResult:
    """What comes out of the room after an empty set, then of an empty set between two of the room."""
    first = kit.case("empty first", lambda: _sets([0.0, 1.0]))
    return first if not first.good else kit.case("empty between", lambda: _sets([1.0, 0.0, 1.0]))


@check("one triangle", "a scene, and a set, of one triangle")
def one_triangle(kit: Kit) -> TrialResult:
    """What comes out of a scene of one triangle, then of a set of one between two of the room."""

    def alone() -> TrialCase:
        scene = scene_of(facing(np.array([[0, 0, -2.0]]), 0.5))
        return TrialCase(scene, still(scene))

    found = kit.case("one in the scene", alone)
    return found if not found.good else kit.case("one in the set", lambda: _sets([1.0, -1.0, 1.0]))


@check("other set", "sets that change completely from frame to frame")
def other_set(kit: Kit) -> TrialResult:
    """What comes out of the room's first half, its last half, its first half again, and all of it."""
    return kit.case("other set", lambda: _sets([0.5, -0.5, 0.5, 1.0]))


def _sets(shares: list[float]) -> TrialCase:
    """The room with sets of the first share of the triangles; of the last where negative; -1 for one triangle."""
    scene = scene_of(room())
    ids, count = np.arange(scene.triangle_count, dtype=np.int32), scene.triangle_count
    parts = {-1.0: ids[count // 2 : count // 2 + 1]}
    sets = [parts.get(s, ids[: round(s * count)] if s >= 0 else ids[round((1 + s) * count) :]) for s in shares]
    return TrialCase(scene, walk(scene, 1) * len(sets), sets=tuple(sets), atlas=ATLAS)


@check("slivers only", "a scene of nothing but triangles 1000 times as long as high")
def slivers_only(kit: Kit) -> TrialResult:
    """What comes out of 100 triangles, flattened to a thousandth."""

    def slivers() -> TrialCase:
        corners = facing(scattered(100, 2.0), 0.4)
        corners[:, 2] = corners[:, 0] + (corners[:, 1] - corners[:, 0]) / 2 + 1e-3 * (corners[:, 2] - corners[:, 0])
        scene = scene_of(corners)
        return TrialCase(scene, still(scene))

    return kit.case("slivers only", slivers)


@check("screen-filling", "one triangle that covers the whole picture")
def screen_filling(kit: Kit) -> TrialResult:
    """What comes out of a triangle with a circumradius of 8 units, 2 units ahead."""

    def large() -> TrialCase:
        scene = scene_of(facing(np.array([[0, 0, -2.0]]), 8))
        return TrialCase(scene, still(scene))

    return kit.case("screen-filling", large)


@check("overflow", "an atlas of 16 x 16 texels: every triangle left out is named, with a reason")
def overflow(kit: Kit) -> TrialResult:
    """What comes out of the room and a wall of 200 triangles in 16 x 16 texels."""

    def tiny() -> TrialCase:
        scene = scene_of(np.concatenate([room(), grid((-1, -1, -2), (2, 0, 0), (0, 2, 0), 10, 10)]))
        return TrialCase(scene, walk(scene), atlas=(16, 16))

    return kit.case("overflow", tiny)


def _stress_check(name: str, value: float) -> None:
    test = CATALOGUE[name]

    @check(f"stress {name} {magnitude(value)}", test.what)
    def withstands(kit: Kit) -> TrialResult:
        return kit.case(f"{name} {value}", lambda: test.make(value))


for _name, _value in BEARABLE.items():
    _stress_check(_name, _value)


def run_check(spec: str, out: Path | None, thorough: bool, timeout: float, device: str | None) -> bool:
    """Run all checks on a packer and print what came out; whether all passed. Failures' pictures, and the smallest
    soup that fails, go into `out`; without it nothing is written.

    Raises InputError or DeviceError for what cannot be used.
    """
    from shading_atlas_bench.harness.workload.methods import load_in_time
    from shading_atlas_bench.kernels.device import Device

    packers = load_in_time(spec, timeout)
    opened = Device.open(device)
    tell_passed_over(opened)
    stages: dict[str, Stage] = {}
    with stops_apart():
        passed = [_check_one(Kit(opened, packer, stages), out, thorough, timeout) for packer in packers]
    return all(passed)


def _check_one(kit: Kit, out: Path | None, thorough: bool, timeout: float) -> bool:
    console = make_console()
    console.print(styled("[bold]{}[/]  {} checks", kit.kind.name, len(CHECKS) + 2))
    failed = late = 0
    for name, found in _results(kit, out, thorough, timeout):
        failed += not found.good
        late += found.status == "timeout"
        mark = styled("[green]pass[/]") if found.good else styled("[bold red]FAIL[/]")
        if found.good and found.sentence.startswith(SKIPPED):
            mark = styled("[dim]skip[/]")
        sentence = found.sentence.removeprefix(SKIPPED)
        console.print(styled("{} {}", mark, f"{name}: {sentence}" if sentence else name))
        for path in _write_pictures(out, kit.kind.name, name, found):
            console.print(styled("     [dim]{}[/]", path), soft_wrap=True)
    if late:
        busy = f"In the last minute {load():.1f} processes wanted to run on {os.cpu_count()} cores."
        console.print(styled("[dim]--timeout SECONDS gives a check more than {:g} s. {}[/]", timeout, busy))
    if failed and out is None:
        console.print(styled("[dim]--out DIR writes pictures of what failed, and the smallest soup.[/]"))
    verdict = (
        styled("[bold red]{} failed[/]", counted(failed, "check")) if failed else styled("[green]all checks passed[/]")
    )
    console.print(styled("[bold]{}[/]  {}", kit.kind.name, verdict))
    return not failed


def _results(kit: Kit, out: Path | None, thorough: bool, timeout: float) -> Iterator[tuple[str, TrialResult]]:
    """Every check's result, one after the other; a hang in a kernel ends the command with a sentence."""
    console = make_console(stderr=True)
    for name, one in CHECKS.items():
        with console.status(name):
            found = guarded_run(name, one.run, kit, timeout * one.patience)
        yield name, found
    count = THOROUGH if thorough else EXAMPLES
    name = f"fuzzing, {count} soups"
    with console.status(name):
        found = _fuzzed(kit, count, out, timeout)
    yield name, found
    with console.status("benchmark"):
        found = guarded_run("benchmark", benchmark, kit, timeout + BENCHMARK)
    yield "benchmark", found


def guarded_run(name: str, one: Run, kit: Kit, timeout: float) -> TrialResult:
    """A check's result within a time limit; whatever is raised becomes one."""
    try:
        with time_limit(timeout, f"check {name}", who=kit.kind.name):
            return one(kit)
    except BaseException as error:
        return result_of(error)


def _fuzzed(kit: Kit, count: int, out: Path | None, timeout: float) -> TrialResult:
    if smallest := find_failure(kit.device, kit.kind, count, kit.parameters, timeout):
        soup, found = smallest
        if out is None:
            return found
        path = save_soup(out / "regressions", kit.kind.name, soup, found)
        return replace(found, sentence=f"{found.sentence} The smallest such case is kept as {path}.")
    return TrialResult("ok")


def benchmark(kit: Kit) -> TrialResult:
    """Ten seconds of packing the hall, as a sentence: device time by halves, samples, host time."""
    packer = CheckedPacker(kit.make())
    stage = kit.scene("hall").shaded_by(packer)
    packer.prepare(stage.server)
    for frame in stage.frames:
        packer.pack(frame)
    stage.device.finish()
    structs: list[float] = []
    gather: list[float] = []
    wall: list[float] = []
    samples = 0
    until = time.perf_counter() + BENCHMARK
    while time.perf_counter() < until:
        start = time.perf_counter()
        with stage.device.record() as record:
            returned = packer.own.pack(frame := stage.frames[len(wall) % len(stage.frames)])
        wall.append((time.perf_counter() - start) * 1000)
        samples = read_payload(returned, frame).sample_count
        structs.append(record.total("structs"))
        gather.append(record.total("gather"))
    if not any(gather) and not any(structs):
        return TrialResult(
            "invalid", 'No kernel was launched as "structs/..." or "gather/...": its time would be zero.'
        )
    sentence = (
        f"{len(wall)} frames of the hall, median structs {median(structs):.2f} ms, gather {median(gather):.2f} ms, "
        f"host {median(wall):.1f} ms, {samples:,} samples."
    )
    return TrialResult("ok", sentence)


def _write_pictures(out: Path | None, method: str, name: str, found: TrialResult) -> list[Path]:
    from shading_atlas_bench.harness.measure.dump import write_png

    if out is None or found.good:
        return []
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{out} cannot be written ({error.strerror}): give another --out.") from error
    paths = []
    for picture_name, rgb in found.pictures.items():
        paths.append(out / f"{method}_{name.replace(' ', '_')}_{picture_name}.png")
        write_png(paths[-1], rgb)
    return paths
