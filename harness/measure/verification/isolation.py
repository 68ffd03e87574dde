"""Whether a client shares nothing with its server: what it can reach, and what it shows of what it is fed."""

from __future__ import annotations

import sys
import zlib
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes, Ints, fixed
from shading_atlas_bench.harness.measure.returned import CheckedPacker, Received, fields_of, verdict_on
from shading_atlas_bench.harness.measure.validity import Violation
from shading_atlas_bench.harness.measure.verification.lists import ListView, blended, list_views
from shading_atlas_bench.harness.measure.verification.truth import LEVELS, Truth, violation
from shading_atlas_bench.packers.interface import (
    ALPHA,
    Client,
    ClientScene,
    Decoded,
    Frame,
    Packer,
    Payload,
    ServerScene,
    View,
)

MOST = 20_000  # objects looked at
PLAIN = (str, bytes, bytearray, memoryview, int, float, complex, bool, type(None), np.generic, np.dtype)
DECOY = 8  # of so many triangles one is in the set of the frame between
NOT_INVERTED = 0.02  # share of pixels that may differ from the inverted picture: where opacity rounds
PIXELS = 256  # of lists' pictures examined
OWN = ("shading_atlas_bench.packers.interface", "abc", "builtins")  # modules whose classes are nobody's method


@dataclass(frozen=True)
class Step:
    """An object, and how it is reached."""

    value: object
    path: str


def check_references(client: Client, scene: ServerScene, forbidden: dict[int, str]) -> Iterator[Violation]:
    """That no way leads from a client to the server's scene or to the packer.

    forbidden: what things are called that no client may hold, by their id.
    """
    seen = {id(value) for value in (scene.device, scene.shader.sky, scene.mask)}
    steps = deque([Step(client, "client")])
    while steps and len(seen) < MOST:  # numbers and texts do not count
        step = steps.popleft()
        if id(step.value) in seen or isinstance(step.value, (*PLAIN, type, ModuleType, BuiltinFunctionType)):
            continue
        seen.add(id(step.value))
        name = forbidden.get(id(step.value)) or _forbidden_kind(step.value)
        if name:
            yield violation("isolated", 1, f"The client holds {name}: {step.path}.")
            return
        steps.extend(_next_steps(step))
    if steps:
        yield violation("isolated", 1, f"The client holds over {MOST:,} objects: too many to tell what it shares.")


def _forbidden_kind(value: object) -> str | None:
    kinds = {ServerScene: "the server's scene", Packer: "a packer", Payload: "a payload", Frame: "a frame"}
    return next((name for kind, name in kinds.items() if isinstance(value, kind)), None)


def things_of(scene: ServerScene, packer: Packer, payload: Received) -> dict[int, str]:
    """What no client may hold, by id: the server's scene, the packer and the payload, and what they are made of."""
    triangles, host = scene.triangles, scene.host
    shipped = {id(value) for value in (scene.device, scene.shader.sky, scene.mask, None)}
    things = {id(value): "the server's scene" for value in vars(scene).values()}
    things |= {id(value): "the server's triangles" for value in vars(triangles).values() if not isinstance(value, int)}
    arrays = [value for value in vars(host).values() if isinstance(value, (np.ndarray, list)) and len(value)]
    things |= {id(value): "the scene's own data" for value in arrays}
    things |= {id(value): "the server's shader" for value in scene.shader.arguments}
    things |= {id(packer): "its packer", id(payload.original): "the payload before it was sent"}
    parts = fields_of(payload.original)
    shared = (parts[name] for name in ("planes", "blobs", "lists", "statistics", "unplaced", "samples"))
    things |= {id(part): "a part of the payload before it was sent" for part in shared}
    things |= {id(plane): "a plane before it was sent" for plane in payload.planes.values()}
    return {key: name for key, name in things.items() if key not in shipped}


def _next_steps(step: Step) -> Iterator[Step]:
    """What an object holds, but for classes, modules and the insides of libraries."""
    value, path = step.value, step.path
    if isinstance(value, dict):
        yield from (Step(part, f"{path}[{key!r}]") for key, part in value.items())
        yield from (Step(key, f"a key of {path}") for key in value)
    elif isinstance(value, (list, tuple, set, frozenset, deque)):
        yield from (Step(part, f"{path}[{number}]") for number, part in enumerate(value))
    elif isinstance(value, MethodType):
        yield Step(value.__self__, f"{path}.__self__")
        yield Step(value.__func__, f"{path}.__func__")
    elif isinstance(value, partial):
        yield from (Step(part, path) for part in (value.func, value.args, value.keywords))
    elif isinstance(value, FunctionType):
        yield from _of_function(value, path)
    elif isinstance(value, np.ndarray):
        yield Step(value.base, f"{path}.base")
        yield Step(value.tolist() if value.dtype == object else None, path)
    elif not type(value).__module__.startswith(("pyopencl", "numpy")):
        yield from (Step(part, f"{path}.{name}") for name, part in getattr(value, "__dict__", {}).items())
        for name in _slots(value):
            yield Step(getattr(value, name, None), f"{path}.{name}")
        yield from _of_class(type(value), path)


