"""`cameras.json` beside a scene file: viewpoints and scale that the file itself does not say.

A JSON object with `metres_per_unit` (optional: a number, or the name of a unit) and `cameras`, a list of objects with
`eye`, `dir` and `up` (in the coordinates of the file after its node transforms) and `fov_x_deg` or
`fov_min_axis_deg`; only `eye` and `dir` must be.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.arithmetic.functions import arctan, tan
from shading_atlas_bench.scenes.files import is_file, reason_of
from shading_atlas_bench.scenes.model import Camera, SceneError
from shading_atlas_bench.scenes.units import UNITS

CAMERAS = "cameras.json"
_LARGEST = 1e18  # units: beyond it squared lengths leave float32's range


def read_cameras(file: Path) -> tuple[list[Camera], float | None]:
    """The cameras, in file coordinates, and metres per unit where stated; nothing where the file is missing.

    Raises SceneError where it is not as described above.
    """
    if not is_file(file):
        return [], None
    try:
        entries, unit = _content(json.loads(file.read_bytes()))
        cameras = [_camera(entry, number) for number, entry in enumerate(entries)]
    except OSError as error:
        raise SceneError(f"{file} cannot be read: {reason_of(error)}.") from error
    except UnicodeDecodeError as error:
        raise SceneError(f"{file} is no valid JSON: it is not UTF-8.") from error
    except json.JSONDecodeError as error:
        raise SceneError(f"{file} is no valid JSON: line {error.lineno}, column {error.colno}.") from error
    except KeyError as error:
        raise SceneError(f"{file} has a camera without {error}.") from error
    except RecursionError as error:
        raise SceneError(f"{file} cannot be used: it is nested too deeply.") from error
    except ValueError as error:
        raise SceneError(f"{file} cannot be used: {error}.") from error
    return cameras, None if unit is None else _metres(unit, file)


def _content(content: Any) -> tuple[list[dict[str, Any]], Any]:
    """The entries of cameras, and the unit, None where there is none."""
    if not isinstance(content, dict):
        raise ValueError("it is no object")
    entries = content.get("cameras", [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise ValueError("its cameras are no list of objects")
    return entries, content.get("metres_per_unit")


def _metres(unit: Any, file: Path) -> float:
    """Metres per unit, from a number or the name of a unit."""
    try:
        metres = UNITS[unit.strip()] if isinstance(unit, str) and unit.strip() in UNITS else float(unit)
    except (ValueError, TypeError):
        metres = np.nan
    if not (np.isfinite(metres) and metres > 0):
        named = ", ".join(UNITS)
        raise SceneError(f"{file} has metres_per_unit = {json.dumps(unit)}: give a number above 0, or one of {named}.")
    return metres


def _camera(entry: dict[str, Any], number: int) -> Camera:
    entry = {"up": (0, 1, 0), **entry}
    direction, eye, up = (_vector(entry, name, number) for name in ("dir", "eye", "up"))
    fov = _angle(entry, "fov_x_deg", number)
    high = _angle(entry, "fov_min_axis_deg", number)
    if fov is None and high is not None:  # the vertical one of a 16:9 picture
        fov = float(np.degrees(2 * arctan(tan(np.radians(high) / 2) * 16 / 9)))
    direction, up = direction / np.linalg.norm(direction, axis=-1), up / np.linalg.norm(up, axis=-1)
    return Camera(tuple(eye.tolist()), tuple(direction.tolist()), tuple(up.tolist()), fov, f"camera {number}")


def _vector(entry: dict[str, Any], name: str, number: int) -> Doubles:
    """A position, or a direction of some length."""
    try:
        vector = np.array(entry[name], np.float64)
    except (ValueError, TypeError, OverflowError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not (np.abs(vector) <= _LARGEST).all():
        raise ValueError(f"camera {number} has no usable {name}")
    if name != "eye" and not np.linalg.norm(vector, axis=-1) > 0:
        raise ValueError(f"camera {number} has no usable {name}")
    return vector


def _angle(entry: dict[str, Any], name: str, number: int) -> float | None:
    """A field of view in degrees, where it is stated."""
    if name not in entry:
        return None
    try:
        angle = float(entry[name])
    except (ValueError, TypeError, OverflowError):
        raise ValueError(f"camera {number} has a {name} that is no number") from None
    if not 0 < angle < 180:
        raise ValueError(f"camera {number} has a {name} of {angle:g}, not between 0 and 180")
    return angle
