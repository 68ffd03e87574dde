"""The validity of fragment lists: each fragment once, each pixel's nearest first; planted errors are found."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.harness.measure.verification import lists as of_lists
from shading_atlas_bench.harness.measure.verification.frame import Verifier
from shading_atlas_bench.harness.measure.verification.lists import (
    check_bytes,
    check_structure,
    count_fragments,
    is_at,
    walk,
)
from shading_atlas_bench.harness.workload.views import CellFrustum, Pose, ViewCell
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.packers.interface import HeldLists, Payload, View


def lists() -> HeldLists:
    """Three pixels with 2, 0 and 3 fragments."""
    view = View(np.eye(4), np.eye(4), 3, 1)
    far = np.array([1, 2, 1, 2, 3], np.float32)
    return HeldLists(view, np.array([0, 2, 2, 5]), np.full((5, 4), 255, np.uint8), np.reciprocal(far))


def rules(device: Device, *held: HeldLists) -> list[str]:
    return [violation.rule for violation in check_structure(held, walk(device, held))]


def test_sound_lists_pass_and_a_swap_is_found(device):
    sound = lists()
    assert rules(device, sound) == []
    swapped = replace(sound, depth=sound.depth[[0, 1, 3, 2, 4]])
    assert rules(device, swapped) == ["sorted"]
    gone = sound.rgba.copy()
    gone[2:] = 0  # what is removed has no order
    assert rules(device, replace(swapped, rgba=gone)) == []
    assert count_fragments((sound, replace(sound, rgba=gone))) == 7


def test_a_fragment_in_two_lists_or_in_none_is_found(device):
    sound = lists()
    shared, lost = (replace(sound, offsets=np.array(offsets)) for offsets in ([0, 2, 1, 5], [0, 2, 2, 4]))
    assert rules(device, shared) == rules(device, lost) == rules(device, sound, lost) == ["once"]


def test_fragments_have_depths(device):
    nowhere = replace(lists(), depth=np.array([1, np.nan, 1, 0, 0], np.float32))
    assert rules(device, nowhere) == ["sorted"]


def test_bytes_are_counted_and_bounded():
    """3 pixels of 4 bytes and 5 fragments of 12, or of 24 with normals."""

    def found(size: int, claimed: int, held: HeldLists, before: int = 0, holds: str = "every") -> int:
        payload = Payload({}, {}, b"", 5, lists={"lists": bytes(size)}, raw_bytes=claimed)
        return len(list(check_bytes(payload, (held,), 5, before, holds)))

    assert found(72, 72, lists()) == 0
    assert found(72, 71, lists()) == 1
    assert found(73, 73, lists()) == 1
    assert found(73, 74, lists()) == 2
    assert found(132, 132, replace(lists(), normals=True)) == 0
    assert found(73, 73, lists(), before=1, holds="alike") == 0
    assert list(check_bytes(Payload({}, {}, b"", 0), (), 0, 0, "every")) == []  # without lists nothing is claimed


@pytest.mark.parametrize(
    ("holds", "found"),
    [("every", ["samples"]), ("nearest", ["samples"]), ("alike", []), ("moved", []), ("blended", ["samples"])],
)
def test_a_claim_may_be_a_fifth_off_where_lists_may_be_old(holds, found, monkeypatch, device):
    """Of 5 fragments, 4 are claimed."""
    monkeypatch.setattr(of_lists, "check_fragments", lambda *_: iter(()))
    payload = Payload({}, {}, b"", 4, lists={"lists": bytes(72)}, raw_bytes=72)
    packer: Any = SimpleNamespace(name="lists", holds=holds)
    client: Any = SimpleNamespace(fragments=lambda: (lists(),))
    truth: Any = SimpleNamespace(scene=SimpleNamespace(device=device))
    unused: Any = None
    verified = Verifier(truth, packer)._of_lists(unused, payload, client, "")
    assert (verified.samples, [violation.rule for violation in verified.found]) == (5, found)


def test_every_surface_that_moved_lists_lack_is_counted():
    """Of eight that rays meet, lists that end before them hold none."""
    hits: Any = SimpleNamespace(certain=np.ones(8, bool), ray=np.arange(8), depth=np.full(8, 0.5), reach=np.zeros(8))
    nothing = of_lists.List(np.empty((0, 4), np.uint8), np.empty(0))
    (found,) = of_lists._check_moved(hits, np.zeros((8, 3), np.uint8), [nothing] * 8)
    assert (found.rule, found.count) == ("fragments", 8)


@pytest.mark.parametrize("position", [(0, 0, 0), (0, 0, 2.5), (1e-17, -3, 1e5), (70, 20, -400)])
def test_views_turned_in_any_way_are_seen_from_the_same_eye_and_moved_ones_are_not(position):
    """Also in a cell of one point, and with coordinates that are 0 but for rounding."""
    frustum, generator, near = CellFrustum.around(ViewCell(0, 170), 70, 160, 90), np.random.default_rng(3), 0.01
    for quaternion in generator.normal(size=(50, 4)):
        pose = Pose(np.array(position, np.float64), quaternion)
        eye, views = frustum.server_view(pose, near).eye, frustum.split(pose, near)
        assert len(views) == 4
        assert all(is_at(view, eye) for view in views)
        moved = views[0].view.copy()
        moved[generator.integers(3), 3] += near / 1000
        assert not is_at(replace(views[0], view=moved), eye)
