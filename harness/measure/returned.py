"""The one door for what methods give back: whatever a packer or its client returns becomes a checked record here.

Nothing of it is run to look at it: only exact types of Python, NumPy and the device get in, and a record is a copy that
its method cannot change any more, but for arrays. Everything else raises ReturnedError, in one sentence, before any of
it is kept or written. Whether what gets in is true is the question of harness/measure/validity.py and verification/.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from math import isfinite
from typing import TYPE_CHECKING, Any, TypeVar, get_args

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles, Floats, Ints
from shading_atlas_bench.harness.errors import is_stop, plain, told
from shading_atlas_bench.harness.plugins import label_of, variant_string
from shading_atlas_bench.harness.watch.watchdog import PackTimeoutError, longer_than, time_limit
from shading_atlas_bench.kernels.runtime.opencl import array_class
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.packers.interface import (
    ALPHA,
    Client,
    ClientScene,
    Decoded,
    Frame,
    HeldLists,
    Holds,
    Image,
    NotShippedError,
    Packer,
    Payload,
    RareCost,
    ServerScene,
    View,
)

if TYPE_CHECKING:
    from numpy.typing import DTypeLike

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.scenes.model import Scene

T = TypeVar("T")

LONGEST_NAME = 32  # letters, of a plane, a blob, lists or a picture: names of parts cost no bytes
LONGEST_STATISTIC, LONGEST_STAGE = 64, 128  # letters of such a name
LONGEST_TEXT = 400  # letters, of one reason why something is not done
LONGEST_REASON = 4000  # letters, of all that is wrong with a frame: names of a method's own things may stand in it
MOST_REASONS = 16  # different ones in one frame
LARGEST_WHOLE = 2**63 - 1  # that a results store holds
LONGEST_SIDE = 16384  # pixels, of a picture
MOST_BYTES = 4 << 30  # of one frame's details
OBJECTIONS = 4  # told of in one sentence
# Names of what the harness itself has among statistics, pictures and the arrays of `--dump`.
OWN_STATISTICS = frozenset(
    {"structs_share", "reference_shading_ns", "gather_over_shading", "metrics_ms", "reference_ms", "metrics_over_work",
     "checks_ms", "rates_ms", "others_share", "unwritten_lookups"}
)  # fmt: skip
OWN_PICTURES = frozenset({"client", "flip", "atlas", "alpha", "reference"})
OWN_DETAILS = frozenset(
    {"client", "reference", "visibility", "view", "projection", "atlas", "owner", "bary", "alpha",
     "file", "args", "kwds", "allow_pickle"}  # the last ones are parameters of numpy.savez
)  # fmt: skip
BYTES: tuple[type, ...] = (bytes, bytearray, memoryview)
WHOLE: tuple[type, ...] = (int, *(np.dtype(code).type for code in np.typecodes["AllInteger"]))
REAL = (*WHOLE, bool, np.bool_, float, *(np.dtype(code).type for code in np.typecodes["Float"]))
ARRAYS = {"triangle": np.int32, "bary1": np.float32, "bary2": np.float32, "footprint": np.float32, "texel": np.int32}
# How to get at these without running what a subclass, or a class of its class, puts in the way.
_FIELDS = vars(Payload)["__dict__"]
_BASES = vars(type)["__mro__"]


class ReturnedError(Exception):
    """What a method gave back is not as packers/interface.py says; the message is one sentence."""


@dataclass(kw_only=True)
class Received(Payload):
    """A payload of nothing but checked values: exact dicts, bytes, ints and floats, with ALPHA last among the planes.

    original: what the packer returned, which only its own methods and the search for shared objects look at.
    """

    original: Payload


def verdict_on(error: BaseException) -> tuple[str, str]:
    """Status and reason of a method of which this was raised. Raises it again if it is a stop."""
    if is_stop(error):
        raise error
    if isinstance(error, PackTimeoutError):
        return "timeout", plain(str(error))
    if isinstance(error, (ReturnedError, NotShippedError)):
        return "invalid", plain(str(error), LONGEST_REASON)
    return "failed", told(error)


def read_payload(returned: object, frame: Frame) -> Received:
    """What `pack` returned for a frame. Raises ReturnedError."""
    if not (_is_derived(returned, Payload) and isinstance(returned, Payload)):
        raise ReturnedError(f"pack() returned {shown(returned)}, and no Payload.")
    held = fields_of(returned)
    if lacking := [field.name for field in fields(Payload) if field.name not in held]:
        raise ReturnedError(f"What pack() returned as a Payload lacks {', '.join(lacking)}.")
    given, device = Payload(**{field.name: held[field.name] for field in fields(Payload)}), frame.scene.device
    has_planes = type(given.planes) is dict and len(given.planes) > 0
    statistics = _of_named(
        "statistics", "statistic", given.statistics, _number_objection, LONGEST_STATISTIC, OWN_STATISTICS
    )
    objections = [
        *_of_planes(given.planes, frame),
        *_of_named("blobs", "blob", given.blobs, _bytes_objection),
        *_of_named("lists", "list", given.lists, _bytes_objection),
        *([] if _is_one(given.geometry, BYTES) else [f"geometry is no bytes but {shown(given.geometry)}"]),
        *_of_samples(given.samples, device, has_planes),
        *_of_count("sample_count", given.sample_count),
        *_of_count("raw_bytes", given.raw_bytes),
        *_of_unplaced(given.unplaced, frame.scene.triangles.count),
        *statistics,
    ]
    if not (objections or given.planes or given.lists):
        objections = ["it has neither planes nor lists, so that there is nothing to draw"]
    _refuse("What pack() returned", objections)
    return Received(
        planes=dict(sorted(given.planes.items(), key=lambda plane: plane[0] == ALPHA)),
        blobs={name: bytes(data) for name, data in given.blobs.items()},
        geometry=bytes(given.geometry),
        sample_count=int(given.sample_count),
        samples=given.samples and replace(given.samples, count=int(given.samples.count)),
        unplaced={int(triangle): reason for triangle, reason in given.unplaced.items()},
        statistics={name: float(value) for name, value in given.statistics.items()},
        lists={name: bytes(data) for name, data in given.lists.items()},
        raw_bytes=int(given.raw_bytes),
        original=returned,
    )


def fields_of(payload: Payload) -> dict[str, Any]:
    """What a payload, of Payload or a class derived from it, has as values, whatever they are; what it would compute is
    not among them."""
    found: dict[str, Any] = _FIELDS.__get__(payload)
    return found


def told_skip(packer: Packer, scene: Scene, timeout: float) -> tuple[str, str] | None:
    """Status and reason of a packer that has nothing to do in a scene, or cannot say it within `timeout` seconds; else
    None."""
    try:
        with time_limit(timeout, "skip()", who=packer.name, late=longer_than(timeout)):
            reason = CheckedPacker(packer).skip(scene)
    except BaseException as error:
        return verdict_on(error)
    return ("skipped", reason) if reason else None


def read_launches(stages: Iterable[object], left_out: Iterable[object]) -> None:
    """Names of the stages that packing launched, and of what it left out. Raises ReturnedError for what is no name."""
    wrong = [f"it launched a stage named {shown(one)}" for one in stages if not _is_text(one, LONGEST_STAGE)]
    wrong += [f"it left out what it names {shown(one)}" for one in left_out if not _is_text(one, LONGEST_STAGE)]
    _refuse("What pack() did", wrong)


class CheckedPacker:
    """A packer whose answers are read here: each method asks the packer's own, and raises ReturnedError for an answer
    that is not as packers/interface.py says.

    own: the packer itself, to be asked by clocks, whose answers are then read by `read_payload`. name, atlas, variant
    and label: as they were in the beginning.
    """

    def __init__(self, own: Packer) -> None:
        self.own, self.name, self.atlas = own, own.name, own.atlas
        self.variant, self.label = variant_string(own), label_of(own)

    def scene_shaded(self, scene: ServerScene) -> ServerScene:
        """The scene as it shades it: that itself, or with the finest level of its textures. Raises ReturnedError."""
        shaded = self.own.scene_shaded(scene)
        if shaded is not scene and not ("finest" in vars(scene) and shaded is scene.finest):
            raise ReturnedError(f"scene_shaded() is {shown(shaded)}: it must be the scene, or its `finest`.")
        return shaded

    def skip(self, scene: Scene) -> str | None:
        """Why it has nothing to do there, or None. Raises ReturnedError."""
        reason = self.own.skip(scene)
        if reason is not None and not _is_text(reason, LONGEST_TEXT):
            raise ReturnedError(f"skip() is {shown(reason)}: it must be None or a line of text.")
        return reason or None

    def prepare(self, scene: ServerScene) -> None:
        """What it does once per scene."""
        self.own.prepare(scene)

    def client(self, scene: ClientScene) -> CheckedClient:
        """A fresh client. Raises ReturnedError."""
        client = self.own.client(scene)
        if not (_is_derived(client, Client) and isinstance(client, Client)):
            raise ReturnedError(f"client() is {shown(client)}, and no Client.")
        return CheckedClient(client, scene.device)

    def pack(self, frame: Frame) -> Received:
        """The frame's payload. Raises ReturnedError."""
        return read_payload(self.own.pack(frame), frame)

    def settled(self) -> bool:
        """Whether the same work would give the same payload. Raises ReturnedError."""
        return _exactly(bool, "settled()", self.own.settled())

    @property
    def leaves_unwritten(self) -> bool:
        """Whether it leaves out texels that lookups touch. Raises ReturnedError."""
        return _exactly(bool, "leaves_unwritten", self.own.leaves_unwritten)

    @property
    def holds(self) -> Holds:
        """What its lists hold. Raises ReturnedError."""
        holds = self.own.holds
        if type(holds) is not str or holds not in get_args(Holds):
            raise ReturnedError(f"holds is {shown(holds)}: it must be one of {', '.join(get_args(Holds))}.")
        return holds

    def rare_costs(self) -> tuple[RareCost, ...]:
        """What it does in a few frames only. Raises ReturnedError."""
        costs = _exactly(tuple, "rare_costs()", self.own.rare_costs())
        for cost in costs:
            _exactly(RareCost, "one of rare_costs()", cost)
            if lacking := _lacking(cost):
                raise ReturnedError(f"One of rare_costs() lacks {', '.join(lacking)}.")
            texts = all(_is_text(text, LONGEST_TEXT) for text in (cost.what, cost.when, cost.counter))
            if not texts or not (cost.frames is None or _is_whole(cost.frames)):
                raise ReturnedError("One of rare_costs() has texts that are none, or frames that are no whole number.")
        return costs

    def pictures(self, payload: Received) -> dict[str, Bytes]:
        """Its pictures of a payload that it packed: uint8 (h, w, 3), by name. Raises ReturnedError."""
        pictures = self.own.pictures(payload.original)
        _refuse(
            "What pictures() returned",
            _of_named("they", "picture", pictures, _picture_objection, taken=OWN_PICTURES),
        )
        return {name: np.ascontiguousarray(rgb) for name, rgb in pictures.items()}

    def details(self, payload: Received) -> dict[str, arrays.Array]:
        """Its arrays for `--dump`, of any shape and numbers, by name. Raises ReturnedError."""
        details = self.own.details(payload.original)
        wrong = [*_of_named("they", "detail", details, _array_objection, LONGEST_STATISTIC, OWN_DETAILS)]
        if not wrong and sum(array.nbytes for array in details.values()) > MOST_BYTES:
            wrong = [f"it has over {MOST_BYTES >> 30} GB"]
        _refuse("What details() returned", wrong)
        return dict(details)


