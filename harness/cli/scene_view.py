"""`bench list --scene`: what a scene is taken for, where a person stands in it, and a picture from there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.segment import Segment, Segments
from rich.style import Style

from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles
from shading_atlas_bench.harness.console import make_console, styled, tell_passed_over
from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.measure.dump import write_png
from shading_atlas_bench.harness.workload.session import open_session
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.harness.workload.views import Pose, client_view
from shading_atlas_bench.kernels.cache import cache_root
from shading_atlas_bench.scenes.paths import CameraPath
from shading_atlas_bench.scenes.quaternions import rotate

WIDTH, HEIGHT = 240, 135  # pixels of the picture
COLUMNS = 60  # of a terminal that the picture fills at most
UPPER_HALF = "\N{UPPER HALF BLOCK}"


def show_scene(wanted: Settings) -> None:
    """Print what a scene is and why, its unit and where its path starts, and draw and write the view from there.

    The picture is a PNG in the cache folder; a terminal shows it too. Raises SceneError, PathError and SettingsError,
    and InputError where it cannot be written.
    """
    session = open_session(replace(wanted, width=WIDTH, height=HEIGHT))
    tell_passed_over(session.device)
    scene, path, console = session.scene.host, session.path, make_console()
    low, high = scene.bounds
    size = " x ".join(f"{length:.3g}" for length in (high - low) * scene.metres_per_unit)
    lines = {
        scene.name: f"{scene.triangle_count:,} triangles, {size} m",
        "place" if scene.place else "object": scene.because or "It was made as one.",
        "unit": f"{scene.metres_per_unit:.6g} m: {scene.unit_from}",
        f"{path.name} starts": _start(path, scene.origin),
    }
    for name, text in lines.items():
        console.print(styled("[bold]{}[/]  {}", name, text), soft_wrap=True)
    for note in [*scene.notes, *path.notes]:
        console.print(styled("[yellow]note[/] {}", note), soft_wrap=True)
    pose = Pose(path.positions[0], path.orientations[0])
    image, _ = session.forward.draw(client_view(pose, session.settings.fov, WIDTH, HEIGHT, session.source.near))
    rgb = image.rgb.get()[..., :3]
    if console.is_terminal and console.color_system and console.encoding.startswith("utf"):
        console.print(half_blocks(rgb, min(COLUMNS, console.width)))
    _write(rgb, f"{scene.name}-{scene.content_hash}", console)


def _start(path: CameraPath, origin: Doubles) -> str:
    """A path's first position, in the file's coordinates, and where it looks."""
    position = ", ".join(f"{value:.5g}" for value in path.positions[0] + origin)
    way = ", ".join(f"{value:.2f}" for value in rotate(path.orientations[0], np.array([0.0, 0.0, -1.0])))
    return f"at ({position}) of the file, looking along ({way})"


def _write(rgb: Bytes, name: str, console: Console) -> None:
    file = cache_root() / "pictures" / f"{name}.png"
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_png(file, rgb)
    except OSError as error:
        raise InputError(f"The picture {file} cannot be written: {error}.") from error
    console.print(styled("[bold]{}[/]", file), soft_wrap=True)


def half_blocks(rgb: Bytes, columns: int) -> Segments:
    """A picture, uint8 (h, w, 3), for a terminal: at most `columns` wide, with two pixels to a character."""
    factor = -(-rgb.shape[1] // columns)
    height, width = rgb.shape[0] // (2 * factor) * 2, rgb.shape[1] // factor
    cut = rgb[: height * factor, : width * factor].reshape(height, factor, width, factor, 3)
    small = cut.mean(axis=(1, 3)).round().astype(int)
    segments = []
    for upper, lower in zip(small[::2], small[1::2], strict=True):
        for top, bottom in zip(upper, lower, strict=True):
            colours = (f"rgb({red},{green},{blue})" for red, green, blue in (top, bottom))
            segments.append(Segment(UPPER_HALF, Style(color=next(colours), bgcolor=next(colours))))
        segments.append(Segment.line())
    return Segments(segments)
