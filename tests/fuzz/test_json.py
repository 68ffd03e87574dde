"""JSON and TOML of strangers: a result, or an error for people that names the file."""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shading_atlas_bench.errors import BenchError
from shading_atlas_bench.harness.cli.run import _settings_of
from shading_atlas_bench.harness.conformance.stress import Log
from shading_atlas_bench.harness.experiments.claims import ClaimsRequest, needs
from shading_atlas_bench.harness.workload.settings import Settings, read_settings
from shading_atlas_bench.reports.analysis.claims import read_claims
from shading_atlas_bench.reports.analysis.sweep import read_sweep
from shading_atlas_bench.reports.charts.pictures import PNG_END, embed, find_pictures
from shading_atlas_bench.reports.documents.kept import read_kept
from shading_atlas_bench.reports.pages.claims_report import read_state
from shading_atlas_bench.reports.pages.stress import write_stress
from shading_atlas_bench.reports.store.columns import SWEEP_SETTINGS
from shading_atlas_bench.reports.store.names import folder_name
from tests.fuzz.cases import fuzzed, nothing_beside, one_sentence
from tests.fuzz.values import JUNK, TEXTS, changed, damaged
from tests.reports.test_claims import CAUSE, CLAIM, HEAD

SECRET = b"secret"  # beside the run's folder
PICTURES = {folder_name("sas", ""): "frame_0000_client.png", "reference": "frame_0000.png"}
SETTINGS = Settings(methods=("sas", "stranger/p.py:X"), unit=0.01).to_json()
CELL = {
    "folder": "cells/000-defaults", "method": "sas", "variant": "a=1", "contender": "sas", "varied": {"a": "1"},
    "condition": "", "codings": {"displayed": ["h264", 25], "lossless": ["none", None]},
    "settings": {name: SETTINGS[name] for name in SWEEP_SETTINGS},
}  # fmt: skip
RUN = {"command": "bench run", "folder": "one", "problem": None, "reused": False, "note": "", "made": ["x"]}
TRIAL = {
    "method": "sas", "variant": "a=1", "label": "sas", "folder": "sas-1a2b", "test": "screen-filling", "step": 0,
    "magnitude": 1.0, "unit": "", "status": "ok", "reason": None, "passed": 1, "error": 0.1, "growth": 1.0,
    "wrong_px": 0.0, "holes_px": 0.0, "samples": 3, "unplaced": 0, "seconds": 1.5,
}  # fmt: skip
STRESS_PLAN = {"tests": ["screen-filling"], "quick": True, "methods": {"sas[a=1]": "0"}, "device": "cpu"}
VALID: dict[str, Any] = {
    "run.json": {"settings": SETTINGS, "plan": {"settings": {}}, "device": {"name": "cpu"}},
    "sweep.json": {
        "settings": SETTINGS, "vary": ["a=1"], "rule": {"width": 0.05}, "timed": True, "frames": 3,
        "left_out": [["a", "b"]], "cells": [CELL],
    },
    "claims.json": {
        "ids": [], "quick": False, "device": "cpu", "date": "2030-01-01T00:00", "variants": {"sas": ["sas", "a=1"]},
        "runs": {"one": RUN},
    },
    "kept.json": {
        "about": {"commands": ["bench run"], "commit": "0", "date": "2030-01-01", "device": "cpu", "driver": "x",
                  "seconds": 1.5, "settings": [SETTINGS]},
        "parts": {"rows": [{"a": 1}]},
    },
    "trial": TRIAL,
    "pictures.json": {folder_name("sas", ""): {"method": "sas", "variant": ""}},
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("json") / "run"
    place.mkdir()
    for name in PICTURES.values():
        (place.parent / name).write_bytes(SECRET + PNG_END)
    return place


def written(folder: Path, name: str, content: object, raw: bytes | None) -> Path:
    file = folder / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(json.dumps(content).encode() if raw is None else raw)
    return file


def contents(name: str) -> st.SearchStrategy[tuple[Any, bytes | None]]:
    valid = VALID[name]
    values = st.tuples(st.just(valid) | changed(valid) | JUNK, st.none())
    return values | st.tuples(st.none(), damaged(json.dumps(valid).encode()))


@fuzzed
@given(contents("run.json"))
def test_a_run_json(folder: Path, content: tuple[Any, bytes | None]) -> None:
    file = written(folder, "run.json", *content)
    with one_sentence():
        read_settings(file)
    try:
        settings = _settings_of({"config": file})
    except BenchError:
        return
    assert not any(".py:" in method for method in settings.methods), "code of a file that nobody named"


@fuzzed
@given(contents("sweep.json"))
def test_a_sweep_json(folder: Path, content: tuple[Any, bytes | None]) -> None:
    written(folder, "sweep.json", *content)
    with one_sentence():
        read_sweep(folder)


@fuzzed
@given(contents("claims.json"))
def test_a_claims_json(folder: Path, content: tuple[Any, bytes | None]) -> None:
    written(folder, "claims.json", *content)
    with one_sentence():
        read_state(folder)


@fuzzed
@given(contents("trial"), st.booleans())
def test_a_log_of_a_stress_test(folder: Path, content: tuple[Any, bytes | None], whole: bool) -> None:
    """Its trials, but for those that are none; a report is made of them."""
    stress = folder / "stress"
    shutil.rmtree(stress, ignore_errors=True)
    trial = written(stress, "stress.jsonl", *content).read_bytes()
    lines = [json.dumps(STRESS_PLAN).encode(), trial, json.dumps(TRIAL).encode()]
    (stress / "stress.jsonl").write_bytes(b"\n".join(lines[not whole :]) + b"\n")
    with nothing_beside(stress), one_sentence():
        write_stress(stress, Log.open(stress, STRESS_PLAN).rows, {}, {})


@fuzzed
@given(contents("kept.json"))
def test_a_kept_table(folder: Path, content: tuple[Any, bytes | None]) -> None:
    written(folder, "reports/data/kept.json", *content)
    with one_sentence():
        read_kept("kept", folder)


ENTRIES = st.sampled_from(["file", "cut", "link", "outside", "fifo", "zero", "folder"])


@fuzzed
@given(contents("pictures.json"), st.sampled_from(sorted(PICTURES)), ENTRIES)
def test_pictures(folder: Path, content: tuple[Any, bytes | None], inside: str, entry: str) -> None:
    """Whatever a folder of pictures is said to be, and is, only pictures in it are embedded."""
    with nothing_beside(folder):
        pictures = folder / "pictures"
        shutil.rmtree(pictures, ignore_errors=True)
        written(folder, "pictures/pictures.json", *content)
        (pictures / inside).mkdir()
        _make(entry, pictures / inside / PICTURES[inside])
        try:
            found = find_pictures(folder)
            shown = embed(found, found.frames(), dict.fromkeys(found.methods, "label"))
        except BenchError:
            return
    assert "c2VjcmV0" not in json.dumps(shown), "the secret, as base64"


def _make(entry: str, file: Path) -> None:
    secret = file.parents[3] / file.name
    if entry in ("file", "cut"):
        file.write_bytes(b"\x89PNG" + (PNG_END if entry == "file" else b""))
    elif entry == "link":
        file.symlink_to(secret)
    elif entry == "outside":
        shutil.rmtree(file.parent)
        file.parent.symlink_to(secret.parent)
    elif entry == "fifo":
        os.mkfifo(file)
    elif entry == "zero":
        file.symlink_to("/dev/zero")
    else:
        file.mkdir()


VALUE = re.compile(r"(?<== )(?:\"[^\"\n]*\"|\d+|\[[^\]\n]*\])")
TOML = (HEAD + CLAIM + CAUSE).encode()
TOKENS = TEXTS.map(json.dumps) | st.sampled_from(
    ["1", "-1", "1e999", "inf", "nan", "9" * 5000, "true", "[]", "[1]", '["a", 1]', "{}", "{ a = 1 }", "2030-01-01",
     "[" * 5000, '"""', '["stranger/p.py:X"]', '"stranger/p.py:X"']
)  # fmt: skip


def with_value(line: str, token: str) -> str:
    """A line of which the first value is another one."""
    return VALUE.sub(lambda _: token, line, count=1)


@st.composite
def claims_files(draw: st.DrawFn) -> bytes:
    """A file of claims with some values changed, or lines left out, doubled or damaged."""
    text = HEAD + CLAIM + CAUSE
    for _ in range(draw(st.integers(1, 3))):
        lines = text.splitlines()
        at = draw(st.integers(0, len(lines) - 1))
        how = draw(st.sampled_from(["value", "value", "value", "remove", "double"]))
        if how == "value":
            token = draw(TOKENS)
            lines[at] = with_value(lines[at], token)
        elif how == "remove":
            del lines[at]
        else:
            lines.insert(at, lines[at])
        text = "\n".join(lines)
    return text.encode("utf-8", errors="surrogatepass")


@fuzzed
@given(claims_files() | damaged(TOML))
def test_a_file_of_claims(folder: Path, text: bytes) -> None:
    file = folder / "claims.toml"
    file.write_bytes(text)
    with one_sentence():
        read_claims(file)
    try:
        _, runs = needs(ClaimsRequest(file=file))
    except BenchError:
        return
    assert not any(".py:" in str(run.options) for run in runs), "code of a file that nobody named"
