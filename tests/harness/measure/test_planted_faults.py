"""Nobody who cheats gets away with it: every planted fault ends as invalid, with a reason, in a run and in the kit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.harness.conformance.trial import Stage, try_isolation, try_method
from shading_atlas_bench.harness.run.run import run
from shading_atlas_bench.harness.workload import session
from shading_atlas_bench.harness.workload.session import open_session
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.packers.ppll import PerPixelLinkedLists
from shading_atlas_bench.packers.sas import ShadingAtlasStreaming
from shading_atlas_bench.packers.sas.client import ShadingAtlasClient
from shading_atlas_bench.reports.store.results import Store
from shading_atlas_bench.scenes.features import find_features
from shading_atlas_bench.scenes.model import Camera, Material, Scene, Texture
from tests.harness import planted_packers as planted
from tests.packers.test_transparency import glazed

FILE = Path(planted.__file__)
HONEST = ("sas", "snakebinning", "tss", "ppll", "ppll[mode=full]", "ppll[mode=difference,tolerance=8]",
          "ppll[mode=bilateral]", "ppll[mode=full,nodes=2]",
          "ppll[preblend=true]")  # fmt: skip
SMALL: dict[str, Any] = {
    "scene": "hall", "frames": 2, "width": 160, "height": 90, "atlas_width": 256, "atlas_height": 256,
    "path": "orbit", "codec": "none", "metrics": ("psnr",),
}  # fmt: skip

WIDE = SMALL | {"cell_radius": 0.3, "cell_fov": 160, "path": "walk"}


def shiny_room() -> Scene:
    """A room with panes of varying opacity, whose walls reflect and have a texture of noise."""
    scene = glazed(textured=True)
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 4), np.uint8)
    noise[..., 3] = 255
    scene.textures.append(Texture("noise", noise))
    scene.materials[0] = Material(base_texture=1, roughness=0.2, metallic=0.5, double_sided=True)
    scene.cameras = [Camera((0.0, 0.1, 1.5), (0.0, 0.0, -1.0))]
    scene.features, scene.content_hash = find_features(scene), "shiny room"
    return scene


@pytest.fixture(scope="module")
def small_scene() -> Iterator[None]:
    """Whatever scene is asked for, it is the shiny room."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(session, "load_scene", lambda *_, **__: shiny_room())
        yield


@pytest.fixture(scope="module")
def rows(small_scene, tmp_path_factory) -> list[dict]:
    """The rows of one run of all of them."""
    folder = tmp_path_factory.mktemp("planted") / "run"
    cheats = [f"{FILE}:{packer.__name__}" for packer in planted.PLANTED]
    assert not run(Settings(methods=(*HONEST, *cheats), **SMALL), folder).well
    with Store(folder, must_exist=True) as store:
        return store.rows()


@pytest.fixture(scope="module")
def stage(small_scene, device) -> Stage:
    opened = open_session(Settings(methods=("sas",), **SMALL), device)
    works = [opened.source.work(index) for index in range(2)]
    return Stage(opened.scene, [work.frame for work in works], [work.novel for work in works], exact=False)


@pytest.fixture(scope="module")
def wide_stage(small_scene, device) -> Stage:
    opened = open_session(Settings(methods=("ppll",), **WIDE), device)
    works = [opened.source.work(index) for index in range(2)]
    return Stage(opened.scene, [work.frame for work in works], [work.novel for work in works], exact=False)


@pytest.mark.parametrize("packer", planted.PLANTED_WIDE, ids=lambda packer: packer.name)
def test_a_fault_in_lists_of_several_views_is_invalid_with_its_reason(wide_stage, packer):
    found = [try_method(wide_stage, packer, again=0), try_isolation(wide_stage, packer)]
    assert "invalid" in [one.status for one in found]
    assert planted.PLANTED_WIDE[packer] in " ".join(one.sentence for one in found), found


def test_honest_lists_of_several_views_are_ok_in_a_run_and_in_the_kit(wide_stage, small_scene, tmp_path):
    lists = [name for name in HONEST if name.startswith("ppll")]
    assert run(Settings(methods=("sas", *lists), **WIDE), tmp_path / "wide").well
    with Store(tmp_path / "wide", must_exist=True) as store:
        rows = store.rows()
    assert len(rows) == 2 * len(lists) + 2
    assert {(row["status"], row["reason"]) for row in rows} == {("ok", None)}
    for make in (PerPixelLinkedLists, partial(PerPixelLinkedLists, mode="bilateral")):
        assert try_method(wide_stage, make, again=0).status == "ok"
        assert try_isolation(wide_stage, make).status == "ok"


@pytest.mark.parametrize("packer", planted.PLANTED, ids=lambda packer: packer.name)
def test_a_fault_is_invalid_in_a_run_with_its_reason(rows, packer):
    since = getattr(packer, "since", 0)
    found = [row for row in rows if row["method"] == packer.name and row["frame"] >= since]
    assert {row["status"] for row in found} == {"invalid"}
    assert any(planted.PLANTED[packer] in row["reason"] for row in found), found[-1]["reason"]


@pytest.mark.parametrize("packer", planted.PLANTED, ids=lambda packer: packer.name)
def test_a_fault_is_invalid_in_the_kit_with_its_reason(stage, packer):
    found = [try_method(stage, packer, again=0), try_isolation(stage, packer)]
    assert "invalid" in [one.status for one in found]
    assert planted.PLANTED[packer] in " ".join(one.sentence for one in found), found


def test_who_is_honest_is_ok(rows):
    found = [row for row in rows if not any(row["method"] == packer.name for packer in planted.PLANTED)]
    assert len(found) == 2 * len(HONEST)
    assert {(row["status"], row["reason"]) for row in found} == {("ok", None)}


def test_who_is_honest_is_ok_in_the_kit(stage):
    for make in (ShadingAtlasStreaming, PerPixelLinkedLists):
        assert try_method(stage, make, again=0).status == "ok"
        assert try_isolation(stage, make).status == "ok"


class SharingClient(ShadingAtlasClient):
    """Leaves its planes to the other client of its pipeline, if it can, and writes to them, if it can."""

    def receive(self, payload):
        super().receive(replace(payload, planes=payload.blobs.pop("left", payload.planes)))
        payload.blobs["left"] = payload.planes
        assert not any(plane.flags.writeable for plane in payload.planes.values())


class Sharing(ShadingAtlasStreaming):
    name = "sharing"

    def client(self, scene):
        return SharingClient(scene)


def test_clients_of_a_lane_share_nothing_that_they_receive(small_scene, tmp_path):
    settings = Settings(
        methods=("sas", f"{__file__}:Sharing"), **SMALL | {"codec": "h264", "crf": (35,), "display_crf": 35}
    )
    assert run(settings, tmp_path / "run").well
    with Store(tmp_path / "run", must_exist=True) as store:
        quality = {(row["method"], row["frame"], row["codec"]): row["psnr"] for row in store.rows()}
    assert len(quality) == 8
    assert all(value == quality["sas", *key[1:]] for key, value in quality.items())
