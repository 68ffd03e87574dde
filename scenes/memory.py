"""What fits into this machine's memory, asked before it is taken: where too much is taken, the system ends the process
without a word."""

from __future__ import annotations

import psutil

from shading_atlas_bench.scenes.model import SceneError

_SHARE = 2  # half of the machine's: what is made of a scene later needs the other


def check_memory(size: int, what: str, remedy: str = "use a larger machine") -> None:
    """Raise SceneError, saying what takes so many bytes and the remedy, for more than half of the machine's."""
    whole: int = psutil.virtual_memory().total
    if size > whole // _SHARE:
        sizes = f"{size / 1e9:,.1f} GB, more than half of this machine's memory of {whole / 1e9:,.1f} GB"
        raise SceneError(f"{what} takes {sizes}: {remedy}.")
