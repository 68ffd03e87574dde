"""`cameras.json` beside a scene file: viewpoints and scale that the file itself does not say.

A JSON object with `metres_per_unit` (optional: a number, or the name of a unit) and `cameras`, a list of objects with
`eye`, `dir` and `up` (in the coordinates of the file after its node transforms) and `fov_x_deg` or
`fov_min_axis_deg`; only `eye` and `dir` must be. Each object may have a `note` and a `source`, which nobody reads.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TypeAlias

import msgspec
import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.arithmetic.functions import arctan, tan
from shading_atlas_bench.scenes.files import is_file, reason_of
from shading_atlas_bench.scenes.model import Camera, SceneError
from shading_atlas_bench.scenes.units import UNITS

CAMERAS = "cameras.json"
_LARGEST = 1e18  # units: beyond it squared lengths leave float32's range

_Vector: TypeAlias = tuple[float, float, float]


class _View(msgspec.Struct, forbid_unknown_fields=True):
    """A camera as the file has it."""

    eye: _Vector
    dir: _Vector
    up: _Vector = (0.0, 1.0, 0.0)
    fov_x_deg: float | None = None
    fov_min_axis_deg: float | None = None
    note: str = ""
    source: str = ""


class _Content(msgspec.Struct, forbid_unknown_fields=True):
    """The whole file."""

    metres_per_unit: float | str | None = None
    cameras: list[_View] = []
    note: str = ""
    source: str = ""


def read_cameras(file: Path) -> tuple[list[Camera], float | None]:
    """The cameras, in file coordinates, and metres per unit where stated; nothing where the file is missing.

    Raises SceneError where it is not as described above.
    """
    if not is_file(file):
        return [], None
    try:
        content = msgspec.convert(json.loads(file.read_bytes()), _Content)
        cameras = [_camera(view, number) for number, view in enumerate(content.cameras)]
    except OSError as error:
        raise SceneError(f"{file} cannot be read: {reason_of(error)}.") from error
    except json.JSONDecodeError as error:
        raise SceneError(f"{file} is no valid JSON: line {error.lineno}, column {error.colno}.") from error
    except UnicodeDecodeError as error:
        raise SceneError(f"{file} is no valid JSON: it is not UTF-8.") from error
    except msgspec.ValidationError as error:
        raise SceneError(_misfit(error, file)) from error
    except RecursionError as error:
        raise SceneError(f"{file} cannot be used: it is nested too deeply.") from error
    except ValueError as error:
        raise SceneError(f"{file} cannot be used: {error}.") from error
    return cameras, None if content.metres_per_unit is None else _metres(content.metres_per_unit, file)


def _misfit(error: msgspec.ValidationError, file: Path) -> str:
    """The sentence for what is not as described, with its place."""
    what, _, place = str(error).replace("`", "").partition(" - at ")
    place = place.replace("$.", "").replace("$", "the file")
    known = ""
    if "unknown field" in what:
        kind = _View if place.startswith("cameras") else _Content
        known = f"; there may be {', '.join(kind.__struct_fields__)}"
    return f"{file} cannot be used: {what[:1].lower()}{what[1:]}{f', at {place}' if place else ''}{known}."


def _metres(unit: float | str, file: Path) -> float:
    """Metres per unit, from a number or the name of a unit."""
    metres = UNITS.get(unit.strip(), np.nan) if isinstance(unit, str) else unit
    if not (np.isfinite(metres) and metres > 0):
        named = ", ".join(UNITS)
        raise SceneError(f"{file} has metres_per_unit = {json.dumps(unit)}: give a number above 0, or one of {named}.")
    return metres


def _camera(view: _View, number: int) -> Camera:
    vectors = {"eye": view.eye, "dir": view.dir, "up": view.up}
    eye, direction, up = (_usable(vector, name, number) for name, vector in vectors.items())
    fov = _angle(view.fov_x_deg, "fov_x_deg", number)
    high = _angle(view.fov_min_axis_deg, "fov_min_axis_deg", number)
    if fov is None and high is not None:  # the vertical one of a 16:9 picture
        fov = float(np.degrees(2 * arctan(tan(np.radians(high) / 2) * 16 / 9)))
    direction, up = direction / np.linalg.norm(direction, axis=-1), up / np.linalg.norm(up, axis=-1)
    return Camera(tuple(eye.tolist()), tuple(direction.tolist()), tuple(up.tolist()), fov, f"camera {number}")


def _usable(given: _Vector, name: str, number: int) -> Doubles:
    """A position, or a direction of some length. Raises ValueError for another."""
    vector = np.array(given, np.float64)
    if not (np.abs(vector) <= _LARGEST).all() or (name != "eye" and not np.linalg.norm(vector, axis=-1) > 0):
        raise ValueError(f"camera {number} has no usable {name}")
    return vector


def _angle(angle: float | None, name: str, number: int) -> float | None:
    """A field of view in degrees, where it is stated. Raises ValueError for what is none."""
    if angle is not None and not 0 < angle < 180:
        raise ValueError(f"camera {number} has a {name} of {angle:g}, not between 0 and 180")
    return angle
