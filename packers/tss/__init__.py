"""Tessellated Shading Streaming."""

from shading_atlas_bench.packers.tss.packer import TessellatedShadingStreaming

__all__ = ["TessellatedShadingStreaming"]