class CheckedClient(Client):
    """A client whose answers are read here, as those of a packer are by CheckedPacker.

    own: the client itself, to be asked by clocks, whose pictures are then read by `read_image`.
    """

    def __init__(self, own: Client, device: Device) -> None:
        self.own, self.device = own, device

    @property
    def shows_other_rates(self) -> bool:
        """Whether it can show what it has received at other rates."""
        return type(self.own).replace_planes is not Client.replace_planes

    def receive(self, payload: Decoded) -> None:
        """Take one frame's decoded payload."""
        self.own.receive(payload)

    def draw(self, view: View) -> Image:
        """Draw `view`. Raises ReturnedError."""
        return self.read_image(self.own.draw(view), view)

    def read_image(self, returned: object, view: View) -> Image:
        """What its `draw` returned for a view. Raises ReturnedError."""
        if type(returned) is not Image:
            raise ReturnedError(f"What the client draws is {shown(returned)}, and no Image.")
        if lacking := _lacking(returned):
            raise ReturnedError(f"The client's Image lacks {', '.join(lacking)}.")
        size = (view.height, view.width)
        parts = {"rgb": (np.uint8, (*size, 4)), "triangle": (np.int32, size), "depth": (np.float32, size)}
        wrong = [
            f"{name} of the client's image is no {np.dtype(dtype)} {shape} array of the frame's device"
            for name, (dtype, shape) in parts.items()
            if (name == "rgb" or getattr(returned, name) is not None)
            and not self.device.holds(getattr(returned, name), dtype, shape)
        ]
        if not wrong and returned.triangle is None and returned.depth is None:
            wrong = ["the client says neither which triangles it shows nor how far"]
        _refuse("What the client draws", wrong)
        return replace(returned)

    def fragments(self) -> tuple[HeldLists, ...]:
        """The lists that it holds. Raises ReturnedError."""
        held = _exactly(tuple, "fragments()", self.own.fragments())
        for part in held:
            lists = _exactly(HeldLists, "one of fragments()", part)
            _refuse("One of fragments()", _of_lists(lists))
        return held

    def locate(self, triangles: Ints, bary: Floats) -> Doubles | None:
        """Atlas positions of surface points, as Client has them, in an array of their own. Raises ReturnedError."""
        places = self.own.locate(triangles, bary)
        if places is not None and not _is_host(places, np.float64, (len(triangles), 2)):
            what = f"{shown(places)}: it must be None, or one column and row, in float64, for each point"
            raise ReturnedError(f"The client's locate() is {what}.")
        if places is not None and np.isinf(places).any():
            raise ReturnedError("The client's locate() has infinite places: those that there are not must be NaN.")
        return None if places is None else places.copy()


