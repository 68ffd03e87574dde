"""Quality and cost columns: what each means, its unit and better direction, and the picture metrics of a frame."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from harness.settings import METRIC_NAMES
from kernels.metrics.ciede2000 import Ciede2000
from kernels.metrics.flip import Flip, magma
from kernels.metrics.iwssim import SMALLEST_SIDE as IWSSIM_SIDE
from kernels.metrics.iwssim import IwSsim
from kernels.metrics.mse import SquaredError, psnr
from kernels.metrics.ssim import SMALLEST_SIDE as SSIM_SIDE
from kernels.metrics.ssim import Ssim

if TYPE_CHECKING:
    from pyopencl.array import Array

    from kernels.device import Device
    from packers.skips import Skips


@dataclass(frozen=True)
class Metric:
    """One quality or cost column: its name in frames.csv, unit, better direction, meaning; "" for a pure number."""

    name: str
    unit: str
    better: Literal["lower", "higher"]
    meaning: str


METRICS: tuple[Metric, ...] = (
    Metric("flip", "", "lower", "mean FLIP error of the novel view at 67.02 pixels per degree, 0..1"),
    Metric("view_dependence", "", "lower", "mean FLIP that shading for the server's eye costs every method"),
    Metric("dssim", "", "lower", "(1 - SSIM) / 2 on BT.601 luma, 11x11 Gaussian window, 0..1"),
    Metric("iwssim", "", "higher", "information content weighted SSIM on BT.601 luma, 5 scales, up to 1"),
    Metric("psnr", "dB", "higher", "peak signal-to-noise ratio over R, G, B; empty where the pictures are identical"),
    Metric("delta_e", "CIEDE2000", "lower", "mean colour difference; about 1 is just noticeable"),
    Metric("stretch_l2", "pixels/texel", "lower", "root mean square stretch over the visible pixels; 1 is one to one"),
    Metric("stretch_linf", "pixels/texel", "lower", "largest stretch of a visible pixel; above 1 is undersampled"),
    Metric("coherence", "share", "higher", "texels with the same owner as in the last frame"),
    Metric("coherence_bytes", "share", "higher", "payload bytes unchanged since the last frame"),
    Metric("fill", "share", "higher", "owned texels of the atlas"),
    Metric("samples", "samples", "lower", "shading samples computed for the frame"),
    Metric("missing_px", "share", "lower", "novel-view pixels whose triangle is not in the potentially visible set"),
    Metric("holes_px", "share", "lower", "novel-view pixels the client leaves empty and the reference does not"),
    Metric("compression_ratio", "share", "lower", "video bytes / (3 bytes * atlas texels)"),
    Metric("bytes_video", "bytes", "lower", "video packets of the frame"),
    Metric("bytes_alpha", "bytes", "lower", "packets of the opacity plane, where there is one"),
    Metric("bytes_metadata", "bytes", "lower", "metadata of the frame after LZ4"),
    Metric("bytes_geometry", "bytes", "lower", "potentially visible triangles of the frame after LZ4"),
    Metric("bytes_total", "bytes", "lower", "everything sent for the frame"),
    Metric("structs_ms", "ms", "lower", "device time of the structures: what goes where"),
    Metric("gather_ms", "ms", "lower", "device time of gathering: computing the samples"),
    Metric("server_ms", "ms", "lower", "device time of packing"),
    Metric("serialise_ms", "ms", "lower", "host time of packing"),
    Metric("fill_ms", "ms", "lower", "host time of reading planes back and filling unowned texels"),
    Metric("encode_ms", "ms", "lower", "processor time of encoding everything sent"),
    Metric("network_ms", "ms", "lower", "everything sent, at the network's bandwidth"),
    Metric("decode_ms", "ms", "lower", "processor time of decoding it"),
    Metric("receive_ms", "ms", "lower", "host time of the client's taking the payload"),
    Metric("draw_host_ms", "ms", "lower", "host time of the client's drawing"),
    Metric("client_ms", "ms", "lower", "device time of the client: taking the payload and drawing the novel view"),
    Metric("frame_ms", "ms", "lower", "the frame from packing to picture, clocked from outside"),
)
PICTURE_METRICS = ("flip", "dssim", "iwssim", "psnr", "delta_e")


class Metrics:
    """The picture metrics of frames against their reference; what depends on the reference is computed once.

    reasons: for a metric that the last picture's size does not allow, name to why. wanted: names of PICTURE_METRICS,
    the others have no values. computed: which of them are, at least the wanted ones. skipped: what is left out.
    """

    def __init__(
        self,
        device: Device,
        wanted: Collection[str] = PICTURE_METRICS,
        computed: Collection[str] = (),
        skipped: frozenset[str] = frozenset(),
    ) -> None:
        self.skipped = skipped
        self.device, self.wanted, self.computed = device, frozenset(wanted), {*wanted, *computed}
        self.reasons: dict[str, str] = {}
        self._size: tuple[int, int] | None = None

    @classmethod
    def asked_for(cls, device: Device, names: Collection[str], skips: Skips) -> Metrics:
        """Those of METRIC_NAMES that were asked for; the others are computed only where skipping them is forced off."""
        forced = not skips.leaves_out("metrics", not set(METRIC_NAMES) <= set(names))
        wanted = [name for name in PICTURE_METRICS if name in names]
        return cls(device, wanted, PICTURE_METRICS if forced else (), skips.take())

    def _allocate(self, width: int, height: int) -> None:
        device = self.device
        self._size = (width, height)
        side = min(width, height)
        self._flip, self._delta_e, self._error, self._ssim, self._iwssim = (
            metric(device, width, height) if name in self.computed and side >= least else None
            for name, metric, least in (
                ("flip", Flip, 1),
                ("delta_e", Ciede2000, 1),
                ("psnr", SquaredError, 1),
                ("dssim", Ssim, SSIM_SIDE),
                ("iwssim", IwSsim, IWSSIM_SIDE),
            )
        )
        smallest = {"dssim": SSIM_SIDE, "iwssim": IWSSIM_SIDE}
        self.reasons = {
            name: f"{name} needs {least} pixels a side, and the picture has {width}x{height}"
            for name, least in smallest.items()
            if side < least and name in self.wanted
        }

    def _windowed(self) -> list[Flip | Ciede2000 | Ssim | IwSsim]:
        parts = [self._flip, self._delta_e, self._ssim, self._iwssim]
        return [part for part in parts if part is not None]

    def reference(self, image: Array) -> None:
        """Take the reference, a device array uint8 (h, w, 4), sRGB; it must not change until the next reference."""
        height, width = image.shape[:2]
        if self._size != (width, height):
            self._allocate(width, height)
        self._reference = image
        for part in self._windowed():
            part.reference(image)

    def compare(self, test: Array) -> dict[str, float | None]:
        """The picture metrics of `test`, uint8 (h, w, 4), by name; None where there is no finite value or no room.

        Raises ValueError if there is no reference or it has another size.
        """
        height, width = test.shape[:2]
        if self._size != (width, height):
            raise ValueError(f"A picture of {width}x{height} cannot be compared with the reference of {self._size}.")
        for part in self._windowed():
            part.compare(test)
        if self._error:
            self._error.compare(test, self._reference)
        values = {
            "flip": self._flip and self._flip.mean(),
            "dssim": self._ssim and (1 - self._ssim.mean()) / 2,
            "iwssim": self._iwssim and self._iwssim.score(),
            "psnr": self._error and psnr(self._error.mean()),
            "delta_e": self._delta_e and self._delta_e.mean(),
        }
        return {name: value if name in self.wanted else None for name, value in values.items()}

    def flip(self, test: Array) -> float | None:
        """Mean FLIP of `test`, uint8 (h, w, 4), alone; None if FLIP is not wanted."""
        if "flip" not in self.wanted:
            return None
        self._flip.compare(test)
        return self._flip.mean()

    def flip_map(self) -> np.ndarray | None:
        """The FLIP errors of the last compared picture in FLIP's colours, uint8 (h, w, 3); None if not wanted."""
        return magma(self._flip.error_map()) if "flip" in self.wanted else None
