"""Camera paths: walk, orbit, turntable, the scene's own animation, or a text file.

A text file has one pose per line: time in milliseconds, position x y z in the scene's own coordinates and units, and
the camera-to-world quaternion x y z w (the camera looks along its -z, y is up), separated by blanks or commas. `#`
starts a comment; empty lines are skipped; times grow by 1 ms at least. Quaternions of any length but zero are
normalised.
"""

from __future__ import annotations

import difflib
import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from shading_atlas_bench.arithmetic import draws
from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.arithmetic.functions import arcsin, arctan2, cos, hypot, sin, tan
from shading_atlas_bench.errors import BenchError
from shading_atlas_bench.scenes.files import MISSING, absence, is_file, reason_of
from shading_atlas_bench.scenes.lines import curve, smoothed
from shading_atlas_bench.scenes.model import Scene
from shading_atlas_bench.scenes.quaternions import about, looking, multiply, slerp
from shading_atlas_bench.scenes.rays import Rays
from shading_atlas_bench.scenes.standing import FOUND, decide
from shading_atlas_bench.scenes.walking import EYE_HEIGHT, route_from
from shading_atlas_bench.scenes.work import WorkError

RATE = 60.0  # frames per second
WALK_FRAMES, ORBIT_FRAMES = 660, 300
LEAD_OUT = 60  # frames that a path goes on after its last one: a second, more than any latency
MOST_FRAMES = 36_000  # of an animation: ten minutes
SPEED = 1.0  # of a person who looks around, metres per second
STEP = 0.3  # metres, of a person without room to walk
TURNTABLE_STEP = 5.0  # degrees per frame
# Half angles, in degrees, of the view that an orbit fits its object in: 60 degrees across in 16:9.
HALF_ACROSS, HALF_UP = 30.0, 18.0

_LARGEST = 1e18  # in a file: beyond it squares leave float32's range
_CLOSEST_MS = 1.0  # between poses of a path: more than a thousand a second are no walk
_ROUNDED = 1 - 1e-6  # of such a distance is enough, as times are rounded
_SHORTEST = 1e-100  # quaternion, as a file has it, whose squares can be added

_PATHS = {
    "walk": "a person's walk through the scene with head bob and a look around, 660 frames at 60 Hz; objects: orbit",
    "orbit": "once around the scene, 300 frames at 60 Hz",
    "turntable": "about the object, 5 degrees per frame, 72 frames at 60 Hz",
    "animation": "the camera animation that came with the scene, at 60 Hz",
}


class PathError(BenchError, ValueError):
    """A camera path or head motion that cannot be used; the message is one sentence."""


@dataclass(frozen=True)
class Poses:
    """Poses in time: times_ms float64 (N), positions float64 (N, 3), orientations float64 (N, 4) x, y, z, w."""

    times_ms: Doubles
    positions: Doubles
    orientations: Doubles

    def part(self, start: int, stop: int | None) -> Poses:
        """The poses start..stop-1."""
        return Poses(self.times_ms[start:stop], self.positions[start:stop], self.orientations[start:stop])

    def at(self, times_ms: Doubles) -> Poses:
        """Poses at times (N): the first one before it, interpolated, and going on at the last speed after the end."""
        count = len(self.times_ms)
        times = np.maximum(times_ms, self.times_ms[0])
        here = np.searchsorted(self.times_ms, times, side="right") - 1
        known = ((self.times_ms[here] == times) | (count == 1))[:, None]
        a = np.minimum(here, max(count - 2, 0))
        b = np.minimum(a + 1, count - 1)
        span = self.times_ms[b] - self.times_ms[a]
        # Two keys of one time have no speed: the later one stays.
        share = np.divide(times - self.times_ms[a], span, out=np.ones(len(times)), where=span > 0)
        positions = self.positions[a] + share[:, None] * (self.positions[b] - self.positions[a])
        orientations = slerp(self.orientations[a], self.orientations[b], share)
        return Poses(
            times_ms,
            np.where(known, self.positions[here], positions),
            np.where(known, self.orientations[here], orientations),
        )


