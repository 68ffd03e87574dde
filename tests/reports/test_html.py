"""The report: complete, self-contained, says what failed, and its viewer obeys the keys."""

from __future__ import annotations

import base64
import gzip
import json
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from shading_atlas_bench.reports.charts.pictures import Pictures, embed, find_pictures
from shading_atlas_bench.reports.pages.html import chosen_frames, moment, write_report
from shading_atlas_bench.reports.pages.tables import number, prose, ranges
from shading_atlas_bench.reports.store.csv_files import write_all
from shading_atlas_bench.reports.store.database import StoreError
from shading_atlas_bench.reports.store.names import folder_name
from shading_atlas_bench.reports.store.results import Store
from tests.reports.browser import BROWSER, opened_browser
from tests.reports.synthetic import COMMON, METHODS, make_picture, make_store


def write_png(path: Path, pixels: np.ndarray) -> None:
    from OpenImageIO import UINT8, ImageOutput, ImageSpec

    output = ImageOutput.create(str(path))
    assert output
    assert output.open(str(path), ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], UINT8))
    assert output.write_image(pixels)
    output.close()


def add_pictures(folder: Path, frames: tuple[int, ...]) -> None:
    (folder / "pictures" / "reference").mkdir(parents=True)
    owners = {}
    for frame in frames:
        write_png(folder / f"pictures/reference/frame_{frame:04d}.png", make_picture(0, 64, 36))
        for index, (method, (variant, _, _)) in enumerate(METHODS.items()):
            place = folder / "pictures" / folder_name(method, variant)
            place.mkdir(exist_ok=True)
            owners[place.name] = {"method": method, "variant": variant}
            atlas = make_picture(0, 1100, 300)
            write_png(place / f"frame_{frame:04d}_client.png", make_picture(index + 1, 64, 36))
            write_png(place / f"frame_{frame:04d}_flip.png", make_picture(index + 2, 64, 36))
            write_png(place / f"frame_{frame:04d}_atlas.png", np.dstack([atlas, atlas[..., :1]]))
            write_png(place / f"frame_{frame:04d}_owners.png", atlas)
    cut = make_picture(1, 64, 36)
    write_png(place / "frame_0005_client.png", cut)
    (place / "frame_0005_client.png").write_bytes((place / "frame_0005_client.png").read_bytes()[:-20])
    (folder / "pictures" / "pictures.json").write_text(json.dumps(owners), encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    make_store(folder)
    add_pictures(folder, (0, 3, 9, 11))
    write_all(folder)
    write_report(folder)
    return folder


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    return (folder / "report.html").read_text(encoding="utf-8")


def data(page: str, name: str) -> dict:
    (text,) = re.findall(rf'<script type="application/json" id="{name}">(.*?)</script>', page, re.DOTALL)
    return json.loads(text)


def without_plotly(page: str) -> str:
    from plotly.offline import get_plotlyjs

    packed = re.findall(r'<script type="application/gzip" id="plotly">([^<]*)</script>', page)
    assert [gzip.decompress(base64.b64decode(text)).decode() for text in packed] == [get_plotlyjs()]
    return page.replace(packed[0], "")


def test_the_report_asks_for_nothing_from_outside(page: str) -> None:
    own = without_plotly(page)
    assert not re.search(r"https?://|\ssrc=|@import|fetch\(|XMLHttpRequest", own)
    assert set(re.findall(r"url\(.", own)) == {"url(#"}
    assert set(re.findall(r'<link[^>]*href="([^"]*)"', own)) == {"data:,"}


def test_the_report_shows_what_failed_and_what_was_skipped(page: str) -> None:
    for text in (
        "11 of 12", "12 of 12", "out of memory", "31 triangles found no cell", "other programs were running",
        "no material has a normal map", "of any frame&gt;", "12 degenerate triangles were dropped", "PoCL 7.1",
        "superblock=256",
    ):  # fmt: skip
        assert text in page, text
    assert "<of any frame>" not in page


def test_every_section_has_a_caption(page: str) -> None:
    sections = re.findall(r'<section id="(\w+)">(.*?)</section>', without_plotly(page), re.DOTALL)
    names = [name for name, _ in sections]
    assert names == [
        "results", "rates", "budget", "pictures", "stages", "frames", "statistics", "failures", "skipped", "details",
    ]  # fmt: skip
    assert all('class="caption"' in content for _, content in sections)


def test_figures_hold_the_medians(page: str) -> None:
    figures = data(page, "figures")
    curves = {trace["name"]: trace for trace in figures["rates"]["flip"]["data"]}
    assert list(curves) == ["bins", "grid", "sas"]
    assert curves["sas"]["text"] == ["25"], "of the rates that have a quality"
    shade = next(trace for trace in figures["stages"]["data"] if trace["name"] == "gather/shade")
    assert shade["x"] == [14.0, 14.0, 14.0]
    lines = figures["frames"]["flip"]["data"]
    assert len(lines) == 6
    assert [value is None for value in lines[0]["y"]] == [frame == 4 for frame in range(12)]
    assert len(figures["frames"]["server_ms"]["data"]) == 3
    assert "coherence_bytes" not in figures["frames"]


def test_sizes_lead_with_everything_sent(folder: Path, page: str) -> None:
    heads = page.split("Everything sent per frame")[1].split("</thead>")[0].split("<thead>")[1]
    named = [re.split(r"[&<]", head)[0] for head in re.findall(r"<th[^>]*>(.*?)</th>", heads)]
    assert named[2:] == [
        "sent", "sent", "largest", "keyframe", "whole run", "video", "metadata", "geometry", "video / raw",
    ]  # fmt: skip
    with Store(folder) as store:
        store.notes["rare/sas[]/resets"] = "sas: none of its 12 frames holds an atlas reset."
    assert "none of its 12 frames holds an atlas reset" in write_report(folder).read_text(encoding="utf-8")


def test_pictures_are_embedded_for_chosen_frames(folder: Path, page: str) -> None:
    with Store(folder) as store:
        assert chosen_frames(find_pictures(folder), store.rows()) == [0, 9, 11]
    assert find_pictures(folder).frames() == [0, 3, 9, 11], "a picture that was cut off counts for nothing"
    embedded = data(page, "picture-data")
    assert embedded["exact"]
    assert [entry["frame"] for entry in embedded["frames"]] == [0, 9, 11]
    entry = embedded["frames"][1]
    assert list(entry["methods"]["sas"]) == ["client", "flip", "atlas", "owners"]
    client = base64.b64decode(entry["methods"]["sas"]["client"].removeprefix("data:image/png;base64,"))
    own = folder / "pictures" / folder_name("sas", METHODS["sas"][0])
    assert client == (own / "frame_0009_client.png").read_bytes()
    assert entry["methods"]["sas"]["atlas"].startswith("data:image/webp;base64,")


@pytest.mark.parametrize("edit", ["swapped", "twice"])
def test_pictures_of_one_method_are_not_taken_for_those_of_another(edit: str, tmp_path: Path) -> None:
    make_store(tmp_path, frames=1)
    add_pictures(tmp_path, (0,))
    file = tmp_path / "pictures" / "pictures.json"
    owners = json.loads(file.read_text(encoding="utf-8"))
    one, other = sorted(owners)[:2]
    owners[one], owners[other] = owners[other], owners[one] if edit == "swapped" else owners[other]
    file.write_text(json.dumps(owners), encoding="utf-8")
    with pytest.raises(StoreError, match=r"pictures\.json says that"):
        write_report(tmp_path)


def test_a_picture_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    file = tmp_path / "frame_0000_atlas.png"
    write_png(file, make_picture(0, 64, 36))
    content = bytearray(file.read_bytes())
    start = content.index(b"IDAT") + len(b"IDAT")
    content[start : start + 16] = b"\xff" * 16
    file.write_bytes(content)
    with pytest.raises(StoreError, match=r"frame_0000_atlas\.png cannot be embedded in the report: "):
        embed(Pictures({}, {("sas", ""): {0: {"atlas": file}}}), [0], {("sas", ""): "sas"})


def test_only_certain_differences_are_marked(page: str) -> None:
    marked = re.findall(r'<tr><th>(\w+)</th>(?:(?!</tr>).)*?class="best"', page)
    assert "sas" in marked  # its FLIP is lower in every frame
    assert not re.search(r'class="best">40', page)


@pytest.mark.parametrize(
    "row",
    [
        {"codec": None, "status": "timeout", "reason": "It took more than 60 s."},
        {"codec": "jpeg", "status": "ok", "flip": 0.1, "server_ms": 3.0, "bytes_video": 1000, "frame": 0},
        {"codec": None, "status": "skipped", "reason": "nothing is transparent"},
    ],
)
def test_a_run_with_hardly_anything_has_a_report(tmp_path: Path, row: dict) -> None:
    with Store(tmp_path) as store:
        store.commit_frame("sas", "", 0, [COMMON | row])
    write_all(tmp_path)
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert row.get("reason", "No frame of any method failed") in page


def test_what_turns_the_direction_of_text_is_seen(tmp_path: Path) -> None:
    """In words, in data of figures, and in labels: all of them come from packers, files and stores of others."""
    turned = "gnp.\u202esas"
    with Store(tmp_path) as store:
        failed = COMMON | {"codec": None, "status": "failed", "reason": turned}
        measured = COMMON | {"codec": "none", "status": "ok", "flip": 0.1, "server_ms": 3.0, "bytes_video": 1000}
        store.commit_frame(turned, "", 0, [failed | {"scene": turned}])
        store.commit_frame("sas", turned, 0, [measured | {"scene": turned, "path": turned}])
        store.notes["scene/repair"] = store.notes["warning/noise"] = turned
        store.set_plan({"settings": {"scene": turned}})
    write_all(tmp_path)
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert "\u202e" not in page
    assert "gnp.\\u202esas" in page


def test_an_empty_store_has_a_report_and_no_store_has_none(tmp_path: Path) -> None:
    Store(tmp_path / "empty").close()
    write_all(tmp_path / "empty")
    assert "No frame is finished yet" in write_report(tmp_path / "empty").read_text(encoding="utf-8")
    with pytest.raises(StoreError):
        write_report(tmp_path / "none")


def test_labels_and_options_are_broken_only_where_words_end() -> None:
    assert prose("sas@published[a=1,b=x<y]") == "sas<wbr>@published<wbr>[a=1,<wbr>b=x&lt;y]"
    assert prose("With --frames 61 <or more>: a-b--c.") == (
        'With <span class="option">--frames 61</span> &lt;or more&gt;: a-b--c.'
    )
    assert prose("(--no-skip)") == '(<span class="option">--no-skip</span>)'


def test_numbers_and_ranges_read_well() -> None:
    assert [number(v) for v in (0, 12345.6, 123.46, 12.346, 1.23456, 0.01234, 1e-7)] == [
        "0", "12\u202f346", "123.5", "12.35", "1.235", "0.0123", "<0.0001"
    ]  # fmt: skip
    assert (number(40, whole=True), number(40)) == ("40", "40.00")
    assert ranges({4, 7, 8, 9}) == "4, 7-9"


PRESS = """
<script>
addEventListener("load", async () => {
  await new Promise((done) => setTimeout(done, 300));
  const seen = [];
  const state = () => document.querySelector("#viewer .state").textContent;
  const shown = () => [...document.querySelectorAll(".pane.shown")].map((pane) => pane.dataset.name).join();
  const press = (key) => document.body.dispatchEvent(new KeyboardEvent("keydown", {key, bubbles: true}));
  for (const key of ["3", "9", "m", "f", "E", "E", "e", "+", "s", "0"]) {
    press(key);
    await new Promise((done) => setTimeout(done, 30));
    seen.push([key, shown(), state(), document.querySelector(".panes").className]);
  }
  const pane = document.querySelector(".pane.shown"), box = pane.getBoundingClientRect();
  const at = {clientX: box.left + box.width / 4, clientY: box.top + box.height / 4, bubbles: true, cancelable: true};
  pane.dispatchEvent(new WheelEvent("wheel", {deltaY: -500, ...at}));
  const transforms = [...document.querySelectorAll(".pane img")].map((image) => image.style.transform);
  const slope = document.querySelector("feFuncR").getAttribute("slope");
  document.documentElement.dataset.seen = JSON.stringify({seen, transforms, slope, after: state()});
  document.documentElement.dataset.charts = document.querySelectorAll(".chart .main-svg").length;
});
</script>
"""


@pytest.mark.skipif(BROWSER is None, reason="no Chromium to open the report with")
def test_keys_flip_zoom_and_expose(page: str, tmp_path: Path) -> None:
    from html import unescape

    assert BROWSER
    (tmp_path / "report.html").write_text(page.replace("</body>", PRESS + "</body>"), encoding="utf-8")
    command = [
        BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
        "--disable-component-update", f"--user-data-dir={tmp_path / 'profile'}", "--window-size=1400,1000",
        "--virtual-time-budget=6000", "--dump-dom", (tmp_path / "report.html").as_uri(),
    ]  # fmt: skip
    out = subprocess.run(command, capture_output=True, text=True, timeout=90, check=True).stdout
    result = json.loads(unescape(re.findall(r'data-seen="(.*?)"', out)[0]))
    seen = {key: rest for key, *rest in result["seen"]}
    assert seen["3"][0] == "flip"
    assert seen["9"][0] == "flip", "a number without a picture changes nothing"
    assert "grid" in seen["m"][1]
    assert "frame 9" in seen["f"][1]
    assert "+0.5 stops" in seen["e"][1]
    assert "Zoom 1.5x" in seen["+"][1]
    assert seen["s"][2] == "panes side"
    assert "Zoom 1.0x, exposure 0 stops" in seen["0"][1]
    assert "Zoom 2.2x" in result["after"]
    assert result["slope"] == "1"
    assert len({transform.split("scale")[0] for transform in result["transforms"][:3]}) == 1
    assert int(re.findall(r'data-charts="(\d+)"', out)[0]) >= 4


WIDTHS = [1400, 700, 390, 1400]
LOOK = """
[...document.querySelectorAll(".chart")].map((chart) => {
  const [box, drawn, next] = [chart, chart.querySelector(".main-svg"), chart.nextElementSibling].map(
    (part) => part?.getBoundingClientRect());
  const cut = [...chart.querySelectorAll(".main-svg text")].filter((text) => {
    const place = text.getBoundingClientRect();
    return place.width && (place.left < box.left - 1 || place.right > box.right + 1);
  });
  return {
    name: chart.dataset.figure, width: box.width, height: box.height, drawn: [drawn.width, drawn.height],
    over: next ? box.bottom - next.top : 0, cut: cut.map((text) => text.textContent),
    marks: chart.querySelectorAll(".point, .points path, .js-line, .bars path").length,
  };
})
"""
DRAWN = """
[...document.querySelectorAll(".chart")].every((chart) => {
  const drawn = chart.querySelector(".main-svg")?.getBoundingClientRect().width, room = chart.clientWidth;
  return drawn <= room && drawn > 0.9 * room;
})
"""


@pytest.mark.skipif(BROWSER is None, reason="no Chromium to open the report with")
def test_charts_follow_the_window_and_keep_their_height(page: str, tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text(page, encoding="utf-8")
    seen = {}
    with opened_browser(tmp_path / "profile") as browser:
        browser.resize(WIDTHS[0])
        browser.open(tmp_path / "report.html")
        for number, width in enumerate(WIDTHS):
            browser.resize(width)
            browser.until(f"innerWidth === {width} && {DRAWN}")
            assert browser.evaluate("document.documentElement.scrollWidth") <= width, "nothing is wider than the window"
            seen[number] = browser.evaluate(LOOK)
    for number, boxes in seen.items():
        assert [box["name"] for box in boxes] == ["error", "rates", "budget", "stages", "frames"]
        for box in boxes:
            where = (WIDTHS[number], box)
            assert box["marks"] > 0, where
            assert 250 <= box["drawn"][1] <= box["height"], where
            assert box["over"] <= 0, where
            assert box["cut"] == [], where
    assert seen[0] == seen[3], "a window that is as wide as before shows the same"


def test_a_date_is_told_to_the_minute_in_its_zone() -> None:
    assert moment("2026-11-30T16:50:34+00:00") == "2026-11-30 16:50 UTC"
    assert moment("2026-11-30T16:50:34+05:45") == "2026-11-30 16:50 UTC+05:45"
    assert [moment(text) for text in ("", "some day")] == ["", "some day"]
