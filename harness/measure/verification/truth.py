"""A scene in float64: what the checks hold methods against."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from functools import cached_property
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import draws
from shading_atlas_bench.arithmetic.arrays import Bools, Bytes, Doubles, Floats, Ints
from shading_atlas_bench.harness.measure.validity import Violation, Whole, first_few
from shading_atlas_bench.harness.measure.verification.shared_arrays import SharedArrays
from shading_atlas_bench.kernels.fragments.opacity import opacity_twin
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.kernels.shade.shade import shade_twin
from shading_atlas_bench.kernels.triangles import Triangles

if TYPE_CHECKING:
    from shading_atlas_bench.harness.measure.returned import CheckedPacker
    from shading_atlas_bench.packers.interface import ServerScene

LEVELS = 2  # of 255, by which a colour may differ from what the shading function gives its surface point
CHOSEN = 64  # texels, pixels or fragments examined per frame
THINNEST = 1e-5  # height over longest edge, below which float32 does not tell where a face looks
NUDGES = 1e-5 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])  # barycentrics that rounding may be off
NONE: Ints = np.empty(0, np.int32)


@dataclass(frozen=True)
class Points:
    """Surface points: triangle int (n), scene ids. bary float64 (n, 2). footprint float64 (n), as samples have it."""

    triangle: Whole
    bary: Doubles
    footprint: Doubles

    def at(self, chosen: Whole) -> Points:
        """Those of these numbers, int (k)."""
        return Points(self.triangle[chosen], self.bary[chosen], self.footprint[chosen])


class Truth:
    """What a server scene is, on the host; fetched once, when asked for. seed: of the run."""

    def __init__(self, scene: ServerScene, seed: int = 0) -> None:
        self.scene, self.seed = scene, seed
        self.drawing = Lock()  # the rasteriser's: methods are checked side by side

    def of(self, packer: CheckedPacker) -> Truth:
        """Of the scene as a method shades it."""
        return self if packer.scene_shaded(self.scene) is self.scene else self._finest

    @cached_property
    def _finest(self) -> Truth:
        finest = Truth(self.scene.finest, self.seed)
        finest.drawing = self.drawing
        return finest

    @cached_property
    def shared(self) -> SharedArrays:
        """The scene's arrays as they are when this is first asked for."""
        return SharedArrays(self.scene)

    def generator(self, frame: int, name: str) -> draws.Generator:
        """Random numbers for one frame, by name."""
        return draws.generator([self.seed, frame, zlib.crc32(name.encode())])

    @property
    def triangles(self) -> Triangles:
        """The scene's triangles, on the device and on the host."""
        return self.scene.triangles

    @cached_property
    def blended(self) -> Bools:
        """bool (T): whether triangles are blended."""
        return (self.triangles.host_flags & Triangles.BLENDED) > 0

    @cached_property
    def _faces(self) -> Ints:
        faces: Ints = self.scene.shader.faces.get()
        return faces

    @cached_property
    def _shadow_maps(self) -> Floats:
        maps: Floats = self.scene.shader.shadows.maps.get()
        return maps

    def shade(self, points: Points, eye: Doubles) -> Bytes:
        """uint8 (n, 3), sRGB, of surface points seen from eye, float64 (3)."""
        if not len(points.triangle):
            return np.empty((0, 3), np.uint8)
        shader = self.scene.shader
        with np.errstate(all="ignore"):  # a corner in a light or without a normal
            return shade_twin(
                shader.tables,
                self._faces,
                shader.textures,
                self._shadow_maps,
                points.triangle,
                points.bary,
                points.footprint,
                eye,
            )[:, :3]

    def opacity(self, points: Points) -> Doubles:
        """float64 (n, 2): from and to where, of 255, surface points may cover what is behind them.

        Textures are looked up at one mip level: the range is that of the two levels that a footprint lies between.
        """
        layers = self.scene.layers
        if layers is None or not len(points.triangle):
            return np.full((len(points.triangle), 2), 255.0)
        with np.errstate(all="ignore"):
            tries = [
                opacity_twin(layers.opacity, points.triangle, points.bary, points.footprint * by)
                for by in (0.99, 1.0, 1.01)
            ]
        return np.stack([np.min(tries, axis=0), np.max(tries, axis=0)], axis=1)

    def is_flat(self, triangle: Whole) -> Bools:
        """bool (n): whether triangles, int (n), are lower than THINNEST of their longest edge."""
        corners = self.triangles.host_positions[self.triangles.host_indices[triangle]].astype(np.float64)
        sides = corners - np.roll(corners, 1, axis=1)
        longest = (sides * sides).sum(axis=2).max(axis=1, initial=0)
        flat: Bools = ~(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) > THINNEST * longest)
        return flat

    def off(self, colours: Bytes, points: Points, eye: Doubles) -> Whole:
        """int (n): levels by which colours (n, 3) differ from those of surface points, as for `shade`.

        Where rounding decides (at a shadow's edge, between texels, on triangles that reach far beyond the scene), the
        nearest colour close by counts, or what the shading function itself gives the point here; any does on triangles
        too thin to have a side in float32.
        """
        off: Whole = np.where(self.is_flat(points.triangle), 0, _apart(colours, self.shade(points, eye)))
        far = np.flatnonzero(off > LEVELS)
        for nudge in NUDGES if far.size else ():
            near = points.at(far)
            moved = self.shade(replace(near, bary=near.bary + nudge), eye)
            off[far] = np.minimum(off[far], _apart(colours[far], moved))
        far = np.flatnonzero(off > LEVELS)
        if far.size:
            off[far] = _apart(colours[far], self._rounded(points.at(far), eye))
        return off

    def _rounded(self, points: Points, eye: Doubles) -> Bytes:
        """As `shade`, in float32: the shading kernel, launched from here."""
        device, count = self.scene.device, len(points.triangle)
        bary1, bary2 = points.bary.T
        with self.drawing:
            samples = Samples.upload(device, points.triangle, bary1, bary2, points.footprint, np.arange(count))
            colours = device.zeros((1, count, 4), np.uint8)
            self.scene.shader.shade(samples, eye, colours, stage="check")
            shaded: Bytes = colours.get()[0, :, :3]
            return shaded


def _apart(one: Bytes, other: Bytes) -> Whole:
    levels: Whole = np.abs(one.astype(np.int16) - other).max(axis=1, initial=0)
    return levels


def violation(rule: str, count: int, sentence: str, triangles: Whole = NONE, texels: Whole = NONE) -> Violation:
    """A violation with its first offenders; triangles, texels: (n)."""
    return Violation(rule, count, sentence, first_few(triangles), first_few(texels))
