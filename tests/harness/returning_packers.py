"""Packers that return what they must not, each in one way: the documentation's example, but for one thing that one of
its methods, or of its client's, gives back; and what the reason must say."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

from shading_atlas_bench.packers.example.grid import Grid, GridClient
from shading_atlas_bench.packers.interface import ALPHA, HeldLists, Image, Packer, Payload

RETURNING: dict[type[Packer], str] = {}  # what the reason must say, by packer
RAISING: dict[type[Packer], str] = {}


class Unlucky:
    """Raises whatever is done with it."""

    def _refuse(self, *_: object) -> int:
        raise RuntimeError("nobody may look at this")

    __len__ = __iter__ = __bool__ = __float__ = __int__ = __array__ = _refuse
    __str__ = __repr__ = __eq__ = __hash__ = _refuse  # type: ignore[assignment]  # they only raise
    shape = dtype = property(_refuse)


class Alike(type):
    """A class of classes that say they are every other one."""

    def __eq__(cls, other: object) -> bool:
        return True

    def __hash__(cls) -> int:
        return hash(int)


class Chameleon(metaclass=Alike):
    """Seems to be of any type that it is compared with, and raises as soon as it is taken for one."""

    def _refuse(self, *_: object) -> int:
        raise RuntimeError("nobody may take this for what it is not")

    __bytes__ = __float__ = __int__ = __index__ = __len__ = _refuse


class MuteError(Exception):
    """An exception that cannot be told."""

    def __str__(self) -> str:
        raise RuntimeError("no words")


class OwnExit(BaseException):
    """Derived from what only the interpreter's own ends are derived from."""


class GrowingPayload(Payload):
    """Computes its statistics when somebody reads them."""

    statistics = property(lambda self: {"waste": 1.0}, lambda self, value: None)


def add(kind: type[Packer], title: str, words: str, among: dict[type[Packer], str]) -> None:
    """Make a class known in this module, as `--method FILE:CLASS` finds it."""
    globals()[kind.__name__] = kind
    kind.name = title.replace(" ", "-")
    among[kind] = words


def named(title: str, **members: object) -> type[Packer]:
    return type("".join(word.capitalize() for word in title.split()), (Grid,), members | {"__module__": __name__})


def payload(title: str, words: str, edit: Callable[[Any], object]) -> None:
    """One that does something to its payload, or returns something else in its place."""

    def pack(self, frame):
        made = Grid.pack(self, frame)
        returned = edit(made)
        return made if returned is None else returned

    add(named(title, pack=pack), title, words, RETURNING)


def method(title: str, words: str, name: str, returned: object) -> None:
    """One whose method or property of this name returns something wrong."""
    add(named(title, **{name: returned}), title, words, RETURNING)


def client(title: str, words: str, name: str, returned: Callable[..., object]) -> None:
    """One whose client's method of this name returns something wrong."""
    kind = type("Wrong", (GridClient,), {name: returned})
    add(named(title, client=lambda self, scene: kind(scene)), title, words, RETURNING)


def raising(title: str, words: str, name: str, error: Callable[[], BaseException]) -> None:
    """One whose method of this name raises."""

    def fail(self, *_: object):
        raise error()

    add(named(title, **{name: fail}), title, words, RAISING)


def statistic(title: str, words: str, name: object, value: object) -> None:
    payload(f"statistic {title}", words, lambda made: made.statistics.update({name: value}))


def picture(title: str, words: str, returned: object) -> None:
    method(f"picture {title}", words, "pictures", lambda self, payload: returned)


def detail(title: str, words: str, returned: object) -> None:
    method(f"detail {title}", words, "details", lambda self, payload: returned)


def edited(**values: object) -> Callable[[Payload], object]:
    """A function that sets fields of a payload."""
    return lambda made: vars(made).update(values)


def with_samples(**values: object) -> Callable[[Payload], object]:
    return lambda made: vars(made.samples).update(values)


def with_plane(edit: Callable[[Any], object], name: object = "atlas") -> Callable[[Payload], object]:
    return lambda made: vars(made).update(planes={name: edit(made.planes["atlas"])})


