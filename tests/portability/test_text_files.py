"""Text files are read and written as UTF-8, whatever the system's own encoding is (Windows: cp1252 and others)."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("kernels", "scenes", "reports", "packers", "harness", "tests")


def is_text_mode(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str) and "b" not in node.value


def opens_text(call: ast.Call) -> bool:
    """Whether a call opens a text file, as far as its own text shows."""
    match call.func:
        case ast.Attribute(attr="read_text" | "write_text"):
            return True
        case ast.Name(id="open") | ast.Attribute(attr="fdopen"):
            given = [*call.args[1:2], *(word.value for word in call.keywords if word.arg == "mode")]
            return all(map(is_text_mode, given))
        case ast.Attribute(attr="NamedTemporaryFile"):
            return any(map(is_text_mode, call.args[:1]))  # bytes unless said otherwise
        case ast.Attribute(attr="open", value=place):
            if call.args:
                mode = call.args[0]
                return is_text_mode(mode) and set(ast.literal_eval(mode)) <= set("rwax+t")
            return isinstance(place, ast.BinOp) or any(word.arg == "newline" for word in call.keywords)
    return False


def without_encoding(source: str) -> Iterator[int]:
    """Lines of the calls that open a text file in the system's own encoding."""
    for node in ast.walk(ast.parse(source)):
        if (
            isinstance(node, ast.Call)
            and opens_text(node)
            and not any(word.arg == "encoding" for word in node.keywords)
        ):
            yield node.lineno


@pytest.mark.parametrize("folder", FOLDERS)
def test_text_files_name_their_encoding(folder: str):
    files = sorted((ROOT / folder).rglob("*.py"))
    found = {str(file.relative_to(ROOT)): [*without_encoding(file.read_text(encoding="utf-8"))] for file in files}
    assert {name: lines for name, lines in found.items() if lines} == {}


@pytest.mark.parametrize(
    "call",
    [
        "open(name{})",
        "open(name, 'a'{})",
        "open(name, newline=''{})",
        "path.read_text({})",
        "path.write_text('a'{})",
        "(a / 'b').open({})",
        "path.open('w'{})",
        "path.open(newline=''{})",
        "os.fdopen(handle, 'w'{})",
        "tempfile.NamedTemporaryFile('w'{})",
    ],
)
def test_a_call_without_encoding_is_found(call: str):
    assert [*without_encoding(call.format(""))] == [1]
    assert [*without_encoding(call.format(", encoding='utf-8'").replace("(, ", "("))] == []


@pytest.mark.parametrize(
    "call", ["open(name, 'rb')", "path.open('ab')", "Device.open()", "tempfile.NamedTemporaryFile()", "encoder.open()"]
)
def test_bytes_and_other_things_need_none(call: str):
    assert [*without_encoding(call)] == []
