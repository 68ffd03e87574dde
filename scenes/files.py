"""Files that a scene file names, and how their names and its text are encoded."""

from __future__ import annotations

import contextlib
import os
import unicodedata
from pathlib import Path, PurePosixPath

from shading_atlas_bench.scenes.memory import check_memory
from shading_atlas_bench.scenes.model import SceneError

# Encodings in which programs have written file names into OBJ, MTL and PLY files, besides UTF-8 and the file system's.
_ENCODINGS = ("cp1252", "cp932", "gb18030", "big5", "cp949", "cp1251")
_MARKS = {b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}
_LINE_ENDS = bytes.maketrans(bytes(range(32)), b" " * 10 + b"\n" + b" " * 2 + b"\n" + b" " * 18)


class SceneFiles:
    """The files that a scene file may name: those in its own folder and below, wherever links lead, or with
    `allow_outside` any.

    Names count from the file that has them, which may lie in a folder below. A name of a file elsewhere raises
    SceneError; one of nothing is just that of a missing file.
    """

    def __init__(self, scene_file: Path, allow_outside: bool = False) -> None:
        self._scene_file, self._allow_outside = scene_file, allow_outside
        self._folder = scene_file.parent.resolve()
        self._listed: dict[Path, dict[str, list[Path]]] = {}

    def own(self, name: str) -> Path:
        """The file of this name in the scene's folder; it need not be there."""
        return self.beside(self._scene_file, name)

    def beside(self, file: Path, name: str) -> Path:
        """The file that `file` names; programs on Windows write backslashes between folders. It need not be there."""
        return self._allowed(file.parent / name.replace("\\", "/"), name)

    def find(self, file: Path, name: bytes) -> Path | None:
        """The file that `file` names in an unknown encoding; None where none or several match.

        As it is written comes first, then with backslashes between folders, in other encodings, without quotation marks
        or what may be a comment, and last without regard to upper and lower case.
        """
        forms = _forms(name)
        for some in (forms[:1], forms):
            exact = {path for path in (file.parent / form for form in some) if is_file(path)}
            if len(exact) == 1:
                return self._allowed(exact.pop(), name)
        alike = {path for form in forms for path in self._alike(file.parent, form) if is_file(path)}
        return self._allowed(alike.pop(), name) if len(alike) == 1 else None

    def _allowed(self, path: Path, name: bytes | str) -> Path:
        """The path. Raises SceneError for a file elsewhere, and for one that no memory holds."""
        if not is_file(path):
            return path
        check_memory(path.stat().st_size, f"The file {shown(path.name)}")
        if self._allow_outside or path.resolve().is_relative_to(self._folder):
            return path
        sentence = f"{self._scene_file} names {shown(name)}, a file outside of its folder"
        raise SceneError(f"{sentence}: --allow-outside reads such files too.")

    def _alike(self, folder: Path, form: str) -> list[Path]:
        """Paths below a folder whose names differ from the form's by upper and lower case or composed accents only."""
        places = [folder]
        for part in PurePosixPath(form).parts:
            if part == "..":
                places = [place / part for place in places]
            else:
                places = [child for place in places for child in self._children(place).get(_key(part), [])]
        return places

    def _children(self, folder: Path) -> dict[str, list[Path]]:
        """What is in a folder, by `_key`, listed once; nothing where it cannot be listed."""
        if folder not in self._listed:
            found = self._listed[folder] = {}
            with contextlib.suppress(OSError, ValueError):
                for child in folder.iterdir():
                    found.setdefault(_key(child.name), []).append(child)
        return self._listed[folder]


def written_differently(name: bytes, file: Path) -> bool:
    """Whether a file that `SceneFiles.find` found has another name than it was named by, slashes and quotes aside."""
    plain = name.strip(b"\"'").replace(b"\\", b"/").removeprefix(b"./")
    return not shown(file.as_posix()).endswith(shown(plain))


def is_file(path: Path) -> bool:
    """Whether there is such a file; False for names that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_there(path: Path) -> bool:
    """Whether there is anything of that name; False for names that nothing can have."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def is_utf8(path: Path) -> bool:
    """Whether a path can be written as UTF-8; others hold bytes that Python keeps as they are."""
    try:
        return bool(str(path).encode())
    except UnicodeEncodeError:
        return False


def shown(name: bytes | str) -> str:
    """A name for people: UTF-8, and \\xNN for bytes that are not; different names stay different."""
    return (name if isinstance(name, bytes) else os.fsencode(name)).decode("utf-8", errors="backslashreplace")


def file_text(path: Path) -> bytes:
    """A text file's bytes with lines that end in \\n, without a byte order mark and control characters.

    UTF-16 becomes UTF-8; other encodings stay as they are, all of them hold ASCII.
    """
    data = path.read_bytes()
    encoding = _MARKS.get(data[:2])
    data = data[2:].decode(encoding, errors="replace").encode() if encoding else data.removeprefix(b"\xef\xbb\xbf")
    return data.replace(b"\r\n", b"\n").translate(_LINE_ENDS)


def _forms(name: bytes) -> list[str]:
    """What a name may mean, the likeliest first."""
    texts = [os.fsdecode(name)] if os.name == "posix" else []
    for encoding in ("utf-8", *_ENCODINGS) if not name.isascii() or not texts else ():
        with contextlib.suppress(UnicodeDecodeError):
            texts.append(name.decode(encoding))
    texts = texts or [name.decode("latin-1")]
    bare = [text[1:-1] for text in texts if len(text) > 2 and text[0] == text[-1] and text[0] in "\"'"]
    bare += [text.partition(" #")[0].rstrip() for text in texts if text.partition(" #")[0].strip()]
    return list(dict.fromkeys(form for text in [*texts, *bare] for form in (text, text.replace("\\", "/"))))


def _key(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()
