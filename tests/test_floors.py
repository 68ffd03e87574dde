"""The design holds: every kernel has its twin, every test asserts, functions are short, help is fast.

Which folder may import which is in pyproject.toml, for `lint-imports`, and in the tables of ARCHITECTURE.md.
"""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
FLOORS = ("arithmetic", "kernels", "scenes", "reports", "packers", "harness")
LONGEST_FUNCTION = 60  # lines
ASSERTING = {"raises", "warns", "fail"}  # of pytest
# Faults of the program, and its end.
NOT_FOR_CALLERS = {"AssertionError", "NotImplementedError", "StopIteration", "Exit"}


def sources(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def is_annotation_only(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING")


def without_annotation_imports(tree: ast.Module) -> ast.Module:
    return ast.Module([node for node in tree.body if not is_annotation_only(node)], [])


def imported_modules(tree: ast.Module) -> set[str]:
    """Modules imported when the module itself is, in full."""
    found = set()
    for node in without_annotation_imports(tree).body:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def kernel_files() -> list[Path]:
    return sorted(path for folder in ("kernels", "packers") for path in (ROOT / folder).rglob("*.cl"))


def has_kernels(file: Path) -> bool:
    return re.search(r"^\s*(__)?kernel\s", file.read_text(encoding="utf-8"), re.MULTILINE) is not None


def test_every_kernel_has_a_twin_beside_it():
    """A `.cl` file with kernels has a `.py` of the same name whose twin's name says so."""
    lacking = []
    for path in filter(has_kernels, kernel_files()):
        beside = path.with_suffix(".py")
        nodes = ast.walk(tree_of(beside)) if beside.is_file() else []
        functions = [node.name for node in nodes if isinstance(node, ast.FunctionDef)]
        if not any("twin" in name for name in functions):
            lacking.append(name_of(path))
    assert lacking == []


def test_every_included_file_is_used():
    """A file without kernels is there for others, which find it beside them or below kernels/."""
    included = set()
    for path in kernel_files():
        for name in re.findall(r'^\s*#include\s+"([^"]+)"', path.read_text(encoding="utf-8"), re.MULTILINE):
            (found,) = [place for place in (path.parent / name, ROOT / "kernels" / name) if place.is_file()]
            included.add(found)
    assert [name_of(path) for path in kernel_files() if not has_kernels(path) and path not in included] == []


def test_every_test_asserts():
    functions = {
        path: [node for node in ast.walk(tree_of(path)) if isinstance(node, ast.FunctionDef)]
        for path in sources("tests")
    }
    helpers = {path: {node.name for node in nodes if asserts(node, set())} for path, nodes in functions.items()}
    by_module = {name_of(path).removesuffix(".py").replace("/", "."): names for path, names in helpers.items()}
    silent = []
    for path, nodes in functions.items():
        known = helpers[path].union(*(by_module.get(name, ()) for name in imported_modules(tree_of(path))))
        silent += [
            f"{name_of(path)}: {node.name}"
            for node in nodes
            if node.name.startswith("test_") and not asserts(node, known)
        ]
    assert silent == []


def asserts(function: ast.FunctionDef, helpers: set[str]) -> bool:
    """Whether a function asserts, expects an error, or calls something that does (`assert_...`, a helper)."""
    for node in ast.walk(function):
        if isinstance(node, ast.Assert):
            return True
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func).rpartition(".")[2]
            if called in ASSERTING | helpers or called.startswith(("assert_", "_assert")):
                return True
    return False


def test_functions_fit_on_a_screen():
    long = {
        f"{name_of(path)}: {node.name}": last_line(node) - node.lineno + 1
        for path in sources(*FLOORS, "tests")
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and body_lines(node) > LONGEST_FUNCTION
    }
    assert long == {}


def last_line(node: ast.stmt) -> int:
    assert node.end_lineno is not None
    return node.end_lineno


def body_lines(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines from the first statement after the docstring to the end: signatures and descriptions may be long."""
    body = function.body[1:] if ast.get_docstring(function, clean=False) is not None else function.body
    return last_line(function) - body[0].lineno + 1 if body else 0


def test_heavy_packages_are_imported_where_they_are_needed():
    """Not at the top of a module, so that the command line answers at once."""
    heavy = {"pyopencl", "trimesh", "pymeshlab", "OpenImageIO", "colour", "av", "plotly", "scipy", "lz4", "skimage"}
    early = {
        name_of(path): sorted(found)
        for path in sources(*FLOORS)
        if (found := {module.partition(".")[0] for module in imported_modules(tree_of(path))} & heavy)
    }
    assert early == {}


def test_public_functions_name_what_they_raise():
    """A docstring has the exceptions that the function makes itself, in whatever words."""
    silent = [
        f"{name_of(path)}: {function.name} raises {name}"
        for path in sources(*FLOORS)
        for function in public_functions(tree_of(path))
        for name in sorted(own_exceptions(function) - NOT_FOR_CALLERS)
        if not re.search(rf"\b{name}\b", ast.get_docstring(function) or "")
    ]
    assert silent == []


def test_exceptions_that_a_function_makes_are_found():
    source = """
def function():
    def inner():
        raise KeyError
    try:
        raise errors.InputError("made")
    except OSError as error:
        raise error
    with guarded():
        raise ValueError("becomes an exit code")
"""
    assert own_exceptions(ast.parse(source).body[0]) == {"InputError"}


def public_functions(scope: ast.Module | ast.ClassDef) -> list[ast.FunctionDef]:
    """Functions of a module and methods of its classes, without those whose name, or class's, has an underscore."""
    public = [node for node in scope.body if not getattr(node, "name", "_").startswith("_")]
    methods = [method for node in public if isinstance(node, ast.ClassDef) for method in public_functions(node)]
    return [node for node in public if isinstance(node, ast.FunctionDef)] + methods


def own_exceptions(node: ast.AST) -> set[str]:
    """Names of the exceptions made below a node: not by functions in it, and not where `guarded` ends the program."""
    found = set()
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.Lambda | ast.ClassDef) or is_guarded(child):
            continue
        if isinstance(child, ast.Raise) and child.exc is not None:
            made = child.exc.func if isinstance(child.exc, ast.Call) else child.exc
            name = ast.unparse(made).rpartition(".")[2]
            if name[0].isupper():  # else it is a variable: an exception that was caught, raised again
                found.add(name)
        found |= own_exceptions(child)
    return found


def is_guarded(node: ast.AST) -> bool:
    return isinstance(node, ast.With) and any(ast.unparse(item.context_expr) == "guarded()" for item in node.items)


def rows_under(heading: str) -> list[list[list[str]]]:
    """The table under a heading of ARCHITECTURE.md: for each of its rows, and each cell, the names in backticks."""
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    section = text.partition(f"\n### {heading}\n")[2].partition("\n#")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")][2:]
    return [[re.findall(r"`([^`]+)`", cell) for cell in line.strip("|").split("|")] for line in lines]


def test_the_architecture_has_the_tables_that_imports_are_held_to():
    rules = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    package = f"{rules['root_package']}."
    for contract in rules["contracts"]:
        rows = rows_under(contract["name"])
        match contract["type"]:
            case "layers":
                assert [" | ".join(cells[0]) for cells in rows] == contract["layers"], contract["name"]
            case "forbidden":
                ((sources, forbidden),) = rows
                assert [package + name for name in sources] == contract["source_modules"]
                full = [package + name if "." in name else name for name in forbidden]
                assert full == contract["forbidden_modules"]
            case other:
                assert other == "acyclic_siblings"
                assert f"\n### {contract['name']}\n" in (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
