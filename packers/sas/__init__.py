"""Shading Atlas Streaming."""

from shading_atlas_bench.packers.sas.packer import ShadingAtlasStreaming

__all__ = ["ShadingAtlasStreaming"]
