"""From the parts that a reader found to one scene: flattened, cleaned, relative to its centre."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from itertools import chain
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from shading_atlas_bench.arithmetic.arrays import Array, Bools, Doubles, Floats, Ints
from shading_atlas_bench.arithmetic.matrices import determinant, dot, transform
from shading_atlas_bench.scenes.model import Camera, CameraAnimation, Indices, Light, Material, Scene, SceneError
from shading_atlas_bench.scenes.normals import perpendicular, tangents, with_normals
from shading_atlas_bench.scenes.raw import Part, RawScene
from shading_atlas_bench.scenes.repair import decimated, repaired
from shading_atlas_bench.scenes.transforms import normal_matrices

_CHUNK = 1 << 18  # triangles at a time: temporaries stay in the processor's cache
_LARGEST = 1e18  # beyond it squared lengths leave float32's range
_NAMED = 5  # properties out of range that a note names
# By the specifications of glTF 2.0 (3.9) and KHR_lights_punctual; emission may have any strength.
_SHARES = ("base_colour", "roughness", "metallic", "occlusion_strength", "transmission")
_MATERIAL_RANGES = dict.fromkeys(_SHARES, (0.0, 1.0))
_MATERIAL_RANGES |= {"emissive": (0.0, np.inf), "alpha_cutoff": (0.0, np.inf)}
_LIGHT_RANGES = {"colour": (0.0, np.inf), "cone": (0.0, 90.0)}
_Described = TypeVar("_Described", Light, Material)
_NUMBERS = [field.name for field in fields(Material) if isinstance(field.default, float | tuple)]
_BEYOND = 3.4028235677973366e38  # the smallest number that is infinite as float32
_BRIGHTEST = np.array([1e4, 1e4, 1e4, 1], np.float32)  # of a vertex: light may be any, coverage at most whole


def assemble(name: str, raw: RawScene, repair: bool = False, decimate: float | None = None, file: str = "") -> Scene:
    """A scene without lights of its own, features and hash: positions relative to the centre of the bounds.

    Triangles that cannot be drawn (vertices that are not numbers or too far away, indices without a vertex, no area)
    are dropped. decimate: ratio of triangles to keep. file: what errors name in place of the scene. The notes count
    what went, by whom.
    Raises SceneError where nothing is left.
    """
    parts = _prepared(raw, repair, decimate)
    _clean_lights(raw)
    _clean_cameras(raw)
    _clean_materials(raw)
    if not parts:
        raise SceneError(f"{file or name} has no usable triangles{_because(raw)}; check that the file holds a mesh.")
    _drop_unused_textures(parts, raw)
    arrays, origin = _flattened(_all_completed(parts, raw.materials))
    keep = has_area(arrays.positions, arrays.indices)
    raw.note("Triangles without any area, dropped: {}.", np.count_nonzero(~keep))
    if not keep.any():
        raise SceneError(f"{file or name} has no triangle of positive area; check that the file holds a surface.")
    if not keep.all():
        arrays = arrays.keeping(keep)
    return Scene(
        name=name,
        positions=arrays.positions,
        indices=arrays.indices,
        normals=arrays.normals,
        uvs=arrays.uvs,
        colours=arrays.colours,
        material_ids=arrays.material_ids,
        materials=raw.materials,
        textures=raw.textures,
        tangents=arrays.tangents,
        further_uvs=arrays.further_uvs,
        lights=[_light_from(light, origin) for light in raw.lights],
        origin=origin,
        cameras=[_camera_from(camera, origin) for camera in raw.cameras],
        animations=[_animation_from(animation, origin) for animation in raw.animations],
        notes=raw.notes(),
    )


@dataclass
class FlatMesh:
    """The scene's arrays as `Scene` documents them."""

    positions: Floats
    indices: Ints
    normals: Floats
    uvs: Floats
    colours: Floats
    material_ids: Ints
    tangents: Floats | None
    further_uvs: Floats | None

    def keeping(self, triangles: Bools) -> FlatMesh:
        """Only the triangles marked in a bool mask (T), and the vertices that they use."""
        indices, used = compacted(self.indices[triangles], len(self.positions))
        return FlatMesh(
            positions=self.positions[used],
            indices=indices.astype(np.int32),
            normals=self.normals[used],
            uvs=self.uvs[used],
            colours=self.colours[used],
            material_ids=self.material_ids[triangles],
            tangents=None if self.tangents is None else self.tangents[used],
            further_uvs=None if self.further_uvs is None else self.further_uvs[:, used],
        )


