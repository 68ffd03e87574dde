"""Packers that cheat, each in one way: two methods with one planted fault each, and what the reason must say."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from shading_atlas_bench.arithmetic import draws
from shading_atlas_bench.harness.measure.verification.truth import CHOSEN
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.packers.interface import ALPHA, Decoded, HeldLists, Image, Payload
from shading_atlas_bench.packers.ppll import PerPixelLinkedLists, server
from shading_atlas_bench.packers.ppll.client import ListClient
from shading_atlas_bench.packers.ppll.kernels.wire import write_twin
from shading_atlas_bench.packers.ppll.wire import Message, decode, encode
from shading_atlas_bench.packers.sas import ShadingAtlasStreaming
from shading_atlas_bench.packers.sas.client import ShadingAtlasClient

GLOBAL: dict[Any, Any] = {}  # what some of them hide things in
NESTED: dict[str, dict[str, Any]] = {"inside": {}}


def edit_lists(payload: Payload, edit) -> Payload:
    """A payload whose lists are those that `edit` makes of offsets and rows."""
    return edit_views(payload, lambda message: [edit(*node) for node in message.nodes])


def edit_views(payload: Payload, edit) -> Payload:
    """A payload of which each view's nodes, offsets and rows, are those that `edit` makes of its message."""
    messages = [
        replace(message, nodes=tuple(nodes), counts=tuple(len(rows) for _, rows in nodes))
        for message in decode(payload.blobs["head"], payload.lists["lists"])
        for nodes in [edit(message)]
    ]
    return with_messages(payload, messages)


def with_messages(payload: Payload, messages: Sequence[Message]) -> Payload:
    """A payload of these messages, one for each view."""
    payload.lists["lists"] = written = b"".join(
        write_twin(*node, message.layout) for message in messages for node in message.nodes
    )
    payload.blobs["head"] = encode(messages, written)
    payload.raw_bytes = len(written)
    payload.sample_count = sum(sum(message.counts) for message in messages)
    return payload


def reshaded(frame, payload: Payload, samples: Samples, eye: np.ndarray, chosen: np.ndarray) -> Payload:
    """The payload with some texels, bool by sample, shaded as other samples from an eye are."""
    plane = payload.planes["atlas"]
    other = frame.scene.device.zeros(plane.shape, np.uint8)
    frame.scene.shader.shade(samples, eye, other, stage="gather/shade")
    assert payload.samples
    texel = payload.samples.texel.get()[: payload.samples.count][chosen]
    pixels, cheap = plane.get().reshape(-1, 4), other.get().reshape(-1, 4)
    pixels[texel] = cheap[texel]
    plane.set(pixels.reshape(plane.shape))
    return payload


class Renamed(ShadingAtlasStreaming):
    """Its launches have names that count for nothing."""

    name = "renamed"

    def pack(self, frame):
        device, launch = frame.scene.device, frame.scene.device.launch
        device.launch = lambda stage, *rest, **options: launch("free/of-charge", *rest, **options)
        try:
            return super().pack(frame)
        finally:
            del device.launch


class FewerSamples(ShadingAtlasStreaming):
    """Claims a tenth of its samples."""

    name = "fewer-samples"

    def pack(self, frame):
        payload = super().pack(frame)
        payload.sample_count //= 10
        return payload


class MoreRawBytes(PerPixelLinkedLists):
    """Claims ten times its bytes before compression."""

    name = "more-raw-bytes"

    def pack(self, frame):
        payload = super().pack(frame)
        payload.raw_bytes *= 10
        return payload


class Renderer(ShadingAtlasStreaming):
    """Its client draws the scene itself."""

    name = "renderer"

    def prepare(self, scene):
        super().prepare(scene)
        self.scene = scene

    def client(self, scene):
        from shading_atlas_bench.harness.workload.reference import ForwardRenderer

        client: Any = super().client(scene)
        renderer = ForwardRenderer(self.scene)
        client.draw = lambda view: renderer.draw(view)[0]
        return client


class AskingRenderer(ShadingAtlasStreaming):
    """Its client asks what it is shipped with for the scene's shader."""

    name = "asking-renderer"

    def client(self, scene):
        client: Any = super().client(scene)
        client.shader = scene.shader
        return client


class Black(ShadingAtlasStreaming):
    """Its client shows nothing, and calls it triangle 0."""

    name = "black"

    def client(self, scene):
        return BlackClient(scene)


class BlackClient(ShadingAtlasClient):
    def draw(self, view):
        shape = (view.height, view.width)
        return Image(self.device.zeros((*shape, 4), np.uint8), self.device.zeros(shape, np.int32))


