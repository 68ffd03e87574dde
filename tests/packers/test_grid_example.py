"""The documented example of a packer is what is tested here, and it is sound."""

import ast

import numpy as np
import pytest

from shading_atlas_bench.harness.measure.validity import check
from shading_atlas_bench.harness.workload.reference import ForwardRenderer
from shading_atlas_bench.packers.example.grid import Grid
from shading_atlas_bench.packers.interface import Decoded
from tests.packers.rooms import frame_of, novel_view, room, server_of
from tests.test_floors import last_line

README = "packers/README.md"


def test_the_documentation_shows_this_packer(request):
    root = request.config.rootpath
    assert (root / "packers/example/grid.py").read_text(encoding="utf-8") in (root / README).read_text(encoding="utf-8")


def test_it_is_under_40_lines_of_code(request):
    """Blank lines, imports and docstrings aside."""
    text = (request.config.rootpath / "packers/example/grid.py").read_text(encoding="utf-8")
    code = {number for number, line in enumerate(text.splitlines(), 1) if line.strip()}
    for node in ast.walk(ast.parse(text)):
        is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if isinstance(node, ast.stmt) and (is_text or isinstance(node, ast.Import | ast.ImportFrom)):
            code -= set(range(node.lineno, last_line(node) + 1))
    assert 20 < len(code) < 40


def received(packer: Grid, frame, client):
    payload = packer.pack(frame)
    planes = {name: plane.get()[..., :3] for name, plane in payload.planes.items()}
    client.receive(Decoded(planes, payload.blobs, payload.geometry))
    return payload


@pytest.mark.parametrize(("size", "error"), [((512, 512), 4), ((300, 200), 12)])
def test_grid_is_valid_and_looks_like_the_reference(device, size, error):
    scene = server_of(device, room())
    packer = Grid()
    packer.prepare(scene)
    client = packer.client(scene.shipped)
    frame = frame_of(scene, *size)
    payload = received(packer, frame, client)
    assert check(frame, payload, payload.owners(), client) == []
    image = client.draw(novel_view())
    reference, _ = ForwardRenderer(scene).draw(novel_view(), eye=frame.server.eye)
    assert image.triangle is not None
    assert reference.triangle is not None
    assert (image.triangle.get() == reference.triangle.get()).mean() > 0.99
    assert np.abs(image.rgb.get().astype(int) - reference.rgb.get())[..., :3].mean() < error


@pytest.mark.parametrize("size", [(16, 16), (37, 8)])
def test_more_triangles_than_texels_are_named(device, size):
    scene = server_of(device, room())
    packer = Grid()
    packer.prepare(scene)
    client = packer.client(scene.shipped)
    frame = frame_of(scene, *size)
    payload = received(packer, frame, client)
    assert len(payload.unplaced) == len(frame.pvs) - size[0] * size[1]
    assert check(frame, payload, payload.owners(), client) == []
