"""Clients that draw the received triangles with lookups in one atlas; affine ones need no more than corners."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import DTypeLike

from shading_atlas_bench.kernels.atlas.locate import locate
from shading_atlas_bench.kernels.atlas.lookup import look_up
from shading_atlas_bench.kernels.atlas.opacity import fragment_opacity
from shading_atlas_bench.kernels.fragments.blend import blend_layers
from shading_atlas_bench.kernels.fragments.layered import LayeredRasteriser, numbered
from shading_atlas_bench.kernels.raster.rasteriser import Rasteriser
from shading_atlas_bench.kernels.raster.resolve import resolve
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.kernels.triangles import Triangles
from shading_atlas_bench.packers.geometry import GeometryDecoder, GeometryEncoder
from shading_atlas_bench.packers.interface import ALPHA, Client, ClientScene, Decoded, Image, ServerScene, View

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Bools, Bytes, Doubles, Floats, Ints
    from shading_atlas_bench.kernels.fragments.build import Fragments
    from shading_atlas_bench.kernels.texture.mask import AlphaMask


class LookupClient(Client):
    """Draws the received triangles with lookups in the received atlas.

    Blended ones become lists of fragments, in the pixels where they are in front. Each fragment's colour is looked up
    at its own surface point, its opacity comes from its material or from the alpha plane, and the lists are blended
    over the opaque picture. A set without blended triangles runs none of this.

    A subclass names its per-triangle `attributes` (name to dtype), takes its metadata in `read` and says in `place`
    where surface points lie in the atlas.
    """

    attributes: ClassVar[Mapping[str, DTypeLike]] = {}

    def __init__(self, scene: ClientScene) -> None:
        self.device = scene.device
        self.sky = scene.sky
        self.mask = scene.mask
        self.geometry = GeometryDecoder(self.attributes)
        self._row_of: Ints | None = None

    def read(self, blobs: Mapping[str, bytes]) -> None:
        """Take the frame's metadata; `self.geometry` holds the frame's triangles already."""

    @abstractmethod
    def place(self, samples: Samples) -> Array:
        """float32 (2, room) on the device: column and row in the atlas of each sample's surface point, where texel
        (0, 0) has its centre at (0, 0); NaN for one without a place. The samples' triangles count through
        `geometry.pvs`."""

    def receive(self, payload: Decoded) -> None:
        """Take a frame's triangles, metadata and atlas."""
        if self.geometry.decode(payload.geometry) or not hasattr(self, "rasteriser"):
            self._row_of = None
            count = len(self.geometry.pvs)
            positions = self.geometry.current("positions").reshape(-1, 3)
            indices = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
            self.triangles = Triangles.upload(self.device, positions, indices, self.geometry.current("flags"))
            mask = self.mask.of_triangles(self.device, self.geometry.pvs) if self.mask else None
            self.rasteriser = self._rasteriser(mask)
            self.ids = self.device.upload(self.geometry.pvs)
        self.replace_planes(payload.planes)
        self.read(payload.blobs)

    def replace_planes(self, planes: Mapping[str, Bytes]) -> None:
        """Take a frame's atlas, and its plane of opacities if it has one."""
        uploaded = {name: self._upload(plane) for name, plane in planes.items()}
        self.alpha = uploaded.pop(ALPHA, None)
        (self.plane,) = uploaded.values()

    def locate(self, triangles: Ints, bary: Floats) -> Doubles:
        """Atlas position of surface points (see Client.locate): what drawing uses."""
        row, known = self._rows(triangles)
        if not known.any():
            return np.full((len(triangles), 2), np.nan)
        found = self.place(Samples.of_points(self.device, row, bary)).get()[:, : len(row)]
        place = np.empty((len(row), 2))
        np.add(found.T, 0.5, out=place, dtype=np.float64)
        if not known.all():
            place[~known] = np.nan
        return place

    def _rows(self, triangles: Ints) -> tuple[Ints, Bools]:
        """Places of triangles (n) in `geometry.pvs`, int (n), 0 for one that is not there, and which are: bool (n)."""
        if self._row_of is None:
            pvs = self.geometry.pvs
            self._row_of = np.full(int(pvs.max(initial=-1)) + 2, -1, np.int32)  # the last stands for all beyond
            self._row_of[pvs] = np.arange(len(pvs))
        row = self._row_of[np.minimum(triangles, len(self._row_of) - 1)]
        return np.maximum(row, 0), row >= 0

    def _upload(self, plane: Bytes) -> Array:
        """The plane with an opacity of 255, uint8 (H, W, 4), on the device."""
        uploaded = self.device.recycled((*plane.shape[:2], 4), np.uint8)
        with self.device.written(uploaded) as rgba:
            for channel in range(3):  # one by one NumPy copies twice as fast as pixel by pixel
                rgba[..., channel] = plane[..., channel]
            rgba[..., 3] = 255
        return uploaded

    def _rasteriser(self, mask: AlphaMask | None) -> Rasteriser | LayeredRasteriser:
        """What draws the current set: one for opaque triangles only, or one for both."""
        if not (self.triangles.host_flags & Triangles.BLENDED).any():
            return Rasteriser(self.device, self.triangles, mask)
        self.opacities = self.device.upload(self.geometry.current_opacities().astype(np.int32))
        return LayeredRasteriser(self.device, self.triangles, mask)

    def draw(self, view: View) -> Image:
        """The view: sky, and over it every pixel of a triangle that has a place."""
        device, camera = self.device, (view.view, view.projection)
        size = (view.width, view.height)
        fragments = None
        if isinstance(self.rasteriser, LayeredRasteriser):
            visibility, fragments = self.rasteriser.draw(*camera, *size, stage="client")
        else:
            visibility = self.rasteriser.draw(*camera, *size, stage="client/raster")
        samples = resolve(device, self.triangles, visibility, *camera, stage="client/resolve")
        rgb = device.empty((view.height, view.width, 4), np.uint8)
        self.sky(*camera, rgb, stage="client/sky")
        drawn = device.empty((view.height, view.width), np.int32)
        device.fill(drawn, -1, "client/lookup")
        look_up(device, samples, self.place(samples), self.ids, self.plane, rgb, drawn, "client/lookup")
        if fragments and fragments.count:
            self._blend(fragments, rgb, drawn)
        return Image(rgb, drawn)

    def _blend(self, fragments: Fragments, rgb: Array, drawn: Array) -> None:
        """Blend the fragments over the opaque picture; `drawn` becomes the nearest one that is visible."""
        device, count = self.device, fragments.count
        samples = numbered(device, fragments, "client/layers").samples
        colours, owners = device.recycled((1, count, 4), np.uint8), device.recycled((1, count), np.int32)
        device.fill(owners, -1, "client/lookup")
        places = self.place(samples)
        look_up(device, samples, places, self.ids, self.plane, colours, owners, "client/lookup")
        alphas = None
        if self.alpha is not None:
            alphas = device.recycled((1, count, 4), np.uint8)
            look_up(device, samples, places, self.ids, self.alpha, alphas, owners, "client/lookup")
        opacity = fragment_opacity(device, count, samples.triangle, owners, self.opacities, alphas, "client/opacity")
        blend_layers(device, fragments, colours, opacity, owners, rgb, drawn, "client/blend")


