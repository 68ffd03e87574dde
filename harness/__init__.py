"""The harness: frames, reference, codecs, metrics, validity, run loop, command line."""

import os

# Where a hypervisor takes free memory back, and in fragmented memory, NumPy's fresh huge pages cost several times what
# small pages do that were in use a moment ago: half of all system time of a run.
os.environ.setdefault("NUMPY_MADVISE_HUGEPAGE", "0")
