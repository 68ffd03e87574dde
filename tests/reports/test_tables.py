"""The documents' tables: markers, numbers in sentences, and that no printed digit can drift from the kept data."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from shading_atlas_bench.reports.analysis.claims import read_claims
from shading_atlas_bench.reports.documents.catalogue import SOURCES
from shading_atlas_bench.reports.documents.kept import (
    FOLDER,
    ROOT,
    About,
    Column,
    DocumentError,
    Kept,
    Part,
    Source,
    checked,
    write_kept,
)
from shading_atlas_bench.reports.documents.markdown import (
    DOCUMENTS,
    NUMBER,
    OPERAND,
    Book,
    provenance,
    table_text,
    write_documents,
    wrong_places,
)

ABOUT: About = {
    "commands": ["bench run --scene hall", "bench run --scene village"], "commit": "0123456789", "date": "2030-01-02",
    "device": "a device", "driver": "a driver 1.2", "seconds": 3.0, "settings": [],
}  # fmt: skip
PART = Part(
    ("scene", "method"),
    (
        Column("scene", ("{scene}",), left=True),
        Column("time", ("{ms:.0f} ({low:.0f} to {high:.0f})", "{ms:.0f}")),
        Column("FLIP", ("{flip:.3f}",)),
    ),
    ("ms", "low", "high"),
)
PARTS = {"rows": PART, "whole": Part(("name",), (Column("says", ("{says}",)),))}
SOURCE = Source("planted", ("bench run",), lambda folders: {}, PARTS)
ROWS: list[dict[str, Any]] = [
    {"scene": "hall", "method": "sas", "ms": 12.4, "low": 11.0, "high": 14.0, "flip": 0.0524},
    {"scene": "village", "method": "sas", "ms": 20.0, "low": None, "high": None, "flip": None},
    {"scene": "village", "method": "tss", "ms": None, "low": None, "high": None, "flip": 0.1},
]
WHOLE: list[dict[str, Any]] = [{"name": "winner", "says": "sas from 12 ms on", "machine": True}]
TEXT = """# A document

<!-- table planted -->
<!-- end -->

<!-- table planted whole -->
<!-- end -->

The error is <!-- n planted(hall, sas).flip as .3f --><!-- / -->, of all at most
about <!-- n max planted(*).flip as .2f --><!-- / -->, which is
a <!-- n planted(village, tss).flip / planted(hall, sas).flip - 1 as .0% --><!-- / --> increase.
"""


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A repository of documents, of which one has places of planted data, written."""
    for name in DOCUMENTS:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("", encoding="utf-8")
    (tmp_path / FOLDER).mkdir(parents=True)
    (tmp_path / "README.md").write_text(TEXT, encoding="utf-8")
    write_kept("planted", Kept(ABOUT, {"rows": ROWS, "whole": WHOLE}), tmp_path)
    assert write_documents(book(tmp_path)) == ["README.md"]
    return tmp_path


def book(root: Path, replaced: Kept | None = None) -> Book:
    return Book({"planted": SOURCE}, root, {"planted": replaced} if replaced else None)


def document(root: Path) -> str:
    return (root / "README.md").read_text(encoding="utf-8")


def test_places_are_written_with_what_the_data_says(root: Path):
    text = document(root)
    assert "| scene | time | FLIP |\n| --- | ---: | ---: |\n| hall | 12 (11 to 14) | 0.052 |\n" in text
    assert "-->0.052<!-- / -->" in text
    assert "-->0.10<!-- / -->" in text
    assert "-->91%<!-- / -->" in text


def test_a_value_that_is_not_there_is_an_empty_cell(root: Path):
    assert "| village | 20 |  |\n| village |  | 0.100 |\n" in document(root)
    assert table_text(PART, [dict.fromkeys(ROWS[0])]).splitlines()[-1] == "|  |  |  |"


def test_writing_again_changes_nothing(root: Path):
    before = document(root)
    assert write_documents(book(root)) == []
    assert document(root) == before
    assert wrong_places(book(root)) == []


def test_under_every_table_stands_where_it_comes_from(root: Path):
    line = (
        "<sub>`bench run --scene hall` and 1 more like it. commit 0123456789, 2030-01-02, a device, a driver 1.2.</sub>"
    )
    assert document(root).count(line) == 2


@pytest.mark.parametrize(("old", "new"), [("| 0.100 |", "| 0.101 |"), (">0.10<", ">0.11<"), ("12 ms on", "13 ms on")])
def test_a_digit_changed_by_hand_is_found(root: Path, old: str, new: str):
    (root / "README.md").write_text(document(root).replace(old, new), encoding="utf-8")
    (sentence,) = wrong_places(book(root))
    assert sentence.startswith("README.md, line ")


def fresh(**changed: float) -> Kept:
    """What a new measurement has to print, where the first row has other values."""
    rows = [ROWS[0] | changed, *ROWS[1:]]
    whole = [WHOLE[0] | {"says": "tss from 15 ms on"}]
    return checked(Kept(ABOUT, {"rows": ROWS, "whole": WHOLE}), {"rows": rows, "whole": whole}, PARTS)


