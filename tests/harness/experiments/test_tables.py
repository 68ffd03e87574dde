"""`bench tables` measures, keeps and compares: a planted table of one small run, in a repository of its own."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.experiments import tables
from shading_atlas_bench.reports.documents.digests import speed_parts, transparency_parts
from shading_atlas_bench.reports.documents.kept import (
    FOLDER,
    Column,
    DocumentError,
    Kept,
    Part,
    Source,
    read_kept,
    write_kept,
)
from shading_atlas_bench.reports.documents.markdown import DOCUMENTS
from tests.harness.commands import bench

COMMAND = "bench run --method sas --scene hall --frames 1 --size 96x54 --atlas 128x128 --codec none --metrics flip"
PART = Part(
    ("scene", "method"),
    (Column("scene", ("{scene}",), True), Column("FLIP", ("{flip:.4f}",)), Column("ratio", ("{ratio:.2f}",))),
)
SMALL = Source("small", (COMMAND, f"{COMMAND} --opaque"), transparency_parts, {"rows": PART}, quick=True)
TIMES = Source(
    "times", (COMMAND,), speed_parts,
    {"rows": Part(("scene", "method"), (Column("ratio", ("{gather_over_shading:.9f}",)),),
                  ("gather_over_shading", "structs_share"))},
)  # fmt: skip
AWAY = replace(SMALL, name="away", commands=("bench run --scene nowhere/scene.glb",))
SOURCES = {"small": SMALL, "times": TIMES, "away": AWAY}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A repository of documents whose tables have been measured, as far as their scenes are there."""
    folder = tmp_path_factory.mktemp("root")
    for name in DOCUMENTS:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("", encoding="utf-8")
    (folder / FOLDER).mkdir(parents=True)
    marks = "".join(f"<!-- table {name} -->\n<!-- end -->\n" for name in SOURCES)
    (folder / "README.md").write_text(marks, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        tables.write_tables((tables.ALL,), sources=SOURCES, root=folder)
    return folder


def kept_of(name: str, root: Path) -> Kept:
    kept = read_kept(name, root)
    assert kept
    return kept


def test_a_table_is_measured_kept_and_written_with_where_it_comes_from(root: Path):
    kept = kept_of("small", root)
    (row,) = kept.parts["rows"]
    assert row["flip"] > 0
    assert f"| hall | {row['flip']:.4f} | 1.00 |" in (root / "README.md").read_text(encoding="utf-8")
    assert kept.about["commands"] == list(SMALL.commands)
    assert kept.about["device"]
    assert kept.about["driver"]
    assert [settings["opaque"] for settings in kept.about["settings"]] == [False, True]
    assert {settings["scene"] for settings in kept.about["settings"]} == {"hall"}


def test_a_table_without_its_scenes_is_named_and_never_said_to_hold(root: Path, capsys: pytest.CaptureFixture[str]):
    assert read_kept("away", root) is None
    write_kept("away", kept_of("small", root), root)  # as measured by somebody who has the scene
    try:
        tables.write_tables((), run=False, sources=SOURCES, root=root)
        assert tables.check_tables(("away",), False, sources=SOURCES, root=root)
    finally:
        (root / FOLDER / "away.json").unlink()
        tables.write_tables((), run=False, sources=SOURCES, root=root)
    said = capsys.readouterr().out
    assert "not checked away: There is no scene nowhere/scene.glb: let BENCH_SCENES name" in said
    assert "holds" not in said
    assert "0 of 1 tables checked" in said


def test_measured_again_all_but_times_is_the_same(
    root: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(root)
    assert tables.check_tables(("times",), False, sources=SOURCES, root=root)
    assert "times: holds" in capsys.readouterr().out


def test_a_planted_digit_is_found_by_measuring_again(
    root: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    """In the data and in the document, so that only the measurement can tell."""
    monkeypatch.chdir(root)
    file, before = root / FOLDER / "small.json", kept_of("small", root)
    content = json.loads(file.read_text(encoding="utf-8"))
    right = content["parts"]["rows"][0]["flip"]
    content["parts"]["rows"][0]["flip"] = right + 0.0001
    file.write_text(json.dumps(content), encoding="utf-8")
    try:
        tables.write_tables((), run=False, sources=SOURCES, root=root)
        assert not tables.check_tables((tables.ALL,), True, sources=SOURCES, root=root)  # `small` is the quick one
    finally:
        write_kept("small", before, root)
        tables.write_tables((), run=False, sources=SOURCES, root=root)
    said = " ".join(capsys.readouterr().out.split())
    assert f"printed '{right + 0.0001:.4f}', now '{right:.4f}'" in said
    assert "small: differs" in said


def test_results_that_are_there_are_taken_and_those_of_other_settings_refused(
    root: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(root)
    folder = min(root.glob("runs/*-tables-times/00"))  # the first is the one that was kept
    before = kept_of("times", root)
    tables.write_tables(("times",), folder, sources=SOURCES, root=root)
    taken = kept_of("times", root)
    assert taken.parts == before.parts
    assert taken.about == before.about | {"seconds": None}
    other = replace(TIMES, commands=(COMMAND.replace("128x128", "256x256"),))
    with pytest.raises(InputError, match="ended with exit code 2"):
        tables.write_tables(("times",), folder, sources=SOURCES | {"times": other}, root=root)
    assert kept_of("times", root).about == taken.about


def test_unusable_arguments_are_refused_in_a_sentence(root: Path):
    with pytest.raises(InputError, match=r"There is no table 'smal'.*Did you mean 'small'"):
        tables.check_tables(("smal",), False, sources=SOURCES, root=root)
    with pytest.raises(InputError, match="name it"):
        tables.write_tables((), root, sources=SOURCES, root=root)
    readme = root / "README.md"
    written = readme.read_text(encoding="utf-8")
    readme.write_text("untouched", encoding="utf-8")
    with pytest.raises(InputError, match="There is no table"):
        tables.write_tables(("smal",), sources=SOURCES, root=root)
    assert readme.read_text(encoding="utf-8") == "untouched", "a name that is wrong writes nothing"
    readme.write_text(written, encoding="utf-8")
    with pytest.raises(InputError, match="does not say which device"):
        tables.write_tables(("times",), root / FOLDER, sources=SOURCES, root=root)


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--list"], 0, "sweep-hall"),
        ([], 2, "Name the tables to measure, or give all."),
        (["--check", "--write"], 2, "Give one of"),
        (["nothing"], 2, "There is no table"),
    ],
)
def test_the_command_line(arguments: list[str], code: int, said: str):
    done = bench("tables", *arguments)
    assert done.returncode == code, done.stderr
    assert said in done.stdout + done.stderr


def test_without_the_documents_nothing_is_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    for measure in (lambda: tables.write_tables(("small",), sources=SOURCES, root=tmp_path),
                    lambda: tables.check_tables(("small",), False, sources=SOURCES, root=tmp_path)):  # fmt: skip
        with pytest.raises(DocumentError, match="needs a clone of the repository"):
            measure()
    assert list(tmp_path.iterdir()) == []


def test_a_command_that_cannot_run_is_said_and_the_others_are_measured(
    root: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(root)
    broken = replace(TIMES, name="broken", commands=("bench run --size nonsense",))
    assert not tables.write_tables(("broken", "times"), sources=SOURCES | {"broken": broken}, root=root)
    said = capsys.readouterr().out
    assert "not measured broken: `bench run --size nonsense` ended with exit code 2" in said
    assert read_kept("broken", root) is None
    seconds = kept_of("times", root).about["seconds"]
    assert seconds is not None
    assert seconds > 0
