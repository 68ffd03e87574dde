"""The validity of fragment lists: each fragment once, each pixel's nearest first; planted errors are found."""

import numpy as np
import pytest

from harness.validity import _check_lists


def details(words: int = 2) -> dict[str, np.ndarray]:
    """Three pixels with 2, 0 and 3 fragments."""
    header = np.array([[[0, 2], [2, 0], [2, 3]]], np.uint32)
    far = np.array([1, 2, 1, 2, 3], np.float32)
    rows = np.full((5, words), 255 << 24, np.uint32)
    rows[:, -1] = (1 / far if words == 2 else far).astype(np.float32).view(np.uint32)
    return {"header": header, "fragments": rows}


def rules(lists: dict[str, np.ndarray]) -> list[str]:
    return [violation.rule for violation in _check_lists(lists)]


@pytest.mark.parametrize("words", [2, 5])
def test_sound_lists_pass_and_a_swap_is_found(words):
    lists = details(words)
    assert rules(lists) == []
    lists["fragments"] = lists["fragments"][[0, 1, 3, 2, 4]]
    assert rules(lists) == ["sorted"]
    lists["fragments"][2:, 0] = 0  # what is removed has no order
    assert rules(lists) == []


def test_a_fragment_in_two_lists_or_in_none_is_found():
    shared, lost, other_node = details(), details(), details()
    shared["header"][0, 2, 0] = 1
    lost["header"][0, 2, 1] = 2
    other_node |= {"header1": lost["header"], "fragments1": lost["fragments"]}
    assert rules(shared) == rules(lost) == rules(other_node) == ["once"]
