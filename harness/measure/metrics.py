"""The picture metrics of a frame, together."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from shading_atlas_bench.harness.workload.settings import METRIC_NAMES
from shading_atlas_bench.kernels.metrics.ciede2000 import Ciede2000
from shading_atlas_bench.kernels.metrics.flip import Flip, magma
from shading_atlas_bench.kernels.metrics.iwssim import SMALLEST_SIDE as IWSSIM_SIDE
from shading_atlas_bench.kernels.metrics.iwssim import IwSsim
from shading_atlas_bench.kernels.metrics.mse import SquaredError, psnr
from shading_atlas_bench.kernels.metrics.ssim import SMALLEST_SIDE as SSIM_SIDE
from shading_atlas_bench.kernels.metrics.ssim import Ssim
from shading_atlas_bench.reports.store.columns import PICTURE_METRICS

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Bytes
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.skips import Skips


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
        self._flip: Flip | None = None
        self._delta_e: Ciede2000 | None = None
        self._error: SquaredError | None = None
        self._ssim: Ssim | None = None
        self._iwssim: IwSsim | None = None

    @classmethod
    def asked_for(cls, device: Device, names: Collection[str], skips: Skips) -> Metrics:
        """Those of METRIC_NAMES that were asked for; the others are computed only where skipping them is forced off."""
        forced = not skips.leaves_out("metrics", not set(METRIC_NAMES) <= set(names))
        wanted = [name for name in PICTURE_METRICS if name in names]
        return cls(device, wanted, PICTURE_METRICS if forced else (), skips.take())

    def _allocate(self, width: int, height: int) -> None:
        device, side = self.device, min(width, height)
        smallest = {"dssim": SSIM_SIDE, "iwssim": IWSSIM_SIDE}
        computed = {name for name in self.computed if side >= smallest.get(name, 1)}
        self._size = (width, height)
        self._flip = Flip(device, width, height) if "flip" in computed else None
        self._delta_e = Ciede2000(device, width, height) if "delta_e" in computed else None
        self._error = SquaredError(device, width, height) if "psnr" in computed else None
        self._ssim = Ssim(device, width, height) if "dssim" in computed else None
        self._iwssim = IwSsim(device, width, height) if "iwssim" in computed else None
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
            "flip": self._flip.mean() if self._flip else None,
            "dssim": self._ssim.loss() / 2 if self._ssim else None,
            "iwssim": self._iwssim.score() if self._iwssim else None,
            "psnr": psnr(self._error.mean()) if self._error else None,
            "delta_e": self._delta_e.mean() if self._delta_e else None,
        }
        return {name: value if name in self.wanted else None for name, value in values.items()}

    def flip(self, test: Array) -> float | None:
        """Mean FLIP of `test`, uint8 (h, w, 4), alone; None if FLIP is not wanted."""
        if self._flip is None or "flip" not in self.wanted:
            return None
        self._flip.compare(test)
        return self._flip.mean()

    def flip_map(self) -> Bytes | None:
        """The FLIP errors of the last compared picture in FLIP's colours, uint8 (h, w, 3); None if not wanted."""
        if self._flip is None or "flip" not in self.wanted:
            return None
        return magma(self._flip.error_map())
