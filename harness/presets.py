"""The papers' own experiments, which `bench run --preset NAME` makes anew; other options override theirs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Preset:
    """What it is, and its options as `bench run` takes them, by their names without dashes."""

    meaning: str
    options: dict[str, Any] = field(default_factory=dict)


# An experiment with tables of its own rather than a run with other options: harness.ppll_2014.
LINKED_LISTS = "ppll-2014"

PRESETS = {
    "snakebinning-2021": Preset(
        "SnakeBinning's tables 1 to 3 and figure 14, outdoors: three methods as published, 1920x1080, smallest cell",
        {
            "method": ("snakebinning@published", "sas@published", "tss@published"),
            "size": "1920x1080",
            "cell": "pvs1",
            "atlas": "8192x4096",
        },
    ),
    # 24 Mpix of atlas; the head turns by 40 degrees beyond the camera's 60.
    "tss-2019": Preset(
        "Tessellated Shading Streaming's tables 1 and 4: itself and SAS as published, 1920x1080, smallest cell",
        {
            "method": ("tss@published", "tss@published[strategy=lpacking]", "sas@published"),
            "size": "1920x1080",
            "cell": "0.1,100",
            "atlas": "6144x4096",
        },
    ),
    LINKED_LISTS: Preset(
        "The thesis on per-pixel linked lists: tables A.1 and A.2, figures 6.1 to 6.3; takes --method ppll\\[...], "
        "--frames, --size, --device, --out"
    ),
}
