"""Bin freezing (section 3.6): while little of the set is new, nothing that has a slot moves."""

from __future__ import annotations


class Freezing:
    """How long the layout may stay as it is.

    share: of the area in the atlas that may be new, 0 for never. most: frames in a row. frozen_frames: so many so far.
    area: in the atlas when the layout was made, added: what has come since, both in texels. rebuilds: how often it was
    over.
    """

    def __init__(self, share: float, most: int) -> None:
        self.share, self.most = share, most
        self.frozen_frames = self.rebuilds = 0
        self.area = self.added = 0.0

    @property
    def is_over(self) -> bool:
        """Whether a frame has to be rebuilt whatever is new in it."""
        return self.frozen_frames >= self.most or self.share <= 0

    def is_exceeded_by(self, area: float) -> bool:
        """Whether this much more that is new is too much."""
        self.added += area
        return self.added >= self.share * self.area

    def restart(self, area: float) -> None:
        """A layout has been made of so much area."""
        self.area, self.added, self.frozen_frames = area, 0.0, 0
