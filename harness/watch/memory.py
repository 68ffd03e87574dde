"""The memory that a process may take, and what to say where that is too little."""

from __future__ import annotations

from shading_atlas_bench.memory import address_limit

LEAST = 2_000_000_000  # bytes of addresses: the interpreter, a compiler and the smallest run


def too_little() -> str:
    """A sentence where the limit lets no run begin; else nothing."""
    limit = address_limit()
    if limit is None or limit >= LEAST:
        return ""
    return f"The limit of memory (ulimit -v) is {limit / 1e9:.2g} GB: give {LEAST / 1e9:g} GB or more."


def ran_out() -> str:
    """The sentence for memory that ran out."""
    limit = address_limit()
    bound = "" if limit is None else f", of which a limit (ulimit -v) allows {limit / 1e9:.2g} GB"
    return f"Memory ran out{bound}: give more of it, or a smaller scene, --size or --atlas."