class AtlasClient(LookupClient):
    """Draws triangles that map affinely into the atlas, by bilinear lookups.

    A subclass says in `corner_texels` where the corners of the current triangles lie.
    """

    @abstractmethod
    def corner_texels(self) -> Array:
        """float32 (n, 3, 2) on the device: column and row of each triangle's corners, where texel (0, 0) has its centre
        at (0.5, 0.5); for the triangles of `self.geometry.pvs`, in that order. NaN for one without a place. Or float32
        (n, 3, 3): column times w, row times w, and w, where w is divided out after interpolation."""

    def place(self, samples: Samples) -> Array:
        """Where the samples lie between their triangles' corners."""
        return locate(self.device, samples, self.corner_texels(), "client/locate")


def geometry_encoder(scene: ServerScene, attributes: Mapping[str, arrays.Array]) -> GeometryEncoder:
    """The encoder whose messages an AtlasClient with the same attributes, see GeometryEncoder, understands."""
    triangles, host = scene.triangles, scene.host
    return GeometryEncoder(
        positions=triangles.host_positions,
        indices=triangles.host_indices,
        flags=triangles.host_flags,
        uvs=host.uvs,
        materials=host.material_ids,
        attributes=attributes,
        opacities=scene.layers.opacity.constants if scene.layers else None,
        alphas=host.colours[:, 3],
    )
