"""Light for files that bring none: sun and sky outdoors and for objects, a few lamps in rooms; and the exposure.

Colours are linear RGB. An irradiance of pi on a white matt surface gives a radiance of 1.
"""

from __future__ import annotations

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.arithmetic.functions import arctan2, cos, power, sin, sin_cos
from shading_atlas_bench.arithmetic.matrices import dot, eigenvectors, product
from shading_atlas_bench.scenes.features import triangle_shapes
from shading_atlas_bench.scenes.model import Camera, Light, Scene, Sky
from shading_atlas_bench.scenes.rays import Rays

_SUN = (3.6, 3.35, 2.95)  # irradiance facing the sun: somewhat warm, about three times that of the sky
_SUN_HEIGHT = 50.0  # degrees above the horizon
_SUN_ASIDE = (50.0, -50.0, 110.0, -110.0)  # degrees from the viewer's heading, in order of preference
_SKY = Sky((0.24, 0.34, 0.52), (0.42, 0.47, 0.52), (0.18, 0.165, 0.15))
_INDOOR_SKY = Sky((0.20, 0.22, 0.25), (0.27, 0.28, 0.29), (0.25, 0.23, 0.21))
_LAMP = (3.4, 3.1, 2.7)  # irradiance on the floor below a lamp
_LAMP_CONE = 65.0  # degrees; a shadow map of twice that still has even texels
_LAMP_RISE = 8.0  # metres above the viewer at most: lamps hang, they are not stuck to a vault
_FARTHEST = 25.0  # metres from the viewer to where a room is explored
_HIGHEST_ROOF = 30.0  # metres above the viewer; what closes the sky higher up is a painted dome, not a roof
_MIDDLE_GREY = 0.18
_EXPOSURES = (0.45, 1.6)  # how far the light rigs are corrected for bright and dark surfaces
_RECEIVED_OUTSIDE, _RECEIVED_INSIDE = 1.0, 0.6  # usual irradiance / pi of what is seen under either rig


def add_lights(scene: Scene) -> str:
    """Fill in lights, sky and exposure where a scene has no lights of its own; say in a sentence what was done."""
    if scene.lights:
        _expose_own_lights(scene)
        return f"The file's {len(scene.lights)} lights are used."
    rays = Rays(scene)
    eye = _viewpoint(scene)
    if eye is not None and _covered(rays, eye, _HIGHEST_ROOF / scene.metres_per_unit):
        scene.lights, scene.sky = _lamps(scene, rays, eye), _INDOOR_SKY
        received = _RECEIVED_INSIDE
        done = f"The file has no lights: {len(scene.lights)} lamps with shadows were hung in the room."
    else:
        received = _RECEIVED_OUTSIDE
        under_dome = eye is not None and _covered(rays, eye, np.inf)
        scene.lights, scene.sky = [_sun(scene, rays, eye, shadows=not under_dome)], _SKY
        done = f"The file has no lights: a sun with{'out' if under_dome else ''} shadows and a sky were added."
    low, high = _EXPOSURES
    scene.exposure = float(np.clip(_MIDDLE_GREY / (received * mean_albedo(scene)), low, high))
    return done


def mean_albedo(scene: Scene) -> float:
    """Mean luminance of the base colours, weighted by area."""
    area, _ = triangle_shapes(scene)
    weight = np.bincount(scene.material_ids, area, len(scene.materials))
    colours = np.array([_mean_colour(scene, index) for index in range(len(scene.materials))])
    mean = (weight[:, None] * colours).sum(axis=0) / weight.sum()
    return max(0.02, float(dot(mean, (0.2126, 0.7152, 0.0722))))


def _mean_colour(scene: Scene, index: int) -> Doubles:
    material = scene.materials[index]
    colour = np.array(material.base_colour[:3])
    if material.base_texture < 0:
        return colour
    texels = scene.textures[material.base_texture].texels[::8, ::8]
    opaque = texels[texels[..., 3] > 127]
    return colour * power(opaque[:, :3] / 255, 2.2).mean(axis=0) if len(opaque) else colour


def _viewpoint(scene: Scene) -> Doubles | None:
    """Where a viewer stands in a place, or None for objects."""
    if not scene.place:
        return None
    low, high = scene.bounds
    eyes = [np.array(camera.position) for camera in scene.cameras]
    return next((eye for eye in eyes if ((low < eye) & (eye < high)).all()), (low + high) / 2)


def _covered(rays: Rays, eye: Doubles, height: float) -> bool:
    """Whether something covers most of the sky straight above and 35 degrees around it, within a height in units."""
    angles = np.arange(8) * np.pi / 4
    aside, upwards = sin_cos(np.radians(35))
    sine, cosine = sin_cos(angles)
    around = np.stack([aside * cosine, np.full(len(angles), upwards), aside * sine], axis=1)
    directions = [np.array([0.0, 1.0, 0.0]), *around]
    return sum(bool(rays.distance(eye, direction) * direction[1] < height) for direction in directions) >= 6


