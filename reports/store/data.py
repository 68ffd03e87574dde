"""Data that others wrote, read through one door: whole regular files of a bounded size, as values of a stated type."""

from __future__ import annotations

import stat
import sys
import tomllib
from pathlib import Path
from typing import TypeVar

import msgspec

from shading_atlas_bench.errors import BenchError

MOST_BYTES = 64_000_000  # of a text file that is read as a whole; those of the largest sweeps have a tenth

Kind = TypeVar("Kind")


class DataError(BenchError, ValueError):
    """Data that is not what it is taken for; the message is a sentence that says where and what."""


def regular_size(file: Path) -> int:
    """The bytes of a regular file, links followed. Raises DataError for a folder, a pipe, a device or no file."""
    try:
        found = file.stat()
    except (OSError, ValueError) as error:  # ValueError: a zero in its name
        raise DataError(f"{file} cannot be read: {_reason(error)}.") from error
    if not stat.S_ISREG(found.st_mode):
        raise DataError(f"{file} cannot be read: it is no regular file.")
    return found.st_size


def read_file(file: Path, most: int = MOST_BYTES) -> bytes:
    """The content of a regular file of at most so many bytes. Raises DataError for others."""
    size = regular_size(file)
    if size > most:
        raise DataError(f"{file} has {size:,} bytes: it may have {most:,}.")
    try:
        with open(file, "rb") as stream:
            content = stream.read(most + 1)
    except OSError as error:
        raise DataError(f"{file} cannot be read: {_reason(error)}.") from error
    if len(content) > most:  # it grew since
        raise DataError(f"{file} has more than {most:,} bytes, which is the most that it may have.")
    return content


def read_text(file: Path) -> str:
    """The text of a regular file of at most MOST_BYTES. Raises DataError for others, and where it is not UTF-8."""
    content = read_file(file)
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise DataError(f"{file} is not UTF-8: {error.reason} at byte {error.start}.") from error


def read_json(file: Path, kind: type[Kind]) -> Kind:
    """A JSON file as a value of a type that msgspec knows. Raises DataError where it is none."""
    return decode_json(read_file(file), kind, str(file))


def decode_json(text: bytes | str, kind: type[Kind], source: str) -> Kind:
    """JSON as a value of a type; `source` names it in errors. Raises DataError where it is none."""
    try:
        return msgspec.json.decode(text, type=kind)
    except msgspec.ValidationError as error:
        raise DataError(_misfit(error, source)) from error
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise DataError(f"{source} is not JSON: {_reason(error)}.") from error


def read_toml(file: Path, kind: type[Kind]) -> Kind:
    """A TOML file as a value of a type. Raises DataError where it is none."""
    text = read_text(file)
    try:
        content = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise DataError(f"{file} is not TOML: {_reason(error)}.") from error
    except ValueError as error:  # of Python's own, which converts no number of thousands of digits
        raise DataError(f"{file} has a number of more than {sys.get_int_max_str_digits():,} digits.") from error
    return as_kind(content, kind, str(file))


def as_kind(value: object, kind: type[Kind], source: str) -> Kind:
    """A value of plain types as one of a stated type; `source` names it in errors. Raises DataError where it is none,
    and whatever the type itself raises of its values."""
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        if error.__cause__ is not None:
            raise error.__cause__ from None
        raise DataError(_misfit(error, source)) from error
    except (UnicodeError, RecursionError) as error:
        raise DataError(f"{source} holds text or nesting that no data has: {_reason(error)}.") from error


def _misfit(error: msgspec.ValidationError, source: str) -> str:
    """The sentence for a value of another type; msgspec says its place, from `$`, the whole."""
    return f"{source} is not what it is taken for: {error}."


def _reason(error: Exception) -> str:
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    return str(getattr(error, "strerror", None) or error).rstrip(".")