@dataclass(frozen=True)
class CompletePart:
    """A part that lacks nothing; fields as in `Part`, tangents where its material has a normal map.

    material: of all triangles, or int (T) of each.
    """

    positions: Array
    indices: Indices
    material: int | Indices
    normals: Floats
    uvs: Array
    colours: Array
    tangents: Array | None
    transforms: Doubles
    further_uvs: tuple[Array, ...]


def compacted(indices: Indices, count: int) -> tuple[Indices, Indices]:
    """Indices, of any shape, renumbered to the vertices that they use of `count`, and those vertices' old numbers, int
    (n), in rising order."""
    marks = np.zeros(count, bool)
    marks[indices] = True
    used = np.flatnonzero(marks)
    number = np.cumsum(marks, dtype=np.int32) - 1  # more vertices no scene has
    return number[indices], used


def has_area(positions: Floats, indices: Indices) -> Bools:
    """Bool (T): whether triangles (T, 3) of positions float32 (V, 3) span any area at all, decided in float64 where it
    is close."""
    keep = np.ones(len(indices), bool)
    for start in range(0, len(indices), _CHUNK):
        corners = [positions[indices[start : start + _CHUNK, corner]] for corner in range(3)]
        (px, py, pz), (qx, qy, qz) = (corners[1] - corners[0]).T, (corners[2] - corners[0]).T
        with np.errstate(over="ignore", invalid="ignore"):
            area = np.maximum.reduce([np.abs(py * qz - pz * qy), np.abs(pz * qx - px * qz), np.abs(px * qy - py * qx)])
            extent = np.maximum.reduce([np.abs(side) for side in (px, py, pz, qx, qy, qz)])
            close = np.flatnonzero(~((area > 1e-5 * extent * extent) & (area > 1e-30)))
        exact = [corner[close].astype(np.float64) for corner in corners]
        keep[start + close] = np.any(np.cross(exact[1] - exact[0], exact[2] - exact[0]) != 0, axis=1)
    return keep


def _prepared(raw: RawScene, repair: bool, decimate: float | None) -> list[Part]:
    """The parts that have triangles after cleaning, repair and decimation."""
    single = repair or decimate is not None
    found = chain.from_iterable(map(_by_material, raw.parts)) if single else raw.parts
    parts = [part for part in (_cleaned(part, raw) for part in found) if len(part.indices) and len(part.transforms)]
    raw.parts.clear()
    if repair:
        before = sum(raw.counts.values())
        parts = [part for part in (repaired(part, raw) for part in parts) if len(part.indices)]
        raw.note("Repair found nothing to drop.", before == sum(raw.counts.values()))
    return parts if decimate is None else [decimated(part, decimate, raw) for part in parts]


def _by_material(part: Part) -> Iterator[Part]:
    """The part as parts of one material each."""
    if part.materials is None:
        yield part
        return
    order = np.argsort(part.materials, kind="stable")
    for triangles in np.split(order, np.flatnonzero(np.diff(part.materials[order])) + 1):
        used, indices = np.unique(part.indices[triangles], return_inverse=True)
        single = part.taking(used, indices.reshape(-1, 3))
        yield replace(single, material=int(part.materials[triangles[0]]), materials=None)


def _clean_lights(raw: RawScene) -> None:
    """Drop lights whose colour, position, direction or cone is not finite, and bring others into range (counted)."""
    whole = [_finite([*light.colour, *light.position, *light.direction, light.cone]) for light in raw.lights]
    raw.note("Lights whose numbers are infinite or none, dropped: {}.", len(whole) - sum(whole))
    lights = [light for light, good in zip(raw.lights, whole, strict=True) if good]
    raw.lights = [_in_range(light, _LIGHT_RANGES)[0] for light in lights]
    changed = sum(old != new for old, new in zip(lights, raw.lights, strict=True))
    raw.note("Lights of less than no light or with cones wider than 90 degrees, clamped: {}.", changed)


