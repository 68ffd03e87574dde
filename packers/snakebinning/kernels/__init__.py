"""Kernels of SnakeBinning: footprints, bins, superblocks, places and samples."""
