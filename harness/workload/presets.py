"""The papers' own experiments, `--preset NAME` of `bench run` and `bench sweep`; other options override theirs."""

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
VILLAGE = "village"  # the built-in scene of the kind of Viking Village, which both papers have outdoors

PRESETS = {
    "snakebinning-2021": Preset(
        "SnakeBinning's tables 1 to 3 and figure 14, outdoors: three methods as published, 1920x1080, H.264, the "
        "smallest of the paper's three view cells",
        {
            "scene": VILLAGE,
            "method": ("snakebinning@published", "sas@published", "tss@published"),
            "size": "1920x1080",
            "cell": "pvs1",
            "atlas": "8192x4096",
        },
    ),
    # Section 5: an atlas of 24 Mpix, a camera of 60 degrees. Section 4: the atlas is encoded with JPEG. Table 1: the
    # smallest view cell is "10cm 40deg". That its field of view is the camera's 60 and these 40 beyond is a reading of
    # ours: the paper does not say what is 40 degrees wide, but the camera's picture is wider.
    "tss-2019": Preset(
        "Tessellated Shading Streaming's tables 1 and 4, outdoors: itself and SAS as published, 1920x1080, JPEG, the "
        "smallest of the paper's three view cells",
        {
            "scene": VILLAGE,
            "method": ("tss@published", "tss@published[strategy=lpacking]", "sas@published"),
            "size": "1920x1080",
            "cell": "0.1,100",
            "atlas": "6144x4096",
            "codec": "jpeg",
        },
    ),
    LINKED_LISTS: Preset(
        "The thesis on per-pixel linked lists: tables A.1 and A.2, figures 6.1 to 6.3; takes --method ppll\\[...], "
        "--frames, --size, --device, --out, --dry-run"
    ),
}