def _clean_cameras(raw: RawScene) -> None:
    """Drop cameras, and their animations, with numbers that are not finite or further out than float32 can draw."""
    cameras = [c for c in raw.cameras if _near(c.position) and _finite([*c.direction, *c.up])]
    animations = [a for a in raw.animations if _near(a.positions) and _finite(a.orientations) and _finite(a.times)]
    gone = len(raw.cameras) - len(cameras) + len(raw.animations) - len(animations)
    raw.note("Cameras and their animations whose numbers are infinite, none or too large, dropped: {}.", gone)
    raw.cameras, raw.animations = cameras, animations


def _near(positions: ArrayLike) -> bool:
    return bool((np.abs(positions) < _LARGEST).all())


def _clean_materials(raw: RawScene) -> None:
    """Give materials the default of each property that is not finite (counted), and clamp what is out of range."""
    default = Material()
    outside: list[str] = []
    for index, material in enumerate(raw.materials):
        broken = [name for name in _NUMBERS if not _drawable(getattr(material, name))]
        raw.note("Properties of materials that are infinite or not a number, replaced: {}.", len(broken))
        if broken:
            usual: dict[str, Any] = {name: getattr(default, name) for name in broken}
            material = replace(material, **usual)
        raw.materials[index], changed = _in_range(material, _MATERIAL_RANGES)
        outside += [f"{name} {_written(material, name)} of {material.name or f'material {index}'}" for name in changed]
    if outside:
        more = f" and {len(outside) - _NAMED:,} more" if len(outside) > _NAMED else ""
        raw.note(f"Properties of materials outside their range, clamped: {', '.join(outside[:_NAMED])}{more}.")


def _drawable(value: float | tuple[float, ...]) -> bool:
    """As `_finite`, of a few numbers."""
    return all(abs(number) < _BEYOND for number in (value if isinstance(value, tuple) else (value,)))


def _finite(values: ArrayLike) -> bool:
    """Whether all values are finite as float32, as which they are used."""
    with np.errstate(over="ignore"):
        return bool(np.isfinite(np.array(values, np.float32)).all())


def _in_range(item: _Described, ranges: dict[str, tuple[float, float]]) -> tuple[_Described, list[str]]:
    """A light or material with its properties clamped, and the names of those that were outside."""
    clamped: dict[str, Any] = {}
    for name, (low, high) in ranges.items():
        value = getattr(item, name)
        inside = (
            tuple(min(max(v, low), high) for v in value) if isinstance(value, tuple) else min(max(value, low), high)
        )
        if inside != value:
            clamped[name] = inside
    return (replace(item, **clamped) if clamped else item), list(clamped)


def _written(material: Material, name: str) -> str:
    value = getattr(material, name)
    return f"({' '.join(f'{v:g}' for v in value)})" if isinstance(value, tuple) else f"{value:g}"


def _drop_unused_textures(parts: list[Part], raw: RawScene) -> None:
    """Give parts without some texture coordinates a copy of their material without the textures there (counted)."""
    bare: dict[tuple[int, tuple[str, ...]], int] = {}
    for part in parts:
        sets = (part.uvs, *part.further_uvs)
        instead = np.arange(len(raw.materials))
        for index in [part.material] if part.materials is None else np.unique(part.materials).tolist():
            material = raw.materials[index]
            lost = tuple(slot for slot in material.textures if sets[material.uv_of(slot)] is None)
            if lost:
                raw.note("Parts without texture coordinates, drawn without their textures: {}.")
                if (index, lost) not in bare:
                    bare[index, lost] = len(raw.materials)
                    raw.materials.append(material.without(lost))
                instead[index] = bare[index, lost]
        part.material = int(instead[part.material])
        part.materials = None if part.materials is None else instead[part.materials]


def _because(raw: RawScene) -> str:
    notes = raw.notes()
    return " (" + " ".join(notes).rstrip(".") + ")" if notes else ""


