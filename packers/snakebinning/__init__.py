"""SnakeBinning."""

from shading_atlas_bench.packers.snakebinning.packer import SnakeBinning

__all__ = ["SnakeBinning"]
