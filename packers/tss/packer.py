"""Tessellated Shading Streaming: L-packing for triangles near to equilateral ones, Oversampling for slanted ones.

See README.md in this folder for what is as published and what is ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from shading_atlas_bench.packers.atlas_client import geometry_encoder
from shading_atlas_bench.packers.interface import (
    FULL,
    ClientScene,
    Frame,
    Packer,
    Paper,
    Parameter,
    Payload,
    ServerScene,
    Value,
)
from shading_atlas_bench.packers.tss.client import TessellatedClient
from shading_atlas_bench.packers.tss.kernels.emit import Placed, build_kernels, emit_samples
from shading_atlas_bench.packers.tss.kernels.footprint import camera_floats
from shading_atlas_bench.packers.tss.kernels.forms import OVERSAMPLED
from shading_atlas_bench.packers.tss.kernels.perspective import invert_depths
from shading_atlas_bench.packers.tss.mapping import AtlasMapping
from shading_atlas_bench.packers.tss.message import encode
from shading_atlas_bench.packers.tss.picture import draw_strategies
from shading_atlas_bench.packers.tss.placement import Placement, find_lost, read_placement
from shading_atlas_bench.packers.tss.statistics import describe

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Bytes
    from shading_atlas_bench.kernels.samples import Samples

STRATEGIES = {"lpacking": float("inf"), "oversampling": 0.0}  # threshold of slantedness that they amount to
ORDERS = ("primitive", "arrival")
PICTURES = ("density", "size")
UNPLACED = "the atlas is full with every primitive at one texel"


class TessellatedShadingStreaming(Packer):
    """Packs triangles as Ls or as pairs of right triangles; see the module."""

    name = "tss"
    paper = Paper("Tessellated Shading Streaming", 2019, "10.1111/cgf.13780")
    strategy: str
    slanted: float
    order: str
    picture: str
    parameters: ClassVar[dict[str, Parameter]] = {
        "strategy": Parameter(
            "combined",
            ("combined", "lpacking", "oversampling"),
            "how triangles are sampled: by their slantedness, or all in the same way",
            "",
            "TSS, sections 3.2 and 3.3, figure 15",
        ),
        "slanted": Parameter(
            8.0,
            (3.0, 5.0, 8.0),
            "longest edge over height on screen above which a triangle goes to Oversampling",
            "1",
            "meaning: TSS, section 3.3; value: ours, by the shares in TSS, table 1",
        ),
        "order": Parameter(
            "primitive",
            ORDERS,
            "which of the triangles of a bin comes first: the one with the lower id, or a random one in each frame, as "
            "with the paper's atomic counters",
            "",
            "arrival: TSS, section 4; primitive: ours",
            published="arrival",
        ),
        "picture": Parameter(
            "density",
            PICTURES,
            "what the server's view, as wide as the cell's, has of the client's: pixels per angle in its centre, or "
            "the number of pixels",
            "",
            "wide view: SnakeBinning, section 5.2; density: ours",
        ),
    }

    skips: ClassVar[dict[str, tuple[str, str, str]]] = {
        "oversampling": ("right triangles of samples", "no primitive is slanted", "primitives are slanted"),
    }

    def __init__(self, **values: Value) -> None:
        super().__init__(**values)
        if self.strategy not in ("combined", *STRATEGIES):
            raise ValueError(f"The strategy {self.strategy!r} is not known: combined, {', '.join(STRATEGIES)}.")
        if self.order not in ORDERS:
            raise ValueError(f"The order {self.order!r} is not known: {', '.join(ORDERS)}.")
        if self.picture not in PICTURES:
            raise ValueError(f"The picture {self.picture!r} is not known: {', '.join(PICTURES)}.")
        self.threshold = STRATEGIES.get(self.strategy, float(self.slanted))

    def prepare(self, scene: ServerScene) -> None:
        """Tabulate bins and Ls."""
        by_arrival, sized = self.order == "arrival", self.picture == "size"
        self.mapping = AtlasMapping(scene.device, self.threshold, by_arrival, sized)
        self.geometry = geometry_encoder(scene, {})
        build_kernels(scene.device)

    def settled(self) -> bool:
        """Only the scale is kept from frame to frame, where it was found to do; the order of arrival is another in
        each."""
        return self.order == "primitive"

    def pack(self, frame: Frame) -> TessellatedPayload:
        """Places for the triangles of the frame's set, and their shading."""
        device, server, mapping = frame.scene.device, frame.server, self.mapping
        camera = camera_floats(server.view, server.projection, server.width, server.height)
        mapped = mapping.map(frame, device.upload(camera))
        primitives, places = mapped.primitives, mapping.place(mapped, frame)
        placement = read_placement(mapped, places, camera)
        lost = find_lost(placement, primitives.parents.get()[: primitives.count])
        if len(lost):
            places = device.upload(placement.places)
        depths, pieces, rows = primitives.depths, primitives.pieces, len(frame.pvs)
        inverse = invert_depths(device, depths, pieces, rows, mapped.scale, "structs/perspective")
        placed = Placed(primitives, mapped.forms, places, inverse)
        slanted = bool((placement.forms[:, 0] == OVERSAMPLED).any())
        oversampled = not frame.scene.skips.leaves_out("oversampling", not slanted)
        triangles, width = frame.scene.triangles, frame.atlas_width
        samples = emit_samples(device, placed, triangles, mapping.cells, width, oversampled=oversampled)
        blobs = encode(placement, mapping.bins)
        statistics = describe(placement)
        statistics[FULL] = int(mapping.is_atlas_full(frame))
        statistics |= {f"{name}_bytes": len(blobs[name]) for name in ("lpacking", "oversampling")}
        statistics["metadata_bytes"] = sum(len(blob) for blob in blobs.values())
        return TessellatedPayload(
            planes=frame.shade(samples),
            blobs=blobs,
            geometry=self.geometry.encode(frame.pvs),
            sample_count=samples.count,
            samples=samples,
            unplaced={int(triangle): UNPLACED for triangle in frame.pvs[lost]},
            statistics=statistics,
            placement=placement,
        )

    def details(self, payload: Payload) -> dict[str, arrays.Array]:
        """The primitives' forms and places, see Placement."""
        placement = _own(payload).placement
        return {"forms": placement.forms, "places": placement.places}

    def pictures(self, payload: Payload) -> dict[str, Bytes]:
        """The atlas by strategy."""
        packed = _own(payload)
        height, width = packed.planes["atlas"].shape[:2]
        texel = packed.samples.texel.get()[: packed.sample_count]
        drawn = draw_strategies(packed.placement.forms, packed.placement.places, texel, width, height)
        return {"strategies": drawn}

    def client(self, scene: ClientScene) -> TessellatedClient:
        """A client without any triangle yet."""
        return TessellatedClient(scene)


@dataclass(kw_only=True)
class TessellatedPayload(Payload):
    """A payload, and what was decided about it, which pictures and `--dump` show."""

    samples: Samples
    placement: Placement


def _own(payload: Payload) -> TessellatedPayload:
    """A payload that was packed here."""
    if not isinstance(payload, TessellatedPayload):
        raise TypeError("Tessellated Shading Streaming shows only what it packed itself.")
    return payload
