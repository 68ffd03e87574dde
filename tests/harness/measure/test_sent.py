"""Sizes of what goes over the wire, each stated independently of how it is added up."""

from __future__ import annotations

from typing import Any

import pytest

from shading_atlas_bench.harness.measure.codecs import EncodedFrame
from shading_atlas_bench.harness.measure.pipeline import Sent

KEY = ("h264", 25)


def _coded(size: int) -> EncodedFrame:
    return EncodedFrame(bytes=size, decoded=None, encode_ms=1.0, decode_ms=2.0, clocked_ms=4.0)


def _sent(**changed) -> Sent:
    usual: dict[str, Any] = {"texels": {"shading": 1000}, "encoded": {KEY: {"shading": _coded(600)}}, "arrived": {}}
    usual |= {"raw_bytes": 0, "metadata_bytes": 70, "geometry_bytes": 8, "lists_bytes": 0}
    usual |= {"pack_ms": 0.5, "unpack_ms": 0.25}
    return Sent(**(usual | changed))


def test_all_parts_are_in_the_whole_and_only_shading_in_the_ratio() -> None:
    planes = {"shading": 1000, "alpha": 1000}
    row = _sent(texels=planes, encoded={KEY: {"shading": _coded(600), "alpha": _coded(50)}}).row(KEY)
    sizes = {name: row[f"bytes_{name}"] for name in ("video", "alpha", "metadata", "geometry", "total")}
    assert sizes == {"video": 600, "alpha": 50, "metadata": 70, "geometry": 8, "total": 728}
    assert row["compression_ratio"] == pytest.approx(0.2), "600 bytes of 1000 texels of three"


def test_planes_without_coding_are_sent_as_they_are() -> None:
    row = _sent(texels={"shading": 1000, "alpha": 1000}).row(("none", None))
    assert (row["bytes_video"], row["bytes_alpha"], row["bytes_total"]) == (3000, 1000, 4078)
    assert row["compression_ratio"] == 1.0


def test_lists_are_compared_with_their_bytes_before_compression() -> None:
    row = _sent(texels={}, encoded={}, lists_bytes=300, raw_bytes=1200).row(("none", None))
    assert (row["bytes_video"], row["bytes_alpha"], row["bytes_total"]) == (300, None, 378)
    assert row["compression_ratio"] == 0.25


def test_nothing_to_compare_with_is_no_ratio() -> None:
    assert _sent(texels={}, encoded={}).row(("none", None))["compression_ratio"] is None


def test_coding_has_the_time_of_all_planes_and_lists() -> None:
    sent = _sent(texels={"shading": 9, "alpha": 9}, encoded={KEY: {"shading": _coded(6), "alpha": _coded(5)}})
    assert sent.row(KEY)["encode_ms"] == 0.5 + 2 * 1.0
    assert sent.clocked(KEY) == 0.5 + 0.25 + 2 * 4.0
