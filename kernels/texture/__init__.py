"""Textures: mip chains, lookups and alpha masks."""
