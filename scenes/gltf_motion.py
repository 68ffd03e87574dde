"""Animated cameras of a glTF file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Doubles
from shading_atlas_bench.arithmetic.functions import arctan2, sin
from shading_atlas_bench.arithmetic.matrices import dot, product
from shading_atlas_bench.scenes.gltf_document import GltfDocument
from shading_atlas_bench.scenes.gltf_nodes import AT_REST, GltfNodes
from shading_atlas_bench.scenes.gltf_values import JsonObject, numbers, picked
from shading_atlas_bench.scenes.model import CameraAnimation
from shading_atlas_bench.scenes.quaternions import from_matrix
from shading_atlas_bench.scenes.raw import RawScene
from shading_atlas_bench.scenes.transforms import compose
from shading_atlas_bench.scenes.work import Work, WorkError

_STEP_MS = 1000 / 60  # rotations between keys are not straight lines, so they are sampled at 60 Hz at least
_LONGEST = 36_000  # frames: ten minutes
MOST_STEPS = 5_000_000  # a step is a matrix, or what takes as long; 14 cameras that fly through a city take 81,045
_POSE_BYTES = 8 * (1 + 3 + 4)

# The nodes of an animation: which of AT_REST moves, and by which sampler.
_Channels: TypeAlias = dict[int, list[tuple[str, JsonObject]]]


def camera_animations(document: GltfDocument, nodes: GltfNodes, raw: RawScene) -> list[CameraAnimation]:
    """Every camera that an animation moves, itself or through an ancestor, in world coordinates; upright ones first.

    Those that are left after MOST_STEPS are not, which is noted.
    """
    found: list[CameraAnimation] = []
    try:
        for animation in _followed(document, nodes, raw):
            found.append(animation)
    except WorkError:
        steps = f"{MOST_STEPS:,} steps"
        raw.note(f"Animated cameras are followed for {steps}: the first {len(found):,} of them are used, no others.")
    return sorted(found, key=lambda animation: -round(_uprightness(animation), 1))


def _followed(document: GltfDocument, nodes: GltfNodes, raw: RawScene) -> Iterator[CameraAnimation]:
    """The animated cameras in the file's order. Raises WorkError after MOST_STEPS."""
    work, cameras = Work(MOST_STEPS), [node for node in nodes.drawn if "camera" in nodes.entries[node]]
    for number, animation in enumerate(document.items("animations")):
        channels = _channels(document, animation)
        if not (cameras and channels):
            continue
        work.take(len(nodes.entries))
        moved = nodes.below(channels)
        for node in cameras:
            if node not in moved:
                continue
            work.take(moved[node])
            camera = document.entry("cameras", nodes.entries[node]["camera"])
            name = camera.get("name") or nodes.entries[node].get("name") or f"camera {node}"
            title = animation.get("name") or f"animation {number}"
            lineage = nodes.lineage(node, moved[node])
            yield _sample(document, nodes, lineage, channels, f"{name}, {title}", work, raw)


def _channels(document: GltfDocument, animation: JsonObject) -> _Channels:
    """What an animation moves of nodes' places."""
    channels: _Channels = {}
    for channel in animation["channels"]:
        target = channel["target"]
        if "node" in target and target.get("path") in AT_REST:
            document.entry("nodes", target["node"])
            sampler = picked(animation["samplers"], channel["sampler"], "an animation's samplers")
            channels.setdefault(target["node"], []).append((target["path"], sampler))
    return channels


def _uprightness(animation: CameraAnimation) -> float:
    """Mean height of the camera's up vector, 1 where it never tilts."""
    x, _, z, _ = animation.orientations.T
    return float((1 - 2 * (x * x + z * z)).mean())


