"""The interface between the suite and a packer: everything a new method needs to know is in this file.

Conventions: column vectors, clip = projection @ view @ (x, y, z, 1), right-handed, the camera looks along -z, NDC y up,
image row 0 on top, pixel and texel centres at +0.5. All positions are relative to the scene's float64 origin.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Literal, NoReturn, TypeAlias

import numpy as np

from shading_atlas_bench.arithmetic.arrays import fixed
from shading_atlas_bench.arithmetic.matrices import matvec, product
from shading_atlas_bench.packers.skips import Skips

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles, Floats, Ints, Longs
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.fragments.layers import Layers
    from shading_atlas_bench.kernels.raster.rasteriser import Rasteriser
    from shading_atlas_bench.kernels.samples import Samples
    from shading_atlas_bench.kernels.shade.shader import Shader
    from shading_atlas_bench.kernels.shade.sky import Sky
    from shading_atlas_bench.kernels.texture.mask import AlphaMask
    from shading_atlas_bench.kernels.triangles import Triangles
    from shading_atlas_bench.scenes.model import Scene


Value: TypeAlias = bool | int | float | str  # of a parameter

ALPHA = "alpha"  # the name of a plane that holds opacities
FULL = "atlas_full"  # the statistic that is 1 in frames for whose texels the atlas has no room, else 0
ALIKE = 8  # levels of 255, by which the blend of lists that a client keeps may differ from that of new ones


@dataclass(frozen=True)
class Paper:
    """Where a method was published."""

    title: str
    year: int
    doi: str


@dataclass(frozen=True)
class Parameter:
    """One parameter of a method: its default, values for a sweep, what it means, its unit and its source.

    limits: lowest and highest value of a number, None for no limit. choices: all values there are, empty for any.
    published: what the paper has, where the default is another value; None where it is not, or the paper has none.
    """

    default: Value
    sweep: tuple[Value, ...]
    meaning: str
    unit: str = ""
    source: str = ""
    limits: tuple[float | None, float | None] = (None, None)
    choices: tuple[Value, ...] = ()
    published: Value | None = None

    def objection(self, value: Value) -> str | None:
        """Why `value` cannot be used, as the end of a sentence, or None."""
        low, high = self.limits
        if self.choices and value not in self.choices:
            return f"is {value!r}: give one of {', '.join(str(choice) for choice in self.choices)}"
        if isinstance(value, str):
            return None if self.limits == (None, None) else f"is {value!r}: give a number"
        if low is not None and not value >= low:
            return f"is {value}: give {low:g} or more"
        if high is not None and not value <= high:
            return f"is {value}: give {high:g} or less"
        return None


@dataclass(frozen=True)
class RareCost:
    """Work that a method does in a few frames only, so that a short run may hold none of it.

    what: a noun with its article. when: what brings it about, as the end of a sentence that begins with "It comes".
    counter: the statistic that counts how often it was done so far; it is not counted for the first frame.
    frames: how many frames, from the first on, hold it for certain; None where only the work decides.
    """

    what: str
    when: str
    counter: str
    frames: int | None = None


@dataclass(frozen=True)
class View:
    """A camera and its image size: view and projection float64 (4, 4), width and height in pixels.

    The projection has reversed depth with an infinite far plane: clip z = near, clip w = distance along -z. The arrays
    are copies that cannot be written to: methods share their views.
    """

    view: Doubles
    projection: Doubles
    width: int
    height: int

    def __post_init__(self) -> None:
        for name in ("view", "projection"):
            object.__setattr__(self, name, fixed(np.array(getattr(self, name))))

    @property
    def matrix(self) -> Doubles:
        """projection @ view, float64 (4, 4)."""
        return product(self.projection, self.view)

    @property
    def eye(self) -> Doubles:
        """The camera's position, float64 (3)."""
        return -matvec(self.view[:3, :3].T, self.view[:3, 3])

    @property
    def pixels_per_tangent(self) -> float:
        """Pixels per unit of tan(angle) at the image centre: the resolution that sample counts derive from."""
        return float(self.projection[0, 0]) * self.width / 2


