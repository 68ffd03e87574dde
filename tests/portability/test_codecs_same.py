"""Codecs give the same bytes and the same decoded pictures whatever SIMD the processor has, and with any threads.

Processors are imitated by taking instructions away from this one: x264 by its own setting `asm`, swscale and FFmpeg's
decoder by `av_force_cpu_flags` of the libavutil that PyAV loaded, JPEG by libjpeg-turbo's environment variables. Each
is a process of its own, because libraries look once.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import os
import platform
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
SSE2 = "mmx+mmxext+sse+sse2"
SSSE3 = f"{SSE2}+sse3+ssse3"
AVX = f"{SSSE3}+sse4.1+sse4.2+avx"
AVX2 = f"{AVX}+fma3+bmi1+bmi2+avx2"
# What a processor has, as FFmpeg, x264 and libjpeg-turbo call it; the last is this one as it is.
PROCESSORS = {
    "none": ("0", "0", "JSIMD_FORCENONE"),
    "sse2": (SSE2, "SSE2", "JSIMD_FORCESSE2"),
    "ssse3": (SSSE3, "SSSE3", "JSIMD_FORCESSE2"),
    "avx": (AVX, "AVX", "JSIMD_FORCESSE2"),
    "avx2": (AVX2, "AVX2", "JSIMD_FORCEAVX2"),
    "whole": ("", "", ""),
}
SIZES = [(96, 128), (67, 121)]  # height, width; the second needs padding
STREAMS = [("h264", 0), ("h264", 5), ("h264", 25), ("h264", 40), ("jpeg", None)]


def loaded_libavutil() -> ctypes.CDLL:
    """The library that PyAV itself uses, so that flags set there count."""
    import av

    assert av.library_versions
    (path,) = set(re.findall(r"\S*/libavutil\S*\.so\S*", Path("/proc/self/maps").read_text(encoding="utf-8")))
    return ctypes.CDLL(path)


def flags_of(instructions: str) -> int:
    """FFmpeg's flags of these instructions."""
    flags = ctypes.c_uint(0)
    if instructions != "0":
        assert loaded_libavutil().av_parse_cpu_caps(ctypes.byref(flags), instructions.encode()) >= 0
    return flags.value


def give_only(instructions: str) -> int:
    """Leave FFmpeg's libraries these instructions only, where any are named; the flags that it then sees."""
    if instructions:
        loaded_libavutil().av_force_cpu_flags(flags_of(instructions))
    return loaded_libavutil().av_get_cpu_flags()


def moving_picture(height: int, width: int, frames: int = 3) -> list[np.ndarray]:
    """Smooth colours, hard blocks and noise, moving by odd steps: every kind of prediction finds something."""
    rng = np.random.default_rng(5)
    y, x = np.mgrid[: height + 32, : width + 32]
    smooth = 127 + 120 * np.sin(np.stack([x / 19 + y / 31, x / 47 - y / 23, (x + y) / 37], axis=-1))
    blocks = rng.integers(0, 256, (height // 8 + 5, width // 8 + 5, 3)).repeat(8, axis=0).repeat(8, axis=1)
    weight = ((x // 40 + y // 24) % 3)[..., None] / 2
    whole = smooth * (1 - weight) + blocks[: height + 32, : width + 32] * weight + rng.normal(0, 3, smooth.shape)
    whole = np.clip(whole, 0, 255).astype(np.uint8)
    return [np.ascontiguousarray(whole[3 * k : 3 * k + height, 5 * k : 5 * k + width]) for k in range(frames)]


def coded() -> dict[str, list[str]]:
    """For each kind of stream and size the digests of all bytes and of all decoded pictures."""
    from shading_atlas_bench.harness.measure.codecs import Picture, VideoStream

    found = {}
    for height, width in SIZES:
        frames = moving_picture(height, width)
        for codec, crf in STREAMS:
            for grey in (False, True):
                coder = VideoStream(codec, crf, width, height, decode=True, grey=grey)._open()
                wire, seen = hashlib.sha256(), hashlib.sha256()
                for frame in frames:
                    data = coder.encode(Picture(frame))
                    wire.update(data)
                    seen.update(coder.decode(data, Picture(frame))[:height, :width].tobytes())
                name = f"{codec} {crf} {width}x{height}{' grey' if grey else ''}"
                found[name] = [wire.hexdigest()[:16], seen.hexdigest()[:16]]
    return found


# argv: instructions for FFmpeg, x264's `asm`, x264 parameters to leave out, whether swscale keeps its exact flags
CHILD = """
import json, sys
from shading_atlas_bench.harness.measure import codecs
from tests.portability import test_codecs_same as same
flags = same.give_only(sys.argv[1])
for name in ("X264", "X264_GREY"):
    asm = ":asm=" + sys.argv[2] if sys.argv[2] else ""
    setattr(codecs, name, getattr(codecs, name).replace(sys.argv[3] or "nothing", "") + asm)
if sys.argv[4] == "inexact":
    codecs.EXACT = ()
print(json.dumps([flags, same.coded()]))
"""


@cache
def coded_on(processor: str, left_out: str = "", flags: str = "exact") -> tuple[int, dict[str, list[str]]]:
    """The flags of what FFmpeg sees, and `coded` there."""
    instructions, asm, jpeg = PROCESSORS[processor]
    done = subprocess.run(
        [sys.executable, "-c", CHILD, instructions, asm, left_out, flags],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | ({jpeg: "1"} if jpeg else {}),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return tuple(json.loads(done.stdout))


linux_x86 = pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64", reason="takes instructions from x86-64 under Linux only"
)


@linux_x86
@pytest.mark.parametrize("processor", list(PROCESSORS)[:-1])
def test_every_processor_gives_the_same_bytes_and_pictures(processor: str):
    flags = flags_of(PROCESSORS[processor][0])
    if flags & ~give_only(""):
        pytest.skip("this processor lacks these instructions")
    seen, found = coded_on(processor)
    assert seen == flags, "the instructions were not taken away"
    assert found == coded_on("whole")[1]


@linux_x86
@pytest.mark.parametrize(
    ("left_out", "flags", "kind"),
    [(":cpu-independent=1", "exact", "h264 25 128x96"), ("", "inexact", "h264 25 121x67")],
)
def test_what_depends_on_the_processor_is_seen(left_out: str, flags: str, kind: str):
    """x264 and swscale as they are of themselves."""
    if flags_of("avx2") & ~give_only(""):
        pytest.skip("this processor lacks what makes a difference")
    assert coded_on("none", left_out, flags)[1][kind] != coded_on("whole", left_out, flags)[1][kind]


def test_threads_of_decoders_and_conversions_change_nothing(monkeypatch: pytest.MonkeyPatch):
    expected = coded()
    monkeypatch.setattr("shading_atlas_bench.harness.measure.codecs.THREADS", 5)
    assert coded() == expected
