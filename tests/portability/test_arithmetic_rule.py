"""Values that reach a scene, a kernel or a result are computed with `arithmetic`, not by what depends on processors."""

from __future__ import annotations

import ast
from collections.abc import Set
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("arithmetic", "scenes", "kernels", "packers", "harness")
ELEMENTARY = {
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh", "sinc"),
    *("asin", "acos", "atan", "atan2", "arcsinh", "arccosh", "arctanh", "asinh", "acosh", "atanh"),
    *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "logaddexp", "power", "pow", "float_power", "cbrt"),
    *("hypot", "dist", "erf", "erfc", "gamma", "lgamma", "geomspace", "logspace"),
}
SUMS = {"dot", "vdot", "matmul", "inner", "outer", "tensordot", "einsum", "kron", "convolve", "correlate", "cov"}
FORBIDDEN = {
    "np": ELEMENTARY | SUMS | {"corrcoef", "polyfit"},
    "math": ELEMENTARY,
    "scipy": {"interpolate", "linalg", "fft", "signal", "stats", "special"},
    "scipy.ndimage": {"gaussian_filter", "gaussian_filter1d", "zoom", "rotate", "affine_transform"},
    "scipy.spatial": {"transform"},
}
FAMILIES = ("np.linalg", "np.random", "np.fft")
HARMLESS = {"np.random.Generator", "np.linalg.norm"}  # a type; allowed along an axis, see below
ADVICE = "its last bits depend on the processor; use the functions of `arithmetic`, and x * x for squares"

# Whose values reach no scene, no kernel of a run and no result, or can change none of them.
EXEMPT = {
    "arithmetic/draws.py": "where NumPy's random numbers are made the same everywhere",
    "kernels/inputs/": "made-up input of `bench kernels` and of tests",
    "inputs.py": "made-up input of `bench kernels` and of tests",
    "cases.py": "made-up input of `bench kernels` and of tests",
    "kernels/case.py:seeded": "made-up input of `bench kernels` and of tests",
    "kernels/shade/colour.py:encode": "twin of colour.cl",
    "kernels/shade/colour.py:sky_irradiance": "twin of colour.cl",
    "kernels/shade/shadow_lookup.py": "twin of shadow_lookup.cl",
    "kernels/texture/sample.py:trilinear": "twin of sample.cl",
    "kernels/metrics/ssim.py:windowed": "used by twins only",
    "harness/measure/exact.py": "a float64 judge of pictures, which allows for more than rounding",
}


def used_names(node: ast.AST) -> list[str]:
    """Dotted names that a node mentions, with NumPy as np."""
    if isinstance(node, ast.ImportFrom) and node.module:
        names = [f"{node.module}.{alias.name}" for alias in node.names]
    elif isinstance(node, ast.Import):
        names = [alias.name for alias in node.names]
    elif isinstance(node, ast.Attribute) and is_dotted(node):
        names = [ast.unparse(node)]
    else:
        names = []
    return ["np" + name.removeprefix("numpy") if name.partition(".")[0] == "numpy" else name for name in names]


def offence(node: ast.AST) -> str | None:
    """What a node uses whose result depends on the processor."""
    if isinstance(node, ast.BinOp | ast.AugAssign):
        if isinstance(node.op, ast.MatMult):
            return "@"
        base = node.left if isinstance(node, ast.BinOp) else node.target
        whole = isinstance(base, ast.Constant) and isinstance(base.value, int)
        return "**" if isinstance(node.op, ast.Pow) and not (whole or is_number(node)) else None
    if isinstance(node, ast.Call) and ast.unparse(node.func) == "np.linalg.norm":
        return None if any(keyword.arg == "axis" for keyword in node.keywords) else "np.linalg.norm without an axis"
    for name in used_names(node):
        parts = name.split(".")
        if any(parts[k] in FORBIDDEN.get(".".join(parts[:k]), ()) for k in range(1, len(parts))):
            return name
        if ".".join(parts[:2]) in FAMILIES and len(parts) > 2 and name not in HARMLESS:
            return name
    return ".dot" if isinstance(node, ast.Attribute) and node.attr == "dot" else None