def shown(value: object) -> str:
    """What a value is, in a few words, with nothing of it run."""
    if type(value) is str:
        return ascii(value[:LONGEST_NAME]) + "..." * (len(value) > LONGEST_NAME)
    if type(value) is np.ndarray:
        return f"an array of {value.dtype} {value.shape}"
    if type(value) is int and abs(value) > LARGEST_WHOLE:
        return "a number beyond 64 bits"
    if value is None or _is_one(value, REAL):
        return str(value)
    name = plain(type(value).__name__, LONGEST_NAME)
    return f"an {name}" if name[:1].lower() in "aeiou" else f"a {name}"


def _is_one(value: object, kinds: Iterable[type]) -> bool:
    """Whether it is of exactly one of these types: compared as Python does it, a type could answer for itself."""
    return any(type(value) is kind for kind in kinds)


def _is_derived(value: object, kind: type) -> bool:
    """Whether its type is this one or really derived from it."""
    return any(base is kind for base in _BASES.__get__(type(value)))


def _lacking(record: object) -> list[str]:
    """Fields that a record of one of the interface's own types, exactly, has lost."""
    return [field.name for field in fields(record) if field.name not in vars(record)]  # type: ignore[arg-type]  # it is


def _refuse(what: str, objections: Iterable[str]) -> None:
    """Raise ReturnedError if there are any."""
    found = list(objections)
    if found:
        more = f"; and {len(found) - OBJECTIONS} more" if len(found) > OBJECTIONS else ""
        raise ReturnedError(f"{what} is not as the interface says: {'; '.join(found[:OBJECTIONS])}{more}.")