@dataclass(frozen=True)
class CameraPath:
    """The server camera's pose for every frame, and where it goes after the last one.

    times_ms: float64 (N), growing. positions: float64 (N, 3), relative to the scene's origin, in scene units.
    orientations: float64 (N, 4), unit quaternions x, y, z, w, camera to world; the camera looks along -z, y is up.
    beyond: the poses after the last frame. notes: sentences for the report.
    """

    name: str
    times_ms: Doubles
    positions: Doubles
    orientations: Doubles
    beyond: Poses | None = None
    notes: tuple[str, ...] = ()

    @property
    def frames(self) -> int:
        """How many poses it has."""
        return len(self.times_ms)

    @property
    def poses(self) -> Poses:
        """Its poses, without those beyond."""
        return Poses(self.times_ms, self.positions, self.orientations)

    @property
    def hash(self) -> str:
        """16 hex digits over the exact bytes of all poses."""
        digest = hashlib.blake2b(digest_size=8)
        for poses in (self.poses, self.beyond):
            if poses is not None:
                for array in (poses.times_ms, poses.positions, poses.orientations):
                    digest.update(np.ascontiguousarray(array, np.float64).tobytes())
        return digest.hexdigest()

    def pose_at(self, t_ms: float) -> tuple[Doubles, Doubles]:
        """Position (3) and orientation (4) at a time: interpolated, and going on at the last speed after the end.

        Before the first pose it is the first pose.
        """
        poses = self.poses if self.beyond is None or t_ms <= self.times_ms[-1] else self._end(self.beyond)
        pose = poses.at(np.array([t_ms], np.float64))
        return pose.positions[0], pose.orientations[0]

    def _end(self, beyond: Poses) -> Poses:
        """The last frame and all beyond."""
        return Poses(
            np.concatenate([self.times_ms[-1:], beyond.times_ms]),
            np.concatenate([self.positions[-1:], beyond.positions]),
            np.concatenate([self.orientations[-1:], beyond.orientations]),
        )


def list_paths() -> dict[str, str]:
    """Names of the built-in paths and what each is."""
    return dict(_PATHS)


def make_path(scene: Scene, name_or_file: str, frames: int | None = None, seed: int = 0) -> CameraPath:
    """The first `frames` poses (None: all) of a built-in path or of a text file, for a scene.

    walk: objects, and scenes without room to walk, are orbited instead, and a note says so. Raises PathError for an
    unknown name, a scene without animation, a malformed file (naming its line) or a number of frames below 1.
    """
    if frames is not None and frames < 1:
        raise PathError(f"A path needs at least one frame, not {frames}.")
    notes: list[str] = []
    name = name_or_file
    if name == "walk":
        poses = _walk(scene, seed, notes)
        name = "orbit" if poses is None else "walk"
        poses = _orbit(scene) if poses is None else poses
        whole = len(poses.times_ms) - LEAD_OUT
    elif name == "orbit":
        poses, whole = _orbit(scene), ORBIT_FRAMES
    elif name == "turntable":
        poses, whole = _turntable(scene), round(360 / TURNTABLE_STEP)
    elif name == "animation":
        poses = _animation(scene)
        whole = len(poses.times_ms)
    else:
        poses = read_path(_file(name), scene.origin)
        name, whole = Path(name).stem, len(poses.times_ms)
    if frames is not None and frames > whole:
        notes.append(f"The path {name} has {whole} frames; {frames} were asked for.")
    count = whole if frames is None else min(frames, whole)
    here, beyond = poses.part(0, count), poses.part(count, None)
    return CameraPath(
        name,
        here.times_ms,
        here.positions,
        here.orientations,
        beyond if len(beyond.times_ms) else None,
        tuple(notes),
    )


def _file(name: str) -> Path:
    """The path's file; PathError with the nearest known name otherwise."""
    file = Path(name)
    if is_file(file):
        return file
    if (why := absence(file)) != MISSING:
        raise PathError(f"{file} {why}.")
    near = difflib.get_close_matches(name, _PATHS, 1)
    hint = f"; did you mean {near[0]}?" if near else "."
    raise PathError(f"There is no path or file {name!r}; the paths are {', '.join(_PATHS)}{hint}")


