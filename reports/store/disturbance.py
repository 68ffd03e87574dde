"""What a run knows of the machine while it ran, by frame: the reference's time, and what other programs took."""

from __future__ import annotations

from typing import Any

REFERENCE = "reference_ms"  # statistics of the harness
OTHERS = "others_share"
MOST = 0.25  # of the machine's cores, that other programs may take before a frame's times are called disturbed


def of_frames(statistics: list[dict[str, Any]], name: str) -> dict[int, float]:
    """The values of a statistic that is the same for all methods of a frame, by frame."""
    return {row["frame"]: row["value"] for row in statistics if row["name"] == name and row["value"] is not None}


def is_disturbed(share: float) -> bool:
    """Whether other programs took too large a share of the cores."""
    return share > MOST
