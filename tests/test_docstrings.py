"""Docstrings say what a caller needs to know of arrays: shapes, and which numbers where the type leaves it open."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from typing import NamedTuple

import pytest

from tests.test_floors import FLOORS, name_of, sources

OPEN = "Array"  # of any numbers, on the host or on a device; the other types say which, or take what can be made one
ARRAYS = {OPEN, "ArrayLike", "NDArray", "Bools", "Bytes", "Floats", "Doubles", "Ints", "Longs", "Words"}
ARRAYS |= {"Indices", "Whole"}  # of single folders
NUMBERS = r"(?i:\b(?:u?int(?:8|16|32|64)?|floats?(?:16|32|64)?|bool|dtype|records|any (?:shape and )?numbers)\b)"
# Sizes in parentheses: (n), (2 n + 1), (..., 3), (height, width, 3 or 4). A lone word is a size where numbers precede.
SIZE = r"(?:\d+ )?(?:\.\.\.|\w+)(?:(?: or | ?[-+*/] ?)\w+)*"
LONE = r"\w|\d+|\d+ \w|[A-Z]{2,}|\.\.\.|(?:\d+ )?\w+(?: ?[-+*/] ?\w+)+"
SHAPE = rf"\((?:{LONE})\)|\({SIZE}(?:, {SIZE})+\)|{NUMBERS} \(\w+\)|\b(?:any|equal|of|this) shapes?\b"
SAME = r"(?:^|[.:] )[Tt]he same\b"  # as a kernel, or as on the device, which are described above
ELSEWHERE = r"\b(?:[Aa]s|[Ss]ee|[Ll]ike)(?: (?:in|for|from|of|by|those of))* (?=`|[\w.]*[A-Z_])`?([\w.]*\w)"


class Described(NamedTuple):
    """A function that takes or returns arrays, or a class with fields of them; named: what it takes, or the fields."""

    name: str
    docstring: str
    types: set[str]
    named: list[str]
    is_class: bool

    def lack(self) -> str | None:
        """What is not said here: a shape at least, and one for each parameter that has no mention; fields have all."""
        shapes = len(re.findall(SHAPE, self.docstring))
        silent = [name for name in self.named if not re.search(rf"(?i)\b{name}\b", self.docstring)]
        if shapes == 0 or len(silent) > (0 if self.is_class else shapes):
            return f"the shape of {', '.join(silent or self.named or ['the result'])}"
        return "which numbers" if OPEN in self.types and not re.search(NUMBERS, self.docstring) else None

    def leads_to(self, told: set[str]) -> bool:
        """Whether it names, in their stead, one of those that are `told` where they are."""
        return bool(re.search(SAME, self.docstring)) or not told.isdisjoint(re.findall(ELSEWHERE, self.docstring))


def array_types(annotation: ast.expr | None) -> set[str]:
    """Types of arrays in an annotation; a class of arrays is none."""
    if annotation is None or ast.unparse(annotation).startswith("type["):
        return set()
    return ARRAYS & {getattr(node, "attr", getattr(node, "id", "")) for node in ast.walk(annotation)}


def docstring_of(node: ast.Module | ast.ClassDef | ast.FunctionDef, *further: str) -> str:
    return " ".join(" ".join([ast.get_docstring(node) or "", *further]).split())


def of_function(function: ast.FunctionDef, owner: ast.Module | ast.ClassDef, prefix: str) -> Described:
    """A constructor is its class: what it takes is said in the class's docstring."""
    given = function.args
    every = [*given.posonlyargs, *given.args, *given.kwonlyargs, *filter(None, (given.vararg, given.kwarg))]
    taken = {argument.arg: types for argument in every if (types := array_types(argument.annotation))}
    types = array_types(function.returns).union(*taken.values())
    if function.name == "__init__":
        return Described(prefix[:-1], docstring_of(owner), types, list(taken), is_class=False)
    return Described(prefix + function.name, docstring_of(function), types, list(taken), is_class=False)


def of_fields(owner: ast.ClassDef, lines: list[str], prefix: str) -> Described:
    """A field is described in the class's docstring or in a comment behind it."""
    fields = {
        node.target.id: node
        for node in owner.body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.target.id[0] != "_"
        if array_types(node.annotation)
    }
    comments = {name: lines[node.lineno - 1].partition("  # ")[2] for name, node in fields.items()}
    docstring = docstring_of(owner, *(f"{name}: {said}." for name, said in comments.items() if said))
    types = set().union(*(array_types(node.annotation) for node in fields.values()))
    return Described(prefix + owner.name, docstring, types, list(fields), is_class=True)


