"""Streaming of per-pixel linked lists."""

from packers.ppll.packer import PerPixelLinkedLists

__all__ = ["PerPixelLinkedLists"]
