"""The cache: whole files or none, and never a reason for a run to fail."""

import os
import warnings
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.harness.progress import warnings_as_sentences
from shading_atlas_bench.kernels.cache import (
    CacheError,
    _delete_parts,
    cache_folder,
    cache_root,
    read_checked,
    write_checked,
)

pytestmark = pytest.mark.filterwarnings("ignore:A cached file in .* was damaged")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@settings(max_examples=200, deadline=None)
@given(content=st.binary(max_size=300), damage=st.data())
def test_any_change_of_a_file_is_noticed(folder, content, damage):
    path = folder / "key"
    write_checked(path, content)
    assert read_checked(path) == content
    whole = path.read_bytes()
    start = damage.draw(st.integers(0, len(whole)))
    changed = whole[:start] + damage.draw(st.binary(max_size=20)) + whole[damage.draw(st.integers(start, len(whole))) :]
    path.write_bytes(changed)
    assert read_checked(path) == (content if changed == whole else None)


@pytest.mark.parametrize("size", [0, 1, 11, 12, 13, 100, 4096])
def test_zeros_are_no_sealed_file(tmp_path, size):
    """What some file systems leave of a file after a power cut."""
    (tmp_path / "key").write_bytes(bytes(size))
    assert read_checked(tmp_path / "key") is None


def test_a_file_under_the_name_of_another_is_not_taken(tmp_path):
    write_checked(tmp_path / "one", b"content")
    (tmp_path / "one").rename(tmp_path / "other")
    assert read_checked(tmp_path / "other") is None
    assert read_checked(tmp_path / "one") is None


def test_a_write_that_fails_leaves_nothing_behind(tmp_path, monkeypatch):
    write_checked(tmp_path / "key", b"first")

    def fails(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("os.replace", fails)
    with pytest.raises(KeyboardInterrupt):
        write_checked(tmp_path / "key", b"second")
    assert [entry.name for entry in tmp_path.iterdir()] == ["key"]
    assert read_checked(tmp_path / "key") == b"first"


def test_a_cache_deleted_meanwhile_is_made_again(tmp_path):
    write_checked(tmp_path / "gone" / "key", b"all")
    assert read_checked(tmp_path / "gone" / "key") == b"all"


def test_runs_at_once_never_read_half_of_a_file_nor_lose_a_whole_one(tmp_path):
    """All find a folder in the file's place; once one of them has written, every read gives something whole."""
    contents = [bytes([k]) * (1000 + 100_000 * k) for k in range(4)]
    together = Barrier(len(contents))

    def heal(worker: int) -> list[bytes | None]:
        seen = []
        for turn in range(40):
            path = tmp_path / f"{turn}"
            if worker == 0:
                (path / "within").mkdir(parents=True)
            together.wait(timeout=60)
            assert read_checked(path) in {None, *contents}
            write_checked(path, contents[worker])
            seen += [read_checked(path) for _ in range(3)]
        return seen

    with ThreadPoolExecutor(len(contents)) as pool:
        seen = set().union(*pool.map(heal, range(len(contents))))
    assert seen <= set(contents)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == sorted(str(turn) for turn in range(40))


def test_a_folder_that_cannot_be_made_is_one_sentence(tmp_path, monkeypatch):
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(CacheError, match="XDG_CACHE_HOME"):
        cache_folder("anything")


def test_what_killed_processes_left_is_deleted_once_it_is_old(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    old, new = (cache_folder("pvs") / name for name in ("old.part", "new.part"))
    for part in (old, new):
        part.write_bytes(b"half")
    os.utime(old, (0, 0))
    _delete_parts.cache_clear()
    write_checked(cache_root() / "walks" / "key", b"content")
    assert not old.exists()
    assert new.exists()


def test_damage_is_said_once_in_each_folder_and_missing_files_are_not(tmp_path):
    for name in ("one", "two"):
        write_checked(tmp_path / name, b"content")
        (tmp_path / name).write_bytes(b"other")
    with pytest.warns(UserWarning, match="A cached file in .* was damaged: it is made again") as said:
        assert [read_checked(tmp_path / name) for name in ("one", "two", "three")] == [None] * 3
    assert len(said) == 1


def test_warnings_for_people_are_printed_as_sentences(monkeypatch, capsys):
    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)
    warnings_as_sentences()
    warnings.showwarning(UserWarning("It was damaged."), UserWarning, "cache.py", 3)
    assert capsys.readouterr().err == "bench: warning: It was damaged.\n"
    with pytest.warns(RuntimeWarning, match="overflow"):
        warnings.showwarning(RuntimeWarning("overflow"), RuntimeWarning, "metrics.py", 3)
    assert capsys.readouterr().err == ""
