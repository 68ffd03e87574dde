"""What others wrote reaches a terminal through one door: never as markup, and what would steer it as escapes."""

from __future__ import annotations

import ast
from io import StringIO

import pytest
import typer

from shading_atlas_bench.harness.cli.guard import guarded
from shading_atlas_bench.harness.console import Terminal, folded, make_table, progress_bars, styled
from shading_atlas_bench.harness.errors import InputError
from tests.test_floors import FLOORS, imported_modules, name_of, sources, tree_of

DOOR = "harness/console.py"
# What these print is not read by people, or passes `visible` beside it.
PRINTING = {
    "harness/cli/main.py",
    "harness/cli/supervisor.py",
    "harness/experiments/exact_merge.py",
    "harness/progress.py",
    "kernels/runtime/probe.py",
}
SOURCES = sources(*FLOORS)
BAD = "a[/]x [red]\x1b[2J\u202e\ud800\x07\u2028"
SHOWN = "a[/]x [red]\\x1b[2J\\u202e\\ud800\\x07\\u2028"


def calls(tree: ast.AST, name: str) -> list[ast.Call]:
    found = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return [node for node in found if getattr(node.func, "id", getattr(node.func, "attr", "")) == name]


def is_literal(node: ast.expr) -> bool:
    """Whether an expression is text of the source alone, or one of two such."""
    if isinstance(node, ast.IfExp):
        return is_literal(node.body) and is_literal(node.orelse)
    return isinstance(node, ast.Constant)


def unsound(tree: ast.Module) -> list[str]:
    """What would print beside the door."""
    found = [f"styled({ast.unparse(call.args[0])}" for call in calls(tree, "styled") if not is_literal(call.args[0])]
    found += [ast.unparse(call) for call in calls(tree, "Console") + calls(tree, "from_markup")]
    found += [ast.unparse(call) for call in calls(tree, "print") if isinstance(call.func, ast.Name)]
    found += [ast.unparse(call) for name in ("echo", "secho") for call in calls(tree, name)]
    markup = {"rich.markup", "rich.text", "rich.print"} & imported_modules(tree)
    return found + sorted(markup)


def test_nothing_prints_beside_the_console() -> None:
    found = {name_of(path): unsound(tree_of(path)) for path in SOURCES if name_of(path) != DOOR}
    assert {name for name, what in found.items() if what} == PRINTING
    assert all(what.startswith("print(") for name in PRINTING for what in found[name])
    planted = ast.parse("from rich.markup import escape\nstyled(f'[bold]{name}[/]')\nprint(name)\nConsole()")
    assert len(unsound(planted)) == 4


def shown(*what: object) -> str:
    console = Terminal()
    console.file = StringIO()
    console.width = 200
    console.print(*what)
    return console.file.getvalue()


def test_text_is_printed_as_it_is_with_what_steers_as_escapes() -> None:
    assert shown(BAD) == f"{SHOWN}\n"
    assert shown(styled("[bold]{}[/] {:,} [{style}]{}[/]", BAD, 12345, BAD, style="red")) == f"{SHOWN} 12,345 {SHOWN}\n"
    assert shown(styled("{}: {}", "a", styled("[red]{}[/]", BAD))) == f"a: {SHOWN}\n"
    table = make_table(BAD, BAD)
    table.add_row(BAD)
    table.add_row(folded(BAD, 300))
    assert [line.strip() for line in shown(table).splitlines()] == [SHOWN] * 4
    bars = progress_bars(Terminal())
    bars.add_task(BAD, total=1)
    assert SHOWN in shown(bars.get_renderable())
    assert (
        shown("a\tb\nc \N{WOMAN}\u200d\N{PERSONAL COMPUTER} é")
        == "a       b\nc \N{WOMAN}\u200d\N{PERSONAL COMPUTER} é\n"
    )


def test_a_style_is_of_its_field_alone() -> None:
    text = styled("[bold]{}[/]{}{}", "ab", "", styled("[red]{}[/]", "cd"))
    assert (text.plain, [(span.start, span.end, str(span.style)) for span in text.spans]) == (
        "abcd",
        [(0, 2, "bold"), (2, 4, "red")],
    )


def test_a_template_has_a_value_for_each_field() -> None:
    assert styled("{!r} {:>3} [{style}]x[/]", "a", 1, style="red").plain == "'a'   1 x"
    for values in ((), (1,), (1, 2, 3)):
        with pytest.raises(ValueError, match=f"has 2 fields, and {len(values)} values are given"):
            styled("{} {}", *values)


def test_a_title_may_be_wider_than_its_table(capsys: pytest.CaptureFixture[str]) -> None:
    table = make_table("a title of many words", "x")
    table.add_row("1")
    Terminal().print(table)
    assert [line.strip() for line in capsys.readouterr().out.splitlines()] == ["a title of many words", "x", "1"]


def test_memory_that_runs_out_is_a_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit) as ended, guarded():
        raise MemoryError
    assert ended.value.exit_code == 2
    assert capsys.readouterr().err.startswith("bench: Memory ran out")


def test_an_error_s_text_is_no_markup(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit), guarded():
        raise InputError(BAD)
    assert capsys.readouterr().err == f"bench: {SHOWN}\n"
