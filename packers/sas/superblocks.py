"""How many superblocks an atlas has, and how large they are."""

from __future__ import annotations

from shading_atlas_bench.packers.sas.kernels.allocate import SuperblockGrid

SIDES = (1, 2, 4, 8, 16, 32, 64, 128, 256)
FEWEST = 128  # of an atlas, when their side is chosen for it: the paper's settings give 128 to 256


def choose_grid(width: int, height: int, superblock: int) -> SuperblockGrid:
    """The superblocks of an atlas; a side of 0 is chosen for it. What their rows and columns leave over is not used.

    Raises ValueError for a side that is not a power of two from 1 to 256, or does not fit.
    """
    side = superblock
    if superblock == 0:
        side = 256 if width * height >= 8_000_000 else 128
        while side > 1 and (width // side) * (height // side) < FEWEST:
            side //= 2
    if side not in SIDES:
        raise ValueError(f"The superblock side {superblock} is not a power of two from 1 to 256 (0 chooses one).")
    if side > min(width, height):
        raise ValueError(
            f"A superblock of {side} texels does not fit into a {width}x{height} atlas: give a smaller side, or 0."
        )
    return SuperblockGrid(side.bit_length() - 1, width // side, height // side)
