"""What is killed at a random moment goes on without a row lost or doubled; `python -m tests.kills` tries many."""

import random
from pathlib import Path

import pytest

from tests.kills import Victim


@pytest.mark.parametrize("name", ["run", "report"])
def test_a_command_that_is_killed_loses_and_doubles_no_row(name: str, tmp_path: Path):
    Victim(name, tmp_path).chain(1, random.Random(name))  # which asserts it
