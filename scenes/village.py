"""The built-in outdoor scene: a village of timber houses on 120 x 120 m among wooded hills.

Shingles, planks, fences, carts, barrels and stones are geometry; foliage and grass are alpha-masked cards. The sun
casts shadows. More detail means finer terrain and round things, smaller and more shingles, leaves and grass.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from shading_atlas_bench.arithmetic import draws
from shading_atlas_bench.arithmetic.arrays import Bools, Bytes, Doubles
from shading_atlas_bench.arithmetic.functions import Numbers, arctan, arctan2, cos, exp, hypot, power, sin
from shading_atlas_bench.arithmetic.matrices import product
from shading_atlas_bench.scenes import surfaces
from shading_atlas_bench.scenes.builder import (
    ALL_FACES,
    WHITE,
    WITHOUT_BOTTOM,
    Mesh,
    Palette,
    ball,
    box,
    boxes,
    card,
    cylinder,
    lathe,
    lattice_indices,
    merge,
    mesh,
    moved,
    picked,
    placement,
    repeat,
    rounded,
    sagging,
    struts,
    tube,
    without_slivers,
)
from shading_atlas_bench.scenes.model import Camera, Light, Material, Scene, SceneError, Sky

DEFAULT_DETAIL = 200_000
LEAST_DETAIL, MOST_DETAIL = 130_000, 8_000_000
HALF, FAR = 60.0, 190.0  # metres from the middle to the village's edge and to the last hills
EYE_HEIGHT = 1.6
OVERHANG = 0.55  # metres of a roof beyond its walls
UP = np.array([0.0, 1.0, 0.0])

# Shares of the triangles that the fixed parts leave over; grass takes the rest.
SHINGLES, FOLIAGE = 0.30, 0.46

# Houses: where along the street (x), which side of it, ridge length, width, wall height in metres.
HOUSES = (
    (-46, 1, 8.0, 5.6, 2.6), (-44, -1, 7.0, 5.2, 2.4), (-33, 1, 7.2, 5.4, 2.5), (-31, -1, 9.0, 6.0, 2.7),
    (-20, 1, 9.4, 6.2, 2.8), (-18, -1, 7.2, 5.2, 2.5), (-6.5, 1, 7.0, 5.2, 2.4), (-5, -1, 8.6, 5.8, 2.7),
    (14, 1, 8.2, 5.6, 2.6), (12, -1, 7.4, 5.4, 2.5), (25, 1, 7.0, 5.2, 2.5), (26, -1, 8.8, 5.8, 2.6),
    (38, 1, 8.0, 5.4, 2.5), (40, -1, 7.2, 5.2, 2.4), (53, 0, 16.0, 7.6, 3.3),
)  # fmt: skip


def street(x: Numbers) -> Numbers:
    """The z of the street's middle at x."""
    return 4.0 * sin(x / 15.0) + 1.5 * sin(x / 6.5)


@dataclass(frozen=True)
class _RoofSide:
    """One side of a roof.

    eave: its lower edge at x = 0. slope, outward: unit directions up along it and away from it. reach: its length along
    the slope.
    """

    eave: Doubles
    slope: Doubles
    outward: Doubles
    reach: float


@dataclass
class _Materials:
    """Material indices."""

    grass: int
    meadow: int
    dirt: int
    stone: int
    paving: int
    planks: int
    timber: int
    bark: int
    shingle: int
    plaster: int
    cloth: int
    iron: int
    straw: int
    paint: int
    signs: int
    dark: int
    glass: int
    leaves: int
    needles: int
    blades: int


SIGNS: surfaces.Boards = (
    (("BLACKSMITH",), "brown"), (("TAVERN", "EST. 893"), "brown"), (("HARBOUR", "2 MILES"), "brown"),
    (("BAKER",), "brown"), (("MARKET", "DAY 7"), "white"), (("WELL",), "blue"), (("NO. 12",), "white"),
    (("WEAVER",), "brown"),
) * 2  # fmt: skip


def _materials(palette: Palette, seed: int) -> _Materials:
    white = (1.0, 1.0, 1.0, 1.0)
    stones, stone_normals = surfaces.cobbles(seed)
    mud, mud_wear = surfaces.mud(seed)
    paved, paved_normals, paved_wear = surfaces.paving(seed)

    add, textured = palette.material, palette.textured

    def worn(name: str, texels: Bytes) -> Material:
        return Material(name, white, surface_texture=palette.texture(name + " wear", texels, srgb=False))

    def alike(name: str, tile: float, other: int) -> int:
        return add(Material(name, white, palette.materials[other].base_texture), tile)

    def cut_out(name: str, roughness: float) -> Material:
        return Material(name, white, roughness=roughness, alpha_mode="mask", alpha_cutoff=0.5, double_sided=True)

    bark = textured(Material("bark", white), 1.0, surfaces.bark(seed))
    shingle = textured(Material("shingle", white), 1.0, surfaces.shingle(seed))
    grass = textured(Material("grass", white), 3.0, surfaces.grass(seed))
    return _Materials(
        grass=grass,
        meadow=alike("meadow", 17.0, grass),
        dirt=textured(worn("dirt", mud_wear), 2.5, mud),
        stone=textured(Material("stone", white, roughness=0.9), 2.0, stones, stone_normals),
        paving=textured(worn("paving", paved_wear), 2.0, paved, paved_normals),
        planks=textured(Material("planks", white, roughness=0.9), 1.6, surfaces.planks(seed)),
        timber=alike("timber", 0.7, bark),
        bark=bark,
        shingle=shingle,
        plaster=textured(Material("plaster", white), 2.0, surfaces.plaster(seed)),
        cloth=textured(Material("cloth", white), 1.5, surfaces.cloth()),
        iron=add(Material("iron", (0.10, 0.10, 0.11, 1), roughness=0.4, metallic=0.9)),
        straw=alike("straw", 0.8, shingle),
        paint=add(Material("paint", white, roughness=0.35)),
        signs=textured(Material("signs", white, roughness=0.5), 1.0, surfaces.signs(SIGNS)),
        dark=add(Material("dark", (0.012, 0.012, 0.015, 1), roughness=0.9)),
        glass=add(Material("glass", (0.012, 0.012, 0.015, 1), roughness=0.08)),
        leaves=textured(cut_out("leaves", 0.5), 1.0, surfaces.leaves(seed)),
        needles=textured(cut_out("needles", 0.6), 1.0, surfaces.needles(seed)),
        blades=textured(cut_out("blades", 0.65), 1.0, surfaces.blades(seed)),
    )