class Grey(ShadingAtlasStreaming):
    """Its texels are grey, which compresses well."""

    name = "grey"

    def pack(self, frame):
        payload = super().pack(frame)
        plane = payload.planes["atlas"].get()
        plane[..., :3] = 128
        payload.planes["atlas"].set(plane)
        return payload


class LeftOut(PerPixelLinkedLists):
    """Leaves out two triangles of five."""

    name = "left-out"

    def pack(self, frame):
        kept = frame.pvs[frame.pvs % 5 > 1]
        return super().pack(replace(frame, pvs=kept, pvs_device=frame.scene.device.upload(kept)))


class InvertedLists(PerPixelLinkedLists):
    """Its fragments have inverted colours."""

    name = "inverted-lists"

    def pack(self, frame):
        return edit_lists(
            super().pack(frame), lambda offsets, rows: (offsets, rows ^ np.array([0xFFFFFF, 0], np.uint32))
        )


class Stale(ShadingAtlasStreaming):
    """Sends the first frame again and again."""

    name = "stale"
    since = 1
    first = None

    def pack(self, frame):
        payload = super().pack(frame)
        self.first = self.first or payload
        return self.first


class Swapped(ShadingAtlasStreaming):
    """Every other sample names its neighbour's triangle."""

    name = "swapped"

    def pack(self, frame):
        payload = super().pack(frame)
        assert payload.samples
        triangle, last = payload.samples.triangle.get(), payload.samples.count // 2 * 2
        triangle[:last:2] = triangle[1:last:2]
        payload.samples.triangle.set(triangle)
        return payload


class WrongEye(ShadingAtlasStreaming):
    """A quarter of its texels is shaded from where the eye was not."""

    name = "wrong-eye"

    def pack(self, frame):
        payload = super().pack(frame)
        assert payload.samples
        quarter = np.arange(payload.samples.count) % 4 == 0
        return reshaded(frame, payload, payload.samples, -frame.server.eye, quarter)


class CoarseTextures(ShadingAtlasStreaming):
    """Its textures come from mip levels that are coarser than its samples say."""

    name = "coarse-textures"

    def pack(self, frame):
        payload = super().pack(frame)
        assert payload.samples
        coarse = replace(payload.samples, footprint=payload.samples.footprint * np.float32(16))
        return reshaded(frame, payload, coarse, frame.server.eye, np.ones(payload.samples.count, bool))


class Excused(ShadingAtlasStreaming):
    """Says of triangles that it could not place them, and places them."""

    name = "excused"

    def pack(self, frame):
        payload = super().pack(frame)
        payload.unplaced = dict.fromkeys(frame.pvs.tolist(), "the atlas is full")
        return payload


class InAnAttribute(ShadingAtlasStreaming):
    """Its metadata is an attribute of the payload, which nobody counts."""

    name = "in-an-attribute"

    def prepare(self, scene):
        super().prepare(scene)
        self.mail = {}

    def pack(self, frame):
        payload = super().pack(frame)
        self.mail["payload"] = payload
        loose: Any = payload
        loose.locations = payload.blobs.pop("locations")
        return payload

    def client(self, scene):
        client: Any = super().client(scene)
        mail = self.mail
        read = client.read
        client.read = lambda blobs: read({"locations": mail["payload"].locations})
        return client


class InTheClass(ShadingAtlasStreaming):
    """Its metadata is an attribute of a class."""

    name = "in-the-class"

    def pack(self, frame):
        payload = super().pack(frame)
        InTheClassClient.sent = payload.blobs.pop("locations")
        return payload

    def client(self, scene):
        return InTheClassClient(scene)


class InTheClassClient(ShadingAtlasClient):
    sent: bytes

    def read(self, blobs):
        super().read({"locations": self.sent})


class InTheModule(ShadingAtlasStreaming):
    """Its geometry lies in a module, and is sent by number."""

    name = "in-the-module"

    def pack(self, frame):
        payload = super().pack(frame)
        GLOBAL[frame.index, len(frame.pvs)] = payload.geometry
        payload.geometry = bytes([frame.index]) + len(frame.pvs).to_bytes(4, "little")
        return payload

    def client(self, scene):
        return InTheModuleClient(scene)


class InTheModuleClient(ShadingAtlasClient):
    def receive(self, payload):
        key = payload.geometry[0], int.from_bytes(payload.geometry[1:], "little")
        super().receive(Decoded(payload.planes, payload.blobs, GLOBAL[key]))