def test_a_new_measurement_is_compared_as_printed_and_without_times(root: Path):
    assert wrong_places(book(root, fresh(flip=0.05242, ms=99.0, low=80.0)), "planted") == []
    table, sentence = wrong_places(book(root, fresh(flip=0.0541)), "planted")[::2]
    assert "hall" in table
    assert "printed '0.052', now '0.054'" in table
    assert "printed '91%', now '85%'" in sentence


def test_rows_that_the_machine_gives_or_not_stay_as_they_were() -> None:
    def row(name: str, machine: bool = False) -> dict:
        return {"name": name, "says": name, "machine": machine}

    before = [row("a", True), row("b"), row("c", True), row("d", True), row("e"), row("f", True)]
    now = [row("b"), row("new", True), row("d", True), row("e")]
    found = checked(Kept(ABOUT, {"whole": before}), {"whole": now}, PARTS)
    assert found.parts["whole"] == before
    other = checked(Kept(ABOUT, {"whole": before}), {"whole": [*now, row("another")]}, PARTS)
    assert {row["name"] for row in other.parts["whole"]} == {*"abcdef", "another"}


def test_a_row_more_or_less_is_found(root: Path):
    fewer = checked(Kept(ABOUT, {"rows": ROWS}), {"rows": ROWS[:-1], "whole": WHOLE}, PARTS)
    with pytest.raises(DocumentError, match="names 0 values"):  # of a sentence
        wrong_places(book(root, fewer), "planted")
    (root / "README.md").write_text(document(root).partition("The error")[0], encoding="utf-8")
    (sentence,) = wrong_places(book(root, fewer), "planted")
    assert "lines" in sentence


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<!-- table nothing -->\n<!-- end -->", "There is no table 'nothing'"),
        ("<!-- table planted nothing -->\n<!-- end -->", "has no part 'nothing'"),
        ("<!-- table planted -->\nand no end", "has no end"),
        ("a <!-- n planted(hall).flip as .3f -->", "has no end"),
        ("a <!-- n planted(hall, nobody).flip as .3f --><!-- / -->", "names 0 values"),
        ("a <!-- n planted(village, sas).flip as .3f --><!-- / -->", "names 0 values"),
        ("a <!-- n planted(*).flip as .3f --><!-- / -->", "names 2 values"),
        ("a <!-- n planted(hall, sas, more).flip as .3f --><!-- / -->", "names"),
        ("a <!-- n planted(hall, sas).flip ? 2 as .3f --><!-- / -->", "cannot be read at `[?] 2`"),
        ("a <!-- n planted(hall, sas).scene as .3f --><!-- / -->", "cannot be written"),
        ("  <!-- n planted(hall, sas).flip as .3f --><!-- / -->", "beginning of a line"),
    ],
)
def test_a_marker_that_cannot_be_followed_is_refused_in_a_sentence(root: Path, text: str, message: str):
    with pytest.raises(DocumentError, match=message):
        list(book(root).places(text))


def test_what_was_never_measured_says_so_and_shows_no_number(root: Path):
    (root / FOLDER / "planted.json").unlink()
    write_documents(book(root))
    text = document(root)
    assert "*Not measured yet: `bench tables planted`.*" in text
    assert re.findall(r"-->([^<]*)<!-- / -->", text) == ["not measured yet"] * 3


# The documents of the repository ------------------------------------------------------------------------------------


def test_the_documents_are_what_the_kept_data_writes():
    assert wrong_places(Book(SOURCES)) == []


def test_every_table_is_printed_somewhere_and_every_file_of_data_is_one_of_a_table():
    printed = {place.what.split()[1] for place in all_places() if place.what.startswith("table ")}
    assert printed == set(SOURCES)
    assert {path.stem for path in (ROOT / FOLDER).glob("*.json")} <= set(SOURCES)


def all_places() -> list:
    texts = [(ROOT / name).read_text(encoding="utf-8") for name in DOCUMENTS]
    return [place for text in texts for place in Book(SOURCES).places(text)]


def test_kept_data_says_where_it_comes_from():
    for path in (ROOT / FOLDER).glob("*.json"):
        about = json.loads(path.read_text(encoding="utf-8"))["about"]
        facts = [about[name] for name in ("commands", "commit", "date", "device", "driver")]
        assert all(facts), path.name
        assert about["commands"] == list(SOURCES[path.stem].commands), path.name
        assert provenance(Kept(about, {})).startswith("<sub>`bench ")


def test_expressions_name_parts_keys_and_claims_that_there_are():
    """Also those of tables that were not measured yet, which nothing evaluates."""
    claims = {claim.id: {"/".join(place) for place in claim.runs} for claim in read_claims().claims}
    wrong = []
    for name in DOCUMENTS:
        for match in NUMBER.finditer((ROOT / name).read_text(encoding="utf-8")):
            for operand in OPERAND.finditer(" ".join(match[1].split())):
                if not operand["name"]:
                    continue
                part = SOURCES[operand["name"]].parts[operand["part"] or "rows"]
                keys = [key.strip() for key in operand["keys"].split(",")]
                known = operand["name"] != "claims" or operand["part"] != "values" or (
                    keys[0] in claims and (keys[1] == "*" or keys[1] in claims[keys[0]])
                )  # fmt: skip
                if len(keys) > len(part.key) or not known:
                    wrong.append(f"{name}: {operand[0]}")
    assert wrong == []