def _exactly(kind: type[T], what: str, value: object) -> T:
    """The value, if it is of this type and of none that is derived from it."""
    if type(value) is kind and isinstance(value, kind):
        return value
    raise ReturnedError(f"{what} is {shown(value)}: it must be a {kind.__name__}.")


def _of_named(
    what: str,
    one: str,
    parts: object,
    objection: Callable[[object], str | None],
    longest: int = LONGEST_NAME,
    taken: frozenset[str] = frozenset(),
) -> Iterator[str]:
    """Objections to parts by name. objection: to one part, as the end of a sentence."""
    if type(parts) is not dict:
        yield f"{what} are {shown(parts)}, and no dict"
        return
    for name, part in parts.items():
        if not _is_name(name, longest) or name in taken:
            which = f"identifiers of up to {longest} letters" + (", but for the harness' own" if taken else "")
            yield f"{shown(name)} cannot be the name of a {one}: these are {which}"
        elif wrong := objection(part):
            yield f"the {one} {name!r} {wrong}"


def _of_planes(planes: object, frame: Frame) -> Iterator[str]:
    device, shape = frame.scene.device, (frame.atlas_height, frame.atlas_width, 4)

    def objection(plane: object) -> str | None:
        fine = device.holds(plane, np.uint8, shape)
        return None if fine else f"is no uint8 {shape} array of the frame's device, the atlas' size"

    yield from _of_named("planes", "plane", planes, objection)
    if type(planes) is dict and planes and sum(shown(name) != repr(ALPHA) for name in planes) != 1:
        names = ", ".join(map(shown, list(planes)[:OBJECTIONS]))
        yield f"planes are {names}, where there must be one beside {ALPHA!r}"


def _of_samples(samples: object, device: Device, needed: bool) -> Iterator[str]:
    """needed: whether there are planes, whose texels only samples tell of."""
    if samples is None and not needed:
        return
    if type(samples) is not Samples:
        yield f"samples are {shown(samples)}: nothing says what the planes' texels are"
        return
    if lacking := _lacking(samples):
        yield f"samples lack {', '.join(lacking)}"
        return
    if not _is_whole(samples.count):
        yield f"samples' count is {shown(samples.count)}, and no whole number of at least 0"
        return
    for name, dtype in ARRAYS.items():
        array = getattr(samples, name)
        shape = array.shape if type(array) is array_class() else ()
        if not (device.holds(array, dtype, shape) and len(shape) == 1):
            yield f"samples' {name} is no {np.dtype(dtype)} (n) array of the frame's device"
        elif shape[0] < samples.count:
            yield f"samples' count is {samples.count}, and there is room for {shape[0]} in {name}"
            return


