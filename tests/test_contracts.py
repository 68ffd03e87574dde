"""What CONTRIBUTING.md asks of the sources, found where it is broken: each finder is tried on a planted violation."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from importlib.util import resolve_name

from tests.test_floors import FLOORS, ROOT, name_of, sources, tree_of

PACKAGE = "shading_atlas_bench"
EXAMPLE = "packers/example"  # it shows users the public names


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