class InTheModuleLater(InTheModule):
    """The same, but from the second frame on."""

    name = "in-the-module-later"

    def pack(self, frame):
        payload = super().pack(frame)
        if not frame.index:
            payload.geometry = payload.geometry[:1] + GLOBAL[0, len(frame.pvs)]
        return payload

    def client(self, scene):
        return InTheModuleLaterClient(scene)


class InTheModuleLaterClient(InTheModuleClient):
    def receive(self, payload):
        if payload.geometry[0]:
            super().receive(payload)
        else:
            ShadingAtlasClient.receive(self, replace(payload, geometry=payload.geometry[1:]))


class InNames(ShadingAtlasStreaming):
    """All but the plane is the name of an empty blob."""

    name = "in-names"

    def pack(self, frame):
        payload = super().pack(frame)
        payload.blobs = {f"{payload.blobs['locations'].hex()}_{payload.geometry.hex()}": b""}
        payload.geometry = b""
        return payload

    def client(self, scene):
        return InNamesClient(scene)


class InNamesClient(ShadingAtlasClient):
    def receive(self, payload):
        (name,) = payload.blobs
        locations, geometry = (bytes.fromhex(part) for part in name.split("_"))
        super().receive(Decoded(payload.planes, {"locations": locations}, geometry))


class Counting(ShadingAtlasStreaming):
    """Names of its blobs count its frames."""

    name = "counting"
    since = 1

    def pack(self, frame):
        payload = super().pack(frame)
        payload.blobs[f"frame_{frame.index}"] = b""
        return payload


class Foreseen(ShadingAtlasStreaming):
    """Shades only the texels that the frame's number and the seed would choose, if they chose."""

    name = "foreseen"

    def pack(self, frame):
        payload = super().pack(frame)
        assert payload.samples
        texel = payload.samples.texel.get()[: payload.samples.count]
        seed = [frame.seed, frame.index, zlib.crc32(self.name.encode())]
        chosen = texel[draws.generator(seed).integers(0, len(texel), CHOSEN)]
        plane = payload.planes["atlas"].get()
        flat = plane.reshape(-1, 4)
        kept = flat[chosen].copy()
        flat[texel, :3] = 128
        flat[chosen] = kept
        payload.planes["atlas"].set(plane)
        return payload


class Deferred(ShadingAtlasStreaming):
    """Its client draws when somebody looks at the picture."""

    name = "deferred"

    def client(self, scene):
        client: Any = super().client(scene)
        draw = client.draw
        client.draw = lambda view: DeferredImage(lambda: draw(view))
        return client


class DeferredImage:
    depth = None

    def __init__(self, work):
        self.work = work

    rgb = property(lambda self: self.work().rgb)
    triangle = property(lambda self: self.work().triangle)


class InAnArray(Renderer):
    """Its client holds the scene among the objects of an array."""

    name = "in-an-array"

    def client(self, scene):
        client: Any = ShadingAtlasStreaming.client(self, scene)
        client.held = np.array([self.scene, None], object)
        return client


class BehindMany(Renderer):
    """Its client holds the scene behind more than anybody looks through."""

    name = "behind-many"

    def client(self, scene):
        client: Any = ShadingAtlasStreaming.client(self, scene)
        client.held = [[] for _ in range(30_000)] + [self.scene]
        return client


class Nested(ShadingAtlasStreaming):
    """Its metadata lies deep in what a module holds."""

    name = "nested"

    def pack(self, frame):
        payload = super().pack(frame)
        NESTED["inside"]["locations"] = payload.blobs.pop("locations")
        return payload

    def client(self, scene):
        client: Any = super().client(scene)
        read = client.read
        client.read = lambda blobs: read(NESTED["inside"])
        return client


class InADefault(ShadingAtlasStreaming):
    """Its metadata is the default argument of a function."""

    name = "in-a-default"

    def pack(self, frame):
        payload = super().pack(frame)
        mail(payload.blobs.pop("locations"))
        return payload

    def client(self, scene):
        client: Any = super().client(scene)
        read = client.read
        client.read = lambda blobs: read({"locations": mail()})
        return client


def mail(letter=None, box=[None]):  # noqa: B006  # a list that lives on is what is planted
    box[0] = letter or box[0]
    return box[0]


class Opaque(ShadingAtlasStreaming):
    """Its alpha plane says that nothing is seen through anything."""

    name = "opaque"

    def pack(self, frame):
        payload = super().pack(frame)
        plane = payload.planes[ALPHA].get()
        plane[plane[..., 3] > 0] = 255
        payload.planes[ALPHA].set(plane)
        return payload


