"""Constants that a kernel shares with its launcher and its twin: the kernel's file holds them, as `#define`s."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TypeAlias

Number: TypeAlias = int | float

DEFINE = re.compile(r"^[ \t]*#[ \t]*define[ \t]+(\w+)[ \t]+(.*?)[ \t]*(?://.*|/\*.*)?$", re.MULTILINE)
LITERAL = re.compile(r"\b(0[xX][0-9a-fA-F]+|\d+\.?\d*(?:[eE][+-]?\d+)?)[fFuU]?\b")


@dataclass(frozen=True)
class Constants:
    """The numbers that a file defines, by name; unusable: what else it defines, and why that has no value here."""

    file: Path
    numbers: Mapping[str, Number]
    unusable: Mapping[str, str]

    def whole(self, name: str) -> int:
        """A whole number, also where the kernel has it as a float.

        Raises ValueError if the file does not define the name, or not as a whole number.
        """
        number = self._number(name)
        if number != int(number):
            raise ValueError(f"{self.file}: {name} is {number}, which is no whole number.")
        return int(number)

    def number(self, name: str) -> float:
        """A number; of a literal such as 0.1f it is the float64 nearest to the decimals, not to the kernel's float32.

        Raises ValueError if the file does not define the name, or not as a number.
        """
        return float(self._number(name))

    def _number(self, name: str) -> Number:
        if name not in self.numbers:
            raise ValueError(f"{self.file}: {name} {self.unusable.get(name, 'is not defined')}.")
        return self.numbers[name]


@cache
def constants_of(file: Path) -> Constants:
    """What a kernel's file defines itself, as literals or by + - * / << of them and of names further up in it.

    Quotients and other results of floats are float64. Definitions in included files are theirs.
    """
    numbers: dict[str, Number] = {}
    unusable: dict[str, str] = {}
    for name, text in DEFINE.findall(file.read_text(encoding="utf-8")):
        if name in numbers or name in unusable:
            numbers.pop(name, None)
            unusable[name] = "is defined more than once"
            continue
        try:
            numbers[name] = _value(ast.parse(LITERAL.sub(r"\1", text), mode="eval").body, numbers)
        except (SyntaxError, ValueError, ArithmeticError):
            unusable[name] = f"is no number that Python computes: {text}"
    return Constants(file, numbers, unusable)


def _value(expression: ast.expr, numbers: Mapping[str, Number]) -> Number:
    match expression:
        case ast.Constant(value=int() | float() as literal):
            return literal
        case ast.Name(id=name) if name in numbers:
            return numbers[name]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_value(operand, numbers)
        case ast.BinOp(left=left, op=operator, right=right):
            return _result(_value(left, numbers), operator, _value(right, numbers))
    raise ValueError("no arithmetic")


def _result(left: Number, operator: ast.operator, right: Number) -> Number:
    match operator, left, right:
        case ast.Add(), _, _:
            return left + right
        case ast.Sub(), _, _:
            return left - right
        case ast.Mult(), _, _:
            return left * right
        case ast.Div(), int(), int():
            return int(left / right)  # C rounds towards 0
        case ast.Div(), _, _:
            return left / right
        case ast.LShift(), int(), int():
            return left << right
    raise ValueError("no operator of constants")