def _of_function(function: FunctionType, path: str) -> Iterator[Step]:
    """What a function brings along: its closure, its defaults and the data of its module that it names."""
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        try:
            yield Step(cell.cell_contents, f"{path} -> {name}")
        except ValueError:  # not filled yet
            continue
    for number, part in enumerate((*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).values())):
        yield Step(part, f"{path}'s default {number}")
    for name in function.__code__.co_names:
        part = function.__globals__.get(name)
        if not callable(part):
            yield Step(part, f"{function.__module__}.{name}")
    yield Step(vars(function), f"{path}.__dict__")


def _of_class(kind: type, path: str) -> Iterator[Step]:
    """What a method's classes hold for all of their objects."""
    for one in _own_classes(kind):
        for name, part in vars(one).items():
            if name not in ("__dict__", "__weakref__", "_abc_impl"):
                part = getattr(part, "__func__", getattr(part, "fget", part))
                yield Step(part, f"{one.__name__}.{name}")


def _own_classes(kind: type) -> list[type]:
    return [one for one in kind.__mro__ if one.__module__ not in OWN]


def _slots(value: object) -> tuple[str, ...]:
    slots = getattr(type(value), "__slots__", ())
    return (slots,) if isinstance(slots, str) else tuple(slots)


def shared_state(kinds: tuple[type, ...]) -> dict[str, object]:
    """What classes and their modules keep outside of objects: prints of all their data by name."""
    found: dict[str, object] = {}
    for one in {own for kind in kinds for own in _own_classes(kind)}:
        found |= {f"{one.__name__}.{name}": _print_of(part) for name, part in vars(one).items() if _is_data(name, part)}
        module = sys.modules.get(one.__module__)
        known = vars(module) if module else {}
        found |= {f"{one.__module__}.{n}": _print_of(part) for n, part in known.items() if _is_data(n, part)}
    return found


def _is_data(name: str, value: object) -> bool:
    """Functions are: they have defaults and attributes."""
    own = isinstance(value, FunctionType) or not callable(value)
    return own and not (name.startswith(("__", "_abc")) or isinstance(value, (ModuleType, property)))


def _print_of(value: object, depth: int = 4) -> object:
    """What changes when a container does, or something in it."""
    if isinstance(value, np.ndarray) and value.dtype != object:
        return id(value), zlib.crc32(value.tobytes())
    if depth == 0:
        return id(value)
    if isinstance(value, dict):
        return id(value), tuple((key, _print_of(part, depth - 1)) for key, part in value.items())
    if isinstance(value, (list, tuple, set, deque, np.ndarray)):
        return id(value), tuple(_print_of(part, depth - 1) for part in value)
    if isinstance(value, FunctionType):
        parts = (value.__defaults__, value.__kwdefaults__, value.__dict__)
        return id(value), tuple(_print_of(part, depth - 1) for part in parts)
    if isinstance(value, (*PLAIN, type, ModuleType)):
        return id(value)
    return id(value), _print_of(getattr(value, "__dict__", None), depth - 1)


def check_shared_state(before: dict[str, object], after: dict[str, object]) -> Iterator[Violation]:
    """That packing and drawing keep nothing in classes and modules."""
    if changed := sorted(name for name in after if name not in before or after[name] != before[name]):
        names = ", ".join(changed)
        yield violation("isolated", len(changed), f"State is kept outside of packer and client, in {names}.")


def decode_losslessly(payload: Payload) -> Decoded:
    """A payload as it arrives without a lossy codec."""
    planes = {name: fixed(plane.get())[..., :3] for name, plane in payload.planes.items()}
    return Decoded(planes, dict(payload.blobs), payload.geometry, dict(payload.lists))


def check_isolation(truth: Truth, make: Callable[[], Packer], frame: Frame, view: View) -> list[Violation]:
    """What a method's clients show of what they are fed, with packers and clients of its own; two frames are alike, so
    that a method that keeps state runs all of its kernels.

    Between packing a frame and showing it, the packer packs another one: whoever looks at more than the payload sees
    that. Raises what the method raises; NotShippedError where a client asks for more than it is shipped with.
    """
    scene, shipped, shared = truth.scene, truth.scene.shipped, truth.shared
    packer = CheckedPacker(make())
    before = shared_state((type(packer.own),))
    packer.prepare(scene)
    client = packer.client(shipped)
    before |= {name: value for name, value in shared_state((type(client.own),)).items() if name not in before}
    payload = packer.pack(frame)
    first = decode_losslessly(payload)
    client.receive(replace(first, planes=dict(first.planes), blobs=dict(first.blobs)))
    shown = _Shown.by(client, view)
    found = list(check_references(client.own, scene, things_of(scene, packer.own, payload)))
    client.receive(decode_losslessly(packer.pack(frame)))
    few = frame.pvs[::DECOY]
    client.receive(decode_losslessly(packer.pack(replace(frame, pvs=few, pvs_device=scene.device.upload(few)))))
    found += _check_decoy(truth, client, view, few)
    found += check_shared_state(before, shared_state((type(packer.own), type(client.own))))
    found += _check_again(truth, packer, first, view, shown)
    if changed := shared.changed():
        sentence = f"It writes to {', '.join(changed)}, which all methods read."
        found.append(violation("isolated", len(changed), sentence))
    return found