NOT_A_NUMBER = "no finite number"
statistic("as text", NOT_A_NUMBER, "waste", "much")
statistic("as an array", NOT_A_NUMBER, "waste", np.zeros(3))
statistic("too large", NOT_A_NUMBER, "waste", 10**400)
statistic("beyond digits", NOT_A_NUMBER, "waste", 10**5000)
statistic("not a number", NOT_A_NUMBER, "waste", float("nan"))
statistic("infinite", NOT_A_NUMBER, "waste", np.float32("inf"))
statistic("absent", NOT_A_NUMBER, "waste", None)
statistic("chameleon", NOT_A_NUMBER, "waste", Chameleon())
statistic("unlucky", NOT_A_NUMBER, "waste", Unlucky())
statistic("with a surrogate", NOT_A_NUMBER, "waste", "\ud800")
statistic("named by a surrogate", "name of a statistic", "\ud800", 1.0)
statistic("named by a tuple", "name of a statistic", ("a", "b"), 1.0)
statistic("named at length", "name of a statistic", "a" * 300, 1.0)
statistic("of the harness", "name of a statistic", "checks_ms", 0.0)

payload("sample count large", "sample_count is", edited(sample_count=2**70))
payload("sample count broken", "sample_count is 3.5", edited(sample_count=3.5))
payload("sample count negative", "sample_count is -5", edited(sample_count=-5))
payload("sample count nan", "sample_count is nan", edited(sample_count=float("nan")))
payload("sample count none", "sample_count is None", edited(sample_count=None))
payload("sample count chameleon", "sample_count is a Chameleon", edited(sample_count=Chameleon()))
payload("sample count true", "sample_count is True", edited(sample_count=True))
payload("raw bytes text", "raw_bytes is 'many'", edited(raw_bytes="many"))

payload("plane float", "plane 'atlas' is no uint8", with_plane(lambda plane: plane.astype(np.float32)))
payload("plane small", "plane 'atlas' is no uint8", with_plane(lambda plane: plane[:5].copy()))
payload("plane on host", "plane 'atlas' is no uint8", with_plane(lambda plane: plane.get()))
payload("plane strided", "plane 'atlas' is no uint8", with_plane(lambda plane: plane.transpose((1, 0, 2))))
payload("plane of a strange name", "name of a plane", with_plane(lambda plane: plane, "../atlas"))
payload("planes two", "beside 'alpha'", lambda made: made.planes.update(more=made.planes["atlas"]))
payload("planes only alpha", "beside 'alpha'", with_plane(lambda plane: plane, ALPHA))
payload("planes as list", "planes are a list", lambda made: edited(planes=[made.planes["atlas"]])(made))
payload("planes none", "neither planes nor lists", edited(planes={}, samples=None, sample_count=0))

payload("blob as array", "blob 'more' is no bytes", lambda made: made.blobs.update(more=np.zeros(3)))
payload("blob chameleon", "blob 'more' is no bytes", lambda made: made.blobs.update(more=Chameleon()))
payload("blob as generator", "blob 'more' is no bytes", lambda made: made.blobs.update(more=(b for b in b"abc")))
payload("blob named by number", "name of a blob", lambda made: made.blobs.update({3: b""}))
payload("geometry none", "geometry is no bytes", edited(geometry=None))
payload("lists as text", "list 'more' is no bytes", edited(lists={"more": "text"}))

payload("samples lacking", "samples lack triangle", lambda made: vars(made.samples).__delitem__("triangle"))
payload("samples as dict", "samples are a dict", edited(samples={}))
payload("samples missing", "samples are None", edited(samples=None))
payload("samples negative", "samples' count is -1", with_samples(count=-1))
payload("samples too many", "samples' count is", with_samples(count=10**9))
payload("samples uncounted", "samples' count is nan", with_samples(count=float("nan")))
payload(
    "samples on host", "samples' texel is no int32", lambda made: with_samples(texel=made.samples.texel.get())(made)
)
payload("samples as floats", "samples' texel is no int32",
        lambda made: with_samples(texel=made.samples.bary1)(made))  # fmt: skip

payload("unplaced as list", "unplaced is a list", edited(unplaced=[1, 2]))
payload("unplaced by name", "unplaced names", edited(unplaced={"one": "no room"}))
payload("unplaced beyond", "unplaced names", edited(unplaced={2**40: "no room"}))
payload("unplaced before", "unplaced names", edited(unplaced={-1: "no room"}))
payload("unplaced unsaid", "reason in unplaced", edited(unplaced={0: None}))
payload("unplaced surrogate", "reason in unplaced", edited(unplaced={0: "\ud800"}))
payload("unplaced at length", "reason in unplaced", edited(unplaced={0: "long " * 1000}))

