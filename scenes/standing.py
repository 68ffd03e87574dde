"""Whether a scene is a place or an object, and where a person stands in a place: decided from what rays see.

Vertical rays on a lattice find floors: level surfaces with room for a person above, joined over steps. The underside
of a solid is none: above it is matter. Below ground there is nothing, or its own thickness; below what is level
on an object there is the object. Under a ceiling that faces up is matter too, unless something is seen to stand there:
then it is a room whose faces are wound the other way. Some spots are looked at closely: rays all around, about level,
say how far it is to what stands there. A spot is *inside* where a ceiling is above and walls are around, and *among*
things where they stand on opposite sides: on top of an object nothing does, beside one it stands on one side. Wide
ground that rises is land, and a place without anything around. Of the spots left the one with the best view is taken:
much to see, neither at the nose nor far away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bools, Doubles
from shading_atlas_bench.arithmetic.functions import arctan2
from shading_atlas_bench.arithmetic.matrices import dot
from shading_atlas_bench.scenes.model import Camera, Indices, Scene
from shading_atlas_bench.scenes.rays import SLOPES, TURNS, Rays, lattice_pairs, panorama_directions, window_groups
from shading_atlas_bench.scenes.walking import EYE_HEIGHT, HEADROOM, KNEE, carries
from shading_atlas_bench.scenes.work import Work, WorkError

LATTICE, FINEST = 160, 0.1  # columns along the longer side of a scene; metres between them at least
MOST_HITS = 4e6  # about: tests of vertical rays against triangles; heaps of large triangles get fewer columns
# Pairs of a ray and a triangle that are looked at. Of real scenes up to 5 million triangles, a saw of 198,470 takes the
# most, 30 million, and a room of 3,936 the most of each triangle, 1,068.
MOST_PAIRS, PAIRS_PER_TRIANGLE = 12_000_000, 200
OFFSET = 0.37  # of a column, where its ray is: models have edges on round numbers
NARROWEST = 3.0  # metres: less is an object on a table
STRIDE, STEEPNESS = 0.2, 0.7  # metres up or down between columns of one floor, and per metre between them
SMALLEST_FLOOR = 2.0  # square metres; less is furniture
TABLES = (0.4, 1.3)  # metres above a floor: what is level there is furniture too
SLAB = (1.5, 2.1)  # metres, by the scene's width: what is thicker below a floor is an object, or storeys
FLATNESS = 0.1  # of that width: how thick the ground may be between the two
TOUCHING = 1e-3  # metres: what is nearer lies on each other
HIGHEST_CEILING = 30.0  # metres above the floor; a painted sky is higher
FAR = 100.0  # metres: what is farther away does not stand around
ROOMY = 0.5  # metres from the eyes to the nearest wall, at least
WALLED, SURROUNDED = 0.6, 0.35  # of all azimuths: where walls stand around who is inside; things on opposite sides
ROOMS = 0.3  # of the spots under a ceiling that are looked at: how many are inside where a scene has rooms
STREETS = 0.2  # of the others: how many are among things where it has streets; four of 24 may be the corners of a yard
GROUND = 0.25  # of a scene's area: how much open ground it has where people are on it
LAND, RELIEF = 30.0, 1.0  # metres: how wide land is at least, and how much it rises
SPOTS, NEARBY = 24, 8  # that are looked at: all over the scene, and then around the best
SHELLS, GLANCES = 8, 4  # largest floors under ceilings that face up, and the spots of each from where things are sought
CROWD = 10.0  # metres: spots are sought where many triangles are within this distance
VIEW = 0.85  # cosine of half the angle that views are judged over
GIVEN_UP = "So many of its triangles are large that no place was looked for in it to the end."
FOUND = "found"  # the name of a camera that is placed here
PLAIN = 0.5  # what a view of a single triangle is worth of one where every ray meets another
MIDDLE, FAR_ENOUGH = 4.0, 30.0  # metres: at half its worth to look at; from where on it is worth less again


@dataclass(frozen=True)
class Standing:
    """A decision.

    place: whether a person can walk in the scene. reason: a sentence. camera: where the person stands in a place that
    has no cameras of its own. given_up: whether it was not decided, and the scene is taken for an object.
    """

    place: bool
    reason: str
    camera: Camera | None = None
    given_up: bool = False


def decide(scene: Scene) -> Standing:
    """Whether a scene is a place, why, and where a person stands in it.

    Of a scene with cameras these decide: it is a place if one of them stands inside its bounds. Another is an object
    where looking for a place takes more than MOST_PAIRS.
    """
    try:
        return _decided(scene)
    except WorkError:
        return Standing(False, GIVEN_UP, given_up=True)


def _decided(scene: Scene) -> Standing:
    """As `decide`; raises WorkError in place of giving up."""
    low, high = scene.bounds
    width = float(min((high - low)[[0, 2]])) * scene.metres_per_unit
    if width < NARROWEST:
        return Standing(False, f"It is {width:.3g} m wide; places are {NARROWEST:g} m wide or more.")
    if scene.cameras:
        inside = any(((low < camera.position) & (camera.position < high)).all() for camera in scene.cameras)
        return Standing(inside, "A camera stands inside it." if inside else "Its cameras look at it from outside.")
    rays = Rays(scene, Work(MOST_PAIRS + PAIRS_PER_TRIANGLE * scene.triangle_count))
    everywhere = _Spots.find(scene)
    spots = everywhere.outside_matter(scene, rays)
    if not len(spots.points):
        return Standing(False, "It has no floor with room for a person above.")
    chosen = spots.chosen(scene)
    looks = [_Look.around(scene, rays, spots, n) for n in chosen]
    rooms = [look for look in looks if look.fine and look.inside]
    streets = [look for look in looks if look.fine and look.among and not spots.covered[look.spot]]
    on_ground = spots.ground_share(scene) >= GROUND
    has_streets = on_ground and len(streets) >= max(2, STREETS * (~spots.covered[chosen]).sum())
    in_air = spots.covered.sum() / max(1, everywhere.covered.sum())  # of what is covered; the rest is inside of solids
    has_rooms = len(rooms) >= 2 and len(rooms) * in_air >= ROOMS * spots.covered[chosen].sum()
    if has_streets and (not has_rooms or spots.covered.mean() < 0.5):
        pool, reason = streets, "A person on its ground has things on opposite sides."
    elif has_rooms:
        pool, reason = rooms, "A person in it has a ceiling above and walls around."
    elif on_ground and spots.is_land(scene):
        pool, reason = [look for look in looks if look.fine], "Its ground is land, wide and not flat."
    else:
        return Standing(False, "Nothing stands around a person on its floors.")
    if not pool:
        return Standing(False, "Nothing in it leaves room around a person.")
    best = max(pool, key=lambda look: look.score)
    nearby = [_Look.around(scene, rays, spots, n) for n in spots.beside(best.spot, chosen)]
    best = max([best, *(look for look in nearby if look.fine)], key=lambda look: look.score)
    return Standing(True, reason, Camera(tuple(best.eye.tolist()), tuple(best.direction.tolist()), name=FOUND))


@dataclass(frozen=True)
class _Spots:
    """Where somebody could stand, on a lattice of columns.

    points: float64 (N, 3), on floors. floors: int (N), the floor of each. shells: int (N), for those under a ceiling
    that faces up, the part of the floor that lies under it; -1 for others. All bool (N):
    covered, whether a ceiling is above; grounded, whether below is ground, at most a slab thick; roomy, whether the
    floor goes on all around. spacing: of the lattice, in scene units.
    """

    points: Doubles
    floors: Indices
    shells: Indices
    covered: Bools
    grounded: Bools
    roomy: Bools
    spacing: float

    @classmethod
    def find(cls, scene: Scene) -> _Spots:
        """All spots on floors of some size."""
        unit, (low, high) = scene.metres_per_unit, scene.bounds
        spacing = max(float(max((high - low)[[0, 2]])) / LATTICE, FINEST / unit, _overlap(scene) / np.sqrt(MOST_HITS))
        depth = int(np.ceil((high[2] - low[2]) / spacing)) + 1
        column, height, triangle, upwards = _vertical_hits(scene, low, spacing, depth)
        # Columns one above the other: one sorted row of numbers for all searches along columns.
        span = 2 * float(high[1] - low[1]) + 10 / unit
        key = np.maximum.accumulate(column * span + (height - low[1]))
        overhead = np.searchsorted(key, key + KNEE / unit, "right")
        above = np.append(key, np.inf)[overhead] - key
        above[above > span / 2] = np.inf
        upright = above * unit >= EYE_HEIGHT + HEADROOM
        ceiling_back = np.append(upwards, False)[overhead] & np.isfinite(above)
        floor = carries(scene, triangle) & ~_undersides(column, key * unit, upwards)
        below = [np.searchsorted(key[floor], key - reach / unit) for reach in TABLES]
        thickest = float(np.clip(FLATNESS * min((high - low)[[0, 2]]), SLAB[0] / unit, SLAB[1] / unit))
        beneath = np.searchsorted(key[~upwards], key - thickest) - np.searchsorted(key[~upwards], column * span)
        stands = np.flatnonzero(floor & upright & (below[0] == below[1]))
        column, key, enclosed = column[stands], key[stands], ceiling_back[stands]
        rise = STRIDE / unit + STEEPNESS * spacing
        links = [_neighbours(key, column, step, span, rise, depth) for step in (depth, 1)]
        floors, area = _joined(len(stands), links), (spacing * unit) * (spacing * unit)
        wide = np.bincount(floors)[floors] * area >= SMALLEST_FLOOR
        shells = _joined(len(stands), [tuple(ends[:, enclosed[ends].all(axis=0)]) for ends in map(np.stack, links)])
        shells[~enclosed | (np.bincount(shells)[shells] * area < SMALLEST_FLOOR)] = -1
        roomy = _eroded(wide, links, max(1, int(np.ceil(ROOMY / (spacing * unit)))))
        x, z = np.divmod(column, depth)
        points = np.stack([low[0] + (x + OFFSET) * spacing, height[stands], low[2] + (z + OFFSET) * spacing], axis=1)
        covered, grounded = above[stands] * unit <= HIGHEST_CEILING, beneath[stands] == 0
        return cls(points, floors, shells, covered, grounded, roomy, spacing).keeping(wide)

    def keeping(self, some: Bools) -> _Spots:
        """The spots of a mask (N)."""
        return _Spots(
            points=self.points[some],
            floors=self.floors[some],
            shells=self.shells[some],
            covered=self.covered[some],
            grounded=self.grounded[some],
            roomy=self.roomy[some],
            spacing=self.spacing,
        )

    def outside_matter(self, scene: Scene, rays: Rays) -> _Spots:
        """Those that are not inside of solids: under a ceiling that faces up only where something is seen to stand."""
        sizes = np.bincount(self.shells + 1)[1:]
        largest = [shell for shell in np.argsort(-sizes, kind="stable")[:SHELLS] if sizes[shell]]
        hollow = [-1, *(shell for shell in largest if self._is_hollow(scene, rays, shell))]
        return self.keeping(np.isin(self.shells, hollow))

    def _is_hollow(self, scene: Scene, rays: Rays, shell: int) -> bool:
        """Whether from the spots of a shell the front of anything is seen that stands on the floor."""
        looks = _spread(self.points, np.flatnonzero(self.shells == shell), GLANCES)
        return any(_Look.around(scene, rays, self, n).furnished for n in looks)

    def ground_share(self, scene: Scene) -> float:
        """How much open ground there is, over the area that holds the middle nine tenths of the triangles."""
        step = max(1, scene.triangle_count // 200_000)
        centres = scene.positions[:, [0, 2]][scene.indices[::step]].mean(axis=1, dtype=np.float64)
        size = np.quantile(centres, 0.95, axis=0) - np.quantile(centres, 0.05, axis=0)
        area = max(float(size[0] * size[1]), self.spacing * self.spacing)
        return float((self.grounded & ~self.covered).sum()) * self.spacing * self.spacing / area

    def is_land(self, scene: Scene) -> bool:
        """Whether the largest floor is wide and not flat."""
        points = self.points[self.floors == np.bincount(self.floors).argmax()] * scene.metres_per_unit
        size = points.max(axis=0) - points.min(axis=0)
        rise = np.quantile(points[:, 1], 0.95) - np.quantile(points[:, 1], 0.05)
        return bool(min(size[0], size[2]) >= LAND and rise >= RELIEF)

    def chosen(self, scene: Scene) -> Indices:
        """SPOTS numbers of spots far from each other, where the scene holds most: half covered, half on open ground.

        Where there is only one of the two, all of them; where there is neither, anywhere.
        """
        usable = self.roomy if self.roomy.any() else np.ones(len(self.points), bool)
        usable = usable & _crowded(scene, self.points, usable, self.spacing)
        groups = [np.flatnonzero(usable & kind) for kind in (self.covered, self.grounded & ~self.covered)]
        groups = [group for group in groups if len(group)] or [np.flatnonzero(usable)]
        return np.concatenate([_spread(self.points, group, SPOTS // len(groups)) for group in groups])

    def beside(self, best: int, chosen: Indices) -> Indices:
        """NEARBY numbers of spots like `best`, no farther from it than the next two of those looked at."""
        away = np.linalg.norm(self.points - self.points[best], axis=1)
        near = (away <= np.sort(away[chosen])[min(2, len(chosen) - 1)]) & (away > 0) & self.roomy
        near &= (self.floors == self.floors[best]) & (self.covered == self.covered[best])
        return _spread(self.points, np.flatnonzero(near), NEARBY) if near.any() else np.zeros(0, np.int64)


def _overlap(scene: Scene) -> float:
    """The side, in scene units, of a square as large as the rectangles around all triangles from above together."""
    corners = [scene.positions[scene.indices[:, corner]][:, [0, 2]] for corner in range(3)]
    size = np.maximum.reduce(corners) - np.minimum.reduce(corners)
    return float(np.sqrt((size[:, 0].astype(np.float64) * size[:, 1]).sum()))


def _vertical_hits(scene: Scene, low: Doubles, spacing: float, depth: int) -> tuple[Indices, Doubles, Indices, Bools]:
    """Columns (N), heights (N) and triangles (N) where vertical rays on a lattice meet a scene, sorted in this order,
    and whether the front faces upwards (N).

    A column's number is x * depth + z. Of what lies on each other, what faces up comes first: a solid's top, before the
    bottom of what stands on it. Leaves and grass, which are alpha-masked, are passed through.
    """
    solid = np.array([m.alpha_mode != "mask" for m in scene.materials] or [True])
    ids = np.flatnonzero(solid[scene.material_ids])
    corners = ((scene.positions[:, [0, 2]] - low[[0, 2]]) / spacing - OFFSET)[scene.indices[ids]]
    first = np.maximum(np.ceil(corners.min(axis=1)), 0).astype(np.int64)
    counts = np.maximum(np.floor(corners.max(axis=1)).astype(np.int64) - first + 1, 0)
    met = np.flatnonzero((counts > 0).all(axis=1))
    parts = []
    for some in window_groups(*counts[met].T):
        owner, x, z = lattice_pairs(*counts[met[some]].T)
        owner = met[some][owner]
        x, z = x + first[owner, 0], z + first[owner, 1]
        across, along = (np.ascontiguousarray(corners[owner, :, axis].T) - place for axis, place in enumerate((x, z)))
        weights = np.stack([across[b] * along[c] - along[b] * across[c] for b, c in ((1, 2), (2, 0), (0, 1))])
        area = weights.sum(axis=0)
        inside = np.flatnonzero(((weights >= 0).all(axis=0) | (weights <= 0).all(axis=0)) & (area != 0))
        triangle = ids[owner[inside]]
        heights = scene.positions[scene.indices[triangle], 1].T.astype(np.float64)
        height = (weights[:, inside] * heights).sum(axis=0) / area[inside]
        parts.append((x[inside] * depth + z[inside], height, triangle, area[inside] < 0))
    column, height, triangle, upwards = (np.concatenate(part) for part in zip(*parts, strict=True))
    order = np.lexsort((~upwards, np.round((height - low[1]) * scene.metres_per_unit / TOUCHING), column))
    return column[order], height[order], triangle[order], upwards[order]


def _undersides(column: Indices, metres: Doubles, upwards: Bools) -> Bools:
    """Which of the sorted hits (N), at these heights, face down below what faces up, too near for a person between."""
    solid = ~upwards[:-1] & upwards[1:] & (column[:-1] == column[1:])
    return np.append(solid & (np.diff(metres) < EYE_HEIGHT + HEADROOM), False)


def _neighbours(
    key: Doubles, column: Indices, step: int, span: float, rise: float, depth: int
) -> tuple[Indices, Indices]:
    """Pairs of spots (two of N) on one floor whose columns are `step` apart."""
    wanted = key + step * span
    after = np.searchsorted(key, wanted)
    padded = np.concatenate([[-np.inf], key, [np.inf]])
    nearest = np.where(wanted - padded[after] <= padded[after + 1] - wanted, after - 1, after)
    joined = np.abs(padded[nearest + 1] - wanted) <= rise
    if step == 1:
        joined &= column % depth != depth - 1
    here = np.flatnonzero(joined)
    return here, nearest[here]


def _joined(count: int, links: list[tuple[Indices, Indices]]) -> Indices:
    """The number (N) of the floor that each of `count` spots belongs to."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    here, there = (np.concatenate(part) for part in zip(*links, strict=True))
    graph = coo_matrix((np.ones(len(here), np.int8), (here, there)), shape=(count, count))
    floors: Indices = connected_components(graph, directed=False)[1]
    return floors


