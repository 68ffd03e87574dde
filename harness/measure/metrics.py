"""The picture metrics of a frame, together."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, TypeAlias

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


Part: TypeAlias = Flip | Ciede2000 | Ssim | IwSsim | SquaredError


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

    def _parts(self) -> dict[str, Part]:
        """The metrics that are computed, by name."""
        parts: dict[str, Part | None] = {
            "flip": self._flip,
            "delta_e": self._delta_e,
            "dssim": self._ssim,
            "iwssim": self._iwssim,
            "psnr": self._error,
        }
        return {name: part for name, part in parts.items() if part is not None}

    def reference(self, image: Array) -> None:
        """Take the reference, a device array uint8 (h, w, 4), sRGB; it must not change until the next reference."""
        height, width = image.shape[:2]
        if self._size != (width, height):
            self._allocate(width, height)
        self._reference = image
        for part in self._parts().values():
            if not isinstance(part, SquaredError):
                part.reference(image)

    def compare(self, test: Array, names: Collection[str] = PICTURE_METRICS) -> dict[str, float | None]:
        """The picture metrics of these names, of `test`, uint8 (h, w, 4); None where there is no finite value or no
        room.

        Raises ValueError if there is no reference or it has another size.
        """
        height, width = test.shape[:2]
        if self._size != (width, height):
            raise ValueError(f"A picture of {width}x{height} cannot be compared with the reference of {self._size}.")
        started = {name: part for name, part in self._parts().items() if name in names}
        for part in started.values():  # all are on their way before the first is waited for
            if isinstance(part, SquaredError):
                part.compare(test, self._reference)
            else:
                part.compare(test)
        values = {name: _value(part) for name, part in started.items()}
        return {name: values.get(name) if name in self.wanted else None for name in names}

    def flip_map(self) -> Bytes | None:
        """The FLIP errors of the last compared picture in FLIP's colours, uint8 (h, w, 3); None if not wanted."""
        if self._flip is None or "flip" not in self.wanted:
            return None
        return magma(self._flip.error_map())


def _value(part: Part) -> float | None:
    """What a metric found of the picture that it compared last, as PICTURE_METRICS has it."""
    if isinstance(part, SquaredError):
        return psnr(part.mean())
    if isinstance(part, Ssim):
        return part.loss() / 2
    return part.score() if isinstance(part, IwSsim) else part.mean()
