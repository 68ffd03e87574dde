"""The memory that a run takes at its peak: told before it starts, and what cannot fit is refused.

The bytes are peaks of resident memory, measured with one size after another (`python -m tests.memory` measures them
again, beside these estimates).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.memory import memory_bound
from shading_atlas_bench.packers.interface import Packer
from shading_atlas_bench.scenes.model import Scene

AT_ONCE = 4  # methods that go through a frame together: that many payloads are in memory at a time
AIM, MOST = 0.6, 0.9  # shares of the machine's memory that a run aims at, and above which it is refused
PROGRAM, METHOD = 450e6, 40e6  # bytes of libraries and of what compiled them; of a method's kernels and small buffers
TRIANGLE, METHOD_TRIANGLE = 450, 50  # bytes of a triangle in the scene, host and device, and in a method's tables
TEXTURE_TEXEL = 4 + 8 * 4 / 3  # bytes: on the host, and with all levels on the device
PIXEL = 230  # bytes of a pixel of the client's picture in references, visible sets and metrics
ATLAS_PIXEL, LISTS_PIXEL = 90, 560  # bytes of a pixel in a method with an atlas, and with lists of fragments
KEPT_TEXEL, PASSING_TEXEL = 14, 12  # bytes of a plane's texel from frame to frame, and while its method is in a frame
CODED_TEXEL = {"none": 0, "jpeg": 17, "h264": 20}  # bytes of a texel in filling, decoder and client of what is coded
ENCODER_TEXEL = (0, 10, 17)  # bytes of a texel in an encoder of x264 after the first frame, the second, and later
DECODER_TEXEL, DECODED_TEXEL = 6, 3  # of a further rate: of its decoder, and of what it gives, while it is shown
CODED_ONCE = 13  # bytes of a texel in filling, encoders and client, if each is closed after its only frame


@dataclass(frozen=True)
class MemoryNeed:
    """Bytes at the peak of a run, by what they are for."""

    program: int
    scene: int
    pictures: int
    planes: int
    encoders: int

    @property
    def total(self) -> int:
        """All bytes."""
        return sum(getattr(self, field.name) for field in fields(self))

    def __str__(self) -> str:
        parts = [f"{field.name} {getattr(self, field.name) / 1e9:.2g}" for field in fields(self)]
        return f"{self.total / 1e9:.2g} GB of memory ({', '.join(parts)})"


def memory_need(settings: Settings, scene: Scene, packers: Sequence[Packer], at_once: int = AT_ONCE) -> MemoryNeed:
    """What a run of these methods takes at its peak, so many of them in a frame together."""
    textures = sum(texture.texels.shape[0] * texture.texels.shape[1] for texture in scene.textures)
    pixels, texels = settings.width * settings.height, settings.atlas_width * settings.atlas_height
    atlases = sum(packer.atlas for packer in packers) * (1 + scene.features.varying_opacity)
    of_pixel = sorted((ATLAS_PIXEL if packer.atlas else LISTS_PIXEL for packer in packers), reverse=True)
    per_triangle = TRIANGLE + METHOD_TRIANGLE * len(packers)
    coded = CODED_TEXEL[settings.codec] if settings.frames > 1 else min(CODED_ONCE, CODED_TEXEL[settings.codec])
    further = max(0, len(settings.crfs) - 1)  # rates of which only the quality is measured
    decoders = DECODER_TEXEL * further if settings.frames > 1 else 0
    encoders = ENCODER_TEXEL[min(settings.frames, len(ENCODER_TEXEL)) - 1] * len(settings.crfs)
    passing = PASSING_TEXEL + DECODED_TEXEL * further
    return MemoryNeed(
        int(PROGRAM + METHOD * len(packers)),
        int(per_triangle * scene.triangle_count + TEXTURE_TEXEL * textures),
        int((PIXEL + sum(of_pixel[:at_once])) * pixels),
        int(((KEPT_TEXEL + coded) * atlases + passing * min(at_once, atlases)) * texels),
        int((encoders + decoders) * atlases * texels),
    )


def methods_at_once(settings: Settings, scene: Scene, packers: Sequence[Packer]) -> int:
    """How many methods go through a frame together: as many as memory has room for. Raises InputError where it has none
    for a single one."""
    if reason := refusal(settings, scene, packers):
        raise InputError(reason)
    aim = _share(settings, AIM)
    needs = {count: memory_need(settings, scene, packers, count) for count in range(AT_ONCE, 0, -1)}
    return next((count for count, need in needs.items() if need.total <= aim), 1)


def refusal(settings: Settings, scene: Scene, packers: Sequence[Packer], processes: int = 1) -> str:
    """Why there is no room for a run of these methods, one at a time, in one of so many processes; empty where there
    is."""
    need = memory_need(settings, scene, packers, 1)
    most = _share(settings, MOST) / processes
    if need.total <= most:
        return ""
    bound = "--memory allows" if settings.memory else f"{MOST:.0%} of {memory_bound().what} are"
    of_each = f" for each of {processes} workers" if processes > 1 else ""
    remedies = (
        [_smaller(need, len(packers))]
        + ["more --memory"] * bool(settings.memory)
        + ["fewer --workers"] * (processes > 1)
    )
    return f"This run takes about {need}, and {bound} {most / 1e9:.2g} GB{of_each}: {', or '.join(remedies)}."


def processes_with_room(settings: Sequence[Settings], scene: Scene, packers: Sequence[Packer], wanted: int) -> int:
    """How many of `wanted` processes have room side by side, each with the largest of these runs that has room alone:
    one method each, the packer of the same place. At least 1."""
    needs = [memory_need(at, scene, [packer], 1).total for at, packer in zip(settings, packers, strict=True)]
    largest = max((need for need in needs if need <= _share(settings[0], MOST)), default=0)
    return min(wanted, max(1, int(_share(settings[0], AIM) // largest))) if largest else wanted


def _share(settings: Settings, share: float) -> float:
    """The bytes that a run may take: what --memory says, else this share of what the process may have."""
    return settings.memory or share * memory_bound().size


def _smaller(need: MemoryNeed, methods: int) -> str:
    """What makes the largest part smaller that can be, in a run of so many methods."""
    fewer = ["--atlas"] + ["fewer methods"] * (methods > 1)
    remedies = {
        "scene": "reduce the scene with --decimate or --max-texture",
        "pictures": "give a smaller --size",
        "planes": f"give a smaller {' or '.join(fewer)}",
        "encoders": f"give a smaller {', '.join(fewer)} or fewer rates (--crf)",
    }
    return remedies[max(remedies, key=lambda name: int(getattr(need, name)))]