def _eroded(spots: Bools, links: list[tuple[Indices, Indices]], steps: int) -> Bools:
    """Those of some spots (bool (N)) that have others on all four sides, `steps` times over."""
    left = spots.copy()
    for _ in range(steps):
        sides = np.zeros((4, len(left)), bool)
        for k, (here, there) in enumerate(links):
            sides[2 * k, here], sides[2 * k + 1, there] = left[there], left[here]
        left &= sides.all(axis=0)
    return left


def _crowded(scene: Scene, points: Doubles, usable: Bools, spacing: float) -> Bools:
    """Whether points (N, 3) have as many triangles around as three quarters of the triangles have.

    All are taken where none of the `usable` (N) has.
    """
    from scipy.ndimage import uniform_filter

    low, high = scene.bounds
    shape = np.ceil((high - low)[[0, 2]] / spacing).astype(int) + 1
    centres = scene.positions[:, [0, 2]][scene.indices].mean(axis=1, dtype=np.float64)

    def cells(places: Doubles) -> Indices:
        x, z = ((places - low[[0, 2]]) / spacing).astype(int).T
        number: Indices = x * shape[1] + z
        return number

    triangles = cells(centres)
    counts = np.bincount(triangles, minlength=shape[0] * shape[1]).reshape(shape).astype(np.float64)
    width = 2 * int(np.ceil(CROWD / scene.metres_per_unit / spacing)) + 1
    around = uniform_filter(counts, width, mode="constant").ravel()
    enough = around[cells(points[:, [0, 2]])] >= np.quantile(around[triangles], 0.25)
    return enough if (enough & usable).any() else np.ones(len(points), bool)