def read_path(file: Path, origin: Doubles) -> Poses:
    """Poses of a text file (see above) relative to `origin`, float64 (3), or PathError naming the file and the line."""
    rows = read_numbers(file, 8, "t_ms, x, y, z, qx, qy, qz, qw", _CLOSEST_MS)
    table = np.array([row for _, row in rows])
    turns = table[:, 4:]
    lengths = np.linalg.norm(turns, axis=1)
    tiny = lengths < _SHORTEST  # their squares are none
    turns[tiny] /= np.maximum(np.abs(turns[tiny]).max(axis=1, initial=0), np.finfo(float).smallest_subnormal)[:, None]
    lengths[tiny] = np.linalg.norm(turns[tiny], axis=1)
    for (line, _), length in zip(rows, lengths, strict=True):
        if not length > 0:
            raise PathError(f"{file}, line {line}: the quaternion is zero.")
    return Poses(table[:, 0].copy(), table[:, 1:4] - origin, turns / lengths[:, None])


def read_numbers(
    file: Path, columns: int, meaning: str, least: float, header: bool = False
) -> list[tuple[int, list[float]]]:
    """Line numbers and values of a text table whose first column, times, grows by `least` or more from line to line.

    `#` starts a comment, values are separated by blanks or commas. header: the first line is not read.
    Raises PathError naming the file and the line where there are not `columns` numbers, none larger than 1e18.
    """
    if not is_file(file):  # others, as pipes, may have no end
        why = absence(file)
        raise PathError(f"There is no file {file}." if why == MISSING else f"{file} {why}.")
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise PathError(f"{file} cannot be read: {reason_of(error)}.") from error
    except UnicodeDecodeError as error:
        raise PathError(f"{file} cannot be read as text: it is not UTF-8.") from error
    rows: list[tuple[int, list[float]]] = []
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words or (header and number == 1):
            continue
        values = [_number(word) for word in words]
        wrong = [place for place, value in enumerate(values, 1) if not np.isfinite(value)]
        if len(values) != columns or wrong:  # its words are not shown: by mistake it may be a file of secrets
            found = f"found {len(values)}" if len(values) != columns else f"value {wrong[0]} is no finite number"
            raise PathError(f"{file}, line {number}: expected {columns} numbers ({meaning}), {found}.")
        if max(map(abs, values)) > _LARGEST:
            raise PathError(f"{file}, line {number}: {max(values, key=abs):g} is larger than {_LARGEST:g}.")
        if rows and not values[0] > rows[-1][1][0]:
            raise PathError(f"{file}, line {number}: time {values[0]:g} does not follow {rows[-1][1][0]:g}.")
        if rows and values[0] - rows[-1][1][0] < least * _ROUNDED:
            raise PathError(f"{file}, line {number}: time {values[0]:g} is less than {least:g} after the one before.")
        rows.append((number, values))
    if not rows:
        raise PathError(f"{file} has no poses; each line needs {columns} numbers ({meaning}).")
    return rows


def _number(word: str) -> float:
    """The number that a word is, or not a number: Python's float takes further digits, and _ between them."""
    if not word.isascii() or "_" in word:
        return np.nan
    try:
        return float(word)
    except ValueError:
        return np.nan


def _frame_times(count: int) -> Doubles:
    return np.arange(count, dtype=np.float64) * 1000.0 / RATE


def _circle(centre: Doubles, distance: float, degrees: Doubles, elevation: float) -> Poses:
    """Poses on a circle around `centre` at angles (N), from +z towards +x, `elevation` degrees above it."""
    angle, tilt = np.radians(degrees), np.radians(elevation)
    outwards = np.stack([sin(angle) * cos(tilt), np.full(len(angle), sin(tilt)), cos(angle) * cos(tilt)], axis=1)
    return Poses(_frame_times(len(degrees)), centre + outwards * distance, looking(-outwards))


