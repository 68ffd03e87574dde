"""The parts of a frame's time: sums worked out by hand, nothing invented where nothing was measured."""

from __future__ import annotations

from shading_atlas_bench.reports.pages.budget import SEGMENTS, budget_figure, budget_table, budgets, visible_set
from shading_atlas_bench.reports.pages.tables import NONE
from tests.reports.synthetic import COMMON

LABELS = {("sas", ""): "sas", ("ppll", ""): "ppll"}
TIMES = {
    "server_ms": 10.0, "serialise_ms": 4.0, "fill_ms": 2.0, "encode_ms": 3.0, "network_ms": 1.0, "decode_ms": 2.0,
    "receive_ms": 0.5, "draw_host_ms": 1.5, "client_ms": 6.0, "frame_ms": 32.0, "pvs_ms": 100.0,
}  # fmt: skip


def row(frame: int, method: str = "sas", codec: str = "h264", **changes: object) -> dict:
    """A measured row with all times."""
    fixed = {"method": method, "variant": "", "codec": codec, "crf": 25 if codec == "h264" else None, "status": "ok"}
    return COMMON | TIMES | fixed | {"frame": frame} | changes


def test_parts_are_means_after_the_keyframe_and_add_up() -> None:
    rows = [row(0, network_ms=500.0, frame_ms=531.0), row(1), row(2, server_ms=14.0, frame_ms=36.0)]
    (found,) = budgets(rows, {("sas", ""): "sas"})
    assert (found.label, found.coding) == ("sas", "CRF 25")
    assert list(found.parts) == [name for name, _, _ in SEGMENTS]
    assert list(found.parts.values()) == [12.0, 4.0, 2.0, 3.0, 1.0, 2.0, 2.0, 6.0]  # client host: 0.5 + 1.5
    assert (found.total, found.whole) == (32.0, 34.0)
    table = budget_table([found])
    assert "<td>34.0</td><td>32.0</td><td>94.1 %</td><td>12.0</td>" in table


def test_the_displayed_coding_is_shown_and_lists_have_their_only_one() -> None:
    lossless = row(1, codec="none", encode_ms=0.25)
    rows = [lossless, row(1), row(1, method="ppll", codec="none", fill_ms=None)]
    sas, ppll = budgets(rows, LABELS)
    assert (sas.coding, sas.parts["encode"]) == ("CRF 25", 3.0)
    assert (ppll.coding, ppll.parts["fill"], ppll.total) == ("lossless", None, 28.0)
    figure = budget_figure([sas, ppll])
    assert figure
    fill = next(trace for trace in figure["data"] if trace["name"] == "fill")
    assert (fill["y"], fill["x"]) == (["sas", "ppll"], [2.0, None])


def test_nothing_measured_is_no_budget() -> None:
    failed = [row(frame, status="failed") | dict.fromkeys(TIMES) for frame in range(3)]
    assert budgets(failed, {("sas", ""): "sas"}) == []
    assert budgets([row(0)], {("sas", ""): "sas"}) == []  # a keyframe alone is no frame like the others
    assert budget_figure([]) is None
    unclocked = budgets([row(1, frame_ms=None)], {("sas", ""): "sas"})
    assert f"<td>{NONE}</td><td>30.0</td><td>{NONE}</td>" in budget_table(unclocked)


def test_the_visible_set_is_told_apart_once_per_frame() -> None:
    rows = [row(0, pvs_ms=900.0), row(1, pvs_ms=100.0), row(1, method="ppll", pvs_ms=100.0), row(2, pvs_ms=103.0)]
    assert visible_set(rows).endswith("101.5 ms per frame.")
    assert visible_set([row(1, pvs_ms=None)]) == ""
