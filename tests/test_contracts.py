"""What CONTRIBUTING.md asks of the sources, found where it is broken: each finder is tried on a planted violation."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from importlib.util import resolve_name

from tests.test_floors import FLOORS, LONGEST_FUNCTION, ROOT, kernel_files, name_of, public_functions, sources, tree_of

PACKAGE = "shading_atlas_bench"
EXAMPLE = "packers/example"  # it shows users the public names

# Modules and functions that load other code, or start programs: ways around the floors.
LOADING = {"asyncio", "imp", "importlib", "multiprocessing", "pkgutil", "pty", "runpy", "subprocess"}
STARTING = re.compile(r"os\.(exec|spawn|posix_spawn|fork|system|popen|startfile)\w*|concurrent\.futures\.Process\w*")
RUNNING = {"__import__", "eval", "exec"}
# Where they stand below the harness, and why: nothing of a higher floor is reached.
BELOW_HARNESS = {
    "kernels/case.py": {
        "importlib": "imports the cases.py of folders of kernels/",
        "eval": "formulas of costs, of its own text, without built-ins",
    },
    "kernels/runtime/builtins_library.py": {
        "importlib": "only looks where the package pocl_binary_distribution lies",
        "subprocess": "asks the compiler for the processor's name, in a process that may die",
    },
    "reports/pages/html.py": {"importlib": "importlib.resources: the file of Plotly's script"},
    "reports/pages/style.py": {"importlib": "importlib.resources: the page's own style sheet"},
    "scenes/repair.py": {"importlib": "pymeshlab, which is optional and may lack a library of the system"},
}

SILENCING = re.compile(r"#\s*(type:\s*ignore|(?:ruff:\s*)?noqa|mypy:|pyright:)(\[[^\]]*\]|:(\s*[A-Z]+\d+,?)+)?", re.I)


def package_names(tree: ast.Module, inside: str) -> Iterator[str]:
    """Imports, wherever they stand, that bind the package itself or a public name of it; `inside`: the folder's import
    name. Folders' import names are none: lint-imports sees what is taken from these."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.partition(".")[0] == PACKAGE and not (alias.asname and "." in alias.name):
                    yield f"import {alias.name}"
        elif isinstance(node, ast.ImportFrom):
            module = resolve_name("." * node.level + (node.module or ""), inside) if node.level else node.module
            if module == PACKAGE:
                yield from (f"from {PACKAGE} import {alias.name}" for alias in node.names if alias.name not in FLOORS)


def test_the_suite_takes_nothing_from_the_package_itself():
    """Which may import everything, so that no floor would hold."""
    found = {
        name_of(path): names
        for path in sources(*FLOORS)
        if not path.is_relative_to(ROOT / EXAMPLE)
        and (names := list(package_names(tree_of(path), ".".join((PACKAGE, *path.relative_to(ROOT).parent.parts)))))
    }
    assert found == {}


def test_names_of_the_package_are_found():
    source = """
import shading_atlas_bench.scenes.load as load
from shading_atlas_bench import kernels
from shading_atlas_bench.kernels import case
from . import runtime
def function():
    import shading_atlas_bench
    import shading_atlas_bench.arithmetic.arrays
    import shading_atlas_bench as suite
    from shading_atlas_bench import kernels, run
    from shading_atlas_bench import *
    from .. import Settings
"""
    assert list(package_names(ast.parse(source), f"{PACKAGE}.kernels")) == [
        "import shading_atlas_bench",
        "import shading_atlas_bench.arithmetic.arrays",
        "import shading_atlas_bench",
        "from shading_atlas_bench import run",
        "from shading_atlas_bench import *",
        "from shading_atlas_bench import Settings",
    ]


def ways_around(tree: ast.Module) -> set[str]:
    """Names of LOADING, STARTING and RUNNING that a module uses."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Attribute):
            names = [ast.unparse(node)]
        else:
            names = [node.id] if isinstance(node, ast.Name) and node.id in RUNNING else []
        found |= {name.partition(".")[0] for name in names if name.partition(".")[0] in LOADING | RUNNING}
        found |= {name for name in names if STARTING.fullmatch(name)}
    return found


def test_below_the_harness_no_code_is_loaded_by_name_and_no_program_started():
    """But where BELOW_HARNESS says why."""
    found = {name_of(path): names for path in sources(*FLOORS[:-1]) if (names := ways_around(tree_of(path)))}
    assert found == {path: set(reasons) for path, reasons in BELOW_HARNESS.items()}


def test_ways_around_the_floors_are_found():
    source = """
import os
import re
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
re.compile("a")
os.environ.get("HOME")
def function():
    from subprocess import run as start
    import importlib.util, multiprocessing.pool
    os.execvp("bench", ["bench"])
    from os import system
    __import__("shading_atlas_bench.harness")
    exec("import shading_atlas_bench")
