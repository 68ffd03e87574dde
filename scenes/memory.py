"""What fits into memory, asked before it is taken: where too much is taken, the system ends the process without a
word."""

from __future__ import annotations

from shading_atlas_bench.memory import memory_bound
from shading_atlas_bench.scenes.model import SceneError


def room() -> int:
    """The bytes that a scene may take: half of the memory, as what is made of it later needs the other half."""
    return memory_bound().size // 2


def check_memory(size: int, what: str, remedy: str = "use a larger machine") -> None:
    """Raise SceneError, saying what takes so many bytes and the remedy, where they are more than there is room for."""
    if size > room():
        bound = memory_bound()
        sizes = f"{size / 1e9:,.1f} GB, more than half of {bound.what}, {bound.size / 1e9:,.1f} GB"
        raise SceneError(f"{what} takes {sizes}: {remedy}.")