@dataclass(frozen=True)
class ServerScene:
    """What the server holds for a scene.

    host: the scene model. triangles: on the device. rasteriser: draws them. shader: the one shading function.
    mask: alpha masks of masked triangles, None where the scene has none; clients are shipped with it.
    layers: what is seen through blended and transmissive triangles, None where the scene has none.
    skips: asked before something is left out that nothing needs.
    """

    host: Scene
    device: Device
    triangles: Triangles
    rasteriser: Rasteriser
    shader: Shader
    mask: AlphaMask | None = None
    layers: Layers | None = None
    skips: Skips = field(default_factory=Skips)

    @property
    def shipped(self) -> ClientScene:
        """What a client gets of it."""
        return ClientScene(self.device, self.shader.sky, self.mask)

    @cached_property
    def finest(self) -> ServerScene:
        """The same scene, with colours and opacities from the finest level of its textures."""
        shader = self.shader.finest()
        return replace(self, shader=shader, layers=self.layers and self.layers.textured(shader.textures))


class NotShippedError(AttributeError):
    """A client asked its scene for something that no client is shipped with."""


@dataclass(frozen=True)
class ClientScene:
    """All that a client is shipped with; whatever else it needs must be in payloads.

    device: what it computes on. sky: painted behind everything. mask: alpha masks of masked triangles, by their numbers
    in the scene, None where it has none. Asked for anything else it raises NotShippedError.
    """

    device: Device
    sky: Sky
    mask: AlphaMask | None = None

    def __getattr__(self, name: str) -> NoReturn:
        raise NotShippedError(
            f"The client uses {name!r} of its scene, but a client is shipped with device, sky and mask only: send what "
            "else it needs."
        )


@dataclass(frozen=True)
class Frame:
    """One frame of work, the same for every packer; it never holds the novel view.

    server: the server's view: the path's pose, the cell's field of view, the client's pixel density at the centre.
    cell_radius: of the view cell, in scene units. cell_fov: horizontal, in degrees.
    pvs: int32 (n), ascending ids of the potentially visible triangles; pvs_device: the same on the device.
    predicted: client views predicted for the latency, nearest first.
    atlas_width, atlas_height: the plane to fill, in texels.
    sample_budget: shading samples that a method with an atlas is to compute, by whatever means are its own, as near as
        it and the atlas allow (see packers.budget); None where its own rule says how many.
    seed: for methods that need random numbers.
    frusta: where the cell's frustum is wider or higher than 100 degrees, and one view of it would have over four times
        the client's pixels, views from the server's eye that cover it together, each turned to its part and at the
        client's density at its own centre; else none. See `cell_views`.
    """

    index: int
    scene: ServerScene
    server: View
    cell_radius: float
    cell_fov: float
    pvs: Ints
    pvs_device: Array
    predicted: tuple[View, ...]
    atlas_width: int
    atlas_height: int
    sample_budget: int | None = None
    seed: int = 0
    frusta: tuple[View, ...] = ()

    @property
    def cell_views(self) -> tuple[View, ...]:
        """What to draw the cell from, seen from the server's eye: its frusta, or the server's view where that will do.

        The pictures of several overlap; which of them a ray belongs to says packers/cell_views.py. Other eyes of the
        cell see other surfaces: the set has what is seen from all of them.
        """
        return self.frusta or (self.server,)

    def shade(self, samples: Samples) -> dict[str, Array]:
        """The frame's planes, uint8 (atlas_height, atlas_width, 4) each, as Payload has them.

        Every sample's colour at its texel of "atlas", not multiplied by its opacity, and in scenes where opacity varies
        over triangles, the opacity in a second plane, ALPHA.
        """
        device, scene = self.scene.device, self.scene
        shape = (self.atlas_height, self.atlas_width, 4)
        opacity = scene.layers.opacity if scene.layers and scene.layers.opacity.varies else None
        planes = {name: device.recycled(shape, np.uint8) for name in ("atlas", *([ALPHA] if opacity else []))}
        for plane in planes.values():
            device.fill(plane.view(np.uint32), 0, "gather/clear")  # type: ignore[no-untyped-call]  # pyopencl's own
        scene.shader.shade(samples, eye=self.server.eye, target=planes["atlas"], stage="gather/shade")
        if opacity:
            opacity.write(samples, planes[ALPHA], "gather/alpha")
        return planes


