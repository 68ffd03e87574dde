"""The picture every method is judged by: the novel view drawn forward, and what follows from it alone."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes, Floats, Ints, fixed
from shading_atlas_bench.harness.measure.metrics import Metrics
from shading_atlas_bench.harness.workload.reference import ForwardRenderer
from shading_atlas_bench.kernels.raster.resolve import resolve
from shading_atlas_bench.packers.interface import Frame, ServerScene, View

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.raster.rasteriser import Visibility
    from shading_atlas_bench.kernels.samples import Samples

STAGE = "reference/shade"


@dataclass(frozen=True)
class Seen:
    """What a view shows.

    view: its camera. visibility: int32 (h, w), the nearest triangle that is not wholly transparent, -1 where empty.
    pixel, triangle, bary: of every covered pixel, int32 (n), int32 (n), float32 (n, 2).
    """

    view: View
    visibility: Ints
    pixel: Ints
    triangle: Ints
    bary: Floats

    @classmethod
    def of(cls, view: View, visibility: Visibility, samples: Samples) -> Seen:
        """samples: resolved from the visibility."""
        n = samples.count
        bary = np.stack([samples.bary1.get()[:n], samples.bary2.get()[:n]], axis=1)
        seen = cls(view, visibility.triangle.get(), samples.texel.get()[:n], samples.triangle.get()[:n], bary)
        return fixed(seen)


@dataclass(frozen=True)
class NovelView(Seen):
    """The reference of one frame.

    rgb: uint8 (h, w, 4). missing: share of all pixels that show a triangle which is not in the PVS.
    view_dependence: mean FLIP between it as shaded for the server's eye and for the client's; None without FLIP.
    milliseconds: device time of drawing it. shading_ns: of which the shading kernel takes so many nanoseconds for each
    covered pixel, None without any. metrics_ms: host time of what metrics need of it, once per frame.
    """

    rgb: Bytes
    missing: float
    view_dependence: float | None
    milliseconds: float
    shading_ns: float | None
    metrics_ms: float


def draw_novel_view(
    scene: ServerScene, forward: ForwardRenderer, metrics: Metrics, frame: Frame, view: View, whose: str
) -> NovelView:
    """Draw the novel view, shaded for the eye of the "client" or "server", and make `metrics` compare with it from now
    on."""
    device = scene.device
    eye, other = (view.eye, frame.server.eye) if whose == "client" else (frame.server.eye, view.eye)
    with device.record() as record:
        image, visibility = forward.draw(view, eye)
    samples = resolve(device, scene.triangles, visibility, view.view, view.projection)
    seen, n = Seen.of(view, visibility, samples), samples.count
    shading = record
    if n and STAGE not in record.milliseconds:  # layers were shaded, whose number differs: the nearest ones alone
        with device.record() as shading:
            scene.shader.shade(samples, eye, device.empty(image.rgb.shape, np.uint8), STAGE)
    known = np.zeros(scene.host.triangle_count, bool)
    known[frame.pvs] = True
    missing = np.count_nonzero(~known[seen.triangle]) / (view.width * view.height)
    start = time.perf_counter()
    metrics.reference(image.rgb)
    device.finish()
    metrics_ms = (time.perf_counter() - start) * 1000
    moved = not np.array_equal(eye, other)
    view_dependence = metrics.compare(forward.draw(view, other)[0].rgb if moved else image.rgb, ("flip",))["flip"]
    return NovelView(
        view=seen.view,
        visibility=seen.visibility,
        pixel=seen.pixel,
        triangle=seen.triangle,
        bary=seen.bary,
        rgb=image.rgb.get(),
        missing=missing,
        view_dependence=view_dependence,
        milliseconds=sum(record.milliseconds.values()),
        shading_ns=shading.milliseconds[STAGE] * 1e6 / n if n else None,
        metrics_ms=metrics_ms,
    )
