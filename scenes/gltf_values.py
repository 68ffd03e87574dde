"""Values of a glTF file's JSON, checked for type and length; damage becomes ValueError with a sentence."""

from __future__ import annotations

from typing import Any, TypeAlias, overload

JsonObject: TypeAlias = dict[str, Any]  # of a file, its values not yet checked

LONGEST_NAME = 200  # letters that are shown of what stands where a name belongs
_SHOWN = 60  # characters of a wrong value


def number(entry: JsonObject, key: str, default: float) -> float:
    """A number of a JSON object, as a float. Raises ValueError for another value."""
    value = entry.get(key, default)
    if not _is_number(value):
        raise ValueError(f"{key} is {_shown(value)}, not a number")
    return float(value)


@overload
def numbers(entry: JsonObject, key: str, default: tuple[float, float]) -> tuple[float, float]: ...
@overload
def numbers(entry: JsonObject, key: str, default: tuple[float, float, float]) -> tuple[float, float, float]: ...
@overload
def numbers(
    entry: JsonObject, key: str, default: tuple[float, float, float, float]
) -> tuple[float, float, float, float]: ...
@overload
def numbers(entry: JsonObject, key: str, default: tuple[float, ...]) -> tuple[float, ...]: ...
def numbers(entry: JsonObject, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
    """A list of numbers of a JSON object, as long as its default. Raises ValueError for another value."""
    values = entry.get(key, default)
    if not isinstance(values, list | tuple) or len(values) != len(default) or not all(map(_is_number, values)):
        raise ValueError(f"{key} is {_shown(values)}, not a list of {len(default)} numbers")
    return tuple(map(float, values))


def whole(entry: JsonObject, key: str, default: int) -> int:
    """A whole number of a JSON object that is not negative. Raises ValueError for another value."""
    value = entry.get(key, default)
    if type(value) is not int or value < 0:
        raise ValueError(f"{key} is {_shown(value)}, not a whole number from 0")
    return value


def picked(entries: list[JsonObject], index: int, name: str) -> JsonObject:
    """The entry that a file refers to by its number in a list; the list's name is for the sentence. Raises ValueError
    where there is none."""
    if type(index) is not int or not 0 <= index < len(entries):
        raise ValueError(f"the file has no {name}[{_shown(index)}], to which it refers")
    return entries[index]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _shown(value: object) -> str:
    text = repr(list(value) if isinstance(value, tuple) else value)
    return text if len(text) <= _SHOWN else text[:_SHOWN] + "..."