payload("returned nothing", "a dict, and no Payload", lambda made: {})
payload("returned generator", "a generator, and no Payload", lambda made: (part for part in ""))
payload("returned unlucky", "an Unlucky, and no Payload", lambda made: Unlucky())
payload("returned bare", "Payload lacks", lambda made: object.__new__(Payload))
payload("returned computed", "Payload lacks statistics", lambda made: GrowingPayload(**vars(made)))
payload("fields missing", "Payload lacks blobs", lambda made: vars(made).__delitem__("blobs"))

picture("float", "no uint8 (h, w, 3)", {"extra": np.zeros((4, 4, 3), np.float32)})
picture("empty", "no uint8 (h, w, 3)", {"extra": np.zeros((0, 0, 3), np.uint8)})
picture("grey", "no uint8 (h, w, 3)", {"extra": np.zeros((4, 4), np.uint8)})
picture("endless", "no uint8 (h, w, 3)", {"extra": np.broadcast_to(np.uint8(0), (10**6, 10**6, 3))})
picture("outside", "name of a picture", {"../../../../outside": np.zeros((4, 4, 3), np.uint8)})
picture("absolute", "name of a picture", {"/tmp/outside": np.zeros((4, 4, 3), np.uint8)})
picture("nameless", "name of a picture", {"": np.zeros((4, 4, 3), np.uint8)})
picture("of the harness", "name of a picture", {"client": np.zeros((4, 4, 3), np.uint8)})
picture("at length", "name of a picture", {"a" * 300: np.zeros((4, 4, 3), np.uint8)})
picture("none", "they are None", None)
picture("generator", "they are a generator", (part for part in ""))
picture("unlucky", "no uint8 (h, w, 3)", {"extra": Unlucky()})

detail("objects", "no array of numbers", {"extra": np.array([object()], object)})
detail("outside", "name of a detail", {"../../outside": np.zeros(3)})
detail("taken", "name of a detail", {"owner": np.zeros(3)})
detail("file", "name of a detail", {"file": np.zeros(3)})
detail("endless", "GB", {"extra": np.broadcast_to(0.0, (10**6, 10**6))})
detail("list", "they are a list", [np.zeros(3)])
detail("unlucky", "no array of numbers", {"extra": Unlucky()})

method("client none", "client() is None", "client", lambda self, scene: None)
method("skip number", "skip() is 3", "skip", lambda self, scene: 3)
method("skip surrogate", "skip() is", "skip", lambda self, scene: "no \ud800")
method("skip unlucky", "skip() is an Unlucky", "skip", lambda self, scene: Unlucky())
method("rare costs none", "rare_costs() is None", "rare_costs", lambda self: None)
method("rare costs texts", "rare_costs()", "rare_costs", lambda self: ("resets",))
method("settled unlucky", "settled() is an Unlucky", "settled", lambda self: Unlucky())
method("leaves text", "leaves_unwritten is 'no'", "leaves_unwritten", property(lambda self: "no"))
method("shaded none", "scene_shaded() is None", "scene_shaded", lambda self, scene: None)

client("draws nothing", "no Image", "draw", lambda self, view: None)
client(
    "draws on host",
    "rgb of the client's image is no uint8",
    "draw",
    lambda self, view: Image(np.zeros((view.height, view.width, 4), np.uint8), None),  # type: ignore[arg-type]  # on the host
)
client("draws half", "Image lacks rgb", "draw", lambda self, view: object.__new__(Image))
client("draws small", "rgb of the client's image is no uint8", "draw",
       lambda self, view: Image(self.device.zeros((2, 2, 4), np.uint8),
                                self.device.zeros((2, 2), np.int32)))  # fmt: skip
client("draws float ids", "triangle of the client's image is no int32", "draw",
       lambda self, view: Image(self.device.zeros((view.height, view.width, 4), np.uint8),
                                self.device.zeros((view.height, view.width), np.float32)))  # fmt: skip
client("locates nothing", "locate() is", "locate", lambda self, triangles, bary: [0])
client("locates few", "locate() is", "locate", lambda self, triangles, bary: np.zeros((3, 2)))
client("locates floats", "locate() is", "locate",
       lambda self, triangles, bary: np.zeros((len(triangles), 2), np.float32))  # fmt: skip
client("locates far", "", "locate", lambda self, triangles, bary: np.full((len(triangles), 2), 1e308))
client(
    "locates infinity",
    "locate() has infinite",
    "locate",
    lambda self, triangles, bary: np.full((len(triangles), 2), np.inf),
)
client("receives unlucky", "", "receive", lambda self, payload: setattr(self, "geometry", Unlucky()))

