"""Mutation testing: small faults are planted in a module, one at a time, and tests are run on each.

    python -m tests.mutants packers/budget.py tests/packers/test_budget.py --sample 40

Printed are the faults that no test noticed. The module is changed in place and put back: work in a clean clone. Tests
run in the order given and end at the first that fails, so give the quick ones first.

A sample has at most one fault for each place and kind, and is the same for the same module, number and seed. Left out
are annotations, the texts of errors, and faults that most often stop a program at once (a sum that becomes a shift).
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import re
import sys
import time
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.plugins import get_operator, operator_names
from cosmic_ray.testing import run_tests
from cosmic_ray.work_item import MutationSpec, TestOutcome

Place = tuple[int, int]  # line and column

KINDS = re.compile(
    r"core/(?P<kind>AddNot|NumberReplacer|ExceptionReplacer|ZeroIterationForLoop"
    r"|Replace(True|False|And|Or|Break|Continue)With\w+"
    r"|ReplaceUnaryOperator(?=_(USub_UAdd|Delete_Not|Delete_Invert)$)"
    r"|ReplaceBinaryOperator(?=_(Add_Sub|Sub_Add|Mul_Add|Mul_Div|Div_Mul|Div_FloorDiv|FloorDiv_Mul|FloorDiv_Div"
    r"|Mod_FloorDiv|Pow_Mul|RShift_LShift|LShift_RShift|BitOr_BitAnd|BitAnd_BitOr|BitXor_BitOr)$)"
    r"|ReplaceComparisonOperator(?=_(Eq_NotEq|NotEq_Eq|Lt_LtE|Lt_GtE|LtE_Lt|LtE_Gt|Gt_GtE|Gt_LtE|GtE_Gt|GtE_Lt|Is_IsNot"
    r"|IsNot_Is)$))"
)


def silent_parts(tree: ast.Module) -> list[tuple[Place, Place]]:
    """From where to where annotations, raised errors, switches of dataclasses and imports for type checkers stand."""
    parts: list[ast.expr | ast.stmt | None] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            arguments = node.args
            parts += [argument.annotation for argument in arguments.posonlyargs + arguments.args + arguments.kwonlyargs]
            parts.append(node.returns)
        elif isinstance(node, ast.ClassDef):
            parts += [decorator for decorator in node.decorator_list if ast.unparse(decorator).startswith("dataclass")]
        elif isinstance(node, ast.AnnAssign):
            parts.append(node.annotation)
            parts.append(node.value if "TypeAlias" in ast.unparse(node.annotation) else None)
        elif isinstance(node, ast.Raise) or (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"):
            parts.append(node)
    return [
        ((part.lineno, part.col_offset), (part.end_lineno, part.end_col_offset))
        for part in parts
        if part and part.end_lineno is not None and part.end_col_offset is not None
    ]


def faults(module: Path, sample: int | None = None, seed: int = 0) -> tuple[list[MutationSpec], int]:
    """Faults to plant in a module, in the order of their places, and of how many they are drawn."""
    silent = silent_parts(ast.parse(module.read_text(encoding="utf-8")))
    nodes = list(ast_nodes(get_ast_from_path(module)))
    places: dict[tuple[Place, str], list[MutationSpec]] = {}
    for name in sorted(operator_names()):
        if not (known := KINDS.match(name)):
            continue
        operator = get_operator(name)()
        spans = (span for node in nodes for span in operator.mutation_positions(node))
        for occurrence, (start, end) in enumerate(spans):
            if not any(first <= start < last for first, last in silent):
                fault = MutationSpec(module, name, occurrence, start, end)
                places.setdefault((start, known["kind"]), []).append(fault)
    found = [some for _, some in sorted(places.items())]
    total = sum(map(len, found))
    if sample is None:
        return [fault for some in found for fault in some], total
    draw = random.Random(f"{module.as_posix()} {seed}")
    chosen = sorted(draw.sample(range(len(found)), min(sample, len(found))))
    return [draw.choice(found[number]) for number in chosen], total


def survivors(planted: list[MutationSpec], command: str) -> list[str]:
    """The differences that no test noticed. Raises RuntimeError if tests fail without any."""
    start = time.monotonic()
    outcome, output = run_tests(command, None)
    if outcome != TestOutcome.SURVIVED:
        raise RuntimeError(f"The tests fail without any fault:\n{output}")
    limit = 10 + 4 * (time.monotonic() - start)
    results = (mutate_and_test([fault], command, limit) for fault in planted)
    return [result.diff for result in results if result.test_outcome != TestOutcome.KILLED]


def main() -> None:
    parser = argparse.ArgumentParser(description="Plant faults in a module and run tests on each.")
    parser.add_argument("module", type=Path)
    parser.add_argument("tests", nargs="+", help="files of tests, or other arguments of pytest behind --")
    parser.add_argument("--sample", type=int, metavar="N", help="so many faults, drawn at random; all of them without")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    os.environ["CI"] = "true"  # hypothesis then tries the same examples every time, and none is too slow
    planted, total = faults(given.module, given.sample, given.seed)
    command = f"{sys.executable} -m pytest -x -q -n 0 -p no:cacheprovider {' '.join(given.tests)}"
    left = survivors(planted, command)
    print("\n".join(left))
    print(f"{total} faults, {len(planted)} tried, {len(left)} not noticed")


if __name__ == "__main__":
    main()
