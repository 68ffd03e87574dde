"""Streaming of per-pixel linked lists."""

from shading_atlas_bench.packers.ppll.packer import PerPixelLinkedLists

__all__ = ["PerPixelLinkedLists"]