def _of_count(name: str, count: object) -> Iterator[str]:
    if not _is_whole(count):
        yield f"{name} is {shown(count)}, and no whole number of at least 0"


def _of_unplaced(unplaced: object, triangles: int) -> Iterator[str]:
    """triangles: how many the scene has."""
    if type(unplaced) is not dict:
        yield f"unplaced is {shown(unplaced)}, and no dict"
        return
    for one in unplaced:
        if not _is_one(one, WHOLE) or not 0 <= one < triangles:
            yield f"unplaced names {shown(one)}, which is no triangle of the scene"
            return
    wrong = [reason for reason in unplaced.values() if not _is_text(reason, LONGEST_TEXT)]
    if wrong:
        yield f"a reason in unplaced is {shown(wrong[0])}, and no line of up to {LONGEST_TEXT} letters"
    elif len(set(unplaced.values())) > MOST_REASONS:
        yield f"unplaced has over {MOST_REASONS} different reasons"


def _of_lists(lists: HeldLists) -> Iterator[str]:
    """Objections to the form of one part's lists."""
    if lacking := _lacking(lists):
        yield f"it lacks {', '.join(lacking)}"
        return
    view = lists.view
    if type(view) is not View or _lacking(view):
        yield f"its view is {shown(view)}, and no whole View"
        return
    matrices = all(_is_host(one, np.float64, (4, 4)) and np.isfinite(one).all() for one in (view.view, view.projection))
    if not matrices or not all(_is_whole(side) and 0 < side <= LONGEST_SIDE for side in (view.width, view.height)):
        yield f"its view has no float64 (4, 4) matrices, or no sides of 1 to {LONGEST_SIDE} pixels"
        return
    if not _is_host(lists.offsets, np.int64, (int(view.width) * int(view.height) + 1,)):
        yield f"its offsets are {shown(lists.offsets)}, not int64 (height * width + 1)"
    count = len(lists.depth) if type(lists.depth) is np.ndarray and lists.depth.ndim else 0
    if not (_is_host(lists.depth, np.float32, (count,)) and _is_host(lists.rgba, np.uint8, (count, 4))):
        yield f"its rgba is {shown(lists.rgba)} and its depth {shown(lists.depth)}, not uint8 (n, 4) and float32 (n)"
    if type(lists.normals) is not bool:
        yield f"its normals are {shown(lists.normals)}, and no bool"


def _bytes_objection(data: object) -> str | None:
    return None if _is_one(data, BYTES) else f"is no bytes but {shown(data)}"


def _number_objection(value: object) -> str | None:
    try:
        fine = _is_one(value, REAL) and isfinite(value)  # type: ignore[arg-type]  # a number by its type
    except OverflowError:
        fine = False
    return None if fine else f"is {shown(value)}, and no finite number: leave out what has none"


def _picture_objection(rgb: object) -> str | None:
    if type(rgb) is np.ndarray and rgb.dtype == np.uint8 and rgb.ndim == 3 and rgb.shape[2] == 3:
        height, width, _ = rgb.shape
        if min(height, width) > 0 and max(height, width) <= LONGEST_SIDE:
            return None
    return f"is {shown(rgb)}, and no uint8 (h, w, 3) of 1 to {LONGEST_SIDE} pixels a side"


def _array_objection(array: object) -> str | None:
    fine = type(array) is np.ndarray and array.dtype.kind in "biufc"
    return None if fine else f"is {shown(array)}, and no array of numbers"


def _is_host(value: object, dtype: DTypeLike, shape: tuple[int, ...]) -> bool:
    """Whether it is a NumPy array of this form."""
    return type(value) is np.ndarray and value.dtype == dtype and value.shape == shape


def _is_name(name: object, longest: int) -> bool:
    return type(name) is str and name.isidentifier() and len(name) <= longest


def _is_text(text: object, longest: int) -> bool:
    """Whether it is one line that every file takes."""
    return type(text) is str and text.isprintable() and len(text) <= longest


def _is_whole(value: object) -> bool:
    """Whether it counts something."""
    return _is_one(value, WHOLE) and 0 <= value <= LARGEST_WHOLE  # type: ignore[operator]  # a number by its type
