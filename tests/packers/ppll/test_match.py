"""Bilateral differences against their twins."""

import numpy as np
import pytest

from shading_atlas_bench.kernels.inputs.soups import look_at
from shading_atlas_bench.packers.ppll.kernels.inputs import PROJECTION, SIZE, normal_lists
from shading_atlas_bench.packers.ppll.kernels.match import (
    apply_differences,
    differences_twin,
    find_differences,
    merge_differences,
    merge_twin,
    move_lists,
    move_twin,
    turning,
)


def assert_same(found, expected):
    np.testing.assert_array_equal(found[0], expected[0])
    np.testing.assert_array_equal(found[1], expected[1])


def test_nothing_moves_where_the_view_stays(device):
    held = normal_lists(device, np.random.default_rng(0))
    moved = move_lists(device, held, turning(np.eye(4), np.eye(4)), PROJECTION, "move")
    assert_same(moved.host(), held.host())


@pytest.mark.parametrize("shift", [0.01, 0.3, 3.0])
def test_moved_fragments_are_where_the_twin_puts_them(device, shift):
    """Distances within 1e-6 of themselves; pixels differ only within 1e-4 pixel of a border."""
    held = normal_lists(device, np.random.default_rng(1))
    turn = turning(np.eye(4), look_at((shift, 0, 0.5 * shift), (0.2, 0.1, -4)))
    offsets, rows = move_lists(device, held, turn, PROJECTION, "move").host()
    column, line, distance = move_twin(held.host(), turn, PROJECTION, *SIZE)
    names = rows[:, 1]
    assert len(np.unique(names)) == len(names)
    away = rows[:, 4].copy().view(np.float32)
    assert (np.abs(away - distance[names]) <= 2e-6 * (np.abs(distance[names]) + shift)).all()
    pixel = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    for place, at in ((pixel % SIZE[0], column[names]), (pixel // SIZE[0], line[names])):
        assert (np.abs(at - place - 0.5) <= 0.5 + 1e-4).all()
    assert (np.diff(away)[np.diff(pixel) == 0] >= 0).all()
    inside = (column > 1e-4) & (column < SIZE[0] - 1e-4) & (line > 1e-4) & (line < SIZE[1] - 1e-4) & (distance > 0.1001)
    assert np.isin(np.flatnonzero(inside), names).all()


@pytest.mark.parametrize(("share", "tolerance"), [(0.0, 0), (0.02, 40), (0.1, 255), (1.0, 255)])
def test_differences_are_those_of_the_twin(device, share, tolerance):
    rng = np.random.default_rng(2)
    moved, fresh = normal_lists(device, rng), normal_lists(device, rng)
    changes = find_differences(device, moved, fresh, share, tolerance, "match")
    offsets, rows = changes.host()
    expected = differences_twin(moved.host(), fresh.host(), share, tolerance)
    assert np.diff(offsets).tolist() == [len(entries) for entries in expected]
    old, new = moved.host()[1], fresh.host()[1]
    for row, (kind, number) in zip(rows, (entry for entries in expected for entry in entries), strict=True):
        if kind == "insert":
            np.testing.assert_array_equal(row, new[number])
        else:
            np.testing.assert_array_equal(row, [0, 0, 0, 0, old[number, 4]])


@pytest.mark.parametrize("accepting", [None, 0.0, 0.02, 0.2])
def test_merging_equals_its_twin(device, accepting):
    rng = np.random.default_rng(3)
    moved, fresh = normal_lists(device, rng), normal_lists(device, rng)
    changes = find_differences(device, moved, fresh, 0.03, 60, "match")
    merged = merge_differences(device, moved, changes, accepting, "merge")
    assert_same(merged.host(), merge_twin(moved.host(), changes.host(), accepting))


@pytest.mark.parametrize(("share", "tolerance"), [(0.0, 0), (0.02, 40), (0.1, 255), (1.0, 255)])
def test_the_sender_applies_changes_as_the_display_merges_them(device, share, tolerance):
    """Also where distances are equal, and what is removed is another one than was meant."""
    rng = np.random.default_rng(7)
    moved, fresh = normal_lists(device, rng, most=12), normal_lists(device, rng, most=12)
    changes = find_differences(device, moved, fresh, share, tolerance, "match")
    applied = apply_differences(device, moved, changes, fresh, "hold")
    assert_same(applied.host(), merge_differences(device, moved, changes, None, "merge").host())


def test_exact_changes_give_the_new_lists(device):
    """Nothing is similar enough to be kept unless it is the same: the merge is the new lists' distances and colours."""
    rng = np.random.default_rng(4)
    moved, fresh = normal_lists(device, rng), normal_lists(device, rng)
    changes = find_differences(device, moved, fresh, 0.0, 0, "match")
    offsets, rows = merge_differences(device, moved, changes, None, "merge").host()
    expected_offsets, expected = fresh.host()
    np.testing.assert_array_equal(offsets, expected_offsets)
    np.testing.assert_array_equal(rows[:, 4], expected[:, 4])
    pixel = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    by_colour = [part[np.lexsort((part[:, 0], part[:, 4].view(np.float32), pixel)), 0] for part in (rows, expected)]
    assert (by_colour[0] == by_colour[1]).mean() > 0.95  # of equal distances another may have gone


def test_the_thesis_merge_errs_more_the_larger_its_threshold(device):
    """Figure 5.9."""
    rng = np.random.default_rng(5)
    moved, fresh = normal_lists(device, rng), normal_lists(device, rng)
    changes = find_differences(device, moved, fresh, 0.001, 10, "match")
    exact = merge_differences(device, moved, changes, None, "merge").host()[1]
    wrong = []
    for accepting in (0.001, 0.1, 0.5):
        rows = merge_differences(device, moved, changes, accepting, "merge").host()[1]
        wrong.append(len(np.setxor1d(rows[:, 1], exact[:, 1])))
    assert wrong[0] < wrong[1] < wrong[2]


def test_work_group_size_changes_no_byte(device, monkeypatch):
    rng = np.random.default_rng(6)
    held, fresh = normal_lists(device, rng, most=30), normal_lists(device, rng)
    turn = turning(np.eye(4), look_at((0.2, 0, 0.1), (0.2, 0.1, -4)))
    found = []
    for local_size in (64, 1, 7, 256):
        monkeypatch.setattr(device, "local_size", local_size)
        moved = move_lists(device, held, turn, PROJECTION, "move")
        changes = find_differences(device, moved, fresh, 0.02, 30, "match")
        merged = merge_differences(device, moved, changes, None, "merge")
        found.append([part.tobytes() for lists in (moved, changes, merged) for part in lists.host()])
    assert found[0] == found[1] == found[2] == found[3]