def described(scope: ast.Module | ast.ClassDef, lines: list[str], prefix: str = "") -> Iterator[Described]:
    """What is public in a module or class and has arrays."""
    for node in scope.body:
        name = getattr(node, "name", "_")
        if isinstance(node, ast.ClassDef) and name[0] != "_":
            found = [of_fields(node, lines, prefix), *described(node, lines, f"{prefix}{name}.")]
        elif isinstance(node, ast.FunctionDef) and (name[0] != "_" or name == "__init__") and not is_overload(node):
            found = [of_function(node, scope, prefix)]
        else:
            continue
        yield from (one for one in found if one.types)


def is_overload(function: ast.FunctionDef) -> bool:
    return any(ast.unparse(decorator) == "overload" for decorator in function.decorator_list)


def lacks(modules: dict[str, str]) -> list[str]:
    """What docstrings in modules, name to source, do not say.

    It may be left to another docstring that says it: of the method that one stands for, or of what is named with "as",
    "see" or "like", such as "as from `locate`" or "see Samples".
    """
    trees = {name: ast.parse(source) for name, source in modules.items()}
    classes = [node for tree in trees.values() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    bases = {node.name: [ast.unparse(base) for base in node.bases] for node in classes}
    found = [(name, one) for name, tree in trees.items() for one in described(tree, modules[name].splitlines())]
    told = {one.name for _, one in found if one.lack() is None}
    last_names = {name.rpartition(".")[2] for name in told}

    def stands_for_one_that_tells(method: str) -> bool:
        owner, _, name = method.rpartition(".")
        above = [f"{base}.{name}" for base in bases.get(owner, [])]
        return any(base in told or stands_for_one_that_tells(base) for base in above)

    return [
        f"{name}: {one.name} does not say {what}"
        for name, one in found
        if (what := one.lack()) and not one.leads_to(told | last_names) and not stands_for_one_that_tells(one.name)
    ]


def test_public_docstrings_say_shapes_and_numbers_of_arrays():
    public = [path for path in sources(*FLOORS) if path.name == "__init__.py" or path.name[0] != "_"]
    assert lacks({name_of(path): path.read_text(encoding="utf-8") for path in public}) == []


def test_every_name_of_a_type_of_arrays_is_known():
    named = re.compile(r"^(\w+): TypeAlias = NDArray\b", re.MULTILINE)
    found = {name for path in sources(*FLOORS) for name in named.findall(path.read_text(encoding="utf-8"))}
    assert {"Floats", "Indices"} < found <= ARRAYS


def function(docstring: str, signature: str = "(points: Doubles) -> Bools") -> str:
    return f'def function{signature}:\n    """{docstring}"""\n'


@pytest.mark.parametrize(
    ("source", "what"),
    [
        (function("Whether they are near."), "the shape of points"),
        (function("Whether `points` are near (perspective)."), "the shape of points"),
        (function("Whether (n) are near.", "(a: Doubles, b: Doubles, c: int) -> Bools"), "the shape of a, b"),
        (function("The points of the same name.", "() -> Floats"), "the shape of the result"),
        (function("Normals, as from `normals`, which says nothing."), "the shape of points"),
        (function("The points (n, 3) on the device.", "(points: Array | None) -> None"), "which numbers"),
        (function("The points (n, 3).", "(points: Sequence[arrays.Array]) -> None"), "which numbers"),
    ],
)
def test_what_a_function_does_not_say_is_found(source: str, what: str):
    assert lacks({"module": source}) == [f"module: function does not say {what}"]


@pytest.mark.parametrize(
    "source",
    [
        function("Whether points (..., 3) are near."),
        function("bool (n): whether the nearest is near, of points (n, 2 k + 1, 3 or 4)."),
        function("Whether points, of any shape, are near."),
        function("float32 (height, width, 4) from uint8 (count).", "(values: Array) -> Array"),
        function("The same on the host."),
        function("As `other` says.") + function("Points (n).").replace("function", "other"),
        function("Makes none.", "(number: int) -> type[Array]"),
        function("Says nothing.").replace("function", "_private"),
    ],
)
def test_what_a_function_says_is_read(source: str):
    assert lacks({"module": source}) == []


def test_fields_and_methods_are_looked_at():
    source = '''
class Samples:
    """Samples on the device. triangle: int32 (n)."""

    triangle: Array
    bary: Array
    count: int
    texel: Array  # int32 (n)

    def __init__(self, texel: Array) -> None: ...

    def place(self) -> Floats:
        """Where they are."""

class Known:
    def place(self) -> Floats:
        """Where they are, (n, 2)."""

class Better(Known):
    def place(self) -> Floats:
        """Where they really are."""
'''
    assert lacks({"module": source}) == [
        "module: Samples does not say the shape of bary",
        "module: Samples.place does not say the shape of the result",
    ]
