"""What is left out changes no byte where it is forced to run all the same, and was not launched where it is not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.measure.metrics import Metrics
from shading_atlas_bench.harness.measure.pipeline import Pipeline
from shading_atlas_bench.harness.run.explain import explain as measure_skips
from shading_atlas_bench.harness.run.explain import rows_of
from shading_atlas_bench.harness.run.run import run
from shading_atlas_bench.harness.workload.frames import FrameSource
from shading_atlas_bench.harness.workload.methods import find_methods
from shading_atlas_bench.harness.workload.reference import ForwardRenderer
from shading_atlas_bench.harness.workload.session import open_session
from shading_atlas_bench.harness.workload.settings import Settings, SettingsError
from shading_atlas_bench.harness.workload.skips import ALWAYS, SKIPS, check_names, known_skips, skipped_stages
from shading_atlas_bench.harness.workload.upload import upload_scene
from shading_atlas_bench.packers.skips import Skips
from shading_atlas_bench.scenes.features import find_features
from shading_atlas_bench.scenes.model import SLOTS

SMALL = Settings(detail=40_000, width=160, height=90, atlas_width=512, atlas_height=512, frames=3, codec="none")
FRAMES = 3


@pytest.fixture(scope="module")
def hall():
    return open_session(SMALL)


def plain(scene):
    """The scene without textures, normal maps, shadows and gloss, which then do not need to be looked up."""
    materials = [replace(m.without(SLOTS), emissive=m.emissive, roughness=0.8) for m in scene.materials]
    stripped = replace(scene, materials=materials, lights=[replace(light, shadows=False) for light in scene.lights])
    stripped.features = find_features(stripped)
    return stripped


class Work:
    """Everything that some frames give: sets, pictures and payloads as bytes, names left out, kernels launched."""

    def __init__(self, session, host, off=(), standing=False):
        scene = upload_scene(session.device, host, Skips(off))
        source = FrameSource(scene, session.path, session.head, session.settings, cached=False)
        pipelines = [Pipeline(packer, scene, session.settings) for packer in find_methods(session.settings)]
        self.results, self.skipped, self.packs = [], set(scene.skips.always), []
        for pipeline in pipelines:
            pipeline.prepare()
        with session.device.record() as record:
            for index in range(FRAMES):
                work = source.work(0 if standing else index)
                picture, visible = ForwardRenderer(scene).draw(work.novel)
                self.results += [work.frame.pvs.tobytes(), picture.rgb.get().tobytes(), visible.depth.get().tobytes()]
                self.skipped |= work.skipped
                for pipeline in pipelines:
                    packed = pipeline.pack(work.frame)
                    self.results.append(payload_bytes(packed.payload))
                    self.skipped |= packed.skipped
                    self.packs.append(len(packed.stages))
        self.kernels = set(record.kernels)


def payload_bytes(payload):
    planes = [plane.get().tobytes() for plane in payload.planes.values()]
    statistics = repr(sorted(payload.statistics.items())).encode()
    return b"".join([*planes, *payload.blobs.values(), payload.geometry, *payload.lists.values(), statistics])


@pytest.fixture(scope="module")
def as_they_are(hall):
    """Scenes with and without what the skips decide on, worked through as they are; the last one stands still."""
    scene = hall.scene.host
    return SimpleNamespace(hall=Work(hall, scene), plain=Work(hall, plain(scene)), still=Work(hall, scene, (), True))


# Name, the scene in which it applies, kernels (or beginnings of their names) that it keeps from running.
APPLYING = [
    ("textures", "plain", ()),
    ("normal maps", "plain", ()),
    ("shadows", "plain", ()),
    ("environment map", "plain", ()),
    ("alpha mask", "hall", ()),
    ("blending", "hall", ("fragments/layers.renumber",)),
    ("clusters", "hall", ()),
    ("bin mapping", "still", ()),
    ("re-binning", "hall", ()),
]


@pytest.mark.parametrize(("name", "where", "kernels"), APPLYING, ids=[case[0] for case in APPLYING])
def test_forcing_a_skip_off_changes_no_byte(hall, as_they_are, name, where, kernels):
    before = getattr(as_they_are, where)
    assert name in before.skipped
    scene = plain(hall.scene.host) if where == "plain" else hall.scene.host
    forced = Work(hall, scene, (name,), where == "still")
    assert forced.results == before.results
    assert name not in forced.skipped
    for kernel in kernels:
        assert kernel in forced.kernels - before.kernels


def test_what_is_forced_is_there(hall):
    scene = plain(hall.scene.host)
    left, forced = (
        upload_scene(hall.device, scene, Skips(off)) for off in ((), ("normal maps", "shadows", "environment map"))
    )
    names = ("TEXTURES", "NORMAL_MAPS", "SHADOWS", "ENVIRONMENT_MAP")
    assert [left.shader.defines[name] for name in names] == [0, 0, 0, 0]
    assert [forced.shader.defines[name] for name in names] == [1, 1, 1, 1]
    left, forced = (
        upload_scene(hall.device, scene, Skips(off)) for off in ((), ("alpha mask", "blending", "clusters"))
    )
    assert (left.mask, left.layers, left.rasteriser.clusters.culls) == (None, None, True)
    assert forced.mask
    assert forced.layers
    assert not forced.rasteriser.clusters.culls


def test_what_applies_where(as_they_are):
    assert {"textures", "normal maps", "shadows", "environment map"} <= as_they_are.plain.skipped
    assert not {"textures", "normal maps", "shadows"} & as_they_are.hall.skipped
    assert {"alpha mask", "blending", "clusters", "re-binning"} <= as_they_are.hall.skipped
    assert "packing" not in as_they_are.hall.skipped
    assert {"packing", "bin mapping"} <= as_they_are.still.skipped


def test_a_frame_like_the_last_is_not_packed_again_and_gives_the_same(hall, as_they_are):
    """Methods that say so launch nothing in the third frame of a camera that stands still."""
    methods = [packer.name for packer in find_methods(SMALL)]
    launched = dict(zip(methods, as_they_are.still.packs[-len(methods) :], strict=True))
    assert {name for name, count in launched.items() if count == 0} == {"sas", "tss", "ppll"}
    assert min(as_they_are.still.packs[: -len(methods)]) > 0  # the second still says what changed since the first
    forced = Work(hall, hall.scene.host, ("packing",), standing=True)
    assert forced.results == as_they_are.still.results
    assert min(forced.packs) > 0


def test_oversampling_is_left_out_where_nothing_is_slanted(hall):
    """L-packing alone slants nothing; the kernels are then those without right triangles, and the bytes the same."""
    settings = replace(SMALL, methods=("tss[strategy=lpacking]",))
    session = replace(hall, settings=settings)
    without, forced = (Work(session, hall.scene.host, off) for off in ((), ("oversampling",)))
    assert without.results == forced.results
    assert "oversampling" in without.skipped - forced.skipped


def test_metrics_that_are_not_asked_for_have_no_value_even_where_they_are_computed(device):
    rng = np.random.default_rng(0)
    a, b = (device.upload(rng.integers(0, 256, (200, 220, 4), dtype=np.uint8)) for _ in range(2))
    found, launched = [], []
    for off in ((), ("metrics",)):
        metrics = Metrics.asked_for(device, ("flip", "psnr", "stretch"), Skips(off))
        with device.record() as record:
            metrics.reference(a)
            found.append(metrics.compare(b))
        launched.append({name for name in record.kernels if name.startswith("metrics/ssim")})
    assert found[0] == found[1]
    assert {name for name, value in found[0].items() if value is not None} == {"flip", "psnr"}
    assert not launched[0]
    assert launched[1]


def test_what_was_left_out_is_told_once():
    skips = Skips(["forced"])
    left = [skips.leaves_out(name, unneeded) for name, unneeded in (("a", True), ("forced", True), ("b", False))]
    assert left == [True, False, False]
    assert [skips.take(), skips.take()] == [{"a"}, set()]


def test_unknown_names_list_the_known_ones():
    with pytest.raises(InputError, match=r"'textures'.*oversampling"):
        check_names(["texture"], find_methods(SMALL))
    with pytest.raises(SettingsError, match="flip, dssim"):
        Settings(metrics=("flop",))


def test_names_are_there_once_and_features_exist(hall):
    names = [skip.name for skip in known_skips(find_methods(SMALL))]
    assert len(set(names)) == len(names)
    features = {skip.feature for skip in SKIPS if skip.feature} | set(ALWAYS)
    assert features <= set(vars(hall.scene.host.features))
    assert "alpha mask" in skipped_stages(hall.scene.host.features)
    assert "alpha mask" not in skipped_stages(hall.scene.host.features, ["alpha mask"])


def test_explaining_says_what_applies_and_what_not(hall):
    session = replace(hall, settings=replace(SMALL, methods=("sas",), frames=1))
    rows = {row["skip"]: row for row in rows_of(measure_skips(session))}
    assert not rows["textures"]["applies"]
    assert rows["textures"]["with_ms"] is None
    assert rows["textures"]["reason"] == "materials have textures"
    for name in ("alpha mask", "blending", "clusters"):
        assert rows[name]["applies"]
        assert rows[name]["with_ms"] > 0
        assert rows[name]["without_ms"] > 0


def test_explaining_after_a_run_may_build_kernels(tmp_path, monkeypatch):
    """What tells of kernels being built while frames are worked on has no progress bar to tell it on afterwards."""

    def explained(session, _):
        session.device.announce("kernels/some.cl")
        return {}

    monkeypatch.setattr("shading_atlas_bench.harness.run.run.explain", explained)
    monkeypatch.setattr("shading_atlas_bench.harness.run.run.rows_of", lambda _: [])
    assert run(replace(SMALL, methods=("sas",), frames=1), tmp_path / "run", explained=True).well
