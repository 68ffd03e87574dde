"""Shadow maps: one per light that casts shadows, rendered once per scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles, Floats
from shading_atlas_bench.arithmetic.functions import tan
from shading_atlas_bench.arithmetic.matrices import matvec, product, transform
from shading_atlas_bench.kernels.raster.rasteriser import Rasteriser
from shading_atlas_bench.kernels.shade.tables import LightLike
from shading_atlas_bench.kernels.triangles import Triangles

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.texture.mask import AlphaMask

ROW_FLOATS = 28  # of a light's record, from its 20th float on; layout in shadow_lookup.cl
DIRECTIONAL_SIZE, LARGE_SIZE, SPOT_SIZE = 2048, 4096, 1024  # texels
COARSEST_TEXEL = 0.03  # metres; a directional light's map covers what its texels reach at this size
WIDEST_SPOT = 80.0  # degrees, half angle; beyond it the map's texels grow without bound
SPOT_NEAR = 0.05  # metres; a lamp's own shell, which is nearer, casts no shadow


class ShadowLight(LightLike, Protocol):
    """A light that says whether it casts shadows."""

    shadows: bool


@dataclass(frozen=True)
class ShadowCamera:
    """A light's camera: view and projection float64 (4, 4), and the map's side in texels.

    texel: the side of a map texel in scene units, base and share per unit of w. slope: depth per scene unit, base and
    share per square of the depth.
    """

    view: Doubles
    projection: Doubles
    size: int
    texel: tuple[float, float]
    slope: tuple[float, float]

    @property
    def texels(self) -> int:
        """Of the whole map."""
        return self.size * self.size

    def row(self, start: int) -> Floats:
        """float32 (28): the shadow's part of the light's record, for a map that begins at float `start`."""
        x, y, depth, w = product(self.projection, self.view)
        half = self.size / 2
        row = np.zeros(ROW_FLOATS, np.float32)
        row[:16] = np.concatenate([half * (w + x), half * (w - y), depth, w])
        row[16:17].view(np.int32)[0] = start
        row[17:22] = self.size, *self.texel, *self.slope
        return row


@dataclass(frozen=True)
class ShadowMaps:
    """maps: float32 device array, all maps one after the other; rows: float32 (L, 28), each light's transform."""

    maps: Array
    rows: Floats

    @classmethod
    def none(cls, device: Device, lights: int) -> ShadowMaps:
        """No shadows for any of `lights` lights."""
        return cls(device.zeros(1, np.float32), np.zeros((lights, ROW_FLOATS), np.float32))

    @classmethod
    def render(
        cls,
        device: Device,
        casters: Triangles,
        mask: AlphaMask | None,
        lights: Sequence[ShadowLight],
        focus: Doubles,
        metres_per_unit: float,
    ) -> ShadowMaps:
        """Draw the maps of all directional and spot lights that have `shadows`; none where nothing casts any.

        casters: what casts shadows, both sides of it: a light from outside must not shine through the back of a wall.
        focus: float64 (3), the middle of what a directional light's map covers where the scene is too large for it.
        """
        if casters.count == 0:
            return cls.none(device, len(lights))
        cameras = [
            shadow_camera(light, casters, focus, metres_per_unit) if light.shadows and light.kind != "point" else None
            for light in lights
        ]
        if not any(cameras):
            return cls.none(device, len(lights))
        flags = casters.host_flags | np.uint8(Triangles.DOUBLE_SIDED)
        rasteriser = Rasteriser(device, replace(casters, flags=device.upload(flags), host_flags=flags), mask)
        maps = device.empty(sum(camera.texels for camera in cameras if camera), np.float32)
        rows = np.zeros((len(lights), ROW_FLOATS), np.float32)
        start = 0
        for row, camera in zip(rows, cameras, strict=True):
            if camera:
                drawn = rasteriser.draw(camera.view, camera.projection, camera.size, camera.size, stage="shadows")
                depths = drawn.depth.ravel()  # type: ignore[no-untyped-call]  # pyopencl has no types for it
                maps[start : start + camera.texels] = depths
                row[:] = camera.row(start)
                start += camera.texels
        return cls(maps, rows)


def shadow_camera(light: ShadowLight, casters: Triangles, focus: Doubles, metres_per_unit: float) -> ShadowCamera:
    """The camera that draws a light's map. focus: float64 (3), see `ShadowMaps.render`.

    A spot sees its cone, in perspective. A directional light sees all casters, or, where texels would be coarser than
    COARSEST_TEXEL, a square around `focus` in which they are not; what lies outside is lit.
    """
    forward = np.asarray(light.direction, np.float64)
    forward = forward / np.linalg.norm(forward, axis=-1)
    if light.kind == "spot":
        return _spot_camera(light, _looking(np.asarray(light.position, np.float64), forward), metres_per_unit)
    view = _looking(np.zeros(3), forward)
    used = np.zeros(len(casters.host_positions), bool)
    used[casters.host_indices] = True
    points = transform(view[:3, :3], casters.host_positions[used])
    low, high = points.min(axis=0), points.max(axis=0)
    extent = max((high - low)[:2].max(), 1e-6)
    coarsest = COARSEST_TEXEL / metres_per_unit
    size = DIRECTIONAL_SIZE if extent <= DIRECTIONAL_SIZE * coarsest else LARGE_SIZE
    side = min(extent * 1.01, LARGE_SIZE * coarsest)  # a border, so that the filter stays inside
    middle = (low + high) / 2
    if side < extent:
        reach = np.maximum((high - low)[:2] - side, 0) / 2
        middle[:2] = np.clip(matvec(view[:3, :3], focus)[:2], middle[:2] - reach, middle[:2] + reach)
    margin = 0.01 * (high[2] - low[2]) + 4 * side / size  # so that nothing lies on the near or far end
    depth = high[2] - low[2] + 2 * margin
    view[:3, 3] = -middle[0], -middle[1], -(high[2] + margin)
    projection = np.diag([2 / side, 2 / side, 1 / depth, 1.0])
    projection[2, 3] = 1.0
    return ShadowCamera(view, projection, size, (side / size, 0.0), (1 / depth, 0.0))


def _spot_camera(light: ShadowLight, view: Doubles, metres_per_unit: float) -> ShadowCamera:
    tangent = float(tan(np.radians(min(light.cone, WIDEST_SPOT)))) * 1.01
    near = SPOT_NEAR / metres_per_unit
    projection = np.array([[1 / tangent, 0, 0, 0], [0, 1 / tangent, 0, 0], [0, 0, 0, near], [0, 0, -1, 0]])
    return ShadowCamera(view, projection, SPOT_SIZE, (0.0, 2 * tangent / SPOT_SIZE), (0.0, 1 / near))


def _looking(eye: Doubles, forward: Doubles) -> Doubles:
    """View matrix of a camera at `eye` that looks along the unit vector `forward`."""
    helper = np.eye(3)[np.argmin(np.abs(forward))]
    right = np.cross(forward, helper)
    right /= np.linalg.norm(right, axis=-1)
    view = np.eye(4)
    view[:3, :3] = right, np.cross(right, forward), -forward
    view[:3, 3] = -matvec(view[:3, :3], eye)
    return view
