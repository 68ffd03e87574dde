"""What others wrote is read as a whole or refused in words."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from shading_atlas_bench.reports.store import data
from shading_atlas_bench.reports.store.data import DataError, read_file, read_json, read_toml


def test_a_file_that_grows_while_it_is_read_is_never_cut(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "a.json"
    file.write_bytes(b"0123456789")
    assert read_file(file, 10) == b"0123456789"
    monkeypatch.setattr(data, "regular_size", lambda _: 5)
    with pytest.raises(DataError, match=r"a\.json has more than 9 bytes"):
        read_file(file, 9)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"a = ", r"is not TOML: Invalid value \(at .*\)\.$"),
        (b"a = " + b"9" * 5000, rf"has a number of more than {sys.get_int_max_str_digits():,} digits\.$"),
        (b"a = '\xff'", r"is not UTF-8: invalid start byte at byte 5\.$"),
        (b"a = " + b"[" * 100_000, r"is not TOML: it is nested too deeply\.$"),
        (b"a = 1979-13-01", r"is not TOML: "),
    ],
)
def test_toml_that_is_none_is_one_sentence(content: bytes, says: str, tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_bytes(content)
    with pytest.raises(DataError, match=says) as raised:
        read_toml(file, dict)
    assert "sys." not in str(raised.value)


def test_a_value_of_another_type_is_named_with_its_place(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_text('{"a": [1, "b"]}', encoding="utf-8")
    with pytest.raises(DataError, match=r"a\.json is not what it is taken for: .*int.*str.*\[1\]"):
        read_json(file, dict[str, list[int]])


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="it has no pipes")
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(DataError, match="no regular file"):
        read_file(tmp_path / "pipe")
