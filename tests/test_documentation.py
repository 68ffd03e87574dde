"""The documents can be followed: commands run, options and files exist, links lead somewhere."""

from __future__ import annotations

import ast
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.main import get_group

import shading_atlas_bench
from shading_atlas_bench.harness.cli.main import app

ROOT = Path(__file__).parents[1]
PLUGIN = ROOT / "tests" / "plugin"
TUTORIAL = ROOT / "docs" / "tutorial.md"
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(path for name in ("docs", "kernels", "packers", "reports")
                                          for path in (ROOT / name).rglob("*.md"))])  # fmt: skip
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
STEP = re.compile(
    r"^(?:\*\*`(?P<file>[^`]+)`\*\*\n\n)?```(?P<language>\w*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)
QUOTED = re.compile(r"`([^`]+)`(:?)(?=(\s(?:in|of)\s`|\s\(`)?)")  # and whether a file stands behind
IDENTIFIER = re.compile(r"(?:@|--)?([A-Za-z_][\w.]*)(?:\(\.\.\.\))?")


def script() -> str:
    """What the tutorial lets its reader do: its commands, and the files that it shows, in their order."""
    lines = ["set -euo pipefail"]
    for step in STEP.finditer(TUTORIAL.read_text(encoding="utf-8")):
        if step["file"]:
            lines.append(f"cat > {step['file']} <<'END OF FILE'\n{step['text']}END OF FILE")
        elif step["language"] == "bash":
            lines.append(step["text"])
    return "\n".join(lines)


def test_the_tutorial_shows_every_file_of_the_plugin_as_it_is():
    steps = STEP.finditer(TUTORIAL.read_text(encoding="utf-8"))
    shown = {step["file"]: step["text"] for step in steps if step["file"]}
    files = {path.relative_to(PLUGIN).as_posix(): path.read_text(encoding="utf-8")
             for path in PLUGIN.rglob("*") if path.suffix in (".toml", ".py", ".cl")}  # fmt: skip
    assert files.pop("shelves/kernels/__init__.py") == ""
    assert shown == files


@pytest.mark.skipif(sys.platform == "win32", reason="the tutorial's commands are for bash")
def test_the_tutorial_ends_with_a_packer_that_passes_every_check(tmp_path: Path):
    """All of its commands, as they are printed; what pip installs goes into a folder of its own."""
    pytest.importorskip("pip", reason="pip installs the plugin")
    place = {"PIP_TARGET": str(tmp_path / "site"), "PIP_NO_INDEX": "1", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    place |= {"PIP_NO_DEPS": "1", "PIP_NO_BUILD_ISOLATION": "0"}  # 0 means that there is none
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    modules = os.pathsep.join([str(ROOT), place["PIP_TARGET"], str(tmp_path / "plugin")])
    done = subprocess.run(
        ["bash", "-c", script()], cwd=tmp_path, env=os.environ | place | {"PATH": path, "PYTHONPATH": modules},
        capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    said = " ".join(done.stdout.split())
    assert "shelves/emit emit_samples" in said
    assert "pass kernels pass" in said
    assert "shelves all checks passed" in said
    for name in ("kernels/kernels.html", "shelves/report.html", "shelves/summary.csv"):
        assert (tmp_path / "plugin" / "runs" / name).stat().st_size > 0


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_printed_commands_have_options_that_there_are(path: Path):
    commands = get_group(app).commands
    for _, text in FENCE.findall(path.read_text(encoding="utf-8")):
        for line in re.split(r"\n| && ", text.replace("\\\n", " ")):
            if found := re.match(r"(?:\w+=\S+ )*bench (\w+)(.*)", line):
                assert found[1] in commands, line
                assert commands[found[1]].make_context(found[1], shlex.split(found[2], comments=True)).params, line


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_links_lead_to_files_of_the_repository(path: Path):
    targets = re.findall(r"\]\((?![\w+]+:|#)([^)\s#]+)", path.read_text(encoding="utf-8"))
    assert [target for target in targets if not (path.parent / target).exists()] == []


@pytest.mark.parametrize("name", ["ARCHITECTURE.md", "CONTRIBUTING.md"])
def test_files_that_are_named_are_there(name: str):
    """But for those with a part in capitals, which stands for any name."""
    named = re.findall(r"`([\w./-]+/[\w.-]*)`", (ROOT / name).read_text(encoding="utf-8"))
    stands_for_any = re.compile(r"(^|[/_])[A-Z]{3,}([/._]|$)")
    lost = [path for path in named if not stands_for_any.search(path) and not (ROOT / path).exists()]
    assert [path for path in lost if path != "structs/..."] == []


def identifiers(text: str) -> Iterator[tuple[str, str]]:
    """Python files with what a document says to be in them: `file.py`: `name`, `name`; or `name` in `file.py`."""
    for item in re.split(r"\n(?:\n|\d\. )", text):
        quoted, file = list(QUOTED.finditer(item)), ""
        for k, part in enumerate(quoted):
            if "/" in part[1]:
                file = part[1] if part[2] else ""
            elif name := IDENTIFIER.fullmatch(part[1]):
                inside = quoted[k + 1][1] if part[3] else file
                if inside.endswith(".py"):
                    yield inside, name[1]


def defined(path: Path) -> set[str]:
    """Names that a module binds, other than by an import, and its strings, as those of columns and options."""
    tree = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = {node.name for node in tree if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
    names |= {node.id for node in tree if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    return names | {node.value for node in tree if isinstance(node, ast.Constant) and isinstance(node.value, str)}


def test_identifiers_that_are_named_with_a_file_are_in_it():
    named = [each for each in identifiers((ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8"))
             if (ROOT / each[0]).exists()]  # fmt: skip
    assert {("scenes/load.py", "_make"), ("scenes/raw.py", "RawScene"), ("reports/pages/tables.py", "Shown"),
            ("harness/conformance/check.py", "check")} <= set(named)  # fmt: skip
    lost = [(file, name) for file, name in named if not set(name.split(".")) <= defined(ROOT / file)]
    assert lost == []


def test_every_public_name_and_page_is_on_the_site():
    text = "".join((ROOT / "docs" / "reference" / name).read_text(encoding="utf-8")
                   for name in ("names.md", "packer-interface.md"))  # fmt: skip
    assert [name for name in shading_atlas_bench.__all__ if not re.search(rf"\b{name}\b", text)] == []
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    config = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert [page for page in sorted(pages) if f": {page}\n" not in config] == []