def _framing(scene: Scene) -> tuple[Doubles, float]:
    """The centre of the scene, and the distance from which a circling camera has all of it in view."""
    low, high = _extent(scene)
    centre, half = (low + high) / 2, (high - low) / 2
    across = max(hypot(half[0], half[2]), 1e-3 * half[1])
    fits = across / sin(np.radians(HALF_ACROSS)), across + half[1] / tan(np.radians(HALF_UP))
    return centre, 1.1 * max(fits)


def _extent(scene: Scene) -> tuple[Doubles, Doubles]:
    """What an orbit frames: an object's bounds; of a place the middle nine tenths of its triangles along each axis."""
    if not scene.place:
        return scene.bounds
    step = max(1, scene.triangle_count // 200_000)
    centres = scene.positions[scene.indices[::step]].mean(axis=1, dtype=np.float64)
    low, high = np.quantile(centres, 0.05, axis=0), np.quantile(centres, 0.95, axis=0)
    return (low, high) if np.any(high > low) else scene.bounds


def _orbit(scene: Scene) -> Poses:
    """Around what an object's own camera looks at, from where it stands; else around the whole scene."""
    degrees = np.arange(ORBIT_FRAMES + LEAD_OUT) * 360 / ORBIT_FRAMES
    for camera in scene.cameras[: 0 if scene.place else 1]:
        direction = np.asarray(camera.direction, np.float64) / np.linalg.norm(camera.direction, axis=-1)
        distance = Rays(scene).distance(np.asarray(camera.position), direction)
        if np.isfinite(distance):
            subject = np.asarray(camera.position) + direction * distance
            # As large in the client's picture as in the camera's own.
            closer = tan(np.radians((camera.fov_x or 2 * HALF_ACROSS) / 2)) / tan(np.radians(HALF_ACROSS))
            start = np.degrees(arctan2(-direction[0], -direction[2]))
            elevation = np.degrees(arcsin(-direction[1]))
            return _circle(subject, distance * min(1.0, closer), degrees + start, elevation)
    return _circle(*_framing(scene), degrees, 30.0 if scene.place else 15.0)


def _turntable(scene: Scene) -> Poses:
    degrees = np.arange(round(360 / TURNTABLE_STEP) + LEAD_OUT, dtype=np.float64) * TURNTABLE_STEP
    return _circle(*_framing(scene), degrees, 5.0)


def _animation(scene: Scene) -> Poses:
    """The scene's first camera animation at 60 Hz."""
    if not scene.animations:
        raise PathError(f"The scene {scene.name} has no camera animation; choose walk, orbit or turntable.")
    animation = scene.animations[0]
    keys = Poses(
        np.asarray(animation.times, np.float64),
        np.asarray(animation.positions, np.float64),
        np.asarray(animation.orientations, np.float64),
    )
    start, end = keys.times_ms[0], keys.times_ms[-1]
    times = _frame_times(int(min((end - start) * RATE / 1000 + 1e-6, MOST_FRAMES)) + 1)
    return replace(keys.at(start + times), times_ms=times)


def _walk(scene: Scene, seed: int, notes: list[str]) -> Poses | None:
    """A walk with a lead-out, or None with a note where nobody can walk."""
    if not scene.place:
        notes.append("The scene is an object, not a place: walk falls back to orbit.")
        return None
    length = SPEED * (WALK_FRAMES + LEAD_OUT) / RATE + 0.5
    if scene.route is not None:
        eyes = scene.route + np.array([0.0, EYE_HEIGHT / scene.metres_per_unit, 0.0])
        direction = np.asarray(scene.cameras[0].direction) if scene.cameras else eyes[1] - eyes[0]
        return _stroll(_rounded(eyes), direction, scene.metres_per_unit, seed)
    camera = scene.cameras[0] if scene.cameras else decide(scene).camera
    if camera is None:
        notes.append("The scene has no room to walk: walk falls back to orbit.")
        return None
    who = "viewpoint found in the scene" if camera.name == FOUND else "scene's camera"
    if camera.name == FOUND:
        notes.append("The walk starts at a viewpoint found inside the scene.")
    eye, direction = np.array(camera.position), np.array(camera.direction)
    try:
        route = route_from(scene, eye, direction, length)
    except WorkError:
        notes.append(f"So much stands around the {who} that the person there takes a small step and looks around.")
        return _stand(scene, eye, direction, seed)
    if route is not None and _in_sight(scene, eye, route.eyes[0]):
        if not route.on_floor:
            notes.append(f"The {who} does not stand on a floor: the walk stays at its height.")
        return _stroll(route.eyes, route.direction, scene.metres_per_unit, seed)
    notes.append(f"The {who} has no room to walk: the person there takes a small step and looks around.")
    return _stand(scene, eye, direction, seed)


def _in_sight(scene: Scene, eye: Doubles, other: Doubles) -> bool:
    """Whether nothing stands between two points: the nearest free place may lie behind a wall."""
    way = other - eye
    length = float(np.linalg.norm(way, axis=-1))
    return length == 0 or Rays(scene).distance(eye, way / length) > length


def _stand(scene: Scene, eye: Doubles, direction: Doubles, seed: int) -> Poses:
    """One slow step from `eye` the way the camera looks, at most STEP metres and a quarter of what is free."""
    ahead = direction / np.linalg.norm(direction, axis=-1)
    free = Rays(scene).distance(eye, ahead) * scene.metres_per_unit
    step = min(STEP, free / 4)
    eyes = np.stack([eye, eye + ahead * step / scene.metres_per_unit])
    return _stroll(eyes, ahead, scene.metres_per_unit, seed, step * RATE / (WALK_FRAMES + LEAD_OUT))


def _rounded(points: Doubles) -> Doubles:
    """A polyline (N, 3) as a smooth line with a point about every twentieth of a leg."""
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    fine = np.linspace(0, along[-1], 20 * len(points))
    return curve(along, points, fine)


def _stroll(eyes: Doubles, direction: Doubles, metres_per_unit: float, seed: int, speed: float = SPEED) -> Poses:
    """A walk with the eyes along a line (N, 3), looking along `direction` first: steps, sway, a look around.

    Steps: 1.9 a second, 2 cm up and down; sway half as often. The gaze follows the way with a lag and wanders by about
    10 degrees aside and 4 up and down.
    """
    count = WALK_FRAMES + LEAD_OUT
    t = np.arange(count) / RATE
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(eyes, axis=0), axis=1))]) * metres_per_unit
    track = np.stack([np.interp(t * speed, along, eyes[:, k]) for k in range(3)], axis=1)
    heading = np.gradient(smoothed(track, 0.15 * RATE), axis=0)
    yaw = np.unwrap(arctan2(-heading[:, 0], -heading[:, 2]))
    yaw = smoothed(yaw, 0.6 * RATE)
    phase = draws.generator([seed, 660]).uniform(0, 2 * np.pi, 4)
    yaw += np.radians(7) * sin(2 * np.pi * 0.11 * t + phase[0]) + np.radians(3) * sin(2 * np.pi * 0.29 * t + phase[1])
    pitch = np.radians(-3) + np.radians(3) * sin(2 * np.pi * 0.17 * t + phase[2])
    first = direction / np.linalg.norm(direction, axis=-1)
    settled = np.clip(t / 3.0, 0, 1)
    settled = settled * settled * (3 - 2 * settled)
    off = arctan2(-first[0], -first[2]) - yaw[0]
    yaw += (1 - settled) * ((off + np.pi) % (2 * np.pi) - np.pi)
    pitch = settled * pitch + (1 - settled) * arcsin(np.clip(first[1], -0.5, 0.5))
    right = np.stack([cos(yaw), 0 * yaw, -sin(yaw)], axis=1)
    bob = 0.02 * sin(2 * np.pi * 1.9 * t)
    sway = 0.012 * sin(2 * np.pi * 0.95 * t + phase[3])
    track = track + (right * sway[:, None] + np.array([0.0, 1.0, 0.0]) * bob[:, None]) / metres_per_unit
    return Poses(_frame_times(count), track, multiply(about(1, yaw), about(0, pitch)))