class Phantom(ShadingAtlasStreaming):
    """Lists samples of which some were not written."""

    name = "phantom"

    def pack(self, frame):
        payload = super().pack(frame)
        assert payload.samples
        plane = payload.planes["atlas"].get()
        plane.reshape(-1, 4)[payload.samples.texel.get()[: payload.samples.count : 3]] = 0
        payload.planes["atlas"].set(plane)
        return payload


class Lazy(ShadingAtlasStreaming):
    """Its payload is packed when somebody looks at it."""

    name = "lazy"

    def pack(self, frame):
        return LazyPayload({}, {}, b"", 0).later(lambda: super(Lazy, self).pack(frame))


class LazyPayload(Payload):
    def later(self, pack):
        self.__dict__ = {"pack": pack}
        return self

    def __getattribute__(self, name):
        own = object.__getattribute__(self, "__dict__")
        if "pack" in own:
            pack = own.pop("pack")
            own.update(vars(pack()))
        return object.__getattribute__(self, name)


class Unrecorded(ShadingAtlasStreaming):
    """Launches where nobody looks."""

    name = "unrecorded"

    def pack(self, frame):
        device, records = frame.scene.device, frame.scene.device._records
        device._records = []
        try:
            return super().pack(frame)
        finally:
            device._records = records


class Ended(PerPixelLinkedLists):
    """Says that its lists may end early, and leaves out the nearest fragments."""

    name = "ended"
    holds = "nearest"
    parameters = PerPixelLinkedLists.parameters | {
        "mode": replace(PerPixelLinkedLists.parameters["mode"], default="full")
    }

    def pack(self, frame):
        def without_first(offsets, rows):
            count = np.diff(offsets)
            kept = np.ones(len(rows), bool)
            kept[offsets[:-1][count > 1]] = False
            return np.concatenate([[0], np.cumsum(count - (count > 1))]), rows[kept]

        return edit_lists(super().pack(frame), without_first)


class FarFragment(PerPixelLinkedLists):
    """Every list ends in a fragment that is not there, and compresses well."""

    name = "far-fragment"

    def pack(self, frame):
        def longer(offsets, rows):
            ends = offsets[1:][np.diff(offsets) > 0]
            far = np.tile(np.array([0xFF808080, np.float32(1e-6).view(np.uint32)], np.uint32), (len(ends), 1))
            count = np.diff(offsets) + (np.diff(offsets) > 0)
            return np.concatenate([[0], np.cumsum(count)]), np.insert(rows, ends, far, axis=0)

        return edit_lists(super().pack(frame), longer)


class WrongOrder(PerPixelLinkedLists):
    """Its lists begin with what is farthest."""

    name = "wrong-order"

    def pack(self, frame):
        def reversed_lists(offsets, rows):
            pixel = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
            return offsets, rows[np.lexsort((rows[:, 1].copy().view(np.float32), pixel))]

        return edit_lists(super().pack(frame), reversed_lists)


class Padded(PerPixelLinkedLists):
    """Its lists end in zeros, which cost nothing once they are compressed; its client takes them off."""

    name = "padded"

    def pack(self, frame):
        payload = super().pack(frame)
        payload.lists["lists"] += bytes(8 * payload.raw_bytes)
        payload.raw_bytes *= 9
        return payload

    def client(self, scene):
        return PaddedClient(scene)