raising("exits", "SystemExit", "pack", lambda: SystemExit(3))
raising("interrupts", "KeyboardInterrupt", "pack", KeyboardInterrupt)
raising("ends generators", "GeneratorExit", "pack", GeneratorExit)
raising("ends loops", "StopIteration", "pack", StopIteration)
raising("exits its own way", "OwnExit", "pack", lambda: OwnExit("over"))
raising("says nothing", "MuteError", "pack", MuteError)
raising("says surrogates", "ValueError", "pack", lambda: ValueError("\ud800 \x1b[31m \x00"))
raising("says much", "ValueError", "pack", lambda: ValueError("long " * 10**6))
raising("is out of memory", "MemoryError", "pack", MemoryError)
raising("exits preparing", "SystemExit", "prepare", lambda: SystemExit(3))
raising("exits skipping", "SystemExit", "skip", lambda: SystemExit(3))
raising("exits at rare costs", "SystemExit", "rare_costs", lambda: SystemExit(3))
raising("exits shading", "SystemExit", "scene_shaded", lambda: SystemExit(3))
raising("exits at pictures", "SystemExit", "pictures", lambda: SystemExit(3))
raising("exits at details", "SystemExit", "details", lambda: SystemExit(3))
raising("interrupts at pictures", "KeyboardInterrupt", "pictures", KeyboardInterrupt)
raising("is unequal", "RuntimeError", "client", lambda: RuntimeError(Unlucky()))


class Endless(Grid):
    """Calls itself until there is no more room for it."""

    name = "endless"

    def pack(self, frame):
        return self.pack(frame)


class Launching(Grid):
    """Names its stages by what is no name."""

    name = "launching"

    def pack(self, frame):
        device, launch = frame.scene.device, frame.scene.device.launch
        device.launch = lambda stage, *rest, **options: launch("gather/\ud800", *rest, **options)
        try:
            return super().pack(frame)
        finally:
            del device.launch


class LeavingOut(Grid):
    """Leaves something out under a name that is none."""

    name = "leaving-out"

    def pack(self, frame):
        frame.scene.skips.leaves_out("\ud800", True)
        return super().pack(frame)


class KeepingOddly(Grid):
    """Keeps something in its class, under a name that is none."""

    name = "keeping-oddly"

    def pack(self, frame):
        setattr(KeepingOddly, "\ud800\x1b", getattr(KeepingOddly, "\ud800\x1b", 0) + 10**6)
        return super().pack(frame)


class ListLess(Grid):
    """Holds lists of no form."""

    name = "list-less"
    atlas = False

    def pack(self, frame):
        super().pack(frame)
        return Payload({}, {}, b"", 0, lists={"lists": b""})

    def client(self, scene):
        client: Any = super().client(scene)
        client.receive = lambda payload: None
        client.draw = lambda view: Image(scene.device.zeros((view.height, view.width, 4), np.uint8), None,
                                         scene.device.zeros((view.height, view.width), np.float32))  # fmt: skip
        held = HeldLists(None, np.zeros(0), np.zeros(0), None)  # type: ignore[arg-type]  # of no form
        client.fragments = lambda: (held,)
        client.locate = lambda triangles, bary: None
        return client


RAISING[Endless] = "RecursionError"
RETURNING[Launching] = "stage"
RETURNING[LeavingOut] = "left out"
RETURNING[ListLess] = "fragments()"


class Greedy(Grid):
    """Reports numbers whose sum is no number any more; that is no mistake."""

    name = "greedy"

    def pack(self, frame):
        made = super().pack(frame)
        made.statistics |= {"waste": sys.float_info.max, "thrift": -1e308}
        return made


class Scripted(Grid):
    """Returns what `edits` holds: fields and statistics of its payload, pictures, details and what its client draws."""

    name = "scripted"
    edits: ClassVar[dict[str, Any]] = {}

    def pack(self, frame):
        made = super().pack(frame)
        made.statistics |= self.edits.get("statistics", {})
        vars(made).update(self.edits.get("fields", {}))
        return made

    def pictures(self, payload):
        return self.edits.get("pictures", {})

    def details(self, payload):
        return self.edits.get("details", {})

    def client(self, scene):
        client: Any = super().client(scene)
        if "draw" in self.edits:
            drawn = self.edits["draw"]
            client.draw = lambda view: drawn
        return client
