"""What a scene is loaded from besides its own file: every file that its reader asks for, there or not."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TypeAlias

from shading_atlas_bench.scenes.files import SceneFiles
from shading_atlas_bench.scenes.model import SceneError

# A file that was asked for: the file that names it; the name, and whether it is meant to the letter; the file that was
# found, and its content's digest, None where there is none. Paths count from the scene file's folder.
Input: TypeAlias = tuple[str, str, bool, str | None, str | None]


class InputFiles(SceneFiles):
    """As its base, with a record of all files that were asked for.

    A content's digest is taken before the file is read: what changes in between is taken for changed later.
    """

    def __init__(self, scene_file: Path, allow_outside: bool = False) -> None:
        super().__init__(scene_file, allow_outside)
        self._home = scene_file.parent
        self._asked: dict[tuple[Path, bytes | str], Input] = {}
        self._contents: dict[Path, str | None] = {}

    def exact(self, file: Path, name: str) -> Path:
        """As that of the base, and recorded."""
        path = super().exact(file, name)
        self._record(file, name, path)
        return path

    def find(self, file: Path, name: bytes) -> Path | None:
        """As that of the base, and recorded."""
        path = super().find(file, name)
        self._record(file, name, path)
        return path

    @property
    def asked(self) -> list[Input]:
        """The files that were asked for, each once, in that order."""
        return list(self._asked.values())

    def unchanged(self, inputs: list[Input]) -> bool:
        """Whether the same files, with the same content, are found as when these were asked for."""
        try:
            for asked in inputs:
                namer, written, to_the_letter = asked[:3]
                file, name = self._home / namer, written if to_the_letter else written.encode("latin-1")
                _ = self.exact(file, name) if isinstance(name, str) else self.find(file, name)
                if self._asked[file, name] != asked:
                    return False
        except SceneError:  # loading says why, where it is still so
            return False
        return True

    def _record(self, file: Path, name: bytes | str, path: Path | None) -> None:
        if (file, name) in self._asked:
            return
        if path is not None and path not in self._contents:
            self._contents[path] = _content(path)
        self._asked[file, name] = (
            self._from_home(file),
            name if isinstance(name, str) else name.decode("latin-1"),
            isinstance(name, str),
            None if path is None else self._from_home(path),
            None if path is None else self._contents[path],
        )

    def _from_home(self, path: Path) -> str:
        return (path.relative_to(self._home) if path.is_relative_to(self._home) else path).as_posix()


def _content(path: Path) -> str | None:
    """The digest of a file's bytes; None where it cannot be read."""
    try:
        if not path.is_file():  # others might block
            return None
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, lambda: hashlib.blake2b(digest_size=16)).hexdigest()
    except (OSError, ValueError):
        return None
