"""The shading kernel's launcher; its twin is in shade.py."""

from __future__ import annotations

from collections.abc import Collection
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING

from shading_atlas_bench.arithmetic.arrays import Doubles, Floats
from shading_atlas_bench.kernels.samples import WIDTH
from shading_atlas_bench.kernels.shade.faces import face_rows
from shading_atlas_bench.kernels.shade.shadow import ShadowMaps
from shading_atlas_bench.kernels.shade.sky import Sky
from shading_atlas_bench.kernels.shade.tables import Lighting, Surface, make_tables

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.samples import Samples
    from shading_atlas_bench.kernels.texture.buffers import TextureBuffers
    from shading_atlas_bench.kernels.triangles import Triangles

CHUNKS = 512  # on a CPU: enough for balance where some samples cost several times others
STEP = 8  # samples shaded at once, by the narrowest kernel


class Shader:
    """The one shading function for a scene: shades sample lists; `sky` paints what is behind everything.

    `defines` and `arguments` are for kernels of packers that include shade/shade.cl: what to build them with, and what
    to pass for SURFACE_PARAMETERS.
    """

    def __init__(
        self,
        device: Device,
        triangles: Triangles,
        surface: Surface,
        lighting: Lighting,
        textures: TextureBuffers,
        shadows: ShadowMaps | None = None,
        keep: Collection[str] = (),
    ) -> None:
        """Upload a scene's surface and lighting. `shadows` belong to the same lights; None for none.

        keep: defines (see tables.needed) of what is compiled in though nothing uses it, which changes no pixel.
        """
        shadows = shadows or ShadowMaps.none(device, len(lighting.lights))
        self.device = device
        self.textures = textures
        self.shadows = shadows
        self.tables = make_tables(
            triangles.host_positions, triangles.host_indices, surface, lighting, textures.wraps, shadows.rows
        )
        self.defines = self.tables.defines | dict.fromkeys(keep, 1)
        vertices = device.upload(self.tables.vertices)
        self.faces = face_rows(device, vertices, triangles.indices, surface.material_ids)
        self.sky = Sky(device, device.upload(self.tables.environment))
        self.arguments: tuple[Array, ...] = (
            vertices,
            device.upload(self.tables.extras),
            triangles.indices,
            self.faces,
            device.upload(self.tables.materials),
            textures.textures,
            textures.levels,
            textures.texels,
            device.upload(self.tables.lights),
            shadows.maps,
            self.sky.environment,
            device.upload(self.tables.environment_map),
        )

    def reflecting(self, environment_map: Floats) -> Shader:
        """The same, whose glossy surfaces reflect an environment map, float32, see environment.py."""
        other = copy(self)
        other.defines = self.defines | {"ENVIRONMENT_MAP": 1}
        told = self.tables.defines | {"ENVIRONMENT_MAP": 1}
        other.tables = replace(self.tables, defines=told, environment_map=environment_map)
        other.arguments = (*self.arguments[:-1], self.device.upload(environment_map))
        return other

    def finest(self) -> Shader:
        """The same function, which looks up textures at their finest level, whatever the samples' footprints."""
        other, table = copy(self), self.textures.textures
        other.textures = self.textures.finest(self.device)
        other.arguments = tuple(other.textures.textures if one is table else one for one in self.arguments)
        return other

    def shade(self, samples: Samples, eye: Doubles, target: Array, stage: str = "shade") -> None:
        """Write the colour of every sample, sRGB with alpha 255, at its texel of `target`, uint8 (H, W, 4).

        eye: float64 (3), from where highlights are seen and double-sided surfaces are turned towards. The sample arrays
        must have room for whole steps of WIDTH (`Samples.allocate` sees to it); what lies beyond `count` is ignored.
        """
        run = max(1, -(-samples.count // (CHUNKS * WIDTH))) * WIDTH if self.device.is_cpu else STEP
        self.device.launch(
            stage,
            self.device.build("shade/shade.cl", **self.defines).shade_samples,
            -(-samples.count // run),
            samples.count,
            run,
            samples.triangle,
            samples.bary1,
            samples.bary2,
            samples.footprint,
            samples.texel,
            target,
            *(float(x) for x in eye),
            *self.arguments,
            local=1 if self.device.is_cpu else None,
        )
