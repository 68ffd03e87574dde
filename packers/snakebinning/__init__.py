"""SnakeBinning."""

from packers.snakebinning.packer import SnakeBinning

__all__ = ["SnakeBinning"]
