"""The cache: whole files or none, and never a reason for a run to fail."""

import pytest

from kernels.cache import CacheError, cache_folder, write_atomically


def test_a_write_that_fails_leaves_nothing_behind(tmp_path):
    def fails(file):
        file.write(b"half")
        raise ValueError("no more")

    with pytest.raises(ValueError, match="no more"):
        write_atomically(tmp_path / "file", fails)
    assert list(tmp_path.iterdir()) == []


def test_a_cache_deleted_meanwhile_is_no_error(tmp_path):
    folder = tmp_path / "gone"
    write_atomically(folder / "file", lambda file: file.write(b"all"))
    assert not folder.exists()


def test_files_are_replaced_whole(tmp_path):
    for content in (b"first", b"second"):
        write_atomically(tmp_path / "file", lambda file, content=content: file.write(content))
    assert (tmp_path / "file").read_bytes() == b"second"
    assert len(list(tmp_path.iterdir())) == 1


def test_a_folder_that_cannot_be_made_is_one_sentence(tmp_path, monkeypatch):
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(CacheError, match="XDG_CACHE_HOME"):
        cache_folder("anything")