@dataclass(frozen=True)
class _Shown:
    """A picture on the host: rgb uint8 (h, w, 3), triangle int32 (h, w) or None."""

    rgb: Bytes
    triangle: Ints | None

    @classmethod
    def by(cls, client: Client, view: View) -> _Shown:
        image = client.draw(view)
        return cls(image.rgb.get()[..., :3], None if image.triangle is None else image.triangle.get())

    @classmethod
    def of(cls, packer: CheckedPacker, shipped: ClientScene, payload: Decoded, view: View) -> _Shown:
        """By a client of a packer that knows nothing else."""
        client = packer.client(shipped)
        client.receive(replace(payload, planes=dict(payload.planes), blobs=dict(payload.blobs)))
        return cls.by(client, view)


def _check_again(
    truth: Truth, packer: CheckedPacker, payload: Decoded, view: View, shown: _Shown
) -> Iterator[Violation]:
    """What other clients show of a payload that one has shown already: the same, and inverted planes inverted."""
    shipped = truth.scene.shipped
    try:
        again = _Shown.of(packer, shipped, payload, view).rgb
        planes = {name: plane if name == ALPHA else fixed(255 - plane) for name, plane in payload.planes.items()}
        inverted = _Shown.of(packer, shipped, replace(payload, planes=planes), view).rgb if planes else None
    except BaseException as error:  # whatever it is, the first client did not meet it
        _, reason = verdict_on(error)
        sentence = f"Another client cannot show the same payload: {reason}"
        yield violation("isolated", 1, sentence)
        return
    if not np.array_equal(again, shown.rgb):
        sentence = "Another client shows another picture of the same payload, once the packer has packed another one."
        yield violation("isolated", int((again != shown.rgb).any(axis=2).sum()), sentence)
    if inverted is not None:
        yield from _check_inverted(truth, shown, inverted)


def _check_decoy(truth: Truth, client: Client, view: View, sent: Ints) -> Iterator[Violation]:
    """A client that was sent few triangles shows no others, and one that was sent lists shows these."""
    held = client.fragments()
    if held:
        for lists in list_views(held):
            yield from _check_blend(truth, client, lists) if lists.owned.any() else ()
        return
    ids = _Shown.by(client, view).triangle
    if ids is not None and (strange := np.setdiff1d(ids[ids >= 0], sent)).size:
        sentence = f"The client shows {strange.size} triangles that it was not sent."
        yield violation("isolated", strange.size, sentence, strange)


def _check_blend(truth: Truth, client: Client, lists: ListView) -> Iterator[Violation]:
    """Seen from where they were made, lists show their blend over the sky, within LEVELS, but for few pixels."""
    view, held, device = lists.view, lists.parts, truth.scene.device
    sky = device.empty((view.height, view.width, 4), np.uint8)
    truth.scene.shader.sky(view.view, view.projection, sky, stage="check/sky")
    behind = sky.get().reshape(-1, 4)[:, :3].astype(np.float64)
    shown = _Shown.by(client, view).rgb.reshape(-1, 3)
    places = np.flatnonzero(lists.owned)
    pixel = places[truth.generator(0, "blend").integers(0, places.size, PIXELS)]
    off = np.empty(PIXELS)
    for number, at in enumerate(pixel):
        spans = [slice(part.offsets[at], part.offsets[at + 1]) for part in held]
        rgba = np.concatenate([part.rgba[span] for part, span in zip(held, spans, strict=True)])
        depth = np.concatenate([part.depth[span] for part, span in zip(held, spans, strict=True)])
        rgba = rgba[np.argsort(-depth, kind="stable")].astype(np.float64)
        *colour, through = blended(rgba[:, :3], rgba[:, 3])
        off[number] = np.abs(colour + through / 255 * behind[at] - shown[at]).max()
    wrong = int(np.count_nonzero(off > LEVELS))
    if wrong > NOT_INVERTED * PIXELS:
        sentence = f"In {wrong} of {PIXELS} pixels the client does not show the blend of the lists that it holds."
        yield violation("isolated", wrong, sentence)


def _check_inverted(truth: Truth, shown: _Shown, inverted: Bytes) -> Iterator[Violation]:
    """Inverted planes show an inverted picture, where opaque triangles are drawn."""
    drawn = np.ones(inverted.shape[:2], bool)
    if shown.triangle is not None:
        ids = np.clip(shown.triangle, -1, truth.triangles.count - 1)
        drawn = (ids >= 0) & ~truth.blended[ids]
    off = np.abs(inverted.astype(np.int16) + shown.rgb - 255).max(axis=2)[drawn] > LEVELS
    if off.size and off.mean() > NOT_INVERTED:
        sentence = f"{off.mean():.0%} of what the client draws does not come from the planes that it received."
        yield violation("isolated", int(off.sum()), sentence)