@dataclass
class Payload:
    """Everything sent for one frame, and what the report wants to know about it.

    Its device arrays are this payload's own: nothing writes to them before the packer packs the next frame.
    Its values are of exactly these types (whole numbers also NumPy's), its names identifiers of up to 32 letters, of a
    statistic 64; harness/measure/returned.py refuses others, and stops the method.

    planes: for the video encoder: name to uint8 (H, W, 4) device arrays, sRGB; alpha 255 where a texel was written this
        frame, 0 elsewhere; see Frame.shade. The plane ALPHA, of the same size, is grey, encoded as luma, and its bytes
        are counted apart. A method without an atlas has none.
    blobs: metadata the client needs each frame: name to bytes, compressed by the harness with LZ4.
    geometry: the potentially visible triangles as the client needs them (see packers.geometry), LZ4 likewise.
    lists: what a method without an atlas sends in place of planes: name to bytes, LZ4 likewise, but counted with the
        planes as `bytes_video`. raw_bytes: their size before LZ4, which `compression_ratio` refers to.
    samples: the shading samples, or None for a method without an atlas.
    sample_count: shading samples computed this frame: those in `samples`, or the fragments that the client then holds.
    unplaced: triangles of the PVS that got no place, id to reason; the harness checks that nothing else is missing.
    statistics: what the method reports beyond the common columns, name to number. FULL among them says that the method
        laid out fewer texels than by its own rule, or otherwise than asked for, because the atlas is too small. What
        has no finite number is left out.
    """

    planes: dict[str, Array]
    blobs: dict[str, bytes]
    geometry: bytes
    sample_count: int
    samples: Samples | None = None
    unplaced: dict[int, str] = field(default_factory=dict)
    statistics: dict[str, float] = field(default_factory=dict)
    lists: dict[str, bytes] = field(default_factory=dict)
    raw_bytes: int = 0

    def owners(self) -> Owners | None:
        """Texel to triangle and barycentrics, of the samples; None for a method without an atlas."""
        samples = self.samples
        if samples is None:
            return None
        n = samples.count
        bary = np.stack([samples.bary1.get()[:n], samples.bary2.get()[:n]], axis=1)
        return Owners(samples.texel.get()[:n].astype(np.int64), samples.triangle.get()[:n], bary)


