"""Real payloads pass the validator; the same payloads with an error planted do not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.harness.measure.validity import Violation, check
from shading_atlas_bench.harness.plugins import find_packers, load_packer
from shading_atlas_bench.harness.workload.upload import upload_scene
from shading_atlas_bench.harness.workload.views import CellFrustum, Pose, ViewCell
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.packers.interface import Client, Decoded, Frame, Owners, Payload, ServerScene
from shading_atlas_bench.scenes.model import Material, Scene

ATLAS = 512


def hills(side: int = 24) -> Scene:
    """A bumpy square, 10 units wide, seen from 6 units above one edge; every triangle in sight."""
    x, z = np.meshgrid(np.linspace(-5, 5, side + 1), np.linspace(-12, -2, side + 1))
    positions = np.stack([x, 0.4 * np.sin(2 * x) * np.cos(z) - 3, z], axis=-1).reshape(-1, 3).astype(np.float32)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1, 1)
    indices = (corner + np.array([[0, side + 1, 1, 1, side + 1, side + 2]])).reshape(-1, 3).astype(np.int32)
    up = np.tile(np.array([0, 1, 0], np.float32), (len(positions), 1))
    uvs, white = positions[:, [0, 2]].copy(), np.ones((len(positions), 4), np.float32)
    ids = np.zeros(len(indices), np.int32)
    return Scene("hills", positions, indices, up, uvs, white, ids, [Material(double_sided=True)], content_hash="hills")


@pytest.fixture(scope="module")
def server(device: Device) -> ServerScene:
    return upload_scene(device, hills())


def frame_of(server: ServerScene, index: int, pvs: np.ndarray) -> Frame:
    pose = Pose(np.array([0.3 * index, 0, 0]), np.array([0, 0, 0, 1.0]))
    view = CellFrustum.around(ViewCell(0.1, 90), 60, 320, 180).server_view(pose, 0.01)
    return Frame(index, server, view, 0.1, 90, pvs, server.device.upload(pvs), (), ATLAS, ATLAS)


class Shifted(Client):
    """Looks up as another client does, some texels away; and nothing of `lost` triangles."""

    def __init__(self, client: Client, shift: tuple[float, float] = (0, 0), lost: int = -1) -> None:
        self.client, self.shift, self.lost = client, np.array(shift), lost

    def receive(self, payload: Decoded) -> None:
        self.client.receive(payload)

    def draw(self, view: Any) -> Any:
        return self.client.draw(view)

    def locate(self, triangles: np.ndarray, bary: np.ndarray) -> np.ndarray:
        located = self.client.locate(triangles, bary) + self.shift
        located[triangles == self.lost] = np.nan
        return located


@dataclass(frozen=True)
class Sent:
    """The last of some frames, as the client has it."""

    frame: Frame
    payload: Payload
    owners: Owners
    client: Client
    earlier: tuple[list[Violation], ...]

    def violations(self, **changes: Any) -> list[Violation]:
        """With some of owners' arrays or of the other parts changed."""
        arrays = {name: changes.pop(name) for name in ("texel", "triangle", "bary") if name in changes}
        sent = replace(self, owners=replace(self.owners, **arrays), **changes)
        return check(sent.frame, sent.payload, sent.owners, sent.client, budget=None)

    def rules(self, **changes: Any) -> set[str]:
        return {violation.rule for violation in self.violations(**changes)}


@pytest.fixture(scope="module", params=[name for name, packer in find_packers().items() if packer.atlas])
def sent(request: pytest.FixtureRequest, server: ServerScene) -> Sent:
    """Three frames of a moving camera over a changing set of triangles, with the packer's default parameters."""
    (packer,) = load_packer(request.param)
    packer.prepare(server)
    client = packer.client(server.shipped)
    everything = np.arange(server.triangles.count, dtype=np.int32)
    found = []
    for index in range(3):
        frame = frame_of(server, index, everything[everything % 5 != index])
        payload = packer.pack(frame)
        owners = payload.owners()
        planes = {name: plane.get()[..., :3] for name, plane in payload.planes.items()}
        client.receive(Decoded(planes, payload.blobs, payload.geometry))
        found.append(check(frame, payload, owners, client, budget=None))
    assert owners
    return Sent(frame, payload, owners, client, tuple(found))


def test_real_frames_break_no_rule(sent: Sent):
    assert sent.earlier == ([], [], [])
    assert sent.payload.sample_count == len(sent.owners.texel) > 10_000


def test_a_texel_that_is_not_written(sent: Sent):
    plane = next(iter(sent.payload.planes.values())).get().copy()
    triangle = int(sent.frame.pvs[100])
    located = sent.client.locate(np.full(1, triangle), np.full((1, 2), 1 / 3, np.float32))
    assert located is not None
    column, row = (int(value) for value in np.floor(located[0]))
    texel = row * ATLAS + column
    keep = sent.owners.texel != texel
    plane[row, column] = 0
    payload = replace(sent.payload, planes={"atlas": sent.frame.scene.device.upload(plane)})
    changes = {name: getattr(sent.owners, name)[keep] for name in ("texel", "triangle", "bary")}
    (violation,) = sent.violations(payload=payload, **changes)
    assert (violation.rule, violation.count, violation.texels) == ("written", 1, (texel,))
    assert triangle in violation.triangles


@pytest.mark.parametrize("shift", [(1, 0), (0, -1), (0.5, 0.5)])
def test_a_client_that_looks_elsewhere(sent: Sent, shift: tuple[float, float]):
    assert sent.rules(client=Shifted(sent.client, shift)) >= {"surface", "written"}


@pytest.mark.parametrize("shift", [(0.36, 0), (0, -0.36)])
def test_a_client_that_is_just_further_off_than_the_cells_of_an_l(sent: Sent, shift: tuple[float, float]):
    assert "surface" in sent.rules(client=Shifted(sent.client, shift))


def test_a_triangle_that_nobody_has(sent: Sent):
    lost = int(sent.frame.pvs[7])
    (violation,) = sent.violations(client=Shifted(sent.client, lost=lost))
    assert (violation.rule, violation.triangles) == ("placed", (lost,))
    assert sent.rules(payload=replace(sent.payload, unplaced={lost: "no room"})) == {"placed"}


def test_blocks_that_overlap(sent: Sent):
    texel = sent.owners.texel.copy()
    first, second = (np.flatnonzero(sent.owners.triangle == t) for t in sent.frame.pvs[[3, 300]])
    several = min(len(first), len(second))
    texel[first[:several]] = texel[second[:several]]
    assert sent.rules(texel=texel) >= {"single owner", "alpha", "written"}


def test_triangles_swapped(sent: Sent):
    triangle = sent.owners.triangle.copy()
    a, b = sent.frame.pvs[[3, 300]]
    triangle[sent.owners.triangle == a], triangle[sent.owners.triangle == b] = b, a
    violations = [v for v in sent.violations(triangle=triangle) if v.rule == "surface"]
    assert {int(a), int(b)} <= set(violations[0].triangles)


def test_barycentrics_mixed_up(sent: Sent):
    assert sent.rules(bary=np.ascontiguousarray(sent.owners.bary[:, ::-1])) >= {"surface", "once"}
    broken = sent.owners.bary.copy()
    broken[5] = np.nan
    assert "barycentrics" in sent.rules(bary=broken)


def test_texels_shifted_by_one(sent: Sent):
    assert sent.rules(texel=sent.owners.texel + 1) >= {"alpha", "surface"}


def test_texels_outside(sent: Sent):
    assert "inside" in sent.rules(texel=sent.owners.texel + ATLAS * ATLAS - 1)
