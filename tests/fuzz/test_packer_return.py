"""Whatever a packer or its client returns, the door takes it as it should be or refuses it in one sentence."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.harness.conformance.catalogue import room, scene_of
from shading_atlas_bench.harness.measure.returned import (
    CheckedClient,
    CheckedPacker,
    ReturnedError,
    read_launches,
    read_payload,
    verdict_on,
)
from shading_atlas_bench.harness.run.run import run
from shading_atlas_bench.harness.watch.stops import stops_apart
from shading_atlas_bench.harness.workload import session
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.packers.example.grid import Grid
from shading_atlas_bench.packers.interface import HeldLists, Image, Payload, RareCost, View
from shading_atlas_bench.reports.pages.html import write_report
from shading_atlas_bench.reports.store.csv_files import write_all
from shading_atlas_bench.reports.store.results import Store
from shading_atlas_bench.scenes.model import Camera
from tests.fuzz.cases import fuzzed, nothing_beside
from tests.harness.returning_packers import Chameleon, MuteError, OwnExit, Scripted, Unlucky

TRIANGLES, WIDE, HIGH = 8, 6, 4
FIELDS = ("planes", "blobs", "geometry", "sample_count", "samples", "unplaced", "statistics", "lists", "raw_bytes")


@cache
def device() -> Device:
    return Device.open()


@cache
def arrays() -> list[Any]:
    """Device arrays of right and wrong forms, made once: no case changes them."""
    opened = device()
    whole = opened.zeros((HIGH, WIDE, 4), np.uint8)
    lists = [opened.zeros(size, dtype) for size in (16, 3) for dtype in (np.int32, np.float32, np.uint8)]
    pictures = [opened.zeros((HIGH, WIDE), dtype) for dtype in (np.int32, np.float32)]
    return [whole, whole[1:], whole.T, whole.astype(np.float32), *lists, *pictures]


# Odd values ----------------------------------------------------------------------------------------------------------

HUGE = [2**31, 2**63 - 1, 2**63, 2**64, 10**400, 10**5000, -1, -(2**63), -(10**400)]
LARGE = st.integers(0, len(HUGE) - 1).map(lambda number: HUGE[number])  # by number: some of them cannot be printed
NUMBERS = st.one_of(
    st.integers(-3, 40), LARGE, st.floats(), st.booleans(), st.sampled_from([1.7e308, 5e-324, -0.0]),
    st.sampled_from([np.int8(3), np.uint64(2**64 - 1), np.float32("nan"), np.float16(2), np.longdouble("1e400"),
                     np.bool_(True), np.complex64(1), np.datetime64("2026-01-01")]),
)  # fmt: skip
TEXTS = st.one_of(
    st.text(max_size=5), st.sampled_from(["a" * 300, "\ud800", "../../x", "/tmp/x", "a\x00b", "\x1b[31m", "con",
                                          "\uff41", "client", "checks_ms", "file", "alpha", "atlas", "", "line\nline"]),
)  # fmt: skip
DTYPES: st.SearchStrategy[Any] = st.sampled_from(
    [np.uint8, np.float32, np.float64, np.int32, np.int64, bool, object, "U3", "M8[s]", "i4,f4"]
)
SHAPES = st.one_of(
    st.sampled_from([(), (0,), (0, 0, 3), (HIGH, WIDE, 3), (HIGH, WIDE, 4), (4, 4), (WIDE * HIGH + 1,)]),
    st.lists(st.integers(0, 5), max_size=4).map(tuple),
)


@st.composite
def hosts(draw: st.DrawFn) -> np.ndarray:
    """NumPy arrays of any form: also without elements, not contiguous, of more elements than memory has."""
    array = np.zeros(draw(SHAPES), draw(DTYPES))
    if array.dtype.kind == "f":
        array += draw(st.sampled_from([0.0, np.nan, np.inf, 1e30]))
    how = draw(st.integers(0, 4))
    if how == 1 and array.ndim:
        return array[::-1]
    if how == 2 and array.ndim < 3 and array.size:
        return np.broadcast_to(array.reshape(-1)[:1, None], (10**6, 10**6))
    return array.T if how == 3 else array


class Array(np.ndarray):
    """Of a derived class."""


ODD = [
    None, ..., Unlucky(), Chameleon(), object(), print, Payload, Image, (part for part in ""), {}, [], (), set(), b"",
    bytearray(3), np.arange(6).reshape(2, 3).data, memoryview(b"abcd")[::2], range(3), np.zeros(3).view(Array),
    slice(3),
    type("Whole", (int,), {"__index__": lambda self: 1 / 0})(3),
    type("Text", (str,), {"__len__": lambda self: 1 / 0})("a"),
]  # fmt: skip
STRANGE = st.integers(0, len(ODD) - 1).map(lambda number: ODD[number])  # by number: some of them cannot be hashed
ON_DEVICE = st.integers(0, 11).map(lambda number: arrays()[number])
LEAVES = st.one_of(NUMBERS, TEXTS, st.binary(max_size=9), STRANGE, hosts(), ON_DEVICE)
KEYS = st.one_of(TEXTS, NUMBERS, st.none(), st.tuples(TEXTS, TEXTS))
ANYTHING = st.recursive(
    LEAVES, lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(KEYS, inner, max_size=3),
                                    st.tuples(inner, inner)), max_leaves=6,
)  # fmt: skip


# What is right, and changes to it ------------------------------------------------------------------------------------


def frame() -> Any:
    """As much of a frame as the door looks at."""
    scene = SimpleNamespace(device=device(), triangles=SimpleNamespace(count=TRIANGLES))
    return SimpleNamespace(scene=scene, atlas_width=WIDE, atlas_height=HIGH)


def view() -> View:
    return View(np.eye(4), np.eye(4), WIDE, HIGH)


def payload() -> Payload:
    """A right one."""
    whole, ints, floats = arrays()[0], arrays()[4], arrays()[5]
    samples = Samples(7, ints, floats, floats, floats, ints)
    return Payload({"atlas": whole}, {"head": b"abc"}, b"abc", 7, samples, {3: "no room"}, {"waste": 0.5}, {}, 0)


@st.composite
def payloads(draw: st.DrawFn) -> object:
    """A right payload with a few things changed, or something else."""
    made = payload()
    for _ in range(draw(st.integers(0, 3))):
        where = draw(st.sampled_from([*FIELDS, "entry", "sample", "gone"]))
        if where == "entry":
            parts = vars(made).get(draw(st.sampled_from(["planes", "blobs", "unplaced", "statistics", "lists"])))
            if type(parts) is dict:
                parts[draw(KEYS)] = draw(LEAVES)
        elif where == "sample" and type(made.samples) is Samples:
            setattr(made.samples, draw(st.sampled_from(["count", "triangle", "bary1", "texel"])), draw(LEAVES))
        elif where == "gone":
            vars(made).pop(draw(st.sampled_from(FIELDS)), None)
            return made
        elif where in FIELDS:
            setattr(made, where, draw(ANYTHING))
    return made if draw(st.integers(0, 3)) else draw(ANYTHING)


@st.composite
def lists_held(draw: st.DrawFn) -> object:
    right = HeldLists(view(), np.zeros(WIDE * HIGH + 1, np.int64), np.zeros((2, 4), np.uint8), np.ones(2, np.float32))
    changed = {
        name: draw(LEAVES) for name in draw(st.lists(st.sampled_from(["view", "offsets", "rgba", "depth", "normals"])))
    }
    if draw(st.booleans()):
        name = draw(st.sampled_from(["view", "projection", "width", "height"]))
        changed["view"] = view()
        object.__setattr__(changed["view"], name, draw(LEAVES))  # a new view would look at it
    return (replace(right, **changed),)


# The door ------------------------------------------------------------------------------------------------------------


def asked(question: Callable[..., Any], *arguments: object) -> Any:
    """The answer, or None where the door refuses it, in one line."""
    try:
        return question(*arguments)
    except ReturnedError as error:
        sentence = str(error)
    assert sentence.isprintable()
    assert len(sentence) < 3000
    return None


def is_whole(value: object) -> bool:
    return type(value) is int and 0 <= value < 2**63


@fuzzed
@given(payloads())
def test_payloads(returned):
    found = asked(read_payload, returned, frame())
    if found is None:
        return
    assert is_whole(found.sample_count)
    assert is_whole(found.raw_bytes)
    assert all(type(name) is str and type(value) is float for name, value in found.statistics.items())
    assert all(map(np.isfinite, found.statistics.values()))
    for parts in (found.blobs, found.lists):
        assert all(name.isidentifier() and type(part) is bytes for name, part in parts.items())
    assert type(found.geometry) is bytes
    assert all(type(key) is int and 0 <= key < TRIANGLES for key in found.unplaced)
    assert all(reason.isprintable() for reason in found.unplaced.values())
    for plane in found.planes.values():
        assert plane.get().shape == (HIGH, WIDE, 4)
    if found.samples:
        assert len(found.owners().texel) == found.samples.count


@dataclass
class Saying:
    """A packer, or a client, of which every question has the same answer."""

    answer: object

    def __getattr__(self, name: str) -> Any:
        if name in ("leaves_unwritten", "holds"):
            return self.answer
        return lambda *_: self.answer


@fuzzed
@given(
    st.sampled_from(["skip", "scene_shaded", "client", "settled", "leaves_unwritten", "holds", "rare_costs", "pictures",
                     "details"]),
    st.one_of(ANYTHING, st.dictionaries(TEXTS, hosts(), max_size=3),
              st.builds(lambda *values: (RareCost(*values),), LEAVES, LEAVES, LEAVES, LEAVES)),
)  # fmt: skip
def test_answers_of_packers(question, answer):
    packer = CheckedPacker(Grid())
    packer.own = Saying(answer)  # type: ignore[assignment]  # a packer in what is asked here only
    scene, packed = SimpleNamespace(device=device()), SimpleNamespace(original=None)
    arguments = {name: (scene,) for name in ("skip", "scene_shaded", "client")}
    arguments |= {name: (packed,) for name in ("pictures", "details")}
    if question in ("leaves_unwritten", "holds"):
        found = asked(lambda: getattr(packer, question))
    else:
        found = asked(getattr(packer, question), *arguments.get(question, ()))
    if found and question in ("pictures", "details"):
        assert all(name.isidentifier() and type(array) is np.ndarray for name, array in found.items())


@fuzzed
@given(
    st.sampled_from(["draw", "fragments", "locate"]),
    st.one_of(
        ANYTHING,
        lists_held(),
        st.builds(Image, *[st.one_of(LEAVES, st.sampled_from([None, arrays]).map(lambda get: get and get()[0]))] * 3),
        st.builds(lambda *at: Image(arrays()[0], *(arrays()[-2:][k] if k < 2 else None for k in at)),
                  st.integers(0, 2), st.integers(0, 2)),
    ),
)  # fmt: skip
def test_answers_of_clients(question, answer):
    saying: Any = Saying(answer)
    client = CheckedClient(saying, device())
    arguments = {"draw": (view(),), "locate": (np.zeros(4, np.int32), np.zeros((4, 2), np.float32))}.get(question, ())
    found = asked(getattr(client, question), *arguments)
    if found is None:
        return
    if question == "draw":
        assert found.rgb.get().shape == (HIGH, WIDE, 4)
        assert found.triangle is not None or found.depth is not None
    elif question == "fragments":
        assert all(len(part.offsets) == WIDE * HIGH + 1 and len(part.rgba) == len(part.depth) for part in found)
    else:
        assert found.shape == (4, 2)
        assert not np.isinf(found).any()


@fuzzed
@given(st.lists(st.one_of(TEXTS, KEYS), max_size=3), st.lists(st.one_of(TEXTS, KEYS), max_size=3))
def test_names_of_launches(stages, left_out):
    asked(read_launches, stages, left_out)
    if all(type(name) is str and name.isidentifier() and len(name) < 100 for name in [*stages, *left_out]):
        read_launches(stages, left_out)


KINDS = st.sampled_from([
    ValueError, KeyError, SystemExit, KeyboardInterrupt, GeneratorExit, StopIteration, RecursionError, MemoryError,
    MuteError, OwnExit, type("\x1b[31m", (Exception,), {}), type("E", (Exception,), {"__str__": lambda self: 3}),
])  # fmt: skip


@fuzzed
@given(KINDS, st.one_of(TEXTS, LEAVES))
def test_whatever_is_raised_can_be_told(kind, text):
    with stops_apart():
        try:
            raise kind(text)
        except BaseException as error:
            status, reason = verdict_on(error)
    assert status == "failed"
    assert reason
    assert reason.isprintable()
    assert len(reason) < 700


# Whole runs ----------------------------------------------------------------------------------------------------------

TINY: dict[str, Any] = {
    "scene": "room", "frames": 2, "width": 32, "height": 18, "atlas_width": 64, "atlas_height": 64, "path": "orbit",
    "codec": "none", "metrics": ("psnr",), "dump": True,
}  # fmt: skip


def scene_with_camera() -> Any:
    scene = scene_of(room())
    scene.cameras, scene.content_hash = [Camera((0.0, 0.1, 1.5), (0.0, 0.0, -1.0))], "room"
    return scene


EDITS = st.fixed_dictionaries({}, optional={
    "fields": st.dictionaries(st.sampled_from(FIELDS), ANYTHING, max_size=1),
    "statistics": st.dictionaries(TEXTS, NUMBERS, max_size=2),
    "pictures": st.dictionaries(TEXTS, hosts(), max_size=2),
    "details": st.dictionaries(TEXTS, hosts(), max_size=2),
    "draw": LEAVES,
})  # fmt: skip


@pytest.fixture
def small_scene(monkeypatch):
    monkeypatch.setattr(session, "load_scene", lambda *_, **__: scene_with_camera())


# A run takes a hundred times as long as what comes through the door, and the first one builds kernels.
@settings(fuzzed, max_examples=max(2, fuzzed.max_examples // 100), deadline=None)
@given(EDITS)
def test_whole_runs(small_scene, edits):
    with tempfile.TemporaryDirectory() as above:
        folder = Path(above) / "deep" / "down" / "run"
        with pytest.MonkeyPatch.context() as patch, nothing_beside(folder):
            patch.setattr(Scripted, "edits", edits)
            made = run(Settings(methods=(f"{Scripted.__module__}:{Scripted.__name__}",), **TINY), folder)
        with Store(folder, must_exist=True) as store:
            rows = store.rows()
        assert [row["frame"] for row in rows] == [0, 1]
        assert all((row["status"] in ("ok", "overflow")) == made.well for row in rows)
        assert all(row["reason"] is None or row["reason"].isprintable() for row in rows)
        write_all(folder)
        write_report(folder)