def _sun(scene: Scene, rays: Rays, eye: Doubles | None, shadows: bool) -> Light:
    """The sun over one of the viewer's shoulders, or from ahead where more of what the viewer sees would be lit."""
    camera = next(iter(scene.cameras), Camera((0.0, 0.0, 0.0), (-0.35, 0.0, -0.94)))
    heading = arctan2(camera.direction[2], camera.direction[0])
    directions = [_sun_direction(heading + np.radians(aside)) for aside in _SUN_ASIDE]
    best = 0
    if eye is not None and shadows:
        seen = _seen_points(rays, eye, heading)
        lit = [sum(np.isinf(rays.distance(point, -direction)) for point in seen) for direction in directions]
        best = int(np.argmax(lit))
    return Light("directional", _SUN, direction=tuple(directions[best].tolist()), shadows=shadows)


def _sun_direction(azimuth: float) -> Doubles:
    (along, above), (aside, level) = sin_cos(np.array([azimuth, np.radians(_SUN_HEIGHT)]))
    return np.array([aside * level, -above, along * level])


def _seen_points(rays: Rays, eye: Doubles, heading: float) -> list[Doubles]:
    """A few surface points around the middle of what a viewer sees, somewhat in front of their surfaces."""
    points = []
    for turn in np.radians([-24, -12, 0, 12, 24]):
        way = np.array([cos(heading + turn), -0.15, sin(heading + turn)])
        way /= np.linalg.norm(way, axis=-1)
        distance = rays.distance(eye, way)
        if np.isfinite(distance):
            points.append(eye + way * distance * 0.99)
    return points


def _lamps(scene: Scene, rays: Rays, eye: Doubles) -> list[Light]:
    """Three spot lights below the ceiling along the longer way through the room that the viewer stands in."""
    reach = _FARTHEST / scene.metres_per_unit
    angles = np.arange(24) * 2 * np.pi / 24
    ways = np.stack([cos(angles), np.zeros(24), sin(angles)], axis=1)
    hits = eye + ways * np.array([min(rays.distance(eye, way), reach) for way in ways])[:, None]
    spread = (hits - hits.mean(axis=0))[:, [0, 2]]
    along = eigenvectors(product(spread.T, spread))[1][:, 1]
    axis = np.array([along[0], 0.0, along[1]])
    low, high = dot(hits, axis).min(), dot(hits, axis).max()
    across = hits.mean(axis=0) - axis * dot(hits.mean(axis=0), axis)
    lights = []
    for share in (0.0, 0.6, -0.6):
        goal = across + axis * ((low + high) / 2 + share * (high - low) / 2) - eye
        length = np.linalg.norm(goal, axis=-1)
        way = goal / length if length > 0 else ways[0]
        place = eye + way * min(length, 0.8 * rays.distance(eye, way))
        lights.append(_lamp(scene, rays, place, -share * axis))
    return lights


def _lamp(scene: Scene, rays: Rays, place: Doubles, lean: Doubles) -> Light:
    """A spot light under the ceiling above a place, shining down and slightly along `lean`."""
    up, down = np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0])
    unit = scene.metres_per_unit
    rise = min(0.85 * rays.distance(place, up), _LAMP_RISE / unit)
    position = place + up * rise
    drop = rays.distance(position, down) * unit
    height = float(np.clip(drop, 1.5, 2 * _LAMP_RISE)) if np.isfinite(drop) else _LAMP_RISE
    direction = down + 0.5 * lean
    direction /= np.linalg.norm(direction, axis=-1)
    colour = _times(_times(_LAMP, height), height)
    return Light("spot", colour, tuple(position.tolist()), tuple(direction.tolist()), _LAMP_CONE)


def _times(colour: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    red, green, blue = colour
    return red * factor, green * factor, blue * factor


def _expose_own_lights(scene: Scene) -> None:
    """Sky and exposure for lights in whatever unit the file has: irradiance is estimated at half the scene's size."""
    low, high = scene.bounds
    distance = max(np.linalg.norm(high - low, axis=-1) / 4 * scene.metres_per_unit, 1e-3)
    arriving = [
        max(light.colour) / (1 if light.kind == "directional" else distance * distance) for light in scene.lights
    ]
    strength = max(sum(arriving), 1e-6) / max(_SUN)
    scene.sky = Sky(_times(_SKY.zenith, strength), _times(_SKY.horizon, strength), _times(_SKY.ground, strength))
    scene.exposure = _MIDDLE_GREY / (_RECEIVED_OUTSIDE * mean_albedo(scene) * strength)