def _cleaned(part: Part, raw: RawScene) -> Part:
    """The part without triangles whose indices or vertices are unusable, and without unused vertices."""
    indices, count = np.asarray(part.indices).reshape(-1, 3), len(part.positions)
    inside = (indices.min(axis=1, initial=0) >= 0) & (indices.max(axis=1, initial=0) < count)
    raw.note("Triangles that refer to missing vertices, dropped: {}.", np.count_nonzero(~inside))
    part = replace(part, indices=indices).keeping(inside)
    usable = np.isfinite(part.transforms).all(axis=(1, 2))
    raw.note("Instances whose placement is infinite or not a number, dropped: {}.", np.count_nonzero(~usable))
    part = replace(part, transforms=part.transforms[usable])
    finite: Bools = np.all(np.isfinite(part.positions), axis=1)
    near: Bools = np.ones(count, bool)
    with np.errstate(over="ignore", invalid="ignore"):
        for placed in part.transforms:
            for start in range(0, count, _CHUNK):
                world = transform(placed[:3], part.positions[start : start + _CHUNK])
                near[start : start + _CHUNK] &= (np.abs(world) < _LARGEST).all(axis=1)
    for good, sentence in (
        (finite, "Triangles with vertices that are infinite or not a number, dropped: {}."),
        (near | ~finite, "Triangles further out than float32 can draw (1e18 units), dropped: {}."),
    ):
        keep: Bools = np.all(good[part.indices], axis=1)
        raw.note(sentence, np.count_nonzero(~keep) * len(part.transforms))
        part = part.keeping(keep)
    renumbered, used = compacted(part.indices, count)
    return part if len(used) == count else part.taking(used, renumbered)


def _completed(part: Part, material: Material) -> CompletePart:
    """The part with normals, UVs and colours, and with tangents where its material has a normal map."""
    if part.normals is None:
        part = with_normals(part)
    count = len(part.positions)
    none = np.zeros((count, 2), np.float32)
    uvs, *further = (
        none if uvs is None else np.nan_to_num(uvs, posinf=0.0, neginf=0.0) for uvs in (part.uvs, *part.further_uvs)
    )
    colours = part.colours if part.colours is not None else np.ones((count, 4), np.float32)
    colours = np.clip(np.nan_to_num(colours, nan=1.0, posinf=1.0, neginf=1.0), 0, _BRIGHTEST)
    normals = _repaired_normals(part)
    tangent = part.tangents if material.normal_texture >= 0 else None
    if material.normal_texture >= 0 and (tangent is None or not np.isfinite(tangent).all()):
        tangent = tangents(part.positions, normals, (uvs, *further)[material.normal_uv], part.indices)
    return CompletePart(
        positions=part.positions,
        indices=part.indices,
        material=part.material if part.materials is None else part.materials,
        normals=normals,
        uvs=uvs,
        colours=colours,
        tangents=tangent,
        transforms=part.transforms,
        further_uvs=tuple(further),
    )


def _all_completed(parts: list[Part], materials: list[Material]) -> list[CompletePart]:
    """All parts, completed; the list is emptied, as each may take much of the memory."""
    waiting, complete = deque(parts), []
    parts.clear()
    while waiting:
        part = waiting.popleft()
        complete.append(_completed(part, materials[part.material]))
    return complete


def _repaired_normals(part: Part) -> Floats:
    """Unit normals, float32; where the file's have no length, that of one of the vertex's faces."""
    normals = np.asarray(part.normals, np.float64)
    length = np.linalg.norm(normals, axis=1)
    bad = ~(np.isfinite(length) & (length > 1e-12))
    if bad.any():
        corners = np.asarray(part.positions, np.float64)[part.indices]
        faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        size = np.linalg.norm(faces, axis=1)
        solid = size > 0
        faces = faces[solid] / size[solid, None]
        normals, length = normals.copy(), length.copy()
        normals[bad], length[bad] = (0.0, 1.0, 0.0), 1.0
        for corner in range(3):
            vertices = part.indices[solid, corner]
            normals[vertices[bad[vertices]]] = faces[bad[vertices]]
    unit: Doubles = normals / length[:, None]
    return unit.astype(np.float32)


