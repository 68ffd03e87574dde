"""FLIP and PSNR are measured at every rate, and are what a client shows that gets that rate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from shading_atlas_bench import run
from shading_atlas_bench.harness.workload.settings import settings_of
from shading_atlas_bench.packers.interface import Client, ClientScene, Decoded, Image, View
from shading_atlas_bench.packers.sas.packer import ShadingAtlasStreaming
from shading_atlas_bench.reports.store.columns import PICTURE_METRICS, RATE_METRICS
from shading_atlas_bench.reports.store.results import Store

RATES = (5, 25, 45)
SIZE = {"size": "96x64", "atlas": "512x512", "frames": 3, "crf": ",".join(map(str, RATES))}


def rows_of(out: Path, **given: Any) -> dict[tuple[str, str, int | None, int], dict[str, Any]]:
    """The rows of a small run, by method, codec, rate and frame."""
    run(settings_of(SIZE | given), out)
    with Store(out) as store:
        return {(row["method"], row["codec"], row["crf"], row["frame"]): row for row in store.rows()}


@pytest.mark.parametrize("scene", ["hall", "village", "shells"])
def test_the_quality_of_a_rate_is_that_of_a_client_that_gets_it(tmp_path: Path, scene):
    given = {"scene": scene, "method": ["sas", "snakebinning", "tss"]}
    found: dict[int | None, Any] = {crf: rows_of(tmp_path / str(crf), **given, display_crf=crf) for crf in RATES}
    judged = 0
    for key, row in found[25].items():
        if key[1] == "h264":
            itself = found[key[2]][key]
            assert {name: row[name] for name in RATE_METRICS} == {name: itself[name] for name in RATE_METRICS}
            assert row["bytes_total"] == itself["bytes_total"]
            assert row["decode_ms"] > 0
            others = set(PICTURE_METRICS) - {*RATE_METRICS, "iwssim"}  # the picture is too small for it
            assert all((row[name] is None) == (key[2] != 25) for name in (*others, "client_ms", "frame_ms"))
            judged += row["flip"] is not None
    assert judged == 3 * len(RATES) * 3
    qualities = [found[25]["sas", "h264", crf, 1]["flip"] for crf in RATES]
    assert qualities == sorted(set(qualities)), "finer rates are nearer to the reference"


@pytest.mark.parametrize(("metrics", "judged"), [("dssim", ()), ("psnr", ("psnr",))])
def test_what_is_not_asked_for_is_not_measured(tmp_path: Path, metrics, judged):
    rows = rows_of(tmp_path, method=["sas"], metrics=metrics)
    row = rows["sas", "h264", 5, 1]
    assert tuple(name for name in PICTURE_METRICS if row[name] is not None) == judged
    assert (row["decode_ms"] is None) == (not judged)
    with Store(tmp_path) as store:
        named = {statistic["name"] for statistic in store.statistics()}
    assert ("rates_ms" in named) == bool(judged)


class OneRateClient(Client):
    """A client that can only show what it has received."""

    def __init__(self, inner: Client) -> None:
        self.inner = inner

    def receive(self, payload: Decoded) -> None:
        self.inner.receive(payload)

    def draw(self, view: View) -> Image:
        return self.inner.draw(view)

    def locate(self, triangles, bary):
        return self.inner.locate(triangles, bary)


class OneRate(ShadingAtlasStreaming):
    name = "one-rate"

    def client(self, scene: ClientScene) -> Client:  # type: ignore[override]  # another kind of client than the method's
        return OneRateClient(super().client(scene))


def test_a_client_of_one_rate_has_the_displayed_one(tmp_path: Path):
    found = rows_of(tmp_path, method=[f"{__file__}:OneRate"])
    for (_, codec, crf, _), row in found.items():
        assert row["status"] == "ok", row["reason"]
        assert (row["flip"] is not None) == (codec == "none" or crf == 25)
