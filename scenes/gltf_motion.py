"""Animated cameras of a glTF file."""

from __future__ import annotations

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.arithmetic.functions import arctan2, sin
from shading_atlas_bench.arithmetic.matrices import dot, product
from shading_atlas_bench.scenes.gltf_document import GltfDocument
from shading_atlas_bench.scenes.gltf_nodes import AT_REST, GltfNodes
from shading_atlas_bench.scenes.gltf_values import JsonObject, numbers, picked
from shading_atlas_bench.scenes.model import CameraAnimation
from shading_atlas_bench.scenes.quaternions import from_matrix
from shading_atlas_bench.scenes.transforms import compose

_STEP_MS = 1000 / 60  # rotations between keys are not straight lines, so they are sampled at 60 Hz at least
_LONGEST = 36_000  # frames: ten minutes


def camera_animations(document: GltfDocument, nodes: GltfNodes) -> list[CameraAnimation]:
    """Every camera that an animation moves, itself or through an ancestor, in world coordinates; upright ones first."""
    found = []
    for number, animation in enumerate(document.items("animations")):
        channels: dict[int, list[tuple[str, JsonObject]]] = {}
        for channel in animation["channels"]:
            target = channel["target"]
            if "node" in target and target.get("path") in AT_REST:
                document.entry("nodes", target["node"])
                sampler = picked(animation["samplers"], channel["sampler"], "an animation's samplers")
                channels.setdefault(target["node"], []).append((target["path"], sampler))
        for node in nodes.drawn:
            lineage = nodes.lineage(node)
            if "camera" in nodes.entries[node] and any(ancestor in channels for ancestor in lineage):
                camera = document.entry("cameras", nodes.entries[node]["camera"])
                name = camera.get("name") or nodes.entries[node].get("name") or f"camera {node}"
                title = animation.get("name") or f"animation {number}"
                found.append(_sample(document, nodes, lineage, channels, f"{name}, {title}"))
    return sorted(found, key=lambda animation: -round(_uprightness(animation), 1))


def _uprightness(animation: CameraAnimation) -> float:
    """Mean height of the camera's up vector, 1 where it never tilts."""
    x, _, z, _ = animation.orientations.T
    return float((1 - 2 * (x * x + z * z)).mean())


def _sample(
    document: GltfDocument,
    nodes: GltfNodes,
    lineage: list[int],
    channels: dict[int, list[tuple[str, JsonObject]]],
    name: str,
) -> CameraAnimation:
    """Poses of the last node of a lineage from the first to the last key of whatever moves it."""
    keys = [_keys(document, sampler)[[0, -1]] for node in lineage for _, sampler in channels.get(node, [])]
    first, last = min(float(key[0]) for key in keys), max(float(key[1]) for key in keys)
    count = int(np.clip(np.ceil((last - first) * 1000 / _STEP_MS), 1, _LONGEST)) + 1
    times = np.linspace(first, last, count)
    world = np.broadcast_to(np.eye(4), (count, 4, 4))
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


def _keys(document: GltfDocument, sampler: JsonObject) -> Doubles:
    """The times of a sampler's values, float64 seconds."""
    return document.accessor(sampler["input"], "an animation's input", "SCALAR").astype(np.float64)


def _interpolate(document: GltfDocument, sampler: JsonObject, times: Doubles, path: str) -> Doubles:
    """A sampler's values at the times (3.11 and appendix C: step, linear, spherical linear, cubic spline)."""
    keys, kind = _keys(document, sampler), f"VEC{len(AT_REST[path])}"
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
