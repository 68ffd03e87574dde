"""Building blocks of the procedural scenes: meshes of boxes, tubes and turned parts, and their assembly into a scene.

Lengths are metres, y is up. UVs are metres too, until `Palette.assemble` divides them by the size of a texture's tile,
so that every surface of a material shows the same texel density. Everything is vectorised over parts.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from shading_atlas_bench.arithmetic.arrays import Bools, Bytes, Doubles, Floats, Ints
from shading_atlas_bench.arithmetic.functions import cos, sin_cos
from shading_atlas_bench.arithmetic.matrices import dot, transform
from shading_atlas_bench.scenes.features import content_digest, find_features
from shading_atlas_bench.scenes.model import Camera, Indices, Light, Material, Scene, Sky, Texture
from shading_atlas_bench.scenes.normals import tangents
from shading_atlas_bench.scenes.transforms import normal_matrices

# Face order of `boxes`: the outward axis and side of each face.
FACES = ("-x", "+x", "-y", "+y", "-z", "+z")
ALL_FACES = "-x+x-y+y-z+z"
WITHOUT_BOTTOM = "-x+x+y-z+z"
SIDES_ALONG_Z = "-x+x-y+y"

WHITE = (1.0, 1.0, 1.0)


@dataclass
class Mesh:
    """Triangles of one or many parts; the order of the triangles is the order in the scene.

    positions, normals: float32 (V, 3). uvs: float32 (V, 2). colours: float32 (V, 3), linear, multiply the material's.
    indices: int32 (T, 3), counter-clockwise from the front. materials: int32 (T).
    """

    positions: Floats
    normals: Floats
    uvs: Floats
    colours: Floats
    indices: Ints
    materials: Ints

    @property
    def triangle_count(self) -> int:
        """How many triangles it has."""
        return len(self.indices)


def mesh(
    positions: ArrayLike,
    normals: ArrayLike,
    uvs: ArrayLike,
    indices: ArrayLike,
    material: int,
    colour: ArrayLike = WHITE,
) -> Mesh:
    """A mesh of one material.

    positions, normals: (..., 3). uvs: (..., 2). indices: three per triangle, into these in their order. colour:
    linear, (3) or (V, 3).
    """
    points = np.asarray(positions, np.float32).reshape(-1, 3)
    triangles = np.asarray(indices, np.int32).reshape(-1, 3)
    return Mesh(
        points,
        np.asarray(normals, np.float32).reshape(-1, 3),
        np.asarray(uvs, np.float32).reshape(-1, 2),
        np.broadcast_to(np.asarray(colour, np.float32), points.shape).copy(),
        triangles,
        np.full(len(triangles), material, np.int32),
    )


def merge(meshes: Sequence[Mesh]) -> Mesh:
    """All meshes in order as one."""
    starts = np.cumsum([0] + [len(m.positions) for m in meshes[:-1]])
    return Mesh(
        np.concatenate([m.positions for m in meshes]),
        np.concatenate([m.normals for m in meshes]),
        np.concatenate([m.uvs for m in meshes]),
        np.concatenate([m.colours for m in meshes]),
        np.concatenate([m.indices + np.int32(start) for m, start in zip(meshes, starts, strict=True)]),
        np.concatenate([m.materials for m in meshes]),
    )


def translation(points: ArrayLike) -> Doubles:
    """Matrices (N, 4, 4) that move to points (N, 3)."""
    places = np.asarray(points, np.float64).reshape(-1, 3)
    matrices = np.tile(np.eye(4), (len(places), 1, 1))
    matrices[:, :3, 3] = places
    return matrices


def placement(points: ArrayLike, yaw: ArrayLike = 0.0, scale: ArrayLike = 1.0, tilt: ArrayLike = 0.0) -> Doubles:
    """Matrices (N, 4, 4): scale, tilt about x, turn about y by `yaw`, move to points (N, 3). Angles in degrees.

    scale: a number, (N,) or (N, 3).
    """
    matrices = translation(points)
    count = len(matrices)
    angles = np.empty((2, count))
    angles[0], angles[1] = yaw, tilt
    sine, cosine = sin_cos(np.radians(angles))
    sizes = np.asarray(scale, np.float64)
    sizes = np.broadcast_to(sizes[:, None] if sizes.ndim == 1 and len(sizes) == count else sizes, (count, 3))
    matrices[:, 0, 0], matrices[:, 2, 0] = cosine[0], -sine[0]
    matrices[:, :3, 1] = np.stack([sine[0] * sine[1], cosine[1], cosine[0] * sine[1]], axis=1)
    matrices[:, :3, 2] = np.stack([sine[0] * cosine[1], -sine[1], cosine[0] * cosine[1]], axis=1)
    matrices[:, :3, :3] *= sizes[:, None, :]
    return matrices


def repeat(part: Mesh, matrices: Doubles, tints: ArrayLike | None = None) -> Mesh:
    """Copies of a part under matrices (N, 4, 4), one after the other; tints (N, 3) multiply their colours."""
    matrices = matrices.reshape(-1, 4, 4)
    count, vertices = len(matrices), len(part.positions)
    positions = transform(matrices[:, :3], part.positions)
    normals = transform(normal_matrices(matrices[:, :3, :3]), part.normals)
    normals /= np.maximum(np.sqrt(dot(normals, normals)), 1e-20)[..., None]
    colours = np.tile(part.colours, (count, 1)).reshape(count, vertices, 3)
    if tints is not None:
        colours = colours * np.asarray(tints, np.float32)[:, None, :]
    indices = part.indices[None] + (np.arange(count, dtype=np.int32) * vertices)[:, None, None]
    return Mesh(
        positions.reshape(-1, 3).astype(np.float32),
        normals.reshape(-1, 3).astype(np.float32),
        np.tile(part.uvs, (count, 1)),
        colours.reshape(-1, 3),
        indices.reshape(-1, 3),
        np.tile(part.materials, count),
    )


def moved(part: Mesh, point: ArrayLike, yaw: float = 0.0, scale: float = 1.0, tilt: float = 0.0) -> Mesh:
    """One copy of a part at a point, (3), placed as by `placement`."""
    return repeat(part, placement(point, yaw, scale, tilt))


@functools.cache
def _unit_box(faces: str) -> tuple[Doubles, Doubles, Indices]:
    """Corners (F, 4, 3) of the unit box's faces, their normals (F, 3) and the axes (F, 2) that u and v run along."""
    corners, normals, axes = [], [], []
    for face in FACES:
        if face not in faces:
            continue
        axis, side = "xyz".index(face[1]), 0.5 if face[0] == "+" else -0.5
        right, up = {0: (2, 1), 1: (0, 2), 2: (0, 1)}[axis]
        normal, u, v = np.zeros((3, 3))
        normal[axis], u[right], v[up] = 2 * side, 1, 1
        if dot(np.cross(u, v), normal) < 0:
            u = -u
        corners.append([normal / 2 + (u * a + v * b) / 2 for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
        normals.append(normal)
        axes.append((right, up))
    return np.array(corners), np.array(normals), np.array(axes)


def boxes(
    centres: ArrayLike,
    sizes: ArrayLike,
    material: int,
    turns: Doubles | None = None,
    tints: ArrayLike | None = None,
    faces: str = ALL_FACES,
) -> Mesh:
    """Boxes with their own sizes: 2 triangles for each face in `faces` (names of `FACES` in one string).

    centres, sizes: (N, 3). turns: rotation matrices (N, 3, 3) or None. tints: (N, 3), (3,) or None.
    """
    middles = np.asarray(centres, np.float64).reshape(-1, 3)
    count = len(middles)
    lengths = np.broadcast_to(np.asarray(sizes, np.float64), (count, 3))
    corners, face_normals, axes = _unit_box(faces)
    faces_count = len(corners)
    local = corners.reshape(1, -1, 3) * lengths[:, None, :]
    normals = np.broadcast_to(face_normals, (count, faces_count, 3))
    if turns is not None:
        local, normals = transform(turns, local), transform(turns, face_normals)
    extent = lengths[:, axes]
    unit = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float64)
    uvs = unit[None, None] * extent[:, :, None, :]
    colours = np.broadcast_to(np.asarray(WHITE if tints is None else tints, np.float32), (count, 3))
    quads = np.arange(count * faces_count, dtype=np.int32)[:, None] * 4
    return Mesh(
        (local + middles[:, None, :]).reshape(-1, 3).astype(np.float32),
        np.repeat(normals.astype(np.float32).reshape(-1, 3), 4, axis=0),
        uvs.reshape(-1, 2).astype(np.float32),
        np.repeat(colours, faces_count * 4, axis=0),
        (quads + np.array([0, 1, 2, 0, 2, 3], np.int32)).reshape(-1, 3),
        np.full(count * faces_count * 2, material, np.int32),
    )


def box(
    centre: ArrayLike,
    size: ArrayLike,
    material: int,
    tint: ArrayLike = WHITE,
    yaw: float = 0.0,
    faces: str = ALL_FACES,
) -> Mesh:
    """One box turned by `yaw` degrees about y. centre, size: (3). tint: linear, (3)."""
    return boxes(centre, size, material, placement([(0, 0, 0)], yaw)[:, :3, :3], tint, faces)


def aim(directions: Doubles) -> Doubles:
    """Rotations (N, 3, 3) whose z axis is along the directions (N, 3) and whose y axis is as upright as can be."""
    z = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    up = np.where(np.abs(z[:, 1:2]) > 0.999, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    x = np.cross(up, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def struts(
    starts: ArrayLike,
    ends: ArrayLike,
    width: float,
    material: int,
    tints: ArrayLike | None = None,
    height: float | None = None,
    faces: str = SIDES_ALONG_Z,
) -> Mesh:
    """Square bars from starts (N, 3) to ends (N, 3); `width` across and `height` (default the same) along up.

    tints: linear, (3), (N, 3) or None.
    """
    first, last = (np.asarray(points, np.float64).reshape(-1, 3) for points in (starts, ends))
    along = last - first
    lengths = np.linalg.norm(along, axis=1)
    across = np.full(len(lengths), width)
    sizes = np.stack([across, across if height is None else np.full(len(lengths), height), lengths], axis=1)
    return boxes((first + last) / 2, sizes, material, aim(along), tints, faces)


def chain(points: ArrayLike, width: float, material: int, tints: ArrayLike | None = None) -> Mesh:
    """Bars along a polyline of points (N, 3); tints: linear, (3) or one per bar, (N - 1, 3)."""
    line = np.asarray(points, np.float64)
    return struts(line[:-1], line[1:], width, material, tints)


def sheet(
    corner: ArrayLike,
    along_u: ArrayLike,
    along_v: ArrayLike,
    material: int,
    divisions: tuple[int, int] = (1, 1),
    tint: ArrayLike = WHITE,
) -> Mesh:
    """A flat rectangle of divisions[0] x divisions[1] cells; its front is cross(along_u, along_v).

    corner, along_u, along_v: (3), the corner at both sides' start, and the sides. tint: linear, (3).
    """
    start, right, up = (np.asarray(point, np.float64) for point in (corner, along_u, along_v))
    nu, nv = divisions
    u, v = np.meshgrid(np.linspace(0, 1, nu + 1), np.linspace(0, 1, nv + 1))
    positions = start + u[..., None] * right + v[..., None] * up
    normal = np.cross(right, up)
    lengths = np.linalg.norm(right, axis=-1), np.linalg.norm(up, axis=-1)
    uvs = np.stack([u * lengths[0], 0.0 - v * lengths[1]], axis=-1)  # 0, and not -0, where v is 0
    normals = np.broadcast_to(normal / np.linalg.norm(normal, axis=-1), positions.shape)
    return mesh(positions, normals, uvs, lattice_indices(nv + 1, nu + 1), material, tint)


def lattice_indices(rows: int, columns: int) -> Ints:
    """Triangles (2 (rows-1) (columns-1), 3) of a grid of vertices numbered row by row, front towards +row x +column."""
    start = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1, 1)
    corners: Indices = start + np.array([0, 1, columns + 1, 0, columns + 1, columns])
    return corners.reshape(-1, 3).astype(np.int32)


def card(
    corners: ArrayLike,
    material: int,
    uv: tuple[float, float, float, float] = (0, 0, 1, 1),
    tint: ArrayLike = WHITE,
) -> Mesh:
    """A quad with explicit texture coordinates (u0, v0, u1, v1); corners (4, 3) from lower left, counter-clockwise.

    The material's tile must be 1. tint: linear, (3).
    """
    points = np.asarray(corners, np.float64)
    normal = np.cross(points[1] - points[0], points[3] - points[0])
    u0, v0, u1, v1 = uv
    uvs = [(u0, v1), (u1, v1), (u1, v0), (u0, v0)]
    return mesh(
        points, np.tile(normal / np.linalg.norm(normal, axis=-1), (4, 1)), uvs, [0, 1, 2, 0, 2, 3], material, tint
    )


def lathe(profile: ArrayLike, segments: int, material: int, tint: ArrayLike = WHITE, crease: float = 40.0) -> Mesh:
    """A profile (N, 2) of (radius, y) turned about the y axis, from bottom to top for outward fronts.

    Bends of the profile sharper than `crease` degrees stay sharp; the rest is smooth. tint: linear, (3).
    """
    outline = np.asarray(profile, np.float64)
    edges = np.diff(outline, axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    flat = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / lengths[:, None]
    lower, upper = flat.copy(), flat.copy()
    smooth = np.sum(flat[:-1] * flat[1:], axis=1) > cos(np.radians(crease))
    blend = flat[:-1] + flat[1:]
    blend /= np.maximum(np.linalg.norm(blend, axis=1, keepdims=True), 1e-12)
    upper[:-1][smooth] = blend[smooth]
    lower[1:][smooth] = blend[smooth]
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    ring = np.stack(sin_cos(angle), axis=1)
    along = np.concatenate([[0], np.cumsum(lengths)])
    reach = max(outline[:, 0].max(), 1e-9)
    around = angle / (2 * np.pi) * max(1.0, np.round(2 * np.pi * reach / 0.5)) * 0.5 if reach > 0.2 else angle * reach
    points = np.stack([outline[:-1], outline[1:]], axis=1)
    normals = np.stack([lower, upper], axis=1)
    positions = _turn(points, ring)
    uvs = np.empty((*positions.shape[:3], 2))
    uvs[..., 0] = around
    uvs[..., 1] = -np.stack([along[:-1], along[1:]], axis=1)[:, :, None]
    indices = lattice_indices(2, segments + 1)
    indices = indices[None] + (np.arange(len(edges)) * 2 * (segments + 1))[:, None, None]
    turned = mesh(positions, _turn(normals, ring), uvs, indices, material, tint)
    return without_slivers(turned)


def _turn(points: Doubles, ring: Doubles) -> Doubles:
    """Points (..., 2) of (radius, y) at all positions of a ring (S, 2): (..., S, 3)."""
    out = np.empty((*points.shape[:-1], len(ring), 3))
    out[..., 0] = points[..., None, 0] * ring[:, 0]
    out[..., 1] = points[..., None, 1]
    out[..., 2] = points[..., None, 0] * ring[:, 1]
    return out


def without_slivers(part: Mesh) -> Mesh:
    """The part without triangles of (almost) no area, such as those at the poles of a turned part."""
    a, b, c = (part.positions[part.indices[:, k]].astype(np.float64) for k in range(3))
    keep = np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-10
    return replace(part, indices=part.indices[keep], materials=part.materials[keep])


def picked(part: Mesh, triangles: Bools, material: int) -> Mesh:
    """The part's triangles where `triangles`, bool (T), with a material, and only the vertices they use."""
    used, indices = np.unique(part.indices[triangles], return_inverse=True)
    return Mesh(
        part.positions[used],
        part.normals[used],
        part.uvs[used],
        part.colours[used],
        indices.reshape(-1, 3).astype(np.int32),
        np.full(indices.size // 3, material, np.int32),
    )


def cylinder(
    radius: float, height: float, segments: int, material: int, tint: ArrayLike = WHITE, rings: int = 1
) -> Mesh:
    """A closed upright cylinder standing on y = 0; `rings` divides its side. tint: linear, (3)."""
    side = [(radius, y) for y in np.linspace(0, height, rings + 1)]
    return lathe([(0, 0), *side, (0, height)], segments, material, tint)


def ball(radius: float, segments: int, material: int, tint: ArrayLike = WHITE) -> Mesh:
    """A sphere about the origin. tint: linear, (3)."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, max(3, segments // 2) + 1)
    sine, cosine = sin_cos(angle)
    profile = np.stack([np.maximum(cosine, 0) * radius, sine * radius], axis=1)
    profile[[0, -1], 0] = 0
    return lathe(profile, segments, material, tint, crease=80)


def tube(
    points: ArrayLike, radius: ArrayLike, sides: int, material: int, tint: ArrayLike = WHITE, closed: bool = False
) -> Mesh:
    """A smooth tube along points (N, 3); radius is a number or (N,); open at its ends unless a closed loop.

    tint: linear, (3).
    """
    line = np.asarray(points, np.float64)
    if closed:
        line = np.concatenate([line, line[:1]])
    count = len(line)
    along: Doubles = np.gradient(line, axis=0)
    if closed:
        along[[0, -1]] = line[1] - line[-2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    frames = _transported(along)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    sine, cosine = (part[:, None] for part in sin_cos(angle))
    normals = cosine * frames[:, 0, None] + sine * frames[:, 1, None]
    radii = np.broadcast_to(np.asarray(radius, np.float64), (count,))
    positions = line[:, None] + normals * radii[:, None, None]
    lengths = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    uvs = np.stack(np.broadcast_arrays(angle[None] * radii.max(), lengths[:, None]), axis=-1)
    return mesh(positions, normals, uvs, lattice_indices(count, sides + 1)[:, [0, 1, 2]], material, tint)


def _transported(tangents: Doubles) -> Doubles:
    """Frames (N, 2, 3) across unit tangents (N, 3), turning as little as possible from one to the next."""
    x, y, z = aim(tangents[:1])[0, :, 0].tolist()
    sides = []
    for a, b, c in tangents.tolist():  # plain numbers: NumPy would take longer to be called than to compute
        along = x * a + y * b + z * c
        x, y, z = x - a * along, y - b * along, z - c * along
        length = math.sqrt(x * x + y * y + z * z)
        x, y, z = x / length, y / length, z / length
        sides.append((x, y, z))
    across = np.array(sides)
    return np.stack([across, np.cross(tangents, across)], axis=1)


def sagging(start: ArrayLike, end: ArrayLike, drop: float, count: int) -> Doubles:
    """Points (count, 3) of a cable from start to end, (3), that hangs `drop` below the straight line in its middle."""
    t = np.linspace(0, 1, count)[:, None]
    points = np.asarray(start, np.float64) * (1 - t) + np.asarray(end, np.float64) * t
    points[:, 1] -= drop * 4 * (t * (1 - t))[:, 0]
    return points


def rounded(corners: ArrayLike, radius: float, steps: int) -> Doubles:
    """A polyline (N, 3) whose corners are bent with about `radius`, each by `steps` points."""
    line = np.asarray(corners, np.float64)
    out = [line[0]]
    t = np.linspace(0, 1, steps)[:, None]
    for before, corner, after in zip(line, line[1:], line[2:], strict=False):
        a = corner + (before - corner) * min(0.45, radius / np.linalg.norm(before - corner, axis=-1))
        b = corner + (after - corner) * min(0.45, radius / np.linalg.norm(after - corner, axis=-1))
        out.extend((1 - t) * (1 - t) * a + 2 * t * (1 - t) * corner + t * t * b)
    out.append(line[-1])
    return np.array(out)


@dataclass
class Palette:
    """The materials and textures of a scene in the making, and how many metres one tile of each texture covers."""

    materials: list[Material] = field(default_factory=list)
    textures: list[Texture] = field(default_factory=list)
    tiles: list[float] = field(default_factory=list)

    def texture(self, name: str, texels: Bytes, srgb: bool = True) -> int:
        """Adds a texture, uint8 (H, W, 4); returns its index."""
        self.textures.append(Texture(name, texels, srgb))
        return len(self.textures) - 1

    def material(self, material: Material, tile: float = 1.0) -> int:
        """Adds a material whose textures repeat every `tile` metres; returns its index."""
        self.materials.append(material)
        self.tiles.append(tile)
        return len(self.materials) - 1

    def textured(self, material: Material, tile: float, texels: Bytes, normals: Bytes | None = None) -> int:
        """Adds a material with a base texture, and perhaps a normal map, named after it; returns its index.

        texels, normals: uint8 (H, W, 4).
        """
        base = self.texture(material.name, texels)
        bumps = -1 if normals is None else self.texture(material.name + " normals", normals, srgb=False)
        return self.material(replace(material, base_texture=base, normal_texture=bumps), tile)

    def assemble(
        self,
        name: str,
        parts: Sequence[Mesh],
        *,
        lights: Sequence[Light] = (),
        sky: Sky | None = None,
        cameras: Sequence[Camera] = (),
        route: Doubles | None = None,
        metres_per_unit: float = 1.0,
        place: bool = True,
    ) -> Scene:
        """The scene of all parts in order, with its tangents, features and content hash; the rest is as in `Scene`."""
        whole = merge(parts)
        vertex_material = np.zeros(len(whole.positions), np.int32)
        vertex_material[whole.indices] = whole.materials[:, None]
        uvs = whole.uvs / np.asarray(self.tiles, np.float32)[vertex_material][:, None]
        colours = np.ones((len(uvs), 4), np.float32)
        colours[:, :3] = whole.colours
        scene = Scene(
            name=name,
            positions=whole.positions,
            indices=whole.indices,
            normals=whole.normals,
            uvs=uvs,
            colours=colours,
            material_ids=whole.materials,
            materials=self.materials,
            textures=self.textures,
            lights=list(lights),
            sky=sky or Sky(),
            cameras=list(cameras),
            route=route,
            metres_per_unit=metres_per_unit,
            place=place,
        )
        mapped = np.array([m.normal_texture >= 0 for m in self.materials])
        if mapped.any():
            scene.tangents = _tangents(scene, mapped[scene.material_ids])
        scene.features = find_features(scene)
        scene.content_hash = content_digest(scene)
        return scene


def _tangents(scene: Scene, wanted: Bools) -> Floats:
    """Tangents float32 (V, 4) of the vertices of the `wanted` triangles, bool (T); (1, 0, 0, 1) for the others."""
    out = np.zeros((len(scene.positions), 4), np.float32)
    out[:, [0, 3]] = 1
    used, indices = np.unique(scene.indices[wanted], return_inverse=True)
    out[used] = tangents(scene.positions[used], scene.normals[used], scene.uvs[used], indices.reshape(-1, 3))
    return out


def slanted_count(part: Mesh) -> int:
    """How many triangles have a longest edge of more than 3 heights."""
    a, b, c = (part.positions[part.indices[:, k]] for k in range(3))
    doubled = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([np.sum((q - p) * (q - p), axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    return int(np.count_nonzero(longest > 3 * doubled))
