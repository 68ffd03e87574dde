"""The built-in indoor scene: a laboratory hall of 40 x 25 x 8 m with robot cells, machines, racks and steelwork.

A few very large triangles (floor, walls, roof) among very many small ones; trusses, fences, railings and pipes give
long thin ones. Opaque only; three spot lights with shadows. Fronts face the inside.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from shading_atlas_bench.arithmetic import draws
from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.arithmetic.functions import cos, sin
from shading_atlas_bench.scenes import surfaces
from shading_atlas_bench.scenes.builder import (
    WHITE,
    WITHOUT_BOTTOM,
    Mesh,
    Palette,
    ball,
    box,
    boxes,
    card,
    chain,
    cylinder,
    lathe,
    merge,
    moved,
    placement,
    repeat,
    rounded,
    sagging,
    sheet,
    slanted_count,
    struts,
    tube,
)
from shading_atlas_bench.scenes.model import Camera, Indices, Light, Material, Scene, SceneError, Sky

DEFAULT_DETAIL = 60_000
LEAST_DETAIL, MOST_DETAIL = 40_000, 2_000_000
HALF_LENGTH, HALF_WIDTH, HEIGHT = 20.0, 12.5, 8.0
EYE_HEIGHT = 1.6
UP = np.array([0.0, 1.0, 0.0])
SLANTED_SHARE = 1 / 3  # of all triangles, as far as the small parts can bring it there

# The walk: a line down the aisle, eyes 1.6 m above the floor, metres; a person covers 12 m of it in 12 s.
ROUTE = np.array(
    [(-15.5, 0.6), (-13.0, 0.7), (-10.5, 0.2), (-8.0, -0.4), (-5.5, -0.3), (-3.0, 0.4), (-0.5, 0.5), (2, 0)]
)

ORANGE, YELLOW, GREY, DARK = (0.85, 0.25, 0.03), (0.85, 0.55, 0.04), (0.42, 0.44, 0.46), (0.07, 0.075, 0.08)
BLUE, GREEN, RED, CREAM = (0.05, 0.14, 0.38), (0.08, 0.28, 0.16), (0.55, 0.05, 0.04), (0.72, 0.70, 0.62)


@dataclass
class _Materials:
    """Material indices. paint: sprayed on, with scratches and grime; coat: of the steelwork, rolled on."""

    brick: int
    floor: int
    tiles: int
    concrete: int
    paint: int
    coat: int
    plates: int
    tread: int
    stripes: int
    signs: int
    screen: int
    board: int
    wood: int
    cardboard: int
    rubber: int
    steel: int
    lamp: int
    window: int
    glass: int
    plastic: int


def _materials(palette: Palette, seed: int) -> _Materials:
    brick, brick_normals = surfaces.brick(seed)
    plates, plate_normals = surfaces.rivets(seed)
    white = (1.0, 1.0, 1.0, 1.0)

    add, textured = palette.material, palette.textured
    floor_wear = palette.texture("floor wear", surfaces.tile_wear(seed), srgb=False)
    paint_wear = palette.texture("paint wear", surfaces.paint_wear(seed), srgb=False)
    paint = textured(Material("paint", white, surface_texture=paint_wear), 1.0, surfaces.paint(seed))
    sprayed = palette.materials[paint].base_texture
    worn = palette.texture("metal wear", surfaces.metal_wear(seed), srgb=False)
    sealed = (0.42, 0.44, 0.45, 1.0)  # the coat fills the joints
    shining = (0.8, 0.8, 0.8)
    return _Materials(
        brick=textured(Material("brick", white, roughness=0.9), 2.0, brick, brick_normals),
        floor=textured(Material("floor", sealed, surface_texture=floor_wear), 1.2, surfaces.tiles(seed)),
        tiles=textured(Material("wall panels", white, roughness=0.7), 2.0, surfaces.paint(seed + 1)),
        concrete=textured(Material("concrete", white, roughness=0.9), 2.0, surfaces.concrete(seed)),
        paint=paint,
        coat=add(Material("coat", white, sprayed, roughness=0.4)),
        plates=textured(Material("plates", white, metallic=0.5, surface_texture=worn), 2.0, plates, plate_normals),
        tread=textured(Material("tread", white, metallic=0.7, surface_texture=worn), 1.0, surfaces.tread(seed)),
        stripes=textured(Material("stripes", white, roughness=0.45), 0.5, surfaces.stripes(seed)),
        signs=textured(Material("signs", white, roughness=0.3), 1.0, surfaces.signs()),
        screen=textured(
            Material("screen", white, emissive=shining, emissive_texture=len(palette.textures), roughness=0.12),
            1.0,
            surfaces.screen(seed),
        ),
        board=textured(Material("board", white, roughness=0.4), 1.0, surfaces.ruler()),
        wood=textured(Material("wood", white, roughness=0.8), 1.0, surfaces.planks(seed)),
        cardboard=textured(Material("cardboard", white, roughness=0.95), 0.5, surfaces.cardboard(seed)),
        rubber=add(Material("rubber", (0.02, 0.02, 0.022, 1), roughness=0.65)),
        steel=add(Material("steel", (0.55, 0.56, 0.58, 1), roughness=0.3, metallic=1.0)),
        lamp=add(Material("lamp", white, emissive=(12.0, 11.2, 9.6))),
        window=add(Material("window", (0.3, 0.4, 0.5, 1), emissive=(2.2, 2.6, 3.0), roughness=0.1)),
        glass=add(Material("glass", (0.02, 0.025, 0.03, 1), roughness=0.06)),
        plastic=add(Material("plastic", white, roughness=0.25)),
    )


class _Hall:
    """The parts of the hall. `finer` scales how finely round things are divided: 0.5 at the default detail."""

    def __init__(self, materials: _Materials, finer: float, seed: int) -> None:
        self.m, self.finer, self.seed = materials, finer, seed

    def count(self, full: int, least: int = 4) -> int:
        """A number of divisions; `full` at finer = 1."""
        return max(least, round(full * self.finer))

    def sign(self, index: int, centre: ArrayLike, size: float, yaw: float) -> Mesh:
        """A sign on a plate whose front faces +z before turning by `yaw`."""
        s = size / 2
        corners = [(-s, -s, 0.021), (s, -s, 0.021), (s, s, 0.021), (-s, s, 0.021)]
        plate = box((0, 0, 0), (size + 0.04, size + 0.04, 0.04), self.m.paint, GREY)
        return moved(merge([plate, card(corners, self.m.signs, surfaces.sign_cell(index))]), centre, yaw)

    # --- building ------------------------------------------------------------------------------------------------

    def shell(self) -> Mesh:
        """Floor, walls and roof: the very large triangles."""
        m, x, z, h, base = self.m, HALF_LENGTH, HALF_WIDTH, HEIGHT, 3.0
        parts = [
            sheet((-x, 0, z), (2 * x, 0, 0), (0, 0, -2 * z), m.floor),
            sheet((-x, h, -z), (2 * x, 0, 0), (0, 0, 2 * z), m.tiles, tint=(0.45, 0.47, 0.5)),
        ]
        for low, high, material, tint in ((0, base, m.brick, WHITE), (base, h, m.tiles, (0.62, 0.66, 0.66))):
            up = (0, high - low, 0)
            parts += [
                sheet((-x, low, -z), (2 * x, 0, 0), up, material, tint=tint),
                sheet((x, low, z), (-2 * x, 0, 0), up, material, tint=tint),
                sheet((-x, low, z), (0, 0, -2 * z), up, material, tint=tint),
                sheet((x, low, -z), (0, 0, 2 * z), up, material, tint=tint),
            ]
        ledge = np.array([(0, base, -z + 0.04), (0, base, z - 0.04)])
        parts.append(boxes(ledge, (2 * x, 0.12, 0.08), m.concrete))
        for edge in (-1.9, 1.9):
            parts.append(sheet((-x, 0.004, edge + 0.06), (2 * x, 0, 0), (0, 0, -0.12), m.paint, tint=YELLOW))
        return merge(parts)

    def columns(self) -> Mesh:
        """I-beam columns along both long walls, with base plates and bolts."""
        m = self.m
        flanges = boxes([(0, 3.4, 0.13), (0, 3.4, -0.13)], (0.26, 6.8, 0.02), m.coat, tints=GREEN, faces=UPRIGHT)
        web = box((0, 3.4, 0), (0.02, 6.8, 0.24), m.coat, GREEN, faces="-x+x")
        plate = box((0, 0.015, 0), (0.46, 0.03, 0.46), m.steel, faces=WITHOUT_BOTTOM)
        bolt = repeat(
            lathe([(0.02, 0), (0.02, 0.05), (0, 0.05)], 6, m.steel),
            placement([(a, 0.03, b) for a in (-0.18, 0.18) for b in (-0.18, 0.18)]),
        )
        guard = box((0, 0.6, 0.15), (0.27, 1.2, 0.004), m.stripes, faces="+z")
        column = merge([flanges, web, plate, bolt, guard])
        xs = np.arange(-17.5, 18, 5)
        north = placement([(x, 0, -HALF_WIDTH + 0.2) for x in xs])
        south = placement([(x, 0, HALF_WIDTH - 0.2) for x in xs], 180)
        return repeat(column, np.concatenate([north, south]))

    def trusses(self) -> Mesh:
        """Roof trusses across the hall, purlins along it and wind bracing between the trusses."""
        m, low, high = self.m, 6.7, 7.75
        panels = 14
        z = np.linspace(-HALF_WIDTH + 0.05, HALF_WIDTH - 0.05, panels + 1)
        bottom = np.stack([0 * z, 0 * z + low, z], axis=1)
        top = np.stack([0 * z, 0 * z + high, z], axis=1)
        diagonal = np.where(np.arange(panels)[:, None] % 2 == 0, bottom[:-1], top[:-1])
        across = np.where(np.arange(panels)[:, None] % 2 == 0, top[1:], bottom[1:])
        steel = (0.30, 0.34, 0.36)
        truss = merge(
            [
                chain(bottom[::2], 0.12, m.coat, steel),
                chain(top[::2], 0.12, m.coat, steel),
                struts(diagonal, across, 0.06, m.coat, steel),
                boxes(bottom[1:-1], (0.14, 0.22, 0.22), m.steel, faces="-x+x-y"),
            ]
        )
        xs = np.arange(-17.5, 18, 5)
        trusses = repeat(truss, placement([(x, 0, 0) for x in xs]))
        rows = np.linspace(-12, 12, 13)
        ends = [(side * HALF_LENGTH, 7.87, row) for side in (-1, 1) for row in rows]
        purlins = struts(ends[:13], ends[13:], 0.08, m.coat, steel, height=0.16)
        starts = [(a, 7.7, row) for a in xs[:-1] for row in rows[:-1:3]] + [
            (a, 7.7, row) for a in xs[:-1] for row in rows[3::3]
        ]
        stops = [(b, 7.7, row) for b in xs[1:] for row in rows[3::3]] + [
            (b, 7.7, row) for b in xs[1:] for row in rows[:-1:3]
        ]
        return merge([trusses, purlins, struts(starts, stops, 0.03, m.steel, faces="-y+y")])

    def windows(self) -> Mesh:
        """Bright window bands high in the long walls, with frames."""
        m = self.m
        pane = sheet((-2.1, 4.9, 0.03), (4.2, 0, 0), (0, 1.6, 0), m.window)
        across, up = np.linspace(-2.1, 2.1, 6), np.linspace(4.9, 6.5, 3)
        frame = merge(
            [
                boxes([(x, 5.7, 0.05) for x in across], (0.05, 1.65, 0.07), m.coat, tints=DARK, faces="-x+x+z"),
                boxes([(0, y, 0.05) for y in up], (4.25, 0.05, 0.07), m.coat, tints=DARK, faces="-y+y+z"),
            ]
        )
        window = merge([pane, frame])
        xs = np.arange(-15.0, 16, 5)
        north = placement([(x, 0, -HALF_WIDTH) for x in xs])
        south = placement([(x, 0, HALF_WIDTH) for x in xs], 180)
        return repeat(window, np.concatenate([north, south]))

    def end_walls(self) -> Mesh:
        """A roller door at one end; a door, a calibration board and signs at the other."""
        m = self.m
        slats = boxes(
            [(0, 0.1 + 0.2 * k, 0.06) for k in range(22)], (5.0, 0.185, 0.05), m.paint, tints=(0.35, 0.42, 0.5)
        )
        frame = boxes(
            [(-2.65, 2.25, 0.1), (2.65, 2.25, 0.1), (0, 4.65, 0.2)],
            [(0.3, 4.5, 0.2), (0.3, 4.5, 0.2), (5.6, 0.5, 0.4)],
            m.stripes,
        )
        roller = moved(merge([slats, frame]), (-HALF_LENGTH, 0, 0), 90)
        leaf = box((0, 1.05, 0.05), (1.1, 2.1, 0.06), m.paint, GREEN)
        bar = merge(
            [box((0.0, 1.05, 0.12), (0.9, 0.05, 0.05), m.steel), box((0, 1.6, 0.085), (0.5, 0.5, 0.01), m.window)]
        )
        board = merge(
            [
                card([(-5.2, 0.9, 0.06), (-2.8, 0.9, 0.06), (-2.8, 3.3, 0.06), (-5.2, 3.3, 0.06)], m.board),
                box((-4, 2.1, 0.03), (2.5, 2.5, 0.05), m.paint, DARK),
            ]
        )
        name = self.sign(6, (4.0, 4.8, 0.05), 2.4, 0)
        east = merge(
            [leaf, bar, board, name, self.sign(2, (0, 2.5, 0.05), 0.5, 0), self.sign(11, (1.4, 1.7, 0.05), 0.4, 0)]
        )
        return merge([roller, moved(east, (HALF_LENGTH, 0, 0), -90)])

    # --- gallery, crane, pipes -----------------------------------------------------------------------------------

    def gallery(self) -> Mesh:
        """A gallery of tread plate along the north wall, with posts, knee braces, a railing and stairs."""
        m, front, y, left, right = self.m, -9.6, 3.2, -19.9, 14.0
        deck = [
            sheet((left, y, front), (right - left, 0, 0), (0, 0, -2.85), m.tread, (8, 1)),
            sheet((left, y - 0.06, -12.45), (right - left, 0, 0), (0, 0, 2.85), m.coat, tint=GREY),
            box(((left + right) / 2, y - 0.1, front), (right - left, 0.24, 0.08), m.coat, YELLOW),
        ]
        xs = np.linspace(left + 0.8, right - 0.1, 15)
        foot, head = np.array([(x, 0, front) for x in xs]), np.array([(x, y - 0.2, front) for x in xs])
        deck.append(struts(foot, head, 0.12, m.coat, GREY))
        for side in (-0.7, 0.7):
            deck.append(struts(head - 0.7 * UP, head + np.array([side, 0, 0]), 0.05, m.coat, GREY))
        deck.append(self._railing(np.array([(left, y, front), (right, y, front)])))
        deck.append(self._railing(np.array([(right, y, -10.9), (right, y, -12.4)])))
        return merge([*deck, self._stairs(right, y, front - 0.7)])

    def _railing(self, ends: Doubles) -> Mesh:
        """A railing between two floor points: posts, handrail, two rails, a kick plate and a lattice of thin bars."""
        m = self.m
        along = ends[1] - ends[0]
        bays = max(1, round(np.linalg.norm(along, axis=-1) / 1.3))
        t = np.linspace(0, 1, bays + 1)[:, None]
        feet = ends[0] + along * t
        parts = [struts(feet, feet + 1.05 * UP, 0.05, m.coat, YELLOW)]
        for height, radius in ((1.05, 0.025), (0.7, 0.015), (0.4, 0.015)):
            line = ends[0] + along * np.linspace(0, 1, bays + 1)[:, None] + (0, height, 0)
            parts.append(tube(line, radius, self.count(5), m.coat, YELLOW))
        parts.append(struts(ends[:1] + 0.08 * UP, ends[1:] + 0.08 * UP, 0.01, m.coat, YELLOW, height=0.16))
        fine = np.linspace(0, 1, bays * self.count(3, 2) + 1)[:, None]
        lower, upper = ends[0] + along * fine + (0, 0.16, 0), ends[0] + along * fine + (0, 0.7, 0)
        parts.append(struts(lower[:-1], upper[1:], 0.012, m.steel, faces=RIBBON))
        parts.append(struts(lower[1:], upper[:-1], 0.012, m.steel, faces=RIBBON))
        return merge(parts)

    def _stairs(self, x: float, y: float, z: float) -> Mesh:
        """A flight of steps from (x, y) down towards +x, 1.2 m wide about z."""
        m, steps, run = self.m, 16, 4.4
        k = np.arange(steps)
        centres = np.stack([x + (k + 0.5) * run / steps, y - (k + 1) * y / steps + 0.1, 0 * k + z], axis=1)
        parts = [boxes(centres, (run / steps + 0.04, 0.04, 1.2), m.tread)]
        for side in (-0.62, 0.62):
            top, foot = np.array([[x, y, z + side]]), np.array([[x + run, 0.05, z + side]])
            parts.append(struts(top, foot, 0.05, m.coat, YELLOW, height=0.25))
            parts.append(tube(np.linspace(top[0] + 1 * UP, foot[0] + 1 * UP, 8), 0.025, self.count(6), m.coat, YELLOW))
            feet = np.linspace(top[0], foot[0], 6)
            parts.append(struts(feet, feet + 1 * UP, 0.04, m.coat, YELLOW))
        return merge(parts)

    def crane(self) -> Mesh:
        """A bridge crane: rails along the walls, a lattice girder across, a trolley with cables and a hook."""
        m, x, y = self.m, 7.5, 5.75
        rails = boxes([(0, y - 0.2, z) for z in (-11.9, 11.9)], (39.6, 0.25, 0.2), m.coat, tints=YELLOW)
        parts = [rails]
        z = np.linspace(-11.9, 11.9, 23)
        for side in (-0.55, 0.55):
            low = np.stack([0 * z + x + side, 0 * z + y, z], axis=1)
            high = low + 0.75 * UP
            odd = np.arange(22)[:, None] % 2 == 0
            parts += [chain(low, 0.1, m.coat, YELLOW), chain(high, 0.1, m.coat, YELLOW)]
            parts.append(
                struts(np.where(odd, low[:-1], high[:-1]), np.where(odd, high[1:], low[1:]), 0.05, m.coat, YELLOW)
            )
        parts.append(
            boxes([(x, y + 0.9, -2.5), (x, y + 1.05, -2.9)], [(1.5, 0.2, 1.3), (0.7, 0.35, 0.4)], m.coat, tints=ORANGE)
        )
        drum = moved(cylinder(0.2, 0.9, self.count(14), m.steel), (x - 0.45, y + 1.1, -2.3), 0)
        wires = [(x + a, y + 0.8, -2.5 + b) for a in (-0.15, 0.15) for b in (-0.08, 0.08)]
        parts.append(struts(wires, [(x + (p[0] - x) * 0.4, 3.6, p[2]) for p in wires], 0.015, m.steel))
        parts += [drum, box((x, 3.45, -2.5), (0.3, 0.4, 0.22), m.stripes)]
        bend = np.linspace(-0.3, 4.2, self.count(14))
        hook = np.stack([x + 0.13 * sin(bend), 3.05 + 0.13 * cos(bend), 0 * bend - 2.5], axis=1)
        parts.append(tube(hook, np.linspace(0.035, 0.015, len(bend)), self.count(8), m.steel))
        return merge([*parts, self.sign(10, (x - 0.62, y + 0.4, 4), 0.6, -90)])

    def pipes(self) -> Mesh:
        """Pipes along the walls and across the roof, with bends, flanges and valves with hand wheels."""
        m, rng = self.m, surfaces.generator(self.seed, "pipes")
        tints = (CREAM, BLUE, GREEN, RED, (0.5, 0.5, 0.5), YELLOW)
        parts = []
        for k in range(6):
            radius, tint = 0.04 + 0.05 * rng.random(), tints[k % len(tints)]
            south = k % 2 == 0
            z, y = (11.75 - 0.13 * k, 4.1 + 0.12 * k) if south else (-9.3 - 0.0 * k, 2.75 - 0.16 * (k // 2))
            z = z if south else -12.1 + 0.22 * (k // 2)
            x0, x1 = -19 + 0.5 * k, 12 + 0.6 * k
            line = rounded(
                [
                    (x0, 0.02, z),
                    (x0, y, z),
                    (x1, y, z),
                    (x1, y, z - 0.8 if south else z + 0.6),
                    (x1, 0.02, z - 0.8 if south else z + 0.6),
                ],
                0.3,
                self.count(6),
            )
            parts.append(self._pipe(line, radius, tint))
            flanges = [(x, y, z) for x in np.arange(x0 + 1.5, x1 - 1, 4.0)]
            turned = placement(flanges)
            turned[:, :3, :3] = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
            ring = moved(cylinder(radius * 1.7, 0.06, self.count(9), m.steel), (0, -0.03, 0))
            parts.append(repeat(ring, turned))
            parts.append(repeat(self._valve(radius), placement(flanges[1::4])))
        return merge(parts)

    def _pipe(self, line: Doubles, radius: float, tint: ArrayLike) -> Mesh:
        """A pipe along a polyline whose long stretches are divided every metre."""
        points = [line[:1]]
        for a, b in itertools.pairwise(line):
            steps = max(1, round(np.linalg.norm(b - a, axis=-1) * 0.4))
            points.append(a + (b - a) * (np.arange(1, steps + 1) / steps)[:, None])
        whole = np.concatenate(points)
        keep = np.concatenate([[True], np.linalg.norm(np.diff(whole, axis=0), axis=1) > 1e-6])
        return tube(whole[keep], radius, self.count(7), self.m.paint, tint)

    def _valve(self, radius: float) -> Mesh:
        """A valve's body and hand wheel, on a pipe along x through the origin."""
        m = self.m
        angle = np.linspace(0, 2 * np.pi, self.count(14) + 1)[:-1]
        wheel = np.stack([0.13 * cos(angle), 0 * angle + 0.3 + radius, 0.13 * sin(angle)], axis=1)
        spokes = struts(
            [(0, 0.3 + radius, 0)] * 4,
            [(0.13, 0.3 + radius, 0), (-0.13, 0.3 + radius, 0), (0, 0.3 + radius, 0.13), (0, 0.3 + radius, -0.13)],
            0.012,
            m.paint,
            RED,
        )
        return merge(
            [
                ball(radius * 1.6, self.count(10), m.paint, BLUE),
                cylinder(0.025, 0.3 + radius, self.count(6), m.steel),
                tube(wheel, 0.013, self.count(5, 3), m.paint, RED, closed=True),
                spokes,
            ]
        )

    def trays(self) -> Mesh:
        """Cable ladders under the roof with bundles of sagging cables."""
        m, rng = self.m, surfaces.generator(self.seed, "trays")
        parts = []
        for z in (-6.3, 6.2):
            rails = np.array([(-19.5, 5.9, z - 0.25), (-19.5, 5.9, z + 0.25)])
            parts.append(struts(rails, rails + np.array([39, 0, 0]), 0.03, m.steel, height=0.1))
            rungs = np.stack([np.arange(-19.2, 19.5, 1.0), np.full(39, 5.87), np.full(39, z)], axis=1)
            parts.append(boxes(rungs, (0.04, 0.02, 0.5), m.steel, faces="-x+x-y"))
            hangers = np.array([(x, 5.95, z + s) for x in np.arange(-17.5, 18, 5) for s in (-0.25, 0.25)])
            parts.append(struts(hangers, hangers + 0.8 * UP, 0.015, m.steel))
            for k in range(2):
                x = np.linspace(-19.4, 19.4, self.count(24))
                wave = z - 0.12 + 0.2 * k + 0.03 * sin(x * 1.3 + k)
                line = np.stack([x, 5.905 + 0.008 * rng.random(len(x)), wave], axis=1)
                parts.append(tube(line, 0.015, 4, m.rubber, closed=False))
        return merge(parts)

    def lamps(self) -> Mesh:
        """Bell lamps that hang from the trusses in two rows."""
        m, n = self.m, self.count(11)
        shade = lathe([(0.36, 0), (0.34, 0.1), (0.2, 0.26), (0.07, 0.32), (0.07, 0.45)], n, m.paint, GREEN)
        inner = lathe([(0, 0.16), (0.19, 0.16), (0.355, 0.0)][::-1][:2], n, m.paint, WHITE)
        glow = lathe([(0, 0.06), (0.3, 0.06)][::-1], n, m.lamp)
        lamp = merge([shade, inner, _flipped(glow), struts([(0, 0.45, 0)], [(0, 1.2, 0)], 0.015, m.rubber)])
        return repeat(lamp, placement([(x, 5.55, z) for x in np.arange(-17.5, 18, 5) for z in (-4.5, 4.0)]))

    # --- robot cells ---------------------------------------------------------------------------------------------

    def robots(self) -> Mesh:
        """Four robot cells: an arm on a pedestal, a fence of wire mesh and a controller with a screen."""
        rng = surfaces.generator(self.seed, "robots")
        parts = []
        for k, x in enumerate((-13.5, -5.5, 2.5, 12.5)):
            pose = rng.uniform((-60, 15, -75, -60), (60, 40, -45, 20), 4)
            arm = self._arm(pose, ORANGE if k % 2 == 0 else YELLOW)
            parts.append(moved(arm, (x, 0, -5.2), 180 * rng.random() - 90))
            parts.append(moved(self._fence(k), (x, 0, -5.2)))
        return merge(parts)

    def _arm(self, pose: Doubles, tint: ArrayLike) -> Mesh:
        """A six-axis arm standing at the origin; pose: turn, shoulder, elbow and wrist angles in degrees."""
        m, n = self.m, self.count(13)
        turn, shoulder, elbow, wrist = pose
        base = lathe(
            [(0, 0), (0.45, 0), (0.45, 0.06), (0.32, 0.1), (0.3, 0.5), (0.36, 0.55), (0.36, 0.7), (0, 0.7)],
            n,
            m.paint,
            DARK,
        )
        bolts = repeat(
            cylinder(0.02, 0.03, 6, m.steel),
            placement([(0.39 * cos(a), 0.06, 0.39 * sin(a)) for a in np.arange(12) * np.pi / 6]),
        )
        joint = _sideways(
            lathe([(0, -0.3), (0.24, -0.3), (0.27, -0.2), (0.27, 0.2), (0.24, 0.3), (0, 0.3)], n, m.paint, tint)
        )
        hub = ball(0.19, n, m.paint, DARK)
        upper = lathe([(0.12, 0.12), (0.17, 0.3), (0.14, 0.7), (0.13, 1.1), (0.1, 1.25)], n, m.paint, tint)
        fore = lathe([(0.1, 0.1), (0.14, 0.3), (0.09, 0.75), (0.07, 1.0)], n, m.paint, tint)
        hand = merge(
            [
                ball(0.1, n, m.paint, DARK),
                cylinder(0.05, 0.22, n, m.steel),
                boxes(
                    [(0, 0.26, 0), (-0.07, 0.36, 0), (0.07, 0.36, 0)],
                    [(0.2, 0.06, 0.1), (0.03, 0.18, 0.06), (0.03, 0.18, 0.06)],
                    m.steel,
                ),
            ]
        )
        shoulder_at = np.array([0, 0.95, 0])
        elbow_at = shoulder_at + 1.3 * _lean(shoulder)
        wrist_at = elbow_at + 1.05 * _lean(shoulder - elbow)
        parts = [moved(joint, shoulder_at), moved(joint, elbow_at, scale=0.72)]
        parts += [moved(hub, elbow_at), moved(hub, wrist_at, scale=0.6)]
        parts += [moved(upper, shoulder_at, tilt=shoulder), moved(fore, elbow_at, tilt=shoulder - elbow)]
        parts += [moved(hand, wrist_at, tilt=shoulder - elbow - wrist), self._hoses(shoulder_at, elbow_at, wrist_at)]
        return merge([base, bolts, moved(merge(parts), (0, 0, 0), turn)])

    def _hoses(self, shoulder: Doubles, elbow: Doubles, wrist: Doubles) -> Mesh:
        """Hoses along both sides of an arm."""
        hoses = []
        for side in (-0.2, 0.2):
            out = np.array([side, 0.08, 0])
            corners = [
                np.array([side, 0.6, -0.3]),
                shoulder + out - [0, 0, 0.35],
                (shoulder + elbow) / 2 + out - [0, 0, 0.25],
                elbow + out + 0.25 * UP,
                (elbow + wrist) / 2 + out * 0.7 + 0.1 * UP,
                wrist + out * 0.4,
            ]
            hoses.append(tube(rounded(corners, 0.5, self.count(4)), 0.022, self.count(5), self.m.rubber))
        return merge(hoses)

    def _fence(self, k: int) -> Mesh:
        """Wire-mesh panels on three sides of a cell about the origin, a gate sign and the controller."""
        m = self.m
        panel = self._mesh_panel(1.9, 2.0)
        places = [(x, 0, 2.6) for x in (-2.0, 0.0, 2.0)]
        yaws = np.zeros(3)
        panels = repeat(panel, placement(places, yaws))
        cabinet = merge(
            [
                box((0, 0.7, 0), (0.8, 1.4, 0.6), m.paint, CREAM, faces=WITHOUT_BOTTOM),
                boxes(
                    [(0, 0.15 + 0.05 * i, 0.301) for i in range(8)],
                    (0.5, 0.02, 0.02),
                    m.paint,
                    tints=DARK,
                    faces=WITHOUT_BOTTOM,
                ),
                card([(-0.25, 0.95, 0.303), (0.25, 0.95, 0.303), (0.25, 1.3, 0.303), (-0.25, 1.3, 0.303)], m.screen),
                repeat(
                    _forward(cylinder(0.02, 0.02, self.count(8), m.paint, RED)),
                    placement([(-0.2 + 0.08 * i, 0.82, 0.3) for i in range(6)]),
                ),
            ]
        )
        signs = [self.sign(1, (-1.0, 1.5, 2.64), 0.45, 0), self.sign(0 if k % 2 else 4, (1.2, 1.6, 2.64), 0.35, 0)]
        cable = sagging((2.3, 0.05, 1.3), (0.35, 0.05, 0.2), 0.0, self.count(16))
        cable[:, 0] += 0.15 * sin(np.linspace(0, 9, len(cable)))
        return merge(
            [panels, moved(cabinet, (2.3, 0, 1.7)), *signs, tube(cable - 0.02 * UP, 0.025, self.count(6), m.rubber)]
        )

    def _mesh_panel(self, width: float, height: float) -> Mesh:
        """A fence panel in the xy plane about x = 0: frame, posts and crossing diagonal wires."""
        m, w = self.m, width / 2
        frame = [(-w, 0.15, 0), (w, 0.15, 0), (w, height, 0), (-w, height, 0), (-w, 0.15, 0)]
        post = struts([(-w - 0.04, 0, 0)], [(-w - 0.04, height + 0.05, 0)], 0.06, m.coat, YELLOW)
        step = 0.26 / self.finer
        reach = np.arange(-w - height, w, step)
        tall = height - 0.15
        low_x, high_x = np.maximum(reach, -w), np.minimum(reach + tall, w)
        ok = high_x - low_x > 0.02
        low, high = low_x[ok], high_x[ok]
        y0, y1 = 0.15 + low - reach[ok], 0.15 + high - reach[ok]
        zero = np.zeros_like(low)
        wires = [
            struts(np.stack([s * low, y0, zero], 1), np.stack([s * high, y1, zero], 1), 0.009, m.steel, faces=RIBBON)
            for s in (1, -1)
        ]
        return merge([post, chain(frame, 0.03, m.coat, DARK), *wires])

    def conveyor(self) -> Mesh:
        """A roller conveyor behind the robots with boxes on it."""
        m, n, rng = self.m, self.count(8), surfaces.generator(self.seed, "conveyor")
        xs = np.arange(-17, 15.5, 0.5)
        roller = _forward(lathe([(0, -0.4), (0.05, -0.4), (0.05, 0.4), (0, 0.4)], n, m.steel))
        rollers = repeat(roller, placement([(x, 0.72, -8.3) for x in xs]))
        rails = boxes([(-0.75, 0.72, z) for z in (-8.73, -7.87)], (33, 0.14, 0.05), m.coat, tints=BLUE)
        feet = np.array([(x, 0, z) for x in np.arange(-17, 16, 2.0) for z in (-8.73, -7.87)])
        legs = struts(feet, feet + 0.68 * UP, 0.06, m.coat, BLUE)
        braces = struts(feet[:-2] + 0.1 * UP, feet[2:] + 0.62 * UP, 0.025, m.coat, BLUE)
        places = [(x, 0.77, -8.3 + rng.uniform(-0.1, 0.1)) for x in np.arange(-16, 15, 1.6)]
        cartons = repeat(
            self._carton(),
            placement(places, rng.uniform(-20, 20, len(places)), rng.uniform(0.8, 1.25, (len(places), 3))),
        )
        return merge([rails, legs, braces, rollers, cartons])

    def _carton(self) -> Mesh:
        """A cardboard box on the origin with tape and labels."""
        m = self.m
        tape = box((0, 0.351, 0), (0.06, 0.004, 0.5), m.paint, CREAM, faces="+y")
        front = card(
            [(-0.2, 0.08, 0.253), (0.0, 0.08, 0.253), (0.0, 0.28, 0.253), (-0.2, 0.28, 0.253)],
            m.signs,
            surfaces.sign_cell(9),
        )
        return merge([box((0, 0.175, 0), (0.5, 0.35, 0.5), m.cardboard), tape, front])

    # --- machines, benches, racks --------------------------------------------------------------------------------

    def machines(self) -> Mesh:
        """Machine tools in the south-east with windows, panels, vents and handles, and cabinets below the gallery."""
        machine = self._machine()
        south = repeat(
            machine,
            placement([(4.5, 0, 4.6), (8.7, 0, 4.6), (12.9, 0, 4.6)], 180),
            np.array([WHITE, (0.9, 0.95, 1), (1, 0.95, 0.85)]),
        )
        cabinets = repeat(self._cabinet(), placement([(x, 0, -11.6) for x in np.arange(-16.5, 12, 2.1)]))
        return merge([south, cabinets])

    def _machine(self) -> Mesh:
        """A machining centre of 3 x 2.3 x 2.2 m; its front faces +z."""
        m, n = self.m, self.count(12)
        body = boxes(
            [(0, 1.15, -0.2), (0, 0.3, 0.95), (0, 2.4, -0.4)],
            [(3.0, 2.1, 1.9), (3.0, 0.6, 0.4), (1.6, 0.4, 1.2)],
            m.paint,
            tints=CREAM,
        )
        door = boxes([(-0.75, 1.35, 0.79), (0.35, 1.35, 0.79)], (1.0, 1.3, 0.05), m.paint, tints=BLUE)
        glass = boxes([(-0.75, 1.5, 0.82), (0.35, 1.5, 0.82)], (0.7, 0.7, 0.02), m.glass)
        vents = boxes([(x, 0.35 + 0.07 * k, 1.155) for x in (-1.0, 0.9) for k in range(5)], (0.7, 0.03, 0.03), m.steel)
        handles = [
            tube(
                rounded([(x, 1.0, 0.81), (x, 1.0, 0.9), (x, 1.7, 0.9), (x, 1.7, 0.81)], 0.06, self.count(5)),
                0.018,
                self.count(8),
                m.steel,
            )
            for x in (-0.3, -0.1)
        ]
        panel = merge(
            [
                box((1.25, 1.5, 0.9), (0.5, 0.9, 0.2), m.paint, DARK),
                card([(1.05, 1.55, 1.003), (1.45, 1.55, 1.003), (1.45, 1.9, 1.003), (1.05, 1.9, 1.003)], m.screen),
                boxes(
                    [(1.08 + 0.073 * i, 1.5 - 0.05 * j, 1.005) for i in range(6) for j in range(4)],
                    (0.055, 0.04, 0.02),
                    m.paint,
                    tints=CREAM,
                    faces=WITHOUT_BOTTOM,
                ),
                repeat(_forward(cylinder(0.035, 0.04, n, m.paint, RED)), placement([(1.4, 1.15, 1.0)])),
            ]
        )
        lamp = merge(
            [
                moved(cylinder(0.05, 0.12, n, m.paint, tint), (1.3, 2.2 + 0.12 * k, 0.3))
                for k, tint in enumerate((GREEN, YELLOW, RED))
            ]
        )
        bolts = repeat(
            _forward(cylinder(0.018, 0.015, 6, m.steel)),
            placement([(x, y, 0.75) for x in np.linspace(-1.42, 0.98, 9) for y in (0.66, 2.14)]),
        )
        plate = card(
            [(-1.4, 1.9, 0.752), (-1.2, 1.9, 0.752), (-1.2, 2.1, 0.752), (-1.4, 2.1, 0.752)],
            m.signs,
            surfaces.sign_cell(7),
        )
        return merge([body, door, glass, vents, *handles, panel, lamp, bolts, plate])

    def _cabinet(self) -> Mesh:
        """An electrical cabinet facing +z with a meter, lamps, a handle, a vent and a warning."""
        m = self.m
        warning = card(
            [(-0.12, 1.5, 0.256), (0.12, 1.5, 0.256), (0.12, 1.74, 0.256), (-0.12, 1.74, 0.256)],
            m.signs,
            surfaces.sign_cell(5),
        )
        lamps = repeat(
            _forward(cylinder(0.018, 0.015, self.count(6), m.paint, GREEN)),
            placement([(-0.3 + 0.07 * k, 1.85, 0.25) for k in range(5)]),
        )
        vents = boxes(
            [(0, 0.25 + 0.06 * k, 0.255) for k in range(6)],
            (0.6, 0.02, 0.015),
            m.paint,
            tints=DARK,
            faces=WITHOUT_BOTTOM,
        )
        return merge(
            [
                box((0, 1.0, 0), (0.98, 2.0, 0.5), m.paint, (0.45, 0.5, 0.5), faces=WITHOUT_BOTTOM),
                warning,
                lamps,
                vents,
                box((0.38, 1.1, 0.27), (0.03, 0.2, 0.04), m.steel),
            ]
        )

    def benches(self) -> Mesh:
        """Work benches with drawers, a vice, a monitor, a keyboard, a lamp, mugs and a tool board."""
        bench = self._bench()
        return repeat(bench, placement([(x, 0, 3.7) for x in (-13.4, -9.6, -5.8)], 180))

    def _bench(self) -> Mesh:
        """A bench of 2.2 m; the worker stands on its +z side."""
        m, n = self.m, self.count(12)
        feet = np.array([(x, 0, z) for x in (-1.1, 1.1) for z in (-0.35, 0.35)])
        drawers = [(0.75, 0.75 - 0.16 * k, 0.02) for k in range(4)]
        lamp = rounded([(-1.0, 0.9, -0.3), (-1.0, 1.4, -0.3), (-0.7, 1.55, -0.05)], 0.2, self.count(6))
        shade = lathe([(0.1, 0), (0.06, 0.1), (0.02, 0.13), (0, 0.13)], n, m.paint, YELLOW)
        spokes = [(0.1 + 0.26 * cos(a), 0.03, 0.75 + 0.26 * sin(a)) for a in np.arange(5) * 1.2566]
        return merge(
            [
                box((0, 0.87, 0), (2.3, 0.06, 0.8), m.wood),
                struts(feet, feet + 0.85 * UP, 0.06, m.paint, BLUE),
                boxes(drawers, (0.55, 0.145, 0.7), m.paint, tints=RED),
                boxes(np.add(drawers, (0, 0, 0.365)), (0.2, 0.02, 0.03), m.steel),
                self._tools(),
                self._desk(),
                tube(lamp, 0.012, self.count(6), m.steel),
                moved(shade, (-0.68, 1.45, -0.02)),
                moved(cylinder(0.19, 0.05, n, m.paint, DARK), (0.1, 0.55, 0.75)),
                cylinder_at((0.1, 0.04, 0.75), 0.03, 0.5, n, m.steel),
                struts([(0.1, 0.06, 0.75)] * 5, spokes, 0.03, m.rubber),
            ]
        )

    def _tools(self) -> Mesh:
        """The bench's tool board with its tools, and a vice."""
        m = self.m
        tools = boxes(
            [(-0.95 + 0.16 * k, 1.5, -0.39) for k in range(13)],
            [(0.03 + 0.01 * (k % 3), 0.25 + 0.06 * (k % 4), 0.02) for k in range(13)],
            m.steel,
        )
        handle = lathe([(0, 0), (0.028, 0.04), (0.018, 0.12), (0, 0.13)], self.count(5), m.paint, ORANGE)
        handles = placement([(-0.95 + 0.16 * k, 1.22 - 0.03 * (k % 4), -0.385) for k in range(13)])
        jaws = [(0.85, 0.96, 0.3), (0.85, 1.02, 0.22), (0.85, 1.02, 0.38)]
        sizes = [(0.18, 0.12, 0.24), (0.2, 0.1, 0.04), (0.2, 0.1, 0.04)]
        return merge(
            [
                box((0, 1.45, -0.42), (2.3, 1.0, 0.03), m.plates),
                tools,
                repeat(handle, handles),
                boxes(jaws, sizes, m.paint, tints=BLUE),
                struts([(0.76, 1.0, 0.46)], [(0.94, 1.0, 0.46)], 0.015, m.steel),
            ]
        )

    def _desk(self) -> Mesh:
        """What stands on a bench: a monitor, a keyboard with its keys, mugs."""
        m, n = self.m, self.count(12)
        picture = [(-0.46, 1.02, -0.133), (0.06, 1.02, -0.133), (0.06, 1.34, -0.133), (-0.46, 1.34, -0.133)]
        keys = [(-0.42 + 0.033 * i, 0.922, 0.09 + 0.055 * j) for i in range(14) for j in range(3)]
        mug = lathe([(0.0, 0.0), (0.042, 0.0), (0.04, 0.1), (0.035, 0.1), (0.032, 0.01)], n, m.plastic, RED)
        mugs = placement([(0.25, 0.9, 0.2), (0.42, 0.9, -0.2), (-0.9, 0.9, 0.1)])
        return merge(
            [
                box((-0.2, 1.18, -0.15), (0.56, 0.36, 0.03), m.plastic, DARK),
                card(picture, m.screen),
                cylinder_at((-0.2, 0.9, -0.18), 0.02, 0.15, n, m.paint, DARK),
                box((-0.2, 0.905, -0.15), (0.25, 0.01, 0.18), m.paint, DARK),
                box((-0.2, 0.907, 0.15), (0.5, 0.016, 0.19), m.paint, DARK, faces=WITHOUT_BOTTOM),
                boxes(keys, (0.027, 0.014, 0.045), m.paint, tints=CREAM, faces=WITHOUT_BOTTOM),
                repeat(mug, mugs, np.array([WHITE, (0.3, 1.5, 3.0), (1.5, 9, 9)])),
            ]
        )

    def racks(self) -> Mesh:
        """Pallet racks along the south wall and a second row, with cartons, drums and crates."""
        rng = surfaces.generator(self.seed, "racks")
        parts = []
        for x, z, yaw in RACKS:
            rack = [self._rack(), self._load(rng)]
            parts.append(moved(merge(rack), (x, 0, z), yaw))
        return merge(parts)

    def _rack(self) -> Mesh:
        """A rack bay of 2.8 x 1.0 x 5 m about the origin."""
        m = self.m
        feet = np.array([(x, 0, z) for x in (-1.4, 1.4) for z in (-0.45, 0.45)])
        posts = struts(feet, feet + 5.0 * UP, 0.09, m.coat, BLUE)
        steps = np.linspace(0.15, 4.9, 7)
        side = np.where(np.arange(6) % 2 == 0, -0.45, 0.45)
        bracing = []
        for x in (-1.4, 1.4):
            a = np.stack([np.full(6, x), steps[:-1], side], axis=1)
            b = np.stack([np.full(6, x), steps[1:], -side], axis=1)
            bracing.append(struts(a, b, 0.035, m.coat, BLUE, faces=RIBBON))
        beams = boxes(
            [(0, y, z) for y in SHELVES for z in (-0.45, 0.45)],
            (2.72, 0.12, 0.05),
            m.coat,
            tints=ORANGE,
            faces="-y-z+z",
        )
        decks = boxes([(0, y + 0.045, 0) for y in SHELVES], (2.7, 0.03, 0.85), m.wood, faces="-y+y+z")
        label = self.sign(12, (-1.4, 2.0, 0.5), 0.22, 0)
        return merge([posts, *bracing, beams, decks, label])

    def _load(self, rng: draws.Generator) -> Mesh:
        """What stands in the upper levels of a rack; the lowest level is kept for small parts."""
        m, n = self.m, self.count(11)
        drum = lathe(
            [(0.28, 0), (0.28, 0.25), (0.305, 0.36), (0.28, 0.47), (0.305, 0.58), (0.28, 0.88), (0, 0.87)], n, m.plastic
        )
        stacks: list[list[tuple[float, float, float]]] = [[], [], []]
        for level, y in enumerate(SHELVES[1:], 1):
            kind = rng.integers(3) if level < 3 else 1
            for x in np.arange(-1.05, 1.1, 0.7):
                stacks[kind].append((x + rng.uniform(-0.04, 0.04), y + 0.06, rng.uniform(-0.05, 0.05)))
        drums, cartons, crates = stacks
        parts = []
        if drums:
            tints = np.array([BLUE, RED, GREEN, YELLOW])[rng.integers(0, 4, len(drums))]
            parts.append(repeat(drum, placement(drums, rng.uniform(0, 360, len(drums))), tints))
        if cartons:
            parts.append(
                repeat(
                    self._carton(),
                    placement(cartons, rng.uniform(-8, 8, len(cartons)), rng.uniform(0.85, 1.3, (len(cartons), 3))),
                )
            )
        if crates:
            parts.append(repeat(self._crate(), placement(crates, rng.uniform(-5, 5, len(crates)))))
        return merge(parts)

    def _crate(self) -> Mesh:
        """A wooden crate with a stencilled label on the origin."""
        m = self.m
        label = card(
            [(-0.15, 0.2, 0.253), (0.15, 0.2, 0.253), (0.15, 0.5, 0.253), (-0.15, 0.5, 0.253)],
            m.signs,
            surfaces.sign_cell(8),
        )
        return merge([box((0, 0.31, 0), (0.6, 0.62, 0.5), m.wood, WHITE), label])

    def yard(self) -> Mesh:
        """On the floor: pallets, cones, gas bottles, fire extinguishers, a ladder, cables and cable reels."""
        m, n = self.m, self.count(10)
        rim = lathe([(0.15, 0.03), (0.10, 0.18)], n, m.plastic, ORANGE)
        band = lathe([(0.10, 0.18), (0.065, 0.36)], n, m.plastic, CREAM)
        tip = lathe([(0.065, 0.36), (0.02, 0.55), (0, 0.55)], n, m.plastic, ORANGE)
        cone = merge([rim, band, tip, box((0, 0.015, 0), (0.36, 0.03, 0.36), m.rubber)])
        spots = ((-9.5, -1.6), (6.2, -1.55), (8.4, -1.6), (16.4, 1.7), (-18.2, 2.9), (-18.6, -2.6))
        drum = [(0, -0.2), (0.4, -0.2), (0.4, -0.17), (0.2, -0.17), (0.2, 0.17), (0.4, 0.17), (0.4, 0.2), (0, 0.2)]
        reels = placement([(-17.0, 0.4, 6.6), (-16.2, 0.4, 7.5), (15.2, 0.4, -3.4)], np.array([20, 70, -30]))
        return merge(
            [
                self._pallets(),
                repeat(cone, placement([(x, 0, z) for x, z in spots])),
                self._bottles(),
                self._ladder(),
                self._floor_cables(),
                repeat(_forward(lathe(drum, self.count(20), m.wood)), reels),
            ]
        )

    def _pallets(self) -> Mesh:
        """Pallets loaded with cartons, and a pile of empty ones."""
        m, rng = self.m, surfaces.generator(self.seed, "pallets")
        slats = [(x, 0.13, 0) for x in np.linspace(-0.54, 0.54, 6)]
        runners = boxes([(0, 0.075, z) for z in (-0.36, 0, 0.36)], (1.2, 0.085, 0.1), m.wood)
        pallet = merge([boxes(slats, (0.15, 0.025, 0.8), m.wood, faces=WITHOUT_BOTTOM), runners])
        stack = [(x, 0.145 + y, z) for y in (0, 0.36) for x in (-0.3, 0.27) for z in (-0.2, 0.2)]
        loaded = merge([pallet, repeat(self._carton(), placement(stack, rng.uniform(-6, 6, 8), (0.95, 1.0, 0.75)))])
        spots = [(-17.5, 0, -3.6), (16.8, 0, 6.5), (18, 0, 3.6), (7.3, 0, -3.1)]
        piled = [(18.2, 0.16 * k, -2.6) for k in range(4)]
        return merge(
            [
                repeat(loaded, placement(spots, rng.uniform(-15, 15, 4))),
                repeat(pallet, placement(piled, rng.uniform(-4, 4, 4))),
            ]
        )

    def _bottles(self) -> Mesh:
        """Gas bottles in a row and fire extinguishers on the walls."""
        m, n = self.m, self.count(10)
        outline = [(0, 0), (0.115, 0), (0.115, 1.3), (0.09, 1.4), (0.04, 1.46), (0.04, 1.56), (0, 1.56)]
        places = placement([(19.5, 0, z) for z in np.arange(8, 11.5, 0.5)])
        tints = np.array([BLUE, RED, GREEN, GREY])[np.arange(7) % 4]
        small = [(0, 0), (0.075, 0), (0.075, 0.42), (0.05, 0.5), (0.02, 0.52), (0.02, 0.56), (0, 0.56)]
        hose = rounded([(0.02, 0.54, 0), (0.12, 0.5, 0), (0.1, 0.15, 0.02)], 0.1, self.count(6))
        extinguisher = merge([lathe(small, n, m.paint, RED), tube(hose, 0.01, 5, m.rubber)])
        walls = [(x, 0.7, 12.25) for x in (-12.5, 2.5)] + [(x, 0.8, -9.4) for x in (-10.0, 5.0)]
        return merge([repeat(lathe(outline, n, m.paint), places, tints), repeat(extinguisher, placement(walls))])

    def _ladder(self) -> Mesh:
        """A ladder that leans against the racks."""
        m = self.m
        rails = struts([(-0.25, 0, 0), (0.25, 0, 0)], [(-0.2, 3.8, -0.9), (0.2, 3.8, -0.9)], 0.05, m.steel)
        left = np.array([(-0.24, 0.3 * k, -0.071 * k) for k in range(1, 13)])
        rungs = struts(left, left * [-1, 1, 1], 0.035, m.steel)
        return moved(merge([rails, rungs]), (15.6, 0, 9.9), 200)

    def _floor_cables(self) -> Mesh:
        """Two cables that wind along the aisle's edge."""
        t = np.linspace(0, 1, self.count(40))
        cables = []
        for k in range(2):
            z = 1.98 + 0.05 * k + 0.05 * sin(t * 40 + k * 2) * sin(t * 7)
            cables.append(tube(np.stack([-17 + 30 * t, 0 * t + 0.012, z], axis=1), 0.012, 4, self.m.rubber))
        return merge(cables)

    def small_parts(self, budget: int, slanted: int) -> Mesh:
        """Small parts on the racks' lowest decks: `budget` triangles, about `slanted` of them long and thin."""
        rng = surfaces.generator(self.seed, "small parts")
        slender, compact = self._slender_kinds(), self._compact_kinds()
        thin = int(np.clip(slanted, 0, budget))
        order = np.concatenate(
            [_filled(slender, thin, rng), len(slender) + _filled(compact, max(0, budget - thin), rng)]
        )
        order = rng.permutation(order)
        places, step = _shelf_places(len(order), rng)
        tints = np.array([WHITE, ORANGE, BLUE, RED, GREEN, YELLOW, GREY, CREAM])
        parts = [box((-13.0, SHELVES[0] + 0.1, 11.0), (0.1, 0.08, 0.1), self.m.cardboard)]
        for chunk in np.array_split(np.arange(len(order)), len(RACKS)):
            for index, kind in enumerate(slender + compact):
                mine = chunk[order[chunk] == index]
                matrices = placement(
                    places[mine], rng.uniform(0, 360, len(mine)), step * rng.uniform(0.75, 1.0, len(mine))
                )
                parts.append(repeat(kind, matrices, tints[rng.integers(0, len(tints), len(mine))]))
        return merge(parts)

    def _slender_kinds(self) -> list[Mesh]:
        """Wire baskets and bundles of rods, nearly all slanted, that fit a disc of diameter 1 on the origin."""
        m = self.m
        corners = 0.4 * np.array([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1), (-1, 0, -1)])
        hoops = [chain(corners + y * UP, 0.03, m.steel) for y in (0.03, 0.35, 0.7)]
        sides = [np.linspace(a, b, self.count(8))[:-1] for a, b in itertools.pairwise(corners)]
        feet = np.concatenate(sides)
        basket = merge([*hoops, struts(feet, feet + 0.7 * UP, 0.015, m.steel)])
        spots = np.array([(x, 0, z) for x in (-0.2, 0, 0.2) for z in (-0.2, 0, 0.2)])
        rods = struts(spots, spots * 1.5 + 1.1 * UP, 0.08, m.steel)
        return [basket, rods]

    def _compact_kinds(self) -> list[Mesh]:
        """Bolts, springs, gears, cans, bearings and boxes that fit a disc of diameter 1 on the origin."""
        m, n = self.m, self.count(10)
        bolt = merge([cylinder(0.3, 0.25, 6, m.steel), moved(cylinder(0.15, 0.8, n, m.steel, rings=3), (0, 0.25, 0))])
        angle = np.linspace(0, 2 * np.pi * 4, self.count(84))
        coil = np.stack([0.38 * cos(angle), 0.08 + angle * 0.03, 0.38 * sin(angle)], axis=1)
        teeth = np.arange(12) * np.pi / 6
        turns = placement(np.zeros((12, 3)), np.degrees(teeth))[:, :3, :3]
        rim = np.stack([0.41 * cos(teeth), 0 * teeth + 0.15, -0.41 * sin(teeth)], axis=1)
        wheel = lathe([(0.36, 0), (0.36, 0.3), (0.15, 0.3), (0.15, 0.1)], self.count(17), m.steel)
        can = lathe([(0, 0), (0.4, 0), (0.4, 0.3), (0.4, 0.6), (0.4, 0.9), (0, 0.9)], n, m.paint)
        shell = lathe([(0.45, 0.0), (0.45, 0.3), (0.35, 0.3), (0.35, 0)], self.count(14), m.steel)
        round_about = np.arange(7) * 0.8976
        places = np.stack([0.26 * cos(round_about), 0 * round_about + 0.15, 0.26 * sin(round_about)], axis=1)
        return [
            bolt,
            tube(coil, 0.07, self.count(5, 3), m.steel),
            merge([wheel, boxes(rim, (0.14, 0.26, 0.12), m.steel, turns)]),
            can,
            merge([shell, repeat(ball(0.11, self.count(6), m.steel), placement(places))]),
            box((0, 0.3, 0), (0.8, 0.6, 0.7), m.cardboard),
        ]


