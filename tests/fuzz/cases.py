"""What every fuzz target has in common: how many cases it tries, and what a case may not do."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

from hypothesis import HealthCheck, settings

from shading_atlas_bench.errors import BenchError

CASES = "BENCH_FUZZ_CASES"  # variable: how many cases of each target
SECONDS = "BENCH_FUZZ_SECONDS"  # variable: how long a case may take
FEW = 25  # as one of many tests
LONGEST = 10  # seconds
LONGEST_SENTENCE = 2000  # letters of an error for people

_asked_for = os.environ.get(CASES)

# The decorator of every target. Among other tests it tries a few cases, the same ones each time, without a limit of
# time: machines differ. As many as asked for are other ones each time.
fuzzed = settings(
    max_examples=int(_asked_for or FEW),
    derandomize=_asked_for is None,
    deadline=timedelta(seconds=float(os.environ.get(SECONDS, LONGEST))) if _asked_for else None,
    database=None,
    print_blob=True,
    suppress_health_check=list(HealthCheck),
)


@contextmanager
def nothing_beside(folder: Path) -> Iterator[None]:
    """What runs in the block may write into this folder only. Raises AssertionError if it changes what lies beside it,
    or below the folder above it."""
    before = _beside(folder)
    yield
    after = _beside(folder)
    assert after == before, f"written outside of {folder}: {sorted(set(after) ^ set(before)) or 'changed files'}"


@contextmanager
def one_sentence(*errors: type[BenchError]) -> Iterator[None]:
    """What the block raises is one of these errors for people, or any of them where none is named, with one sentence
    that can be printed. Raises AssertionError if it is not."""
    expected = errors or (BenchError,)
    try:
        yield
    except expected as error:
        sentence = str(error)
        assert sentence.encode()
        assert "\n" not in sentence
        assert sentence.endswith((".", "?"))
        assert len(sentence) < LONGEST_SENTENCE


def _beside(folder: Path) -> dict[str, tuple[int, int]]:
    """Size and time of change of every file below the folder above, but for those in the folder."""
    return {
        str(path): (path.lstat().st_size, path.lstat().st_mtime_ns)
        for path in folder.parent.rglob("*")
        if path != folder and folder not in path.parents and not path.is_dir()
    }
