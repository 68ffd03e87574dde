"""The files that a scene file names: which it may name, how their names are encoded, and why one is not there."""

from __future__ import annotations

import contextlib
import os
import stat
import unicodedata
from pathlib import Path, PurePosixPath

from shading_atlas_bench.scenes.memory import check_memory
from shading_atlas_bench.scenes.model import SceneError

# Encodings in which programs have written file names into OBJ, MTL and PLY files, besides UTF-8 and the file system's.
_ENCODINGS = ("cp1252", "cp932", "gb18030", "big5", "cp949", "cp1251")
_KINDS = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
_KINDS |= dict.fromkeys((stat.S_IFCHR, stat.S_IFBLK), "a device")
MISSING = "is missing"


class SceneFiles:
    """The files that a scene file may name: those in its own folder and below, wherever links lead, or with
    `allow_outside` any.

    `exact` takes a name to the letter, as glTF's are meant; `find` one as OBJ, MTL and PLY files have it, in an unknown
    encoding, and in another case than the file's. Names count from the file that has them, which may lie in a folder
    below. SceneError is raised for the name of a file elsewhere, and for that of one that does not fit into memory.
    """

    def __init__(self, scene_file: Path, allow_outside: bool = False) -> None:
        self._scene_file, self._allow_outside = scene_file, allow_outside
        self._folder = scene_file.parent.resolve()
        self._listed: dict[Path, dict[str, list[Path]]] = {}

    def exact(self, file: Path, name: str) -> Path:
        """The path that `file` names; programs on Windows write backslashes between folders. It need not be there."""
        return self._usable(file.parent / name.replace("\\", "/"), name)

    def find(self, file: Path, name: bytes) -> Path | None:
        """The file that `file` names; None where none or several match.

        As it is written comes first, then with backslashes between folders, in other encodings, without quotation marks
        or what may be a comment, and last without regard to upper and lower case.
        """
        forms = _forms(name)
        for some in (forms[:1], forms):
            exact = {path for path in (file.parent / form for form in some) if is_file(path)}
            if len(exact) == 1:
                return self._usable(exact.pop(), name)
        alike = self._alike(file.parent, forms)
        return self._usable(alike.pop(), name) if len(alike) == 1 else None

    def absence(self, file: Path, name: bytes | str) -> str:
        """Why there is no file that `file` names, as what follows the name in a sentence."""
        forms = [name.replace("\\", "/")] if isinstance(name, str) else _forms(name)
        if "://" in forms[0]:
            return "is on the network, and nothing is fetched"
        alike = set() if isinstance(name, str) else self._alike(file.parent, forms)
        if len(alike) > 1:
            return f"is one of several: {', '.join(sorted(shown(path.name) for path in alike))}"
        reasons = (absence(file.parent / form) for form in forms)
        return next((reason for reason in reasons if reason != MISSING), MISSING)

    def _usable(self, path: Path, name: bytes | str) -> Path:
        """The path. Raises SceneError for a file elsewhere, and for one that does not fit into memory."""
        if is_file(path):
            self._check_place(path, name)
            check_memory(path.stat().st_size, f"the file {shown(path.name)}")
        return path

    def _check_place(self, path: Path, name: bytes | str) -> None:
        """Raises SceneError for a file elsewhere, by its name or by links."""
        end = path.resolve()
        if self._allow_outside or end.is_relative_to(self._folder):
            return
        written, own = (Path(os.path.abspath(place)) for place in (path, self._scene_file.parent))
        place = f"which leads by a link to {shown(str(end))}," if written.is_relative_to(own) else "a file"
        sentence = f"{self._scene_file} names {shown(name)}, {place} outside of its folder"
        raise SceneError(f"{sentence}: --allow-outside reads such files too.")

    def _alike(self, folder: Path, forms: list[str]) -> set[Path]:
        """Files below a folder whose names differ from one of the forms by upper and lower case or composed accents
        only."""
        return {path for form in forms for path in self._alike_paths(folder, form) if is_file(path)}

    def _alike_paths(self, folder: Path, form: str) -> list[Path]:
        places = [folder]
        for part in PurePosixPath(form).parts:
            if part == "..":
                places = [place / part for place in places]
            else:
                places = [child for place in places for child in self._children(place).get(_key(part), [])]
        return places

    def _children(self, folder: Path) -> dict[str, list[Path]]:
        """What is in a folder, by `_key`, listed once; nothing where it cannot be listed.

        Of folders elsewhere only the way back to the scene's own is known: what else they hold is not looked for.
        """
        if folder not in self._listed:
            found = self._listed[folder] = {}
            with contextlib.suppress(OSError, ValueError):
                for child in self._visible(folder):
                    found.setdefault(_key(child.name), []).append(child)
        return self._listed[folder]

    def _visible(self, folder: Path) -> list[Path]:
        end = folder.resolve()
        if self._allow_outside or end.is_relative_to(self._folder):
            return list(folder.iterdir())
        return [folder / self._folder.relative_to(end).parts[0]] if self._folder.is_relative_to(end) else []


def absence(path: Path) -> str:
    """Why there is no file of that name, as what follows the name in a sentence."""
    try:
        kind = stat.S_IFMT(path.stat().st_mode)
    except PermissionError:
        return "cannot be reached: permission is denied"
    except (OSError, ValueError):
        with contextlib.suppress(OSError, ValueError):
            return f"is a link to {shown(os.readlink(path))}, which is missing"
        return MISSING
    return f"is {_KINDS.get(kind, 'no plain file')}, which is not read"


def reason_of(error: OSError) -> str:
    """Why a file cannot be read, as the system has it, to follow a colon."""
    if isinstance(error, PermissionError):
        return "permission is denied"
    text = error.strerror or str(error) or type(error).__name__
    return text[:1].lower() + text[1:]


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


def shown(name: bytes | str) -> str:
    """A name for people: UTF-8, and \\xNN for bytes that are not; different names stay different."""
    return (name if isinstance(name, bytes) else os.fsencode(name)).decode("utf-8", errors="backslashreplace")


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