"""
    assert ways_around(ast.parse(source)) == {
        "concurrent.futures.ProcessPoolExecutor", "subprocess", "importlib", "multiprocessing", "os.execvp",
        "os.system", "__import__", "exec",
    }  # fmt: skip


def long_in_opencl(text: str) -> list[str]:
    """Heads of the functions of an OpenCL file, and of its macros, that are too long; a function's braces stand on
    lines of their own, as clang-format puts them."""
    found, head, begun, macro = [], "", 0, 0
    for number, line in enumerate(text.splitlines(), 1):
        if line == "{":
            begun = number
        elif line == "}" and begun:
            if number - begun > LONGEST_FUNCTION:  # the closing brace counts, as the last line of Python does
                found.append(head)
            begun = 0
        elif not begun and re.match(r"\w.*\(", line):
            head = line
        macro = macro + 1 if line.endswith("\\") else 0
        if macro == LONGEST_FUNCTION:
            found.append(f"the macro that ends at line {number}")
    return found


def test_kernels_fit_on_a_screen():
    long = {
        name_of(path): found for path in kernel_files() if (found := long_in_opencl(path.read_text(encoding="utf-8")))
    }
    assert long == {}


def test_long_functions_of_opencl_are_found():
    def function(head: str, lines: int) -> str:
        return f"{head}\n{{\n" + "    x++;\n" * lines + "}\n"

    fits = function("__kernel void fits(__global int *a,\n                   const int b)", LONGEST_FUNCTION - 1)
    long = function("INLINE int too_long(const int a)", LONGEST_FUNCTION)
    macro = "#define MACRO(x) \\\n" + "    x++; \\\n" * LONGEST_FUNCTION + "    x++\n"
    assert long_in_opencl(fits) == []
    assert long_in_opencl(fits + long + fits) == ["INLINE int too_long(const int a)"]
    assert len(long_in_opencl(fits + macro)) == 1


def silenced_without_reason(text: str) -> list[int]:
    """Lines with a comment that silences a tool, and names no rule or says no reason behind it."""
    if not SILENCING.search(text):
        return []
    comments = [each for each in tokenize.generate_tokens(io.StringIO(text).readline) if each.type == tokenize.COMMENT]
    return [
        comment.start[0]
        for comment in comments
        for match in SILENCING.finditer(comment.string)
        if not match[2] or len(re.findall(r"[^\W\d_]{2,}", SILENCING.split(comment.string[match.end() :])[0])) < 2
    ]


def test_what_silences_a_tool_has_its_reason_in_the_line():
    files = [*sources(*FLOORS, "tests", "docs"), *(ROOT / PACKAGE).glob("*.py")]
    found = {
        name_of(path): lines for path in files if (lines := silenced_without_reason(path.read_text(encoding="utf-8")))
    }
    assert found == {}


def test_silence_without_reason_is_found():
    marks = ("type: ignore", "noqa")  # put in here, so that no tool takes them for its own
    source = """
a = 1  # {0}[arg-type]  # NumPy's stub has no such argument
a = 1  # {1}: E501, B006 a picture's data
a = "# {1}"  # words
a = 1  # {0}[arg-type]
a = 1  # {1}: E501
a = 1  # {1}
a = 1  # {0}  # every rule at once is too many
a = 1  # {0}[misc]  # {1}: E501 the stub is long
# ruff: {1}
""".format(*marks)
    assert silenced_without_reason(source) == [5, 6, 7, 8, 9, 10]


def bare_any(tree: ast.Module) -> Iterator[str]:
    """Public functions, and those within them, with a parameter or result that may be anything."""
    inside = (node for function in public_functions(tree) for node in ast.walk(function))
    for function in (node for node in inside if isinstance(node, ast.FunctionDef)):
        given = function.args
        parameters = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
        annotations = [each.annotation for each in parameters if each] + [function.returns]
        if any(annotation and is_any(annotation) for annotation in annotations):
            yield function.name


def is_any(annotation: ast.expr) -> bool:
    return not {"Any", "typing.Any"}.isdisjoint(ast.unparse(annotation).strip("'").split(" | "))


def test_public_signatures_say_what_is_given():
    """But `array_class`, whose methods hand on what pyopencl's take."""
    found = {name_of(path): names for path in sources(*FLOORS) if (names := list(bare_any(tree_of(path))))}
    assert found == {"kernels/runtime/opencl.py": ["get", "set"]}


def test_bare_any_is_found():
    source = """
def typed(a: dict[str, Any], b: NDArray[Any]) -> tuple[Any, ...]: ...
def _own(a: Any) -> Any: ...
def taken(a: int, *rest: Any): ...
def given() -> Any | None: ...
class Public:
    def method(self, *, a: "Any"): ...
class _Own:
    def method(self, a: Any): ...
"""
    assert list(bare_any(ast.parse(source))) == ["taken", "given", "method"]
