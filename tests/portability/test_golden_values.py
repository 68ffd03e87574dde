"""Scenes, paths and host-side numbers are the same to the last bit on every processor, by golden hashes.

After a change that is meant to change them, `python -m tests.portability.values --whole` prints what belongs here.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GOLDEN = {
    "head motion": "65e8f08264cce672",
    "FLIP": "6d2c3468093d6081",
    "IW-SSIM": "1bebcdfe7eab408e",
    "SSIM and PSNR": "295262324a533c51",
    "SnakeBinning": "de5bed8a7a8dc3f6",
    "rates": "954973860b87e660",
    "environment map": "64c27eb5f1761abf",
    "sRGB": "da1d9e6ad7c8d8cf",
    "glTF": "5c6ca04721a08488",
    "glTF animation": "aed2e9d06319e0b0",
    "glTF orbit": "b785a725b3173180",
    "hall 40000": "c22b3f52db9d8a45",
    "hall 40000 walk": "b5114acbe6036fcf",
    "hall 40000 orbit": "5c7e4b0c76325895",
    "hall 40000 turntable": "b50e533c872ef5ca",
    "hall 40000 found lights": "de93dfd35dfc92a7",
    "hall 40000 found walk": "7e2935272d4499b5",
    "hall 40000 found viewpoint": "245653f057f8d8eb",
    "hall 40000 host": "30dc1b22a6286593",
    "hall default": "e7bd661db7fda1c7",
    "hall default walk": "b5114acbe6036fcf",
    "hall default orbit": "9f9571c7437772a5",
    "hall default turntable": "b4dbcf38db77f5de",
    "village 130000": "04982b6d8f04837e",
    "village 130000 walk": "19359475ae046219",
    "village 130000 orbit": "c95004bccd172f39",
    "village 130000 turntable": "64557f2ca51b10d8",
    "village 130000 found lights": "fb6bcef4f1be38e4",
    "village 130000 found walk": "fbd5cd011eba0aae",
    "village 130000 found viewpoint": "fc6b59e7959eea75",
    "village 130000 host": "ec2ef1768e024605",
    "village default": "18adfcade30e6e59",
    "village default walk": "9e4c8c34364ff685",
    "village default orbit": "2fe51d8b6633f6e1",
    "village default turntable": "e662998e703999bb",
    "shells 2000": "60f0f14dba7624ac",
    "shells 2000 walk": "3d032f583d26f6ab",
    "shells 2000 orbit": "3d032f583d26f6ab",
    "shells 2000 turntable": "27a9ea91f82c1687",
    "shells 2000 found lights": "f634f0f0b997033e",
    "shells 2000 found walk": "3d032f583d26f6ab",
    "shells 2000 found viewpoint": "8bf78be021e3016b",
    "shells 2000 host": "5692d40f9608f616",
    "shells default": "c429b241a2018762",
    "shells default walk": "fa69f0adea3e1566",
    "shells default orbit": "fa69f0adea3e1566",
    "shells default turntable": "0fbb780b77e2dc17",
}

try:
    numpy_core = import_module("numpy._core._multiarray_umath")
except ImportError:  # NumPy 1
    numpy_core = import_module("numpy.core._multiarray_umath")

# What NumPy has special code for, and this processor can; and of that what is as wide as 512 bits.
FEATURES = [name for name in numpy_core.__cpu_dispatch__ if numpy_core.__cpu_features__.get(name)]
WIDE = [name for name in FEATURES if "512" in name or name == "X86_V4"]
PLAIN_C_LIBRARY = "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX,-AVX512F"  # sin, exp, pow without fused products
PROCESSORS = {
    "oldest": {
        "OPENBLAS_CORETYPE": "Nehalem",
        "NPY_DISABLE_CPU_FEATURES": " ".join(FEATURES),
        "GLIBC_TUNABLES": PLAIN_C_LIBRARY,
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    },
    "Haswell, 8 threads": {"OPENBLAS_CORETYPE": "Haswell", "OPENBLAS_NUM_THREADS": "8", "OMP_NUM_THREADS": "8"},
    "Zen, plain C library": {"OPENBLAS_CORETYPE": "Zen", "GLIBC_TUNABLES": PLAIN_C_LIBRARY},
}
if WIDE:
    PROCESSORS["without 512 bits"] = {"NPY_DISABLE_CPU_FEATURES": " ".join(WIDE)}


def values(*arguments: str, **environment: str) -> dict[str, str]:
    """The hashes that a process of its own computes; no scene comes from a cache."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.portability.values", *arguments],
        cwd=ROOT, env=os.environ | environment, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_values_are_the_golden_ones():
    assert values("--whole") == GOLDEN


@pytest.mark.skipif(sys.platform != "linux" or not FEATURES, reason="other processors are imitated on x86 and Linux")
@pytest.mark.parametrize("processor", PROCESSORS)
def test_values_are_the_same_on_every_processor(processor: str):
    found = values(**PROCESSORS[processor])
    assert found == {name: GOLDEN[name] for name in found}