def _flattened(parts: list[CompletePart]) -> tuple[FlatMesh, Doubles]:
    """Every instance of every part in world space, and the origin: the centre of the bounds, float64 (3)."""
    world = [transform(part.transforms[:, :3], part.positions) for part in parts]
    low: Doubles = np.min([points.min(axis=(0, 1)) for points in world], axis=0)
    high: Doubles = np.max([points.max(axis=(0, 1)) for points in world], axis=0)
    origin = (low + high) / 2
    vertices = sum(points.shape[0] * points.shape[1] for points in world)
    triangles = sum(len(part.transforms) * len(part.indices) for part in parts)
    sets = max(len(part.further_uvs) for part in parts)
    if max(vertices, triangles * 3) >= 1 << 31:
        raise SceneError(f"it has {triangles:,} triangles, more than 32-bit indices can number; use --decimate.")
    bumpy = any(part.tangents is not None for part in parts)
    tangent = np.tile(np.array([1, 0, 0, 1], np.float32), (vertices if bumpy else 0, 1))
    further = np.zeros((sets, vertices, 2), np.float32)
    mesh = FlatMesh(
        positions=np.empty((vertices, 3), np.float32),
        indices=np.empty((triangles, 3), np.int32),
        normals=np.empty((vertices, 3), np.float32),
        uvs=np.empty((vertices, 2), np.float32),
        colours=np.empty((vertices, 4), np.float32),
        material_ids=np.empty(triangles, np.int32),
        tangents=tangent if bumpy else None,
        further_uvs=further if sets else None,
    )
    vertex = triangle = 0
    for part, points in zip(parts, world, strict=True):
        count, size = points.shape[:2]
        rows, faces = slice(vertex, vertex + count * size), slice(triangle, triangle + count * len(part.indices))
        mesh.positions[rows] = (points - origin).reshape(-1, 3)
        mesh.uvs[rows], mesh.colours[rows] = np.tile(part.uvs, (count, 1)), np.tile(part.colours, (count, 1))
        mesh.indices[faces] = _instance_indices(part, vertex)
        mesh.material_ids[faces].reshape(count, -1)[:] = part.material
        mesh.normals[rows] = _instance_normals(part)
        for number, uvs in enumerate(part.further_uvs):
            further[number, rows] = np.tile(uvs, (count, 1))
        if part.tangents is not None:
            tangent[rows] = _instance_tangents(part, part.tangents, mesh.normals[rows])
        vertex, triangle = rows.stop, faces.stop
    return mesh, origin


def _mirrored(part: CompletePart) -> Bools:
    return determinant(part.transforms[:, :3, :3]) < 0


def _instance_indices(part: CompletePart, first: int) -> Indices:
    """Indices (N*T, 3) of a part's instances; mirrored ones turned, so that fronts stay counter-clockwise."""
    offsets = first + np.arange(len(part.transforms)) * len(part.positions)
    turned = np.where(_mirrored(part)[:, None, None], part.indices[None][:, :, [0, 2, 1]], part.indices[None])
    return (turned + offsets[:, None, None]).reshape(-1, 3)


def _instance_normals(part: CompletePart) -> Doubles:
    turned = transform(normal_matrices(part.transforms[:, :3, :3]), part.normals)
    length = np.linalg.norm(turned, axis=2, keepdims=True)
    return np.where(length > 0, turned / np.where(length > 0, length, 1), part.normals[None]).reshape(-1, 3)


def _instance_tangents(part: CompletePart, tangent: Array, normals: Floats) -> Doubles:
    turned = transform(part.transforms[:, :3, :3], tangent[:, :3]).reshape(-1, 3)
    turned = turned - normals * dot(turned, normals)[:, None]
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    unit = np.where(length > 0, turned / np.where(length > 0, length, 1), perpendicular(normals))
    side = np.where(_mirrored(part), -1.0, 1.0)[:, None] * tangent[None, :, 3]
    return np.concatenate([unit, side.reshape(-1, 1)], axis=1)


def _moved(point: tuple[float, float, float], origin: Doubles) -> tuple[float, float, float]:
    return tuple((np.array(point) - origin).tolist())


def _camera_from(camera: Camera, origin: Doubles) -> Camera:
    return replace(camera, position=_moved(camera.position, origin))


def _light_from(light: Light, origin: Doubles) -> Light:
    return replace(light, position=_moved(light.position, origin))


def _animation_from(animation: CameraAnimation, origin: Doubles) -> CameraAnimation:
    return replace(animation, positions=animation.positions - origin)
