"""Whether both ends of the bilateral method hold the same bits, frame after frame.

python -m shading_atlas_bench.harness.experiments.exact_merge shells hall path/to/scene.ply
"""

from __future__ import annotations

import sys
from statistics import median

from shading_atlas_bench.harness.workload.session import open_session
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.packers.interface import Decoded
from shading_atlas_bench.packers.ppll import PerPixelLinkedLists
from shading_atlas_bench.packers.ppll.kernels.lists import Lists

FRAMES, WIDTH, HEIGHT = 360, 160, 90


def compare(scene: str, frames: int = FRAMES) -> tuple[int, list[float]]:
    """Frames after which sender and display differ in any bit of their lists, and the share sent of each frame's."""
    path = "walk" if scene in ("hall", "village") else "turntable"
    session = open_session(Settings(("ppll",), scene, path=path, frames=frames, width=WIDTH, height=HEIGHT))
    packer = PerPixelLinkedLists(mode="bilateral", merge="exact")
    packer.prepare(session.scene)
    display = packer.client(session.scene.shipped)
    different, shares = 0, []
    for index in range(frames):
        payload = packer.pack(session.source.work(index % session.path.frames).frame)  # a turntable begins again
        display.receive(Decoded({}, payload.blobs, payload.geometry, payload.lists))
        ours, theirs = (lists for _, lists in display.held), (held.lists for held in packer.held)
        different += [_bytes_of(lists) for lists in ours] != [_bytes_of(lists) for lists in theirs]
        shares.append(1 - payload.statistics["share_saved"])
    return different, shares


def _bytes_of(lists: list[Lists]) -> list[bytes]:
    return [array.tobytes() for part in lists for array in part.host()]


def main(scenes: list[str]) -> int:
    """Print a line per scene; returns 1 if any frame differs."""
    worst = 0
    for scene in scenes:
        different, shares = compare(scene)
        print(f"{scene}: {different} of {len(shares)} frames differ; {median(shares):.0%} of the fragments sent")
        worst = max(worst, different)
    return int(worst > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:] or ["shells", "hall"]))