def is_dotted(node: ast.expr) -> bool:
    """Whether an expression is names and dots alone."""
    return isinstance(node, ast.Name) or (isinstance(node, ast.Attribute) and is_dotted(node.value))


def is_number(node: ast.AST) -> bool:
    """Whether an expression is made of numbers alone, like 2.0**-10."""
    return not any(isinstance(part, ast.Name | ast.Attribute | ast.Call) for part in ast.walk(node))


def twins(tree: ast.Module) -> set[str]:
    """A module's twins, which are compared within bounds and go nowhere else, and what only they use."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    users: dict[str, set[str | None]] = {function.name: set() for function in functions}
    for name, nodes in (*((f.name, ast.walk(f)) for f in functions), (None, outside(tree))):
        for node in nodes:
            if isinstance(node, ast.Name | ast.Attribute):
                used = node.id if isinstance(node, ast.Name) else node.attr
                users.get(used, set()).add(name)
    found = {name for name in users if "twin" in name}
    while more := {n for n, by in users.items() if n.startswith("_") and by - {n} and by - {n} <= found} - found:
        found |= more
    return found


def outside(tree: ast.Module) -> list[ast.AST]:
    """Nodes of a module that are in none of its functions."""
    inside = {id(n) for f in ast.walk(tree) if isinstance(f, ast.FunctionDef) for n in ast.walk(f)}
    return [node for node in ast.walk(tree) if id(node) not in inside]


def offences(text: str, exempt: Set[str] = frozenset()) -> list[str]:
    """Lines and names of what a module uses outside its twins and exempt functions."""
    tree = ast.parse(text)
    spared = twins(tree) | exempt
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name in spared]
    free = {id(node) for function in functions for node in ast.walk(function)}
    nodes = (node for node in ast.walk(tree) if isinstance(node, ast.expr | ast.stmt) and id(node) not in free)
    found = [(node.lineno, what) for node in nodes if (what := offence(node))]
    return [f"line {line}: {what}" for line, what in sorted(set(found))]


def test_values_do_not_depend_on_the_processor():
    found: dict[str, list[str]] = {}
    for path in sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        if not any(part in name for part in EXEMPT):
            exempt = {entry.partition(":")[2] for entry in EXEMPT if entry.startswith(f"{name}:")}
            found[name] = offences(path.read_text(encoding="utf-8"), exempt)
    found = {name: wrong for name, wrong in found.items() if wrong}
    assert found == {}, ADVICE


PLANTED = (
    ("a = b @ c", "@"),
    ("a @= c", "@"),
    ("a = b**0.5", "**"),
    ("a = np.sin(b)", "np.sin"),
    ("a = numpy.exp(b)", "np.exp"),
    ("a = math.atan2(b, c)", "math.atan2"),
    ("from math import hypot", "math.hypot"),
    ("a = np.linalg.inv(b)", "np.linalg.inv"),
    ("a = np.linalg.norm(b)", "np.linalg.norm without an axis"),
    ("a = b(0).dot(c)", ".dot"),
    ("a = np.einsum('i,i', b, c)", "np.einsum"),
    ("a = np.random.default_rng(0)", "np.random.default_rng"),
    ("from scipy.ndimage import gaussian_filter1d", "scipy.ndimage.gaussian_filter1d"),
    ("from scipy.spatial.transform import Rotation", "scipy.spatial.transform"),
    ("def work(a):\n    return _part(a)\ndef a_twin(a):\n    return _part(a)\ndef _part(a):\n    return a @ a", "@"),
)


@pytest.mark.parametrize(("text", "what"), PLANTED)
def test_what_depends_on_the_processor_is_found(text: str, what: str):
    assert any(what in found for found in offences(text))


@pytest.mark.parametrize(
    "text",
    [
        "a = 2**n",
        "a = np.linalg.norm(b, axis=1)",
        "a = sin(b) * math.sqrt(c)",
        "rng: np.random.Generator",
        "def a_twin(a):\n    return _part(a)\ndef _part(a):\n    return a @ a",
    ],
)
def test_what_does_not_is_let_be(text: str):
    assert offences(text) == []