class _Ground:
    """The height of the land, and the mesh grid that shows it."""

    def __init__(self, cells: int, seed: int) -> None:
        rng = surfaces.generator(seed, "ground")
        self._waves = [
            (rng.uniform(0.16, 0.3), length, rng.uniform(0, 6.28), rng.uniform(0, 6.28))
            for length in 8.0 * power(1.7, np.arange(9.0))
        ]
        outside = HALF * power(FAR / HALF, np.arange(1, 13) / 12)
        self.axis = np.concatenate([-outside[::-1], np.linspace(-HALF, HALF, cells + 1), outside])
        x, z = np.meshgrid(self.axis, self.axis)
        self.grid = self._shape(x, z)

    def _shape(self, x: Doubles, z: Doubles) -> Doubles:
        """The smooth land: gentle in the village, level under houses and along the street, hills around."""
        land, hills = np.zeros_like(x), np.zeros_like(x)
        for weight, length, turn, phase in self._waves:
            wave = sin((x * cos(turn) + z * sin(turn)) * 6.28 / length + phase)
            if length < 60:
                land += wave * weight * min(1.0, length / 40)
            else:
                hills += wave
        away = np.clip((hypot(x, z) - 55) / (FAR - 55), 0, None)
        rise = power(away, 1.3) * (30 + 7 * hills)
        trodden = _bell((z - street(x)) / 4.5) * (np.abs(x) < HALF + 20)
        return land * (1 - 0.8 * trodden) * 0.8 + np.maximum(rise, 0) * (1 - 0.6 * trodden)

    def height(self, x: ArrayLike, z: ArrayLike) -> Doubles:
        """The mesh's height at points, as its triangles show it."""
        x, z = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(z, np.float64))
        last = len(self.axis) - 2
        i = np.clip(np.searchsorted(self.axis, x, side="right") - 1, 0, last)
        j = np.clip(np.searchsorted(self.axis, z, side="right") - 1, 0, last)
        u = (x - self.axis[i]) / (self.axis[i + 1] - self.axis[i])
        v = (z - self.axis[j]) / (self.axis[j + 1] - self.axis[j])
        a, b = self.grid[j, i], self.grid[j, i + 1]
        c, d = self.grid[j + 1, i + 1], self.grid[j + 1, i]
        height: Doubles = np.where(u > v, a + u * (b - a) + v * (c - b), a + v * (d - a) + u * (c - d))
        return height

    def points(self, x: ArrayLike, z: ArrayLike, above: float = 0.0) -> Doubles:
        """Points (N, 3) on the ground."""
        across, along = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(z, np.float64))
        return np.stack([across, self.height(across, along) + above, along], axis=-1)


