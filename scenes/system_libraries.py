"""Which package brings a shared library that the system lacks."""

from __future__ import annotations

import re

LIBRARIES = {  # that a fresh Debian or Ubuntu lacks, and the packages that bring them
    "libGL.so.1": "libgl1",
    "libOpenGL.so.0": "libopengl0",
    "libEGL.so.1": "libegl1",
    "libGLU.so.1": "libglu1-mesa",
    "libX11.so.6": "libx11-6",
    "libxcb.so.1": "libxcb1",
    "libgomp.so.1": "libgomp1",
}


def missing_library(error: Exception) -> tuple[str, str] | None:
    """The shared library that an ImportError or OSError is about, and how to get it; None for every other error."""
    found = re.search(r"(lib[\w+-]+\.so[.\d]*)", str(error)) if isinstance(error, ImportError | OSError) else None
    if found is None:
        return None
    package = LIBRARIES.get(found[1])
    return found[
        1
    ], f"install {package} (Debian, Ubuntu: apt install {package})" if package else "install what brings it"
