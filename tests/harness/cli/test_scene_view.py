"""`bench list --scene`: what a scene is taken for, its unit, and a picture; a cell larger than the object is noted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from shading_atlas_bench.harness.cli.scene_view import HEIGHT, WIDTH, half_blocks, show_scene
from shading_atlas_bench.harness.workload.session import open_scene
from shading_atlas_bench.harness.workload.settings import Settings
from tests.scenes.checks import read_image
from tests.scenes.test_load_files import box


@pytest.mark.parametrize(("inwards", "kind", "path"), [(True, "place", "walk"), (False, "object", "orbit")])
def test_a_scene_is_described_and_drawn(
    inwards: bool, kind: str, path: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.obj").write_text(box(6, inwards), encoding="utf-8")
    show_scene(Settings(scene=str(tmp_path / "mine.obj")))
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("mine  12 triangles, ")
    assert lines[1].startswith(kind)
    assert lines[1].endswith(".")
    assert lines[2].startswith("unit")
    assert "a guess" in lines[2]
    assert lines[3].startswith(f"{path} starts  at (")
    picture = read_image(Path(lines[-1]))
    assert picture.shape[:2] == (HEIGHT, WIDTH)
    assert len(np.unique(picture.reshape(-1, 4), axis=0)) > 10


def test_a_unit_that_is_asked_for_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.obj").write_text(box(6, inwards=False), encoding="utf-8")
    show_scene(Settings(scene=str(tmp_path / "mine.obj"), unit=0.0254))
    assert "unit  0.0254 m: --unit" in capsys.readouterr().out.splitlines()


@pytest.mark.parametrize(("unit", "noted"), [(0.02, True), (1.0, False)])
def test_a_cell_larger_than_the_object_is_noted(unit: float, noted: bool, tmp_path: Path) -> None:
    (tmp_path / "mine.obj").write_text(box(1, inwards=False), encoding="utf-8")
    scene = open_scene(Settings(scene=str(tmp_path / "mine.obj"), unit=unit))
    assert any("inside the view cell" in note and "--unit" in note for note in scene.notes) == noted
    assert scene.metres_per_unit == unit


def test_a_picture_fits_the_terminal() -> None:
    rgb = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    rgb[: HEIGHT // 2] = 200
    for columns, width in ((60, 60), (50, 48), (300, 240)):
        rows = "".join(segment.text for segment in half_blocks(rgb, columns).segments).splitlines()
        assert {len(row) for row in rows} == {width}
    first, last = half_blocks(rgb, 60).segments[0].style, half_blocks(rgb, 60).segments[-2].style
    assert first
    assert first.color
    assert last
    assert last.bgcolor
    assert (first.color.triplet, last.bgcolor.triplet) == ((200, 200, 200), (0, 0, 0))
