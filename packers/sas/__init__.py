"""Shading Atlas Streaming."""

from packers.sas.packer import ShadingAtlasStreaming

__all__ = ["ShadingAtlasStreaming"]
