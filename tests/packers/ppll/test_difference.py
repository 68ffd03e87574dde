"""What a change of depth is worth sending."""

from __future__ import annotations

import numpy as np
import pytest

from shading_atlas_bench.harness.workload.views import client_view
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.packers.ppll.difference import VisualDifference
from shading_atlas_bench.packers.ppll.kernels.lists import Lists
from tests.packers.rooms import FOV, NEAR, pose_at


@pytest.mark.parametrize(("share", "sent"), [(0.9e-4, [0, 0]), (1.1e-4, [1, 1])])
def test_a_ten_thousandth_of_its_depth_moves_no_fragment(device: Device, share: float, sent: list[int]) -> None:
    """Two pixels of one fragment each, one of which comes nearer and one of which goes away."""
    view = client_view(pose_at(0), FOV, 2, 1, NEAR)
    held = VisualDifference(device, by_fragments=True, tolerance=0)
    for depths in ([3.0, 0.7], [3.0 * (1 - share), 0.7 * (1 + share)]):
        rows = np.array([[-1, -1], depths], np.float32).T.copy().view(np.uint32)
        (changed,) = held.changes([Lists.upload(device, 2, 1, np.arange(3), rows)], view)
    assert np.diff(changed.host()[0]).tolist() == sent