UPRIGHT = "-x+x-z+z"
RIBBON = "-x+x"  # of a strut in a vertical plane: seen from both sides of the plane
SHELVES = (0.75, 2.0, 3.1, 4.2)
RACKS = tuple((x, 11.0, 180) for x in np.arange(-14.5, 7, 3.0)) + tuple(
    (x, 7.6, 180) for x in np.arange(-12.5, -6, 3.0)
)


def _filled(kinds: list[Mesh], budget: int, rng: draws.Generator) -> Indices:
    """Indices of random kinds that together have at most `budget` triangles, up to the smallest kind's count."""
    counts = np.array([kind.triangle_count for kind in kinds])
    least = counts.min()
    order = rng.integers(0, len(kinds), budget // least + 1)
    total = np.cumsum(counts[order])
    order = order[: np.searchsorted(total, budget, side="right")]
    left = budget - int(counts[order].sum())
    return np.concatenate([order, np.full(left // least, counts.argmin())])


def cylinder_at(
    point: ArrayLike, radius: float, height: float, segments: int, material: int, tint: ArrayLike = WHITE
) -> Mesh:
    """An upright cylinder standing on a point, (3). tint: linear, (3)."""
    return moved(cylinder(radius, height, segments, material, tint), point)


def _flipped(part: Mesh) -> Mesh:
    """The part seen from the other side."""
    return Mesh(part.positions, -part.normals, part.uvs, part.colours, part.indices[:, ::-1].copy(), part.materials)


def _forward(part: Mesh) -> Mesh:
    """A part standing along y laid down so that y becomes z."""
    return repeat(part, placement([(0, 0, 0)], tilt=90))


def _sideways(part: Mesh) -> Mesh:
    """A part standing along y laid down along x."""
    return repeat(part, placement([(0, 0, 0)], yaw=90, tilt=90))


def _lean(degrees: float) -> Doubles:
    """Up, tilted about x as `placement` does."""
    return np.array([0, cos(np.radians(degrees)), sin(np.radians(degrees))])


def _shelf_places(count: int, rng: draws.Generator) -> tuple[Doubles, float]:
    """Floor points (count, 3) in a grid on the racks' lowest decks, rack after rack, and the grid's step in metres."""
    width, depth = 2.5, 0.8
    per_rack = -(-count // len(RACKS)) if count else 1
    step = min(0.16, np.sqrt(width * depth / per_rack) * 0.97)
    columns, rows = int(width / step), int(depth / step)
    while columns * rows < per_rack:
        step *= 0.99
        columns, rows = int(width / step), int(depth / step)
    spots = np.argsort(rng.random(columns * rows))[:per_rack]
    local = np.stack([(spots % columns + 0.5) * step - width / 2, (spots // columns + 0.5) * step - depth / 2], axis=1)
    places = np.concatenate([[(x + u, SHELVES[0] + 0.06, z + v) for u, v in local] for x, z, _ in RACKS])
    return places[:count], step


def make_hall(detail: int = DEFAULT_DETAIL, seed: int = 0) -> Scene:
    """The hall with `detail` triangles (40,000 to 2,000,000; within 1%), the same for the same detail and seed.

    Raises SceneError for a detail outside that range.
    """
    if not LEAST_DETAIL <= detail <= MOST_DETAIL:
        raise SceneError(
            f"The hall can have {LEAST_DETAIL:,} to {MOST_DETAIL:,} triangles, not {detail:,}; choose a detail between."
        )
    palette = Palette()
    hall = _Hall(_materials(palette, seed), float(np.clip(0.5 * np.sqrt(detail / DEFAULT_DETAIL), 0.35, 2.0)), seed)
    parts = [
        hall.shell(), hall.columns(), hall.trusses(), hall.windows(), hall.end_walls(), hall.gallery(), hall.crane(),
        hall.pipes(), hall.trays(), hall.lamps(), hall.robots(), hall.conveyor(), hall.machines(), hall.benches(),
        hall.racks(), hall.yard(),
    ]  # fmt: skip
    budget = detail - sum(part.triangle_count for part in parts)
    parts.append(hall.small_parts(budget, round(SLANTED_SHARE * detail) - sum(slanted_count(part) for part in parts)))
    spots = [
        ((-12.0, 6.4, 1.0), (0.18, -1, -0.25)),
        ((0.0, 6.4, -0.5), (0.1, -1, 0.2)),
        ((12.0, 6.4, 1.0), (-0.2, -1, -0.1)),
    ]
    eye = ROUTE[0]
    route = np.stack([ROUTE[:, 0], 0 * ROUTE[:, 0], ROUTE[:, 1]], axis=1)
    return palette.assemble(
        "hall",
        parts,
        lights=[Light("spot", (150.0, 138.0, 118.0), position, direction, 66.0) for position, direction in spots],
        sky=Sky((0.16, 0.18, 0.21), (0.23, 0.24, 0.25), (0.15, 0.14, 0.125)),
        cameras=[Camera((float(eye[0]), EYE_HEIGHT, float(eye[1])), (1.0, -0.04, -0.06), name="aisle")],
        route=route,
    )
