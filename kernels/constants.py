"""Constants that a kernel shares with its launcher and its twin: the kernel's file holds them, as `#define`s."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import accumulate
from pathlib import Path
from typing import TypeAlias

import numpy as np

from shading_atlas_bench.kernels.preprocessor import logical_lines

Number: TypeAlias = int | float

DIRECTIVE = re.compile(r"^\s*(?:#|%:)[^\S\n]*(\w+)[^\S\n]*(.*?)[^\S\n]*$", re.MULTILINE)
DEFINITION = re.compile(r"(\w+)(\()?\s*(.*)")  # with a bracket: of arguments
LITERAL = re.compile(r"\b(0[xX][0-9a-fA-F]+|\d+\.?\d*(?:[eE][+-]?\d+)?)([fFuU]?)\b")
INTS = range(-(2**31), 2**31)
LARGEST_FLOAT = (2.0 - 2.0**-23) * 2.0**127


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
        if isinstance(number, float) and float(np.float32(number)) != number:
            raise ValueError(f"{self.file}: {name} is {number:.0f}, which the kernel's float32 rounds.")
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

    Quotients and other results of floats are float64. Definitions in included files are theirs. What another build or
    another place in the text may see otherwise is unusable: names that are defined more than once, undefined again, or
    defined below a condition other than an include guard and `#if SWITCH`, an argument of the build without which they
    are missing; and so is arithmetic that is no int's or float's in C: of unsigned numbers, of larger ones, and of
    names whose text is arithmetic without parentheses around it.

    Raises OSError for a file that cannot be read.
    """
    numbers: dict[str, Number] = {}
    operands: dict[str, Number] = {}  # those that mean the same number wherever their text is put
    unusable: dict[str, str] = {}
    for name, definition in _definitions(logical_lines(file.read_text(encoding="utf-8"))).items():
        text, enclosed = _without_parentheses(definition.text)
        if definition.fault:
            unusable[name] = definition.fault
        elif literal := LITERAL.fullmatch(text):
            numbers[name] = _literal(literal[1])
            if not literal[2] or literal[2] in "fF":
                operands[name] = numbers[name]
        elif definition.text:
            try:
                body = ast.parse(LITERAL.sub(_decimals, text), mode="eval").body
                numbers[name] = _value(body, operands)
            except (SyntaxError, ValueError, ArithmeticError):
                unusable[name] = f"is no number that Python computes: {definition.text}"
            else:
                if enclosed or not isinstance(body, ast.BinOp):
                    operands[name] = numbers[name]
    return Constants(file, numbers, unusable)


@dataclass(frozen=True)
class _Definition:
    """A `#define`: its text, empty for those with arguments; fault: why it has no one value, if so."""

    text: str
    fault: str = ""


def _definitions(lines: str) -> dict[str, _Definition]:
    """What a text of logical lines defines, by name."""
    found: dict[str, _Definition] = {}
    conditions: list[bool] = []  # of each #if that is open: whether what is below it may be another number elsewhere
    guard = ""
    for keyword, rest in DIRECTIVE.findall(lines):
        name, arguments, text = match.groups() if (match := DEFINITION.match(rest)) else ("", None, "")
        if keyword in ("if", "ifdef", "ifndef"):
            is_switch = keyword == "if" and rest.isidentifier() and rest not in found
            conditions.append(not is_switch)
        elif keyword in ("else", "elif"):
            conditions[-1:] = [True]
        elif keyword == "endif":
            conditions[-1:] = []
        elif keyword == "define" and name == guard and not text:
            conditions[-1:] = [False]
        elif keyword == "define":
            fault = "is defined more than once" if name in found else "is defined below a condition"
            found[name] = _Definition("" if arguments else text, fault if name in found or any(conditions) else "")
        elif keyword == "undef":
            found[name] = _Definition("", "is undefined again")
        guard = name if keyword == "ifndef" else ""
    return found


def _without_parentheses(text: str) -> tuple[str, bool]:
    """The text without those around the whole of it, and whether there were any."""
    if not (text.startswith("(") and text.endswith(")")):
        return text, False
    depths = list(accumulate((letter == "(") - (letter == ")") for letter in text))
    return (_without_parentheses(text[1:-1].strip())[0], True) if min(depths[:-1]) > 0 else (text, False)


def _decimals(literal: re.Match[str]) -> str:
    if literal[2] in ("u", "U"):
        raise ValueError("unsigned numbers wrap")
    return literal[1]


def _literal(text: str) -> Number:
    return int(text, 16) if text[:2] in ("0x", "0X") else int(text) if text.isdigit() else float(text)


def _value(expression: ast.expr, operands: Mapping[str, Number]) -> Number:
    match expression:
        case ast.Constant(value=int() | float() as literal) if not isinstance(literal, bool):
            return _in_range(literal)
        case ast.Name(id=name) if name in operands:
            return _in_range(operands[name])
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return _in_range(-_value(operand, operands))
        case ast.BinOp(left=left, op=operator, right=right):
            return _in_range(_result(_value(left, operands), operator, _value(right, operands)))
    raise ValueError("no arithmetic")


def _in_range(number: Number) -> Number:
    """The number itself, where an int or a float of C holds it."""
    if number not in INTS if isinstance(number, int) else not abs(number) <= LARGEST_FLOAT:
        raise ArithmeticError("C has another type or another value for it")
    return number


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