@dataclass(frozen=True)
class Decoded:
    """What arrives at the client: planes uint8 (H, W, 3) after the codec; blobs, geometry and lists as sent."""

    planes: dict[str, Bytes]
    blobs: dict[str, bytes]
    geometry: bytes
    lists: dict[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Owners:
    """Which triangle each written texel belongs to; one entry per sample, so that conflicts show.

    texel: int64 (n), row * width + column. triangle: int32 (n). bary: float32 (n, 2), weights of vertices 1 and 2.
    """

    texel: Longs
    triangle: Ints
    bary: Floats


class Client(ABC):
    """The receiver: it holds decoded payloads only and shares nothing with the packer."""

    @abstractmethod
    def receive(self, payload: Decoded) -> None:
        """Take one frame's decoded payload."""

    @abstractmethod
    def draw(self, view: View) -> Image:
        """Draw `view` from what was received, and from nothing that was drawn before: a run that goes on after a stop
        receives its finished frames again, and draws none of them."""

    def replace_planes(self, planes: Mapping[str, Bytes]) -> None:
        """Take the last payload's planes as another rate's decoder gives them, in place of those received, so that the
        picture at every rate is measured.

        planes: uint8 (H, W, 3) each, by name. A client that does not say how has pictures at the displayed rate only.
        """
        raise NotImplementedError

    def fragments(self) -> tuple[HeldLists, ...]:
        """The lists that it holds after `receive`, one for each view and part that was sent apart; none of an atlas.

        They must come from decoded bytes: the harness holds them against the scene.
        """
        return ()

    def locate(self, triangles: Ints, bary: Floats) -> Doubles | None:
        """Atlas position, in texels, that a lookup at a surface point uses; None for a method without an atlas.

        triangles: int32 (n), scene ids. bary: float32 (n, 2). Returns float64 (n, 2) of column, row, where texel (0, 0)
        covers 0..1 and has its centre at 0.5; NaN for triangles the client does not have.
        """
        return None


@dataclass(frozen=True)
class Image:
    """A drawn picture on the device: rgb uint8 (h, w, 4), sRGB, and what shows in each pixel. It is read at once.

    triangle: int32 (h, w), scene ids of what is nearest there and not wholly transparent, -1 where nothing is drawn. A
    client that knows no ids has None, and says in their place:
    depth: float32 (h, w), the near plane's distance over that of what is nearest, 0 where nothing is drawn.
    """

    rgb: Array
    triangle: Array | None
    depth: Array | None = None


@dataclass(frozen=True)
class HeldLists:
    """Fragments of a list view, as a client holds them, whatever the wire format.

    view: the camera that saw them, with the server's eye. Parts of equal views hold a pixel's fragments together. All
        views together cover the frustum of the server's view; where there are several, a ray has fragments only in the
        one that it belongs to, see packers/cell_views.py.
    offsets: int64 (height * width + 1), where each pixel's begin, row by row.
    rgba: uint8 (n, 4), nearest first; one of alpha 0 is not there. depth: float32 (n), near plane over distance.
    normals: whether they carry what lighting or moving them needs: 24 bytes each on the wire in place of 12.
    """

    view: View
    offsets: Longs
    rgba: Bytes
    depth: Floats
    normals: bool = False


# Parameters of all methods, which the harness sees to: their shading is one. A method may say more of one of them.
COMMON = {
    "mipmaps": Parameter(
        True,
        (True, False),
        "whether samples look up textures at the mip level of their footprint, or at the finest",
        "",
        "true: TSS, section 6; false: SnakeBinning, section 5.2, of shading in tessellation",
    ),
}

# What a client's lists hold of the fragments that a list view sees, see Packer.holds.
Holds: TypeAlias = Literal["every", "nearest", "alike", "moved", "blended"]


class Packer(ABC):
    """A method: how shading is packed. A subclass says what it is, packs frames, and makes the matching client.

    Stages are launched under names that start with "structs/" or "gather/"; the device times them.
    parameters: by name; those of COMMON come on top.
    atlas: whether it fills planes for the video encoder. A method that does not has rows of codec `none` only.
    skips: what it leaves out (ServerScene.skips) where a frame does not need it, by name: what that is, why it is not
        needed where that applies, and why it is needed elsewhere.
    """

    name: ClassVar[str]
    paper: ClassVar[Paper]
    atlas: ClassVar[bool] = True
    parameters: ClassVar[dict[str, Parameter]] = {}
    skips: ClassVar[dict[str, tuple[str, str, str]]] = {}
    mipmaps: bool = True

    def __init_subclass__(cls) -> None:
        if not isinstance(cls.parameters, dict):
            raise TypeError(f"the class {cls.__qualname__} has parameters that are no dict of names to Parameters")
        cls.parameters = COMMON | cls.parameters

    def __init__(self, **values: Value) -> None:
        """Set the parameters; unknown names and values that cannot be used raise ValueError, naming those that can."""
        for name in values:
            if name not in self.parameters:
                known = ", ".join(sorted(self.parameters))
                raise ValueError(f"{self.name} has no parameter {name!r}; it has: {known}.")
        for name, parameter in self.parameters.items():
            value = values.get(name, parameter.default)
            if objection := parameter.objection(value):
                raise ValueError(f"{self.name}: the parameter {name} {objection}.")
            setattr(self, name, value)

    @property
    def leaves_unwritten(self) -> bool:
        """Whether it writes only the texels within half a texel of a triangle, not all that lookups in it touch.

        Their share is then reported as the statistic `unwritten_lookups`, where validity would else object.
        """
        return False

    @property
    def holds(self) -> Holds:
        """Of a method that sends lists, what clients hold of each pixel's fragments.

        "every" one; "nearest", the nearest ones; "alike", some that blend to the same colour within ALIKE levels;
        "moved", some that were seen from elsewhere; "blended", one in place of all.
        """
        return "every"

    def scene_shaded(self, scene: ServerScene) -> ServerScene:
        """The scene as this method shades it, which the harness hands to `prepare` and has in its frames."""
        return scene if self.mipmaps else scene.finest

    def skip(self, scene: Scene) -> str | None:
        """Why this scene has nothing for this method to do, or None."""
        return None

    def prepare(self, scene: ServerScene) -> None:
        """Once per scene, timed apart: patches, charts, buffers."""

    def settled(self) -> bool:
        """Whether packing the last frame's work once more would give the same payload again, byte for byte.

        Asked after a frame of the same work as the one before it; then it may not be packed again.
        """
        return False

    def rare_costs(self) -> tuple[RareCost, ...]:
        """What these parameters make it do in a few frames only; a run that holds none of it says so."""
        return ()

    @abstractmethod
    def pack(self, frame: Frame) -> Payload:
        """Place and shade everything in the frame's PVS."""

    def pictures(self, payload: Payload) -> dict[str, Bytes]:
        """What the report shows beside the atlas, on request only: name, as in Payload, to uint8 (h, w, 3)."""
        return {}

    def details(self, payload: Payload) -> dict[str, arrays.Array]:
        """Arrays of any shape and numbers that `--dump` writes beside the pictures, on request only, by name, an
        identifier of up to 64 letters."""
        return {}

    @abstractmethod
    def client(self, scene: ClientScene) -> Client:
        """A fresh client. It keeps nothing of the packer; `scene` is all that it has before the first payload."""