class PaddedClient(ListClient):
    def receive(self, payload):
        lists = payload.lists["lists"]
        super().receive(replace(payload, lists={"lists": lists[: len(lists) // 9]}))


class Pretending(PerPixelLinkedLists):
    """Its client tells of lists that it made up, and shows none."""

    name = "pretending"

    def client(self, scene):
        return PretendingClient(scene)


class PretendingClient(ListClient):
    def fragments(self) -> tuple[HeldLists, ...]:
        return tuple(replace(part, rgba=part.rgba // 2 + 64) for part in super().fragments())


class SayingNothing(ShadingAtlasStreaming):
    """Neither ids nor depths come with its pictures."""

    name = "saying-nothing"

    def client(self, scene):
        client: Any = super().client(scene)
        draw = client.draw
        client.draw = lambda view: replace(draw(view), triangle=None)
        return client


# What the reason of each must say.
class OtherRays(PerPixelLinkedLists):
    """Each of its views has all that its picture shows, also on rays that belong to another."""

    name = "other-rays"

    def pack(self, frame):
        module: Any = server
        spans = module.owned_spans
        module.owned_spans = lambda views, number: np.tile(
            np.array([0, views[number].width], np.int32), (views[number].height, 1)
        )
        try:
            return super().pack(frame)
        finally:
            module.owned_spans = spans


class ViewLess(PerPixelLinkedLists):
    """Sends no lists of the last view."""

    name = "view-less"

    def pack(self, frame):
        payload = super().pack(frame)
        return with_messages(payload, decode(payload.blobs["head"], payload.lists["lists"])[:-1])


class ViewMoved(PerPixelLinkedLists):
    """The last view's lists are told to be seen from beside the eye, by a thousandth of the near plane's distance."""

    name = "view-moved"

    def pack(self, frame):
        payload = super().pack(frame)
        messages = decode(payload.blobs["head"], payload.lists["lists"])
        view = messages[-1].view.copy()
        view[0, 3] += 1e-3 * frame.server.projection[2, 3]
        return with_messages(payload, [*messages[:-1], replace(messages[-1], view=view)])


class ViewEmpty(PerPixelLinkedLists):
    """The last view's lists are empty."""

    name = "view-empty"

    def pack(self, frame):
        payload = super().pack(frame)
        *others, last = decode(payload.blobs["head"], payload.lists["lists"])
        nodes = tuple((offsets * 0, rows[:0]) for offsets, rows in last.nodes)
        return with_messages(payload, [*others, replace(last, nodes=nodes, counts=(0,) * len(nodes))])


class ViewInverted(PerPixelLinkedLists):
    """The last view's fragments have inverted colours."""

    name = "view-inverted"

    def pack(self, frame):
        payload = super().pack(frame)
        *others, last = decode(payload.blobs["head"], payload.lists["lists"])
        nodes = tuple((offsets, rows ^ np.array([0xFFFFFF, 0], np.uint32)) for offsets, rows in last.nodes)
        return with_messages(payload, [*others, replace(last, nodes=nodes)])


class ViewPretending(PerPixelLinkedLists):
    """Its client shows nothing of the last view's lists."""

    name = "view-pretending"

    def client(self, scene):
        return ViewPretendingClient(scene)


class ViewPretendingClient(ListClient):
    def draw(self, view):
        held, self.held = self.held, self.held[:-1]
        try:
            return super().draw(view)
        finally:
            self.held = held


PLANTED = {
    Renamed: "Packing launched free/of-charge",
    FewerSamples: "samples and has",
    MoreRawBytes: "uncompressed bytes of lists and has",
    Renderer: "The client holds",
    AskingRenderer: "The client uses 'shader' of its scene",
    Black: "the client claims a triangle that is not there",
    Grey: "levels from what float64 shading gives them",
    LeftOut: "the nearest fragment is not the nearest surface",
    InvertedLists: "colour or cover otherwise",
    Stale: "differ by up to",
    Swapped: "find another surface",
    WrongEye: "levels from what float64 shading gives them",
    CoarseTextures: "levels from what float64 shading gives them",
    Excused: "are listed as unplaced and have a place",
    InAnAttribute: "The client holds the payload before it was sent: client.read",
    InTheClass: "State is kept outside of packer and client, in InTheClassClient.sent",
    InTheModule: "State is kept outside of packer and client",
    InTheModuleLater: "State is kept outside of packer and client",
    InNames: "cannot be the name of a blob",
    Counting: "other names than in the first frame",
    Foreseen: "levels from what float64 shading gives them",
    Deferred: "DeferredImage, and no Image",
    InAnArray: "The client holds the server's scene",
    BehindMany: "too many to tell what it shares",
    Nested: "State is kept outside of packer and client",
    InADefault: "State is kept outside of packer and client",
    Opaque: "texels of the alpha plane have another opacity",
    Phantom: "have an alpha that is not 255 where they are listed",
    Lazy: "as a Payload lacks planes",
    Unrecorded: "packing it launched no gather stage",
    Ended: "the nearest fragment is not the nearest surface",
    FarFragment: "hold, too, what is not",
    WrongOrder: "lie before one that is nearer",
    Padded: "more than",
    Pretending: "does not show the blend of the lists",
    SayingNothing: "neither which triangles it shows nor how far",
}

# In a view cell that takes several views.
PLANTED_WIDE = {
    MoreRawBytes: "uncompressed bytes",
    LeftOut: "nearest",
    InvertedLists: "colour or cover otherwise",
    FarFragment: "hold, too",
    Ended: "nearest",
    Pretending: "does not show the blend",
    OtherRays: "belong to another view",
    ViewLess: "in no picture",
    ViewMoved: "from another eye",
    ViewEmpty: "nearest",
    ViewInverted: "colour or cover otherwise",
    ViewPretending: "does not show the blend",
}