def _spread(points: Doubles, among: Indices, count: int) -> Indices:
    """Up to `count` of the numbers `among`: first the one nearest the middle, then the farthest from those before."""
    places = points[among]
    off = np.linalg.norm(places - np.median(places, axis=0), axis=1)
    taken = [int(np.argmin(off))]
    away = np.linalg.norm(places - places[taken[0]], axis=1)
    while len(taken) < min(count, len(among)):
        taken.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(places - places[taken[-1]], axis=1))
    return among[taken]


@dataclass(frozen=True)
class _Look:
    """What is seen from a spot.

    fine: whether there is room around, and most of what is seen shows its front, or under a ceiling that faces up is
    drawn: fronts, and backs of double-sided materials.
    furnished: whether most is drawn, and the front of something above the knee is seen, and over it a wall's back: what
    is higher may be another solid that this one touches. inside, among: see above.
    score: of the best direction of view, direction (3).
    """

    spot: int
    eye: Doubles
    fine: bool
    furnished: bool
    inside: bool
    among: bool
    score: float
    direction: Doubles

    @classmethod
    def around(cls, scene: Scene, rays: Rays, spots: _Spots, spot: int) -> _Look:
        eye = spots.points[spot] + np.array([0.0, EYE_HEIGHT / scene.metres_per_unit, 0.0])
        seen = rays.panorama(eye)
        distances, hits = seen.distances * scene.metres_per_unit, seen.triangles >= 0
        level = panorama_directions()[:, len(SLOPES) // 2]
        standing = (distances[:, SLOPES > -0.01] < FAR).any(axis=1)
        angles = _angles(level)
        around, opposite = (
            float(angles[where].sum() / (2 * np.pi)) for where in (standing, standing & np.roll(standing, TURNS // 2))
        )
        double = np.array([material.double_sided for material in scene.materials] or [True])
        drawn = seen.fronts | double[scene.material_ids[seen.triangles]]
        right = drawn if spots.shells[spot] >= 0 else seen.fronts
        share = float(right[hits].mean()) if hits.any() else 1.0
        behind = (hits & ~seen.fronts)[:, len(SLOPES) // 2]
        things = hits & seen.fronts & (EYE_HEIGHT + np.where(hits, distances, 0) * SLOPES > KNEE) & (SLOPES < -0.01)
        scores = share * _scores(distances, seen.triangles, level, angles)
        best = int(np.argmax(scores))
        return cls(
            spot,
            eye,
            fine=share >= 0.5 and float(distances.min()) >= ROOMY,
            furnished=share >= 0.5 and bool((things & behind[:, None]).any()),
            inside=bool(spots.covered[spot] and around >= WALLED),
            among=opposite >= SURROUNDED,
            score=float(scores[best]),
            direction=level[best],
        )


def _angles(level: Doubles) -> Doubles:
    """The part of a full turn, in radians, that each of the directions (TURNS, 3) stands for."""
    turn = np.unwrap(arctan2(level[:, 2], level[:, 0]))
    edges = (turn + np.roll(turn, -1)) / 2
    edges[-1] = turn[-1] + (turn[0] + 2 * np.pi - turn[-1]) / 2
    return np.diff(np.concatenate([[edges[-1] - 2 * np.pi], edges]))


def _scores(distances: Doubles, triangles: Indices, level: Doubles, angles: Doubles) -> Doubles:
    """How good (TURNS) the view is in each direction: up to 1, 0 for an empty sky.

    distances: metres, (TURNS, SLOPES). triangles: what is seen there. Good is a view of what is neither near nor far,
    and of much detail. What is nearer than ROOMY counts against it.
    """
    reached = np.minimum(distances, 1e6)
    worth = reached / (reached + MIDDLE) * np.minimum(FAR_ENOUGH / np.maximum(reached, 1), 1)
    worth = np.where(np.isfinite(distances), np.where(distances < ROOMY, -1.0, worth), 0).mean(axis=1)
    weights = np.maximum(dot(level[:, None], level[None]) - VIEW, 0) * angles
    view = weights > 0
    detail = np.array([len(np.unique(triangles[row])) for row in view]) / (view.sum(axis=1) * len(SLOPES))
    scores: Doubles = (weights * worth).sum(axis=1) / weights.sum(axis=1) * (PLAIN + (1 - PLAIN) * detail)
    return scores