class _Village:
    """The parts of the village. `finer` scales how finely round things are divided: 1 at the default detail."""

    def __init__(self, materials: _Materials, ground: _Ground, finer: float, seed: int) -> None:
        self.m, self.ground, self.finer, self.seed = materials, ground, finer, seed
        x = np.array([h[0] for h in HOUSES], np.float64)
        side = np.array([h[1] for h in HOUSES], np.float64)
        depth = np.array([h[3] for h in HOUSES])
        z = street(x) + side * (5.2 + depth / 2)
        slope = np.degrees(arctan((street(x + 1) - street(x - 1)) / 2))
        yaw = np.where(side >= 0, 180.0, 0.0) - slope
        x[-1], z[-1], yaw[-1] = 50.0, street(53.0) + 0.5, -90.0
        self.houses = np.stack([x, z, yaw], axis=1)

    def count(self, at_default: int, least: int = 4) -> int:
        """A number of divisions, more of them at more detail."""
        return max(least, round(at_default * self.finer))

    # --- land ----------------------------------------------------------------------------------------------------

    def land(self) -> Mesh:
        """The terrain: the village, then the hills, whose texture is larger so that it does not show its tiles."""
        axis, grid = self.ground.axis, self.ground.grid
        x, z = np.meshgrid(axis, axis)
        slope_x, slope_z = np.gradient(grid, axis, axis=1), np.gradient(grid, axis, axis=0)
        normals = np.stack([-slope_x, np.ones_like(grid), -slope_z], axis=-1)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        indices = lattice_indices(len(axis), len(axis))[:, ::-1]
        part = mesh(np.stack([x, grid, z], -1), normals, np.stack([x, z], -1), indices, self.m.grass)
        worn = _bell((z - street(x)) / 3.2) * (np.abs(x) < HALF)
        for hx, hz, _ in self.houses:
            worn = np.maximum(worn, _bell(hypot(x - hx, z - hz) / math.sqrt(38)))
        tint = 1 + worn.reshape(-1, 1) * np.array([0.35, -0.05, 0.1])
        rng = surfaces.generator(self.seed, "land")
        tint = tint * (1 + 0.25 * _patches(rng, x, z).reshape(-1, 1) * np.array([1.0, 0.6, 0.5]))
        part.colours[:] = tint * (0.95 - 0.25 * np.clip(hypot(x, z).reshape(-1, 1) / FAR, 0, 1))
        outside = np.abs(part.positions[part.indices][:, :, [0, 2]]).max(axis=(1, 2)) > HALF + 1e-3
        return merge([picked(part, ~outside, self.m.grass), picked(part, outside, self.m.meadow)])

    def path(self) -> Mesh:
        """The street and paths to the doors as ribbons that lie on the terrain and dip under it at their edges."""
        x = np.linspace(-HALF, 46, self.count(150))
        ribbons = [self._ribbon(np.stack([x, street(x)], axis=1), 2.1, self.m.dirt)]
        for (hx, hz, _), house in zip(self.houses[:-1], HOUSES[:-1], strict=True):
            t = np.linspace(0, 1, self.count(8))[:, None]
            start, end = np.array([hx, street(hx) + house[1] * 1.5]), np.array([hx, hz - house[1] * house[3] / 2])
            ribbons.append(self._ribbon(start + (end - start) * t, 0.7, self.m.dirt))
        angle = np.linspace(0, 2 * np.pi, self.count(28) + 1)
        plaza = [self._disc(np.array([3.0, street(3.0)]), r0, r1, angle) for r0, r1 in ((0.0, 3.0), (3.0, 6.5))]
        return merge(ribbons + plaza)

    def _ribbon(self, line: Doubles, half: float, material: int) -> Mesh:
        """A ribbon of half width `half` along (x, z) points (N, 2)."""
        along = np.gradient(line, axis=0)
        side = np.stack([along[:, 1], -along[:, 0]], axis=1)
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        across = np.array([-1.12, -1, -0.5, 0, 0.5, 1, 1.12])
        lift = np.array([-0.3, 0.03, 0.05, 0.06, 0.05, 0.03, -0.3])
        spots = line[:, None] + side[:, None] * (across * half)[:, None]
        positions = self.ground.points(spots[..., 0], spots[..., 1])
        positions[..., 1] += lift
        length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        uvs = np.stack(np.broadcast_arrays(across * half, length[:, None]), axis=-1)
        indices = lattice_indices(len(line), len(across))[:, ::-1]
        return mesh(positions, np.broadcast_to(UP, positions.shape), uvs, indices, material)

    def _disc(self, centre: Doubles, inner: float, outer: float, angle: Doubles) -> Mesh:
        """A ring of the paved plaza on the terrain."""
        radii = np.linspace(inner, outer, self.count(5, 3))
        x = centre[0] + radii[:, None] * sin(angle)
        z = centre[1] + radii[:, None] * cos(angle)
        positions = self.ground.points(x, z, 0.075)
        if outer > 6:
            positions[-1, :, 1] -= 0.35
        indices = lattice_indices(len(radii), len(angle))[:, ::-1]
        part = mesh(positions, np.broadcast_to(UP, positions.shape), np.stack([x, z], -1), indices, self.m.paving)
        return without_slivers(part)

    # --- houses --------------------------------------------------------------------------------------------------

    def body(self, index: int) -> Mesh:
        """House number `index` about its own middle, without shingles."""
        rng = surfaces.generator(self.seed, f"house {index}")
        _, _, length, width, wall = HOUSES[index]
        hall = index == len(HOUSES) - 1
        walls = [self._walls(length, width, wall, index % 3, rng), self._openings(length, width, wall, rng)]
        extra = self._shields(length, width, wall, rng) if hall else self._chimney(length, wall, width)
        return merge([*walls, self._roof(length, width, wall), extra])

    def house(self, index: int, body: Mesh, shingles: int) -> Mesh:
        """House number `index` on the ground: its body and about `shingles` shingles."""
        rng = surfaces.generator(self.seed, f"shingles {index}")
        _, _, length, width, wall = HOUSES[index]
        frame = _roof_side(width, wall)
        sides = [self._slope(frame, length / 2 + OVERHANG, shingles // 2, rng) for _ in range(2)]
        x, z, yaw = self.houses[index]
        corner = hypot(length, width) / 2
        around = self.ground.height(x + corner * np.array([0, 1, -1, 0, 0]), z + corner * np.array([0, 0, 0, 1, -1]))
        level = float(around.max() + around.min()) / 2 + 0.12
        return moved(merge([body, sides[0], moved(sides[1], (0, 0, 0), 180)]), (x, level, z), yaw)

    def _walls(self, length: float, width: float, wall: float, kind: int, rng: draws.Generator) -> Mesh:
        """Stone base, plank or plaster walls between posts with braces; the gables are boarded."""
        m, a, b = self.m, length / 2, width / 2
        dark = np.array([0.55, 0.5, 0.46])
        parts = [box((0, -0.35, 0), (length + 0.3, 1.3, width + 0.3), m.stone, faces=WITHOUT_BOTTOM)]
        infill = (m.planks, m.plaster, m.planks)[kind]
        parts.append(
            box((0, wall / 2 + 0.05, 0), (length - 0.1, wall - 0.3, width - 0.1), infill, WHITE, faces="-x+x-z+z")
        )
        if kind != 1:
            rows = np.arange(0.42, wall - 0.2, 0.24 / min(self.finer, 1.5))
            for z in (-b, b):
                centres = np.stack([0 * rows, rows, z + 0.02 * np.sign(z) * rng.random(len(rows))], axis=1)
                sizes = np.stack(
                    [np.full(len(rows), length - 0.1), np.full(len(rows), 0.22), np.full(len(rows), 0.08)], 1
                )
                tints = rng.uniform(0.7, 1.1, (len(rows), 1)) * np.ones(3)
                parts.append(boxes(centres, sizes, m.planks, None, tints, faces="-y+y-z+z"))
        xs = np.linspace(-a, a, max(4, round(length / 1.7)) + 1)
        feet = [(x, 0.25, z) for x in xs for z in (-b, b)] + [(x, 0.25, 0) for x in (-a, a)]
        posts = np.array(feet)
        parts.append(struts(posts, posts + (wall - 0.42) * UP, 0.2, m.timber, dark))
        corners = np.array([(-a, 0, -b), (a, 0, -b), (a, 0, b), (-a, 0, b), (-a, 0, -b)])
        for y in (0.3, wall - 0.22):
            parts.append(struts(corners[:-1] + y * UP, corners[1:] + y * UP, 0.22, m.timber, dark, faces=ALL_FACES))
        low, high = [], []
        for z in (-b, b):
            low += [(xs[0], 0.4, z), (xs[-1], 0.4, z)]
            high += [(xs[1], wall - 0.1, z), (xs[-2], wall - 0.3, z)]
        for x in (-a, a):
            low += [(x, 0.4, -b), (x, 0.4, b)]
            high += [(x, wall - 0.3, -0.1), (x, wall - 0.3, 0.1)]
        parts.append(struts(low, high, 0.14, m.timber, dark))
        return merge(parts)

    def _openings(self, length: float, width: float, wall: float, rng: draws.Generator) -> Mesh:
        """A door with iron bands and a ring, and shuttered windows; the front faces +z."""
        m, front = self.m, width / 2 + 0.06
        dark = np.array([0.45, 0.4, 0.36])
        parts = [box((0, 1.1, front), (1.05, 1.9, 0.1), m.planks, (0.7, 0.62, 0.55))]
        parts.append(boxes([(0, y, front + 0.055) for y in (0.55, 1.1, 1.7)], (0.95, 0.07, 0.02), m.iron))
        parts.append(
            boxes(
                [(-0.62, 1.15, front), (0.62, 1.15, front), (0, 2.12, front)],
                [(0.16, 2.0, 0.2), (0.16, 2.0, 0.2), (1.5, 0.18, 0.22)],
                m.timber,
                tints=dark,
            )
        )
        parts.append(box((0, 0.12, front + 0.45), (1.5, 0.25, 0.7), m.stone))
        angle = np.linspace(0, 2 * np.pi, self.count(10) + 1)[:-1]
        ring = np.stack([0.35 + 0.06 * cos(angle), 1.05 + 0.06 * sin(angle), 0 * angle + front + 0.08], axis=1)
        parts.append(tube(ring, 0.012, self.count(5, 3), m.iron, closed=True))
        paint = (
            np.array([(0.25, 0.07, 0.05), (0.08, 0.16, 0.22), (0.10, 0.18, 0.10), (0.35, 0.25, 0.10)])[rng.integers(4)]
            * 2.2
        )
        windows = [
            (x, side)
            for x in np.linspace(-length / 2 + 1.3, length / 2 - 1.3, max(2, round(length / 2.4)))
            for side in (1, -1)
        ]
        window = merge(
            [
                box((0, 0, 0), (0.6, 0.7, 0.06), m.glass, faces="+z"),
                boxes(
                    [(0, 0.38, 0.02), (0, -0.38, 0.02), (-0.33, 0, 0.02), (0.33, 0, 0.02), (0, 0, 0.02)],
                    [(0.8, 0.08, 0.12), (0.8, 0.08, 0.12), (0.08, 0.7, 0.12), (0.08, 0.7, 0.12), (0.04, 0.7, 0.06)],
                    m.timber,
                    tints=dark,
                ),
                boxes([(-0.6, 0, 0.06), (0.6, 0, 0.06)], (0.42, 0.74, 0.05), m.planks, tints=paint),
            ]
        )
        spots = [(x, wall * 0.6, side * (front - 0.02)) for x, side in windows if abs(x) > 1.1 or side < 0]
        turns = [0 if z > 0 else 180 for _, _, z in spots]
        return merge([*parts, repeat(window, placement(spots, turns))])

    def _roof(self, length: float, width: float, wall: float) -> Mesh:
        """Boarded gables, rafters, a deck, and barge boards that cross above the ridge; without shingles."""
        m, a = self.m, length / 2
        side = _roof_side(width, wall)
        eave, slope, outward = side.eave, side.slope, side.outward
        ridge = eave + slope * side.reach
        dark = np.array([0.5, 0.45, 0.42])
        gables = []
        for x, turn in ((-a, -1), (a, 1)):
            foot, top = np.array([x, wall - 0.12, width / 2 * turn]), np.array([x, ridge[1] - 0.12, 0])
            corners = np.array([foot, foot * [1, 1, -1], top])
            uvs = corners[:, [2, 1]] * [1, -1]
            gables.append(mesh(corners, np.tile([turn, 0, 0], (3, 1)), uvs, [0, 1, 2], m.planks, (0.8, 0.75, 0.7)))
        turns = np.stack([[1, 0, 0], outward, -slope], axis=1)[None]
        deck_size = (length + 2 * OVERHANG, 0.08, side.reach)
        deck = boxes([eave + slope * side.reach / 2 - outward * 0.05], deck_size, m.planks, turns, (0.6, 0.55, 0.5))
        xs = np.linspace(-a, a, max(3, round(length / 1.2)))[:, None] * np.array([1.0, 0, 0])
        rafters = struts(xs + eave - outward * 0.14, xs + ridge - outward * 0.14, 0.1, m.timber, dark)
        edges = np.array([[-a - OVERHANG, 0.02, 0], [a + OVERHANG, 0.02, 0]])
        boards = struts(
            edges + eave, edges + ridge + slope * 0.8, 0.07, m.timber, dark * 1.3, height=0.28, faces=ALL_FACES
        )
        covered = merge([deck, rafters, boards])
        beam = edges + (ridge[1] + 0.04) * UP
        return merge(
            [
                *gables,
                covered,
                moved(covered, (0, 0, 0), 180),
                struts(beam[:1], beam[1:], 0.2, m.timber, dark, faces=ALL_FACES),
            ]
        )

    def _slope(self, side: _RoofSide, half: float, count: int, rng: draws.Generator) -> Mesh:
        """Courses of shingles up one side of a roof of half length `half`: `count` of them, each a thin wedge."""
        eave, slope, outward, reach = side.eave, side.slope, side.outward, side.reach
        size = max(0.09, np.sqrt(2 * half * reach / max(count, 8) / 1.3))
        columns, rows = max(3, round(2 * half / size)), max(3, round(reach / (1.3 * size)))
        row, column = (grid.ravel() for grid in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
        wide, tall = 2 * half / columns, reach / rows
        x = (column + 0.5 + 0.5 * (row % 2) * (column < columns - 1)) * wide - half
        x = np.minimum(x, half - wide / 2) + rng.uniform(-0.06, 0.06, len(row)) * wide
        thick = 0.02 + 0.012 * rng.random(len(row))
        drop = rng.uniform(-0.12, 0.12, len(row)) * tall
        centres = eave + np.stack([x, 0 * x, 0 * x], axis=1) + slope * ((row + 0.62) * tall + drop)[:, None]
        centres = centres + outward * (0.035 + thick)[:, None]
        lean = arctan2(0.05, tall * 1.3)
        along = slope * cos(lean) - outward * sin(lean)
        turn = np.stack([[1, 0, 0], np.cross(-along, [1, 0, 0]), -along], axis=1)
        spin = rng.normal(0, 0.02, len(row))
        turns = product(turn, placement(np.zeros((len(row), 3)), np.degrees(spin))[:, :3, :3])
        sizes = np.stack([np.full(len(row), wide * 0.96), thick, np.full(len(row), tall * 1.3)], axis=1)
        tints = rng.uniform(0.65, 1.15, (len(row), 1)) * (1 + rng.normal(0, 0.03, (len(row), 3)))
        return boxes(centres, sizes, self.m.shingle, turns, tints, faces=self.shingle_faces)

    @property
    def shingle_faces(self) -> str:
        """The faces of a shingle that are drawn: its sides only where shingles are many."""
        return "+y+z" if self.finer < 2 else "-x+x+y+z"

    @property
    def triangles_per_shingle(self) -> int:
        return len(self.shingle_faces)

    def _chimney(self, length: float, wall: float, width: float) -> Mesh:
        """A stone chimney through the roof."""
        top = wall + width / 2 + 1.1
        return merge(
            [
                box((length / 4, top / 2 + 1, -0.5), (0.7, top - 2, 0.7), self.m.stone),
                box((length / 4, top + 0.03, -0.5), (0.86, 0.12, 0.86), self.m.stone),
                box((length / 4, top + 0.1, -0.5), (0.45, 0.06, 0.45), self.m.dark),
            ]
        )

    def _shields(self, length: float, width: float, wall: float, rng: draws.Generator) -> Mesh:
        """A row of painted round shields and two banners along the hall's front, and dragon posts beside its door."""
        m, front = self.m, width / 2 + 0.22
        n = self.count(18)
        board = lathe([(0.42, 0), (0.42, 0.03), (0.1, 0.07)], n, m.paint)
        boss = lathe([(0.1, 0.07), (0.08, 0.13), (0, 0.15)], n, m.iron)
        rim = tube(
            np.stack(
                [
                    0.42 * cos(np.linspace(0, 6.283, n + 1)[:-1]),
                    0.02 + 0 * np.arange(n),
                    0.42 * sin(np.linspace(0, 6.283, n + 1)[:-1]),
                ],
                1,
            ),
            0.025,
            self.count(5),
            m.iron,
            closed=True,
        )
        shield = merge([board, boss, rim])
        xs = [x for x in np.linspace(-length / 2 + 0.8, length / 2 - 0.8, 15) if abs(x) > 1.4]
        tints = np.array([(0.45, 0.06, 0.05), (0.75, 0.62, 0.35), (0.06, 0.13, 0.3), (0.1, 0.25, 0.12)])
        shields = repeat(
            shield, placement([(x, 2.55, front) for x in xs], 0, 1.0, 90), tints[rng.integers(0, 4, len(xs))]
        )
        posts = []
        for x in (-1.3, 1.3):
            curve = rounded(
                [(x, 0, front + 0.3), (x, 2.6, front + 0.3), (x, 3.4, front + 0.9), (x, 3.9, front + 0.4)],
                0.8,
                self.count(8),
            )
            posts.append(tube(curve, np.linspace(0.16, 0.05, len(curve)), self.count(8), m.timber))
        banners = [
            card(
                [
                    (x - 0.4, 1.0, front + 0.02),
                    (x + 0.4, 1.0, front + 0.02),
                    (x + 0.4, 2.1, front + 0.02),
                    (x - 0.4, 2.1, front + 0.02),
                ],
                m.cloth,
                (0, 0, 0.53, 0.73),
            )
            for x in (-4.5, 4.5)
        ]
        return merge([shields, *posts, *banners])

    # --- things --------------------------------------------------------------------------------------------------

    def well(self) -> Mesh:
        """A well on the plaza: a stone ring, posts, a shingled roof, a windlass with rope and a bucket."""
        m, rng = self.m, surfaces.generator(self.seed, "well")
        rings = []
        for k in range(5):
            angle = (np.arange(14) + 0.5 * (k % 2)) / 14 * 360
            places = np.stack([sin(np.radians(angle)), 0 * angle + 0.1 + 0.19 * k, cos(np.radians(angle))], axis=1)
            turns = placement(np.zeros((14, 3)), angle)[:, :3, :3]
            sizes = np.array([0.44, 0.185, 0.3]) * rng.uniform(0.93, 1.03, (14, 3))
            rings.append(boxes(places, sizes, m.stone, turns, rng.uniform(0.75, 1.1, (14, 1)) * np.ones(3)))
        water = lathe([(0.85, 0.55), (0, 0.55)], self.count(14), m.glass)
        posts = struts([(-1.0, 0, 0), (1.0, 0, 0)], [(-1.0, 2.5, 0), (1.0, 2.5, 0)], 0.16, m.timber)
        windlass = repeat(
            cylinder(0.11, 1.9, self.count(12), m.planks), product(placement([(-0.95, 1.5, 0)]), _lay("x"))
        )
        crank = tube([(0.95, 1.5, 0), (1.25, 1.5, 0), (1.25, 1.2, 0.1), (1.5, 1.2, 0.1)], 0.025, self.count(6), m.iron)
        rope = struts([(0, 1.5, 0.11)], [(0, 1.15, 0.11)], 0.03, m.straw)
        bucket = moved(self._barrel(), (0, 0.85, 0.11), scale=0.32)
        slope = np.array([0, 0.7, -0.75]) / hypot(0.7, 0.75)
        eave = np.array([0, 2.35, 0.95])
        outward = np.array([0, -slope[2], slope[1]])
        side = self._slope(_RoofSide(eave, slope, outward, 1.25), 1.4, 60, rng)
        deck = boxes(
            [eave + slope * 0.62 - outward * 0.03],
            (2.8, 0.05, 1.25),
            m.planks,
            np.array([np.stack([[1, 0, 0], outward, -slope], axis=1)]),
        )
        roof = merge([side, deck])
        x = 3.0
        centre = self.ground.points(x, street(x), 0.05)
        return moved(
            merge([*rings, water, posts, windlass, crank, rope, bucket, roof, moved(roof, (0, 0, 0), 180)]), centre, 20
        )

    def _barrel(self) -> Mesh:
        """A barrel of 0.95 m with hoops and a sunk lid."""
        m, n = self.m, self.count(11)
        body = lathe(
            [(0.30, 0), (0.36, 0.22), (0.38, 0.47), (0.36, 0.72), (0.30, 0.95), (0.27, 0.95), (0.27, 0.9), (0, 0.9)],
            n,
            m.planks,
        )
        hoops = [
            lathe([(r, y), (r + 0.008, y + 0.06)], n, m.iron)
            for r, y in ((0.325, 0.08), (0.368, 0.27), (0.372, 0.63), (0.325, 0.82))
        ]
        return merge([body, *hoops])

    def _wheel(self) -> Mesh:
        """A cart wheel of radius 0.55 m about the z axis."""
        m, n = self.m, self.count(20)
        angle = np.linspace(0, 2 * np.pi, n + 1)[:-1]
        rim = tube(
            np.stack([0.55 * cos(angle), 0.55 * sin(angle), 0 * angle], axis=1),
            0.045,
            self.count(5),
            m.planks,
            closed=True,
        )
        spokes = np.arange(10) * np.pi / 5
        ends = np.stack([0.54 * cos(spokes), 0.54 * sin(spokes), 0 * spokes], axis=1)
        hub = repeat(moved(cylinder(0.09, 0.24, self.count(10), m.timber), (0, -0.12, 0)), _lay("z")[None])
        return merge([rim, struts(0 * ends, ends, 0.05, m.planks), hub])

    def _cart(self) -> Mesh:
        """A two-wheeled cart with board sides, shafts and a load of sacks."""
        m = self.m
        floor = boxes([(0.0, 0.7, z) for z in np.linspace(-0.5, 0.5, 6)], (2.2, 0.05, 0.18), m.planks)
        sides = boxes([(0, y, z) for y in (0.85, 1.05) for z in (-0.62, 0.62)], (2.3, 0.16, 0.04), m.planks)
        ends = boxes([(x, 0.95, 0) for x in (-1.1, 1.1)], (0.04, 0.36, 1.2), m.planks)
        stakes = np.array([(x, 0.6, z) for x in (-0.9, 0, 0.9) for z in (-0.66, 0.66)])
        wheels = repeat(self._wheel(), placement([(0, 0.58, -0.8), (0, 0.58, 0.8)]))
        shafts = struts([(1.0, 0.68, -0.5), (1.0, 0.68, 0.5)], [(2.9, 0.25, -0.42), (2.9, 0.25, 0.42)], 0.08, m.timber)
        axle = struts([(0, 0.58, -0.9)], [(0, 0.58, 0.9)], 0.1, m.timber)
        sacks = repeat(
            ball(0.3, self.count(12), m.straw, (1.2, 1.1, 0.9)),
            placement(
                [(-0.7, 0.9, -0.2), (-0.2, 0.92, 0.25), (0.35, 0.9, -0.15), (0.7, 0.95, 0.3)],
                [10, 70, 130, 40],
                np.array([(1.2, 0.8, 0.9)] * 4),
            ),
        )
        return merge(
            [floor, sides, ends, struts(stakes, stakes + 0.62 * UP, 0.06, m.timber), wheels, shafts, axle, sacks]
        )

    def _crate(self) -> Mesh:
        """A slatted crate of 0.7 m."""
        m = self.m
        slats = [(0, y, z) for y in (0.1, 0.33, 0.56) for z in (-0.3, 0.3)]
        ends = [(x, y, 0) for y in (0.1, 0.33, 0.56) for x in (-0.33, 0.33)]
        return merge(
            [
                boxes(slats, (0.7, 0.17, 0.03), m.planks),
                boxes(ends, (0.03, 0.17, 0.6), m.planks),
                box((0, 0.02, 0), (0.66, 0.03, 0.6), m.planks),
                box((0, 0.45, 0), (0.6, 0.2, 0.54), m.straw, faces="+y"),
            ]
        )

    def _stall(self, rng: draws.Generator) -> Mesh:
        """A market stall with a sagging striped awning, a counter, crates and fruit."""
        m, n = self.m, self.count(10)
        feet = np.array([(x, 0, z) for x in (-1.5, 1.5) for z in (-0.9, 0.9)])
        tops = feet + np.array([2.6, 2.2, 2.6, 2.2])[:, None] * UP
        u, v = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n))
        sag = 2.42 - 0.22 * v - 0.16 * (1 - u * u)
        positions = np.stack([u * 1.75, sag, v * 1.2], axis=-1)
        normals = np.broadcast_to(UP, positions.shape)
        uvs = np.stack([u * 1.75, v * 1.2], axis=-1)
        top = mesh(positions, normals, uvs, lattice_indices(n, n)[:, ::-1], m.cloth)
        under = mesh(positions - 0.01 * UP, -normals, uvs, lattice_indices(n, n), m.cloth, (0.7, 0.7, 0.7))
        counter = boxes([(0, 0.9, 0.75), (0, 0.5, 0.98)], [(3.1, 0.06, 0.6), (3.0, 0.75, 0.04)], m.planks)
        fruit = [
            (x + rng.uniform(-0.03, 0.03), 0.98 + 0.06 * k, 0.62 + 0.11 * j)
            for x in np.arange(-1.3, 1.3, 0.17)
            for j in range(3)
            for k in range(1)
        ]
        tints = np.array([(0.6, 0.06, 0.04), (0.75, 0.42, 0.05), (0.25, 0.4, 0.06)])
        goods = repeat(ball(0.055, self.count(7), m.paint), placement(fruit), tints[(np.arange(len(fruit)) // 15) % 3])
        return merge(
            [
                struts(feet, tops, 0.09, m.timber),
                top,
                under,
                counter,
                goods,
                repeat(self._crate(), placement([(-1.0, 0, -0.3), (0.9, 0, -0.4), (0.9, 0.68, -0.4)], [5, -8, 20])),
            ]
        )

    def things(self) -> list[Mesh]:
        """Barrels, carts, crates, stalls, wood piles, hay, signs and washing lines about the houses."""
        rng = surfaces.generator(self.seed, "things")
        barrels: list[Doubles] = []
        crates: list[Doubles] = []
        hay: list[Doubles] = []
        piles: list[tuple[float, float, float]] = []
        for (x, z, yaw), house in zip(self.houses, HOUSES, strict=True):
            out = np.array([sin(np.radians(yaw)), cos(np.radians(yaw))])
            side = np.array([cos(np.radians(yaw)), -sin(np.radians(yaw))])
            front, half = house[3] / 2 + 0.75, house[2] / 2
            for k in range(3):
                barrels.append(np.array([x, z]) + out * (front + 0.1 * (k % 2)) + side * (half - 0.6 - 0.8 * k))
            crates.append(np.array([x, z]) + out * front - side * (half - 0.7))
            if len(hay) % 2 == 0:
                beside = np.array([x, z]) - side * (half + 1.15)
                piles.append((beside[0], beside[1], yaw + 90))
            hay.append(np.array([x, z]) - out * (house[3] / 2 + 2.5) + side * rng.uniform(-2, 2))
        x, z, yaw = np.array(piles).T
        parts = [
            self._about(self._barrel(), np.array(barrels), rng),
            self._about(self._crate(), np.array(crates), rng),
            self._about(self._bale(), np.array(hay), rng),
            repeat(self._logs(), placement(self.ground.points(x, z), yaw)),
        ]
        carts = np.array(
            [
                (-27.0, street(-27.0) + 3.6, 15),
                (-12.5, street(-12.5) - 3.5, 170),
                (19.0, street(19.0) + 3.4, -20),
                (33.0, street(33) - 3.5, 200),
            ]
        )
        parts.append(repeat(self._cart(), placement(self.ground.points(carts[:, 0], carts[:, 1]), carts[:, 2])))
        for x, dz, yaw in ((-2.2, 6.9, 180), (6.0, 6.5, 200), (8.2, -5.6, -20), (0.2, -7.4, 10)):
            parts.append(moved(self._stall(rng), self.ground.points(x, street(x) + dz), yaw))
        for index, x, dz in ((1, -23.5, 3.1), (0, -9.8, -3.2), (3, 9.5, 3.5), (2, -38.0, 3.0), (7, 20.5, -3.0)):
            parts.append(moved(self._signpost(index), self.ground.points(x, street(x) + dz), -90 if index != 2 else 90))
        parts.append(self._washing())
        return parts

    def _about(self, part: Mesh, places: Doubles, rng: draws.Generator) -> Mesh:
        """Copies of a part at (x, z) places (N, 2) on the ground, turned, sized and tinted at random."""
        count, points = len(places), self.ground.points(places[:, 0], places[:, 1], -0.02)
        turned = placement(points, rng.uniform(0, 360, count), rng.uniform(0.85, 1.1, count))
        return repeat(part, turned, rng.uniform(0.75, 1.15, (count, 1)) * np.ones(3))

    def _bale(self) -> Mesh:
        """A round bale of hay."""
        straw = cylinder(0.6, 1.2, self.count(18), self.m.straw, (1.7, 1.45, 0.8), rings=3)
        return repeat(moved(straw, (0, -0.6, 0)), product(placement([(0, 0.55, 0)]), _lay("z")))

    def _logs(self) -> Mesh:
        """A pile of 26 logs."""
        log = moved(cylinder(0.11, 1.0, self.count(6), self.m.bark, (1.3, 1.2, 1.1)), (0, -0.5, 0))
        places = [(0.23 * i + 0.115 * (j % 2), 0.11 + 0.2 * j, 0) for j in range(4) for i in range(8 - j)]
        return repeat(repeat(log, _lay("z")[None]), placement(places))

    def _signpost(self, index: int) -> Mesh:
        """A post with a hanging board that can be read from both sides."""
        m = self.m
        board = box((0.55, 2.05, 0), (0.7, 0.7, 0.05), m.planks)
        faces = [
            card(
                [
                    (0.55 - s * 0.33, 1.72, s * 0.027),
                    (0.55 + s * 0.33, 1.72, s * 0.027),
                    (0.55 + s * 0.33, 2.38, s * 0.027),
                    (0.55 - s * 0.33, 2.38, s * 0.027),
                ],
                m.signs,
                surfaces.sign_cell(index),
            )
            for s in (1, -1)
        ]
        post = struts(
            [(0, -0.1, 0), (-0.1, 2.55, 0), (0, 2.1, 0)],
            [(0, 2.8, 0), (1.05, 2.55, 0), (0.4, 2.5, 0)],
            0.1,
            m.timber,
            faces=ALL_FACES,
        )
        chains = struts([(0.3, 2.5, 0), (0.8, 2.5, 0)], [(0.3, 2.4, 0), (0.8, 2.4, 0)], 0.02, m.iron)
        return merge([board, *faces, post, chains])

    def _washing(self) -> Mesh:
        """A line with cloths between two posts behind the houses."""
        m, parts = self.m, []
        for x0, z0 in ((-26.0, street(-26.0) + 14.0), (18.0, street(18.0) - 13.5)):
            ends = self.ground.points([x0, x0 + 7], [z0, z0 + 1.0])
            rope = sagging(ends[0] + 1.9 * UP, ends[1] + 1.9 * UP, 0.25, self.count(20))
            parts += [struts(ends, ends + 2.1 * UP, 0.1, m.timber), tube(rope, 0.01, 4, m.straw)]
            for k in range(5):
                at = rope[int((k + 0.7) / 5.6 * len(rope))]
                for side in (1, -1):
                    corners = [
                        at + np.array([-0.45 * side, -0.9 - 0.1 * k % 0.3, 0.006 * side]),
                        at + np.array([0.45 * side, -0.9, 0.006 * side]),
                        at + np.array([0.45 * side, 0, 0.006 * side]),
                        at + np.array([-0.45 * side, 0, 0.006 * side]),
                    ]
                    parts.append(card(corners, m.cloth, (0, 0, 0.6, 0.6)))
        return merge(parts)

    def fences(self) -> Mesh:
        """Post-and-rail fences around the gardens and along the edge of the village."""
        rng, parts = surfaces.generator(self.seed, "fences"), []
        lines = []
        for (x, z, _), house in zip(self.houses[:-1], HOUSES[:-1], strict=True):
            side, a = house[1], house[2] / 2 + 1.6
            back, near = z + side * 8.5, z - side * 0.5
            lines.append([(x - a, near), (x - a, back), (x + a, back), (x + a, near)])
        lines.append([(-58, -30), (-30, -33), (0, -31), (30, -32), (56, -28)])
        lines.append([(-58, 31), (-28, 32), (2, 30), (32, 33), (56, 29)])
        for corners in lines:
            for start, end in itertools.pairwise(np.array(corners, np.float64)):
                bays = max(1, round(np.linalg.norm(end - start, axis=-1) / 2.1))
                spots = (
                    start + (end - start) * np.linspace(0, 1, bays + 1)[:, None] + rng.normal(0, 0.05, (bays + 1, 2))
                )
                feet = self.ground.points(spots[:, 0], spots[:, 1], -0.1)
                parts.append(
                    struts(
                        feet,
                        feet + rng.normal(0, 0.04, feet.shape) + 1.25 * UP,
                        0.11,
                        self.m.timber,
                        faces="-x+x-y+y+z",
                    )
                )
                for y in (0.5, 1.0):
                    wobble = rng.normal(0, 0.035, feet.shape) + y * UP
                    parts.append(
                        struts(
                            (feet + wobble)[:-1],
                            (feet + wobble)[1:],
                            0.07,
                            self.m.timber,
                            rng.uniform(0.8, 1.2, (bays, 1)) * np.ones(3),
                        )
                    )
        return merge(parts)

    def stones(self) -> Mesh:
        """Boulders and pebbles along the street and about the land, and a ring of standing stones."""
        rng = surfaces.generator(self.seed, "stones")
        count = self.count(90)
        x = rng.uniform(-58, 58, count)
        z = street(x) + rng.choice([-1, 1], count) * (2.6 + rng.exponential(5, count))
        size = np.clip(rng.lognormal(-1.6, 0.6, (count, 1)), 0.06, 1.2) * rng.uniform(0.6, 1.2, (count, 3))
        lump = ball(1.0, self.count(8), self.m.stone)
        noise = rng.normal(0, 0.09, (64, 3))
        key = np.abs(((lump.positions * 7.3).round().astype(int) * [7, 31, 17]).sum(axis=1)) % 64
        lump.positions += noise[key].astype(np.float32)
        keep = self._free(x, z, 1.0) & (hypot(x - 3, z - street(3)) > 7.5)
        stones = repeat(
            lump,
            placement(self.ground.points(x, z, -0.05), rng.uniform(0, 360, count), size)[keep],
            (rng.uniform(0.7, 1.2, (count, 1)) * np.ones(3))[keep],
        )
        angle = np.arange(7) * 0.9
        ring = self.ground.points(-8 + 5 * cos(angle), 43 + 5 * sin(angle), 0.9)
        runes = boxes(
            ring,
            np.array([0.9, 2.6, 0.45]) * rng.uniform(0.8, 1.2, (7, 3)),
            self.m.stone,
            placement(ring, np.degrees(-angle) + 90, 1.0, rng.uniform(-7, 7, 7))[:, :3, :3],
        )
        return merge([stones, runes])

    def _free(self, x: Doubles, z: Doubles, margin: float) -> Bools:
        """Whether points lie outside all houses and the longhouse's front yard."""
        free = np.ones(np.shape(x), bool)
        for (hx, hz, yaw), house in zip(self.houses, HOUSES, strict=True):
            c, s = cos(np.radians(yaw)), sin(np.radians(yaw))
            u, v = (x - hx) * c - (z - hz) * s, (x - hx) * s + (z - hz) * c
            free &= (np.abs(u) > house[2] / 2 + margin) | (np.abs(v) > house[3] / 2 + margin)
        return free

    # --- plants --------------------------------------------------------------------------------------------------

    def trees(self, budget: int) -> list[Mesh]:
        """Broadleaf trees and bushes in the village, firs on the hills: about `budget` triangles."""
        rng = surfaces.generator(self.seed, "trees")
        broad, firs, bushes = self._tree_places(rng)
        weight = len(broad) * 4 + len(firs) + len(bushes) * 0.5
        wood = len(broad) * self._broadleaf(1, rng).triangle_count + len(firs) * self._fir(1, rng).triangle_count
        cards = max(12, int((budget - wood) / 2 / weight))
        kinds = [self._broadleaf(cards * 4, surfaces.generator(self.seed, f"tree {k}")) for k in range(3)]
        fir = [self._fir(cards, surfaces.generator(self.seed, f"fir {k}")) for k in range(2)]
        bush = self._bush(max(8, cards // 2), surfaces.generator(self.seed, "bush"))
        parts = []
        for places, prototypes, low, high in (
            (broad, kinds, 0.75, 1.25),
            (firs, fir, 0.8, 1.6),
            (bushes, [bush], 0.6, 1.3),
        ):
            which = rng.integers(0, len(prototypes), len(places))
            yaw, scale = rng.uniform(0, 360, len(places)), rng.uniform(low, high, len(places))
            tints = rng.uniform(0.75, 1.15, (len(places), 1)) * (1 + rng.normal(0, 0.06, (len(places), 3)))
            points = self.ground.points(places[:, 0], places[:, 1], -0.15)
            parts += [
                repeat(prototypes[which[k]], placement(points[k : k + 1], yaw[k], scale[k : k + 1]), tints[k : k + 1])
                for k in range(len(places))
            ]
        return parts

    def _tree_places(self, rng: draws.Generator) -> tuple[Doubles, Doubles, Doubles]:
        """(x, z) of broadleaf trees, firs and bushes, clear of houses and the street."""
        x, z = rng.uniform(-57, 57, (2, 160))
        ok = self._free(x, z, 3.0) & (np.abs(z - street(x)) > 7) & (hypot(x - 3, z - street(3)) > 11)
        broad = np.stack([x[ok], z[ok]], axis=1)[:36]
        angle, r = rng.uniform(0, 2 * np.pi, 260), np.sqrt(rng.uniform(60**2, 150**2, 260))
        firs = np.stack([r * cos(angle), r * sin(angle)], axis=1)
        firs = firs[np.abs(firs[:, 1] - street(firs[:, 0])) > 6]
        x, z = rng.uniform(-56, 56, (2, 220))
        ok = self._free(x, z, 0.9) & (np.abs(z - street(x)) > 4.6)
        return broad, firs, np.stack([x[ok], z[ok]], axis=1)[:60]

    def _cards(
        self,
        centres: Doubles,
        ups: Doubles,
        sides: Doubles,
        sizes: Doubles,
        heart: Doubles,
        material: int,
        tints: Doubles,
    ) -> Mesh:
        """Quads about centres (N, 3), spanned by unit ups and sides (N, 3); normals bent away from `heart`."""
        half = sizes[:, None, None] / 2
        corner = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
        positions = centres[:, None] + half * (corner[:, :1] * sides[:, None] + corner[:, 1:] * ups[:, None])
        bent = positions - heart
        bent = bent / np.maximum(np.linalg.norm(bent, axis=2, keepdims=True), 1e-6) + 0.35 * UP
        bent /= np.linalg.norm(bent, axis=2, keepdims=True)
        uvs = np.broadcast_to(np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32), (len(centres), 4, 2))
        indices = (np.arange(len(centres))[:, None] * 4 + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3)
        part = mesh(positions, bent, uvs, indices, material)
        part.colours[:] = np.repeat(tints, 4, axis=0)
        return part

    def _branch(self, start: Doubles, end: Doubles, radius: float, rng: draws.Generator, steps: int) -> Mesh:
        """A bent, tapering branch."""
        t = np.linspace(0, 1, steps)[:, None]
        bend = rng.normal(0, 0.12, 3) * np.linalg.norm(end - start, axis=-1)
        line = start + (end - start) * t + bend * sin(np.pi * t)
        return tube(line, radius * (1 - 0.75 * t[:, 0]), self.count(6), self.m.bark)

    def _broadleaf(self, cards: int, rng: draws.Generator) -> Mesh:
        """A broadleaf tree of about 7 m."""
        crown = np.array([0, 4.9, 0])
        parts = [self._branch(np.zeros(3), np.array([0.2, 4.6, 0.1]), 0.28, rng, self.count(7))]
        for k in range(7):
            angle = k * 2.4 + rng.uniform(-0.3, 0.3)
            start = np.array([0.05, 2.0 + 0.3 * k, 0.03])
            end = start + np.array([cos(angle) * 1.7, 1.0 + 0.2 * k, sin(angle) * 1.7])
            parts.append(self._branch(start, end, 0.11, rng, self.count(4)))
        way = rng.normal(size=(cards, 3))
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        radius = np.sqrt(rng.uniform(0.35, 1.0, cards))
        lumps = 1 + 0.22 * sin(way[:, 0] * 5 + way[:, 2] * 4) * cos(way[:, 1] * 6)
        centres = crown + way * (radius * lumps)[:, None] * np.array([2.5, 2.2, 2.5])
        ups = way * 0.6 + rng.normal(0, 0.6, (cards, 3)) + 0.3 * UP
        ups /= np.linalg.norm(ups, axis=1, keepdims=True)
        sides = np.cross(ups, rng.normal(size=(cards, 3)))
        sides /= np.linalg.norm(sides, axis=1, keepdims=True)
        size = float(np.clip(1.75 * math.sqrt(180 / cards), 0.3, 2.0))
        sizes = size * rng.uniform(0.7, 1.2, cards)
        shade = (0.55 + 0.5 * radius)[:, None] * rng.uniform(0.8, 1.15, (cards, 1)) * np.ones(3)
        return merge([*parts, self._cards(centres, ups, sides, sizes, crown - UP, self.m.leaves, shade)])

    def _fir(self, cards: int, rng: draws.Generator) -> Mesh:
        """A fir of about 9 m: drooping boughs around a straight trunk, short ones at the top."""
        trunk = tube([(0, 0, 0), (0, 4.5, 0), (0, 9, 0)], np.array([0.24, 0.14, 0.02]), self.count(4, 3), self.m.bark)
        level = np.sqrt(rng.random(cards))
        height = 9.2 - 8.2 * level
        angle = np.arange(cards) * 2.39996
        reach = 0.35 + 2.2 * level
        out = np.stack([cos(angle), -0.45 + 0 * angle, sin(angle)], axis=1)
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        centres = out * (reach * 0.55)[:, None] + height[:, None] * UP
        sides = np.cross(out, UP)
        sides /= np.linalg.norm(sides, axis=1, keepdims=True)
        sides = sides * cos(0.3) + np.cross(out, sides) * sin(rng.normal(0, 0.35, (cards, 1)))
        sides /= np.linalg.norm(sides, axis=1, keepdims=True)
        sizes = reach * 1.15 * float(np.clip(math.sqrt(math.sqrt(90 / cards)), 0.45, 1.35))
        shade = (0.7 + 0.35 * level)[:, None] * rng.uniform(0.75, 1.2, (cards, 1)) * np.ones(3)
        boughs = self._cards(centres, -out, sides, sizes, np.array([0, 3.0, 0]), self.m.needles, shade)
        return merge([trunk, boughs])

    def _bush(self, cards: int, rng: draws.Generator) -> Mesh:
        """A bush of about 1.2 m."""
        way = rng.normal(size=(cards, 3))
        way[:, 1] = np.abs(way[:, 1])
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        centres = way * np.array([0.75, 0.65, 0.75]) * rng.uniform(0.5, 1, (cards, 1)) + 0.25 * UP
        sides = np.cross(way + 0.01, rng.normal(size=(cards, 3)))
        sides /= np.linalg.norm(sides, axis=1, keepdims=True)
        ups = np.cross(sides, way)
        ups /= np.maximum(np.linalg.norm(ups, axis=1, keepdims=True), 1e-9)
        sizes = float(np.clip(0.9 * math.sqrt(40 / cards), 0.18, 1.1)) * rng.uniform(0.8, 1.2, cards)
        return self._cards(
            centres, ups, sides, sizes, np.zeros(3), self.m.leaves, rng.uniform(0.7, 1.1, (cards, 1)) * np.ones(3)
        )

    def grass(self, budget: int) -> Mesh:
        """Tufts of two crossed cards, thickest near the street and the fences: exactly budget // 2 cards."""
        rng = surfaces.generator(self.seed, "tufts")
        cards = budget // 2
        tufts = -(-cards // 2)
        x = rng.uniform(-58, 58, tufts * 3)
        near = rng.random(tufts * 3) < 0.6
        aside = rng.choice([-1, 1], tufts * 3) * (2.5 + rng.gamma(1.6, 3.0, tufts * 3))
        z = np.where(near, street(x) + aside, rng.uniform(-58, 58, tufts * 3))
        ok = (
            self._free(x, z, 0.25)
            & (np.abs(z - street(x)) > 2.4)
            & (hypot(x - 3, z - street(3)) > 6.6)
            & (np.abs(z) < 59)
        )
        x, z = x[ok][:tufts], z[ok][:tufts]
        order = np.lexsort((x, np.floor(z / 6), np.floor(x / 6)))
        x, z = np.tile(np.repeat(x[order], 2)[:cards], 1), np.repeat(z[order], 2)[:cards]
        turn = np.repeat(rng.uniform(0, np.pi, len(order)), 2)[:cards] + np.pi / 2 * (np.arange(cards) % 2)
        tall = np.repeat(rng.uniform(0.22, 0.6, len(order)), 2)[:cards] * float(
            np.clip(power(20_000 / cards, 0.15), 0.6, 1.3)
        )
        sides = np.stack([cos(turn), 0 * turn, sin(turn)], axis=1)
        ups = UP + 0.15 * rng.normal(size=(cards, 3)) * np.array([1, 0, 1])
        foot = self.ground.points(x, z, -0.03)
        tints = np.repeat(rng.uniform(0.75, 1.2, (len(order), 1)), 2, axis=0)[:cards] * np.array([1.0, 1.0, 0.9])
        part = self._cards(foot + ups * (tall / 2)[:, None], ups, sides, tall, np.zeros(3), self.m.blades, tints)
        part.normals[:] = UP
        return part


def _roof_side(width: float, wall: float) -> _RoofSide:
    """One side of the roof of a house by its width and the height of its walls."""
    half, rise = width / 2, width * 0.55
    slope = np.array([0, rise, -half]) / hypot(rise, half)
    reach = hypot(rise, half) * (1 + OVERHANG / half)
    eave = np.array([0, wall + rise, 0]) - slope * reach
    return _RoofSide(eave, slope, np.array([0, -slope[2], slope[1]]), reach)


def _lay(axis: str) -> Doubles:
    """The matrix (4, 4) that lays a part standing along y down along an axis."""
    matrix = np.eye(4)
    matrix[:3, :3] = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]] if axis == "x" else [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    return matrix


def _bell(away: Doubles) -> Doubles:
    """1 where `away` is 0, falling smoothly to 1 / e where it is 1."""
    return exp(-(away * away))


def _patches(rng: draws.Generator, x: Doubles, z: Doubles) -> Doubles:
    """Irregular patches of 10 to 60 m, about -1..1, at points."""
    out = np.zeros_like(x)
    for _ in range(12):
        turn, length, phase = rng.uniform(0, 6.28), rng.uniform(10, 60), rng.uniform(0, 6.28)
        out += sin((x * cos(turn) + z * sin(turn)) * 6.28 / length + phase)
    return out / 4


def make_village(detail: int = DEFAULT_DETAIL, seed: int = 0) -> Scene:
    """The village with `detail` triangles (130,000 to 8,000,000; within 1%), the same for the same detail and seed.

    Raises SceneError for a detail outside that range.
    """
    if not LEAST_DETAIL <= detail <= MOST_DETAIL:
        raise SceneError(
            f"The village can have {LEAST_DETAIL:,} to {MOST_DETAIL:,} triangles, not {detail:,}; choose one between."
        )
    palette = Palette()
    materials = _materials(palette, seed)
    finer = float(np.clip(np.sqrt(detail / DEFAULT_DETAIL), 0.6, 2.5))
    ground = _Ground(int(np.clip(70 * np.sqrt(detail / DEFAULT_DETAIL), 40, 420)), seed)
    village = _Village(materials, ground, finer, seed)
    parts = [village.land(), village.path(), village.well(), village.fences(), village.stones(), *village.things()]
    bodies = [village.body(k) for k in range(len(HOUSES))]
    left = detail - sum(part.triangle_count for part in parts + bodies)
    area = np.array([(h[2] + 1.1) * (h[3] + 1.1) for h in HOUSES])
    shingles = SHINGLES * left / village.triangles_per_shingle * area / area.sum()
    houses = [village.house(k, body, int(shingles[k])) for k, body in enumerate(bodies)]
    parts = parts[:2] + houses + parts[2:] + village.trees(round(FOLIAGE * left))
    parts.append(village.grass(detail - sum(part.triangle_count for part in parts)))
    xs = np.linspace(-34, -18, 18)
    route = ground.points(xs, street(xs), 0.06)
    eye = route[0] + EYE_HEIGHT * UP
    return palette.assemble(
        "village",
        parts,
        lights=[Light("directional", (3.5, 3.2, 2.7), direction=(0.55, -0.62, -0.48))],
        sky=Sky((0.26, 0.38, 0.60), (0.52, 0.56, 0.60), (0.17, 0.16, 0.13)),
        cameras=[Camera(tuple(eye.tolist()), (1.0, 0.0, 0.22), name="street")],
        route=route,
    )
