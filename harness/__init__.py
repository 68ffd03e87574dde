"""The harness: frames, reference, codecs, metrics, validity, run loop, command line."""

import ctypes
import os
import sys

# Where a hypervisor takes free memory back, and in fragmented memory, NumPy's fresh huge pages cost several times what
# small pages do that were in use a moment ago: half of all system time of a run.
os.environ.setdefault("NUMPY_MADVISE_HUGEPAGE", "0")

# glibc gives every thread a pool of its own, and what one has freed the others cannot take: with scenes of millions of
# triangles the pools of a run's threads grew by a gigabyte. One pool serves all; other C libraries have no such call.
M_ARENA_MAX = -8
if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "mallopt"):
    libc.mallopt(M_ARENA_MAX, 1)
