"""Cameras: poses to matrices, the client's view, the server's view of the cell, and the frusta that cover the cell."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.arithmetic.functions import arctan, arctan2, cos, sin_cos, tan
from shading_atlas_bench.arithmetic.matrices import matvec, product
from shading_atlas_bench.packers.interface import View
from shading_atlas_bench.scenes.quaternions import conjugate, multiply

# A frustum wider than this is split: perspective spends most pixels of a wider one near its edges.
WIDEST_FRUSTUM = 100.0
ONE_VIEW = 4  # times the client's pixels, which one view of a cell may have, however wide it is


@dataclass(frozen=True)
class Pose:
    """Where a camera is.

    position: float64 (3), origin-relative, in scene units. orientation: float64 (4), quaternion x, y, z, w, camera to
    world.
    """

    position: Doubles
    orientation: Doubles


@dataclass(frozen=True)
class ViewCell:
    """A view cell: radius in metres and horizontal field of view in degrees."""

    radius: float = 0.08
    fov: float = 80.0


def rotation(quaternion: Doubles) -> Doubles:
    """The rotation matrix, float64 (3, 3), of a quaternion (4), x, y, z, w, of any positive length."""
    x, y, z, w = np.asarray(quaternion, np.float64) / np.linalg.norm(quaternion, axis=-1)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_vector(q: Doubles) -> Doubles:
    """Axis times angle, (3), in radians, of a unit quaternion (4), x, y, z, w, the short way round."""
    q = q if q[3] >= 0 else -q
    sine = np.linalg.norm(q[:3], axis=-1)
    return q[:3] * (2.0 if sine < 1e-12 else 2 * arctan2(sine, q[3]) / sine)


def from_rotation_vector(v: Doubles) -> Doubles:
    """The unit quaternion (4), x, y, z, w, of axis times angle, (3), in radians."""
    angle = np.linalg.norm(v, axis=-1)
    sine, cosine = sin_cos(angle / 2)
    return np.append(v * (0.5 if angle < 1e-12 else sine / angle), cosine)


def view_matrix(pose: Pose) -> Doubles:
    """World to camera, float64 (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation(pose.orientation).T
    matrix[:3, 3] = -matvec(matrix[:3, :3], pose.position)
    return matrix


def projection_matrix(tan_x: float, tan_y: float, near: float) -> Doubles:
    """Perspective, float64 (4, 4), with half-angle tangents tan_x and tan_y, reversed depth, infinite far plane."""
    return np.array([[1 / tan_x, 0, 0, 0], [0, 1 / tan_y, 0, 0], [0, 0, 0, near], [0, 0, -1, 0]], np.float64)


def client_view(pose: Pose, fov: float, width: int, height: int, near: float) -> View:
    """The client's view: `fov` degrees across `width` square pixels."""
    tan_x = tan(np.radians(fov / 2))
    return View(view_matrix(pose), projection_matrix(tan_x, tan_x * height / width, near), width, height)


@dataclass(frozen=True)
class CellFrustum:
    """What the cell can see: half-angle tangents of its frustum, pixels per unit tangent at the client's density, and
    pixels of the client's picture."""

    tan_x: float
    tan_y: float
    density: float
    pixels: int

    @classmethod
    def around(cls, cell: ViewCell, fov: float, width: int, height: int) -> CellFrustum:
        """The frustum of `cell` for a client of `fov` degrees: the same angle is added on all four sides."""
        half_x = np.radians(fov / 2)
        half_y = arctan(tan(half_x) * height / width)
        margin = np.radians(cell.fov - fov) / 2
        return cls(
            float(tan(half_x + margin)),
            float(tan(min(half_y + margin, np.radians(88)))),
            float(width / 2 / tan(half_x)),
            width * height,
        )

    def server_view(self, pose: Pose, near: float) -> View:
        """The server's view at the client's density in its centre."""
        width, height = (max(1, int(np.ceil(2 * t * self.density))) for t in (self.tan_x, self.tan_y))
        return View(view_matrix(pose), projection_matrix(self.tan_x, self.tan_y, near), width, height)

    def frusta(self, pose: Pose, near: float, density: float) -> list[View]:
        """Views that together cover the cell's frustum, none wider or higher than WIDEST_FRUSTUM.

        Each is turned to its part of the angles, so that its density holds at its own centre. Turning by c, a ray
        (tan a, y) lands on (tan(a - c), y cos a / cos(a - c)), whose second factor is monotone in a: the ends bound it.
        """
        views = []
        for low, high in _split(arctan(self.tan_x)):
            turn = (low + high) / 2
            tall = self.tan_y * max(cos(a) / cos(a - turn) for a in (low, high))
            for bottom, top in _split(arctan(tall)):
                tilt = (bottom + top) / 2
                wide = tan((high - low) / 2) * max(cos(a) / cos(a - tilt) for a in (bottom, top))
                views.append(_turned(pose, turn, tilt, wide, tan((top - bottom) / 2), near, density))
        return views

    def split(self, pose: Pose, near: float) -> tuple[View, ...]:
        """The frusta at the client's density where one view is too wide for the cell, else none (Frame.frusta).

        A client that is itself as wide spends its pixels near its edges; frusta have none to spare there.
        """
        server, views = self.server_view(pose, near), self.frusta(pose, near, self.density)
        too_large = server.width * server.height > ONE_VIEW * self.pixels
        return tuple(views) if len(views) > 1 and too_large else ()

    def contains(self, server: Pose, client: View) -> bool:
        """Whether the four corner rays of a client view lie inside the frustum."""
        corners = np.array([[x, y, -1.0] for x in (-1, 1) for y in (-1, 1)])
        corners[:, 0] /= client.projection[0, 0]
        corners[:, 1] /= client.projection[1, 1]
        rays = product(corners, client.view[:3, :3], rotation(server.orientation))
        depth = -rays[:, 2]
        slack = 1 + 1e-9
        inside = (np.abs(rays[:, 0]) <= self.tan_x * depth * slack) & (np.abs(rays[:, 1]) <= self.tan_y * depth * slack)
        return bool(np.all((depth > 0) & inside))


def _split(half_angle: float) -> list[tuple[float, float]]:
    """Equal parts of -half_angle..half_angle, none wider than WIDEST_FRUSTUM."""
    parts = max(1, int(np.ceil(np.degrees(2 * half_angle) / WIDEST_FRUSTUM - 1e-9)))
    edges = np.linspace(-half_angle, half_angle, parts + 1)
    return list(itertools.pairwise(edges))


def _turned(pose: Pose, right: float, up: float, tan_x: float, tan_y: float, near: float, density: float) -> View:
    """A view turned right, then up, by angles in radians, with `density` pixels per unit tangent."""
    turn = multiply(from_rotation_vector(np.array([0.0, -right, 0.0])), from_rotation_vector(np.array([up, 0.0, 0.0])))
    turned = Pose(pose.position, multiply(pose.orientation, turn))
    width, height = (max(1, int(np.ceil(2 * t * density))) for t in (tan_x, tan_y))
    return View(view_matrix(turned), projection_matrix(tan_x, tan_y, near), width, height)


def confined(server: Pose, wanted: Pose, radius: float, frustum: CellFrustum, client: View) -> tuple[Pose, bool]:
    """The pose nearest to `wanted` whose view stays inside the cell, and whether it had to be moved.

    The offset is shortened to `radius` (scene units); the rotation from the server's pose is scaled back, by bisection,
    until the client's four corners lie inside the cell's frustum.
    """
    offset = wanted.position - server.position
    length = np.linalg.norm(offset, axis=-1)
    moved = length > radius * (1 + 1e-9)
    position = server.position + offset * (radius / length) if moved else wanted.position
    turn = rotation_vector(multiply(conjugate(server.orientation), wanted.orientation))

    def pose(share: float) -> Pose:
        return Pose(position, multiply(server.orientation, from_rotation_vector(turn * share)))

    def fits(share: float) -> bool:
        view = View(view_matrix(pose(share)), client.projection, client.width, client.height)
        return frustum.contains(server, view)

    if fits(1.0):
        return pose(1.0), bool(moved)
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (middle, high) if fits(middle) else (low, middle)
    return pose(low), True
