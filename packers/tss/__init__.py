"""Tessellated Shading Streaming."""

from packers.tss.packer import TessellatedShadingStreaming

__all__ = ["TessellatedShadingStreaming"]