def _sample(
    document: GltfDocument,
    nodes: GltfNodes,
    lineage: list[int],
    channels: _Channels,
    name: str,
    work: Work,
    raw: RawScene,
) -> CameraAnimation:
    """Poses of the last node of a lineage, whose first one is moved, from the first to the last key of whatever moves
    it."""
    samplers = [sampler for node in lineage for _, sampler in channels.get(node, [])]
    work.take(len(samplers))
    keys = [_keys(document, sampler) for sampler in samplers]
    first, last = min(float(some[0]) for some in keys), max(float(some[-1]) for some in keys)
    count = int(np.clip(np.ceil((last - first) * 1000 / _STEP_MS), 1, _LONGEST)) + 1
    work.take(count * (len(lineage) + len(samplers)) + sum(map(len, keys)))
    raw.take(count * _POSE_BYTES, "all animated cameras")
    times = np.linspace(first, last, count)
    above = nodes.parents[lineage[0]]
    resting = np.eye(4) if above < 0 else product(np.eye(4), nodes.world[above])
    world = np.broadcast_to(resting, (count, 4, 4))
    for node in lineage:
        local = _local_over_time(document, nodes.entries[node], channels.get(node, []), times)
        world = product(world, nodes.local[node] if local is None else local)
    return CameraAnimation(name, (times - first) * 1000, world[:, :3, 3].copy(), _quaternions(world[:, :3, :3]))


def _local_over_time(
    document: GltfDocument, entry: JsonObject, channels: list[tuple[str, JsonObject]], times: Doubles
) -> Doubles | None:
    """A node's local matrices (N, 4, 4) at the times, or None where nothing moves it."""
    if not channels:
        return None
    rest = {name: numbers(entry, name, default) for name, default in AT_REST.items()}
    values = {name: np.tile(value, (len(times), 1)) for name, value in rest.items()}
    for path, sampler in channels:
        values[path] = _interpolate(document, sampler, times, path)
    return compose(values["translation"], values["rotation"], values["scale"])


def _keys(document: GltfDocument, sampler: JsonObject) -> Array:
    """The times of a sampler's values, seconds."""
    return document.accessor(sampler["input"], "an animation's input", "SCALAR")


def _interpolate(document: GltfDocument, sampler: JsonObject, times: Doubles, path: str) -> Doubles:
    """A sampler's values at the times (3.11 and appendix C: step, linear, spherical linear, cubic spline)."""
    keys, kind = _keys(document, sampler).astype(np.float64), f"VEC{len(AT_REST[path])}"
    values = document.accessor(sampler["output"], f"an animation's {path}", kind).astype(np.float64)
    mode = sampler.get("interpolation", "LINEAR")
    if len(values) != len(keys) * (3 if mode == "CUBICSPLINE" else 1):
        raise ValueError(f"an animation has {len(keys)} times but {len(values)} values of {path}")
    after = np.clip(np.searchsorted(keys, times, side="right"), 1, max(1, len(keys) - 1))
    before = after - 1
    after = np.minimum(after, len(keys) - 1)
    span = np.where(keys[after] > keys[before], keys[after] - keys[before], 1)
    t = np.clip((times - keys[before]) / span, 0, 1)[:, None]
    if mode == "STEP":
        return values[np.where(t[:, 0] >= 1, after, before)]
    if mode == "CUBICSPLINE":
        arriving, points, leaving = values.reshape(len(keys), 3, -1).transpose(1, 0, 2)
        p, q, m, n = points[before], points[after], leaving[before] * span[:, None], arriving[after] * span[:, None]
        square, cube = t * t, t * t * t
        h = (2 * cube - 3 * square + 1, cube - 2 * square + t, -2 * cube + 3 * square, cube - square)
        return h[0] * p + h[1] * m + h[2] * q + h[3] * n
    return (
        _slerp(values[before], values[after], t)
        if path == "rotation"
        else values[before] + t * (values[after] - values[before])
    )


def _slerp(p: Doubles, q: Doubles, t: Doubles) -> Doubles:
    """Spherical interpolation of quaternions (N, 4) along the shorter way."""
    cosine = dot(p, q)[:, None]
    q, cosine = np.where(cosine < 0, -q, q), np.abs(cosine)
    angle = arctan2(np.sqrt(np.maximum(0, 1 - cosine * cosine)), cosine)
    sine = sin(angle)
    near = sine < 1e-6
    safe = np.where(near, 1, sine)
    return np.where(near, 1 - t, sin((1 - t) * angle) / safe) * p + np.where(near, t, sin(t * angle) / safe) * q


def _quaternions(linear: Doubles) -> Doubles:
    """Unit quaternions (N, 4) x, y, z, w of camera frames (N, 3, 3), scale taken out."""
    z = linear[:, :, 2] / np.linalg.norm(linear[:, :, 2], axis=1, keepdims=True)
    x = np.cross(linear[:, :, 1], z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return from_matrix(np.stack([x, np.cross(z, x), z], axis=2))
