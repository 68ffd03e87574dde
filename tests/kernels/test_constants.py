"""Constants that Python reads from a kernel's file."""

from __future__ import annotations

from pathlib import Path

import pytest

from shading_atlas_bench.kernels.constants import Constants, constants_of

SOURCE = """#include "common/wide.cl"
#define ANGLES 30 // bins
#define COLUMN 1504
#define BINS (ANGLES * ANGLES * COLUMN)
#define SAME ANGLES
#define NO_KEY 0xFFFFFFFFu
#define FAR_AWAY 0x7FFFFFFF /* never reached */
#define BIT (1 << 30)
#define FLATTEST 3.7320508f // cot 15 degrees
#define OBTUSE -0.22f
#define UNPLACED -4
#define TINY 4.5e-3f
#define GUARD 4194048.0f
#define THIRD (1.0f / 3.0f)
#define QUOTIENT (-7 / 2)
#define SUM (2 + 3 * 4 - 1)
#define SHIFTED (1 << 2 + 3)
#define SHAPE (ushort4)(0, 8, 8, 0)
#define INLINE __attribute__((always_inline)) static inline
#define EARLY (LATE + 1)
#define LATE 1
#define BY_ZERO (1 / 0)
#define EMPTY
#define SIZE_OF(a) (a)
  #  define INDENTED 3
#if WIDE
#define STREAM 1
#else
#define STREAM 0
#endif
"""


@pytest.fixture
def constants(tmp_path: Path) -> Constants:
    file = tmp_path / "stage.cl"
    file.write_text(SOURCE, encoding="utf-8")
    return constants_of(file)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ANGLES", 30),
        ("BINS", 30 * 30 * 1504),
        ("SAME", 30),
        ("NO_KEY", 4294967295),
        ("FAR_AWAY", 2147483647),
        ("BIT", 1073741824),
        ("UNPLACED", -4),
        ("GUARD", 4194048),
        ("QUOTIENT", -3),
        ("SUM", 13),
        ("SHIFTED", 32),
        ("INDENTED", 3),
    ],
)
def test_whole_numbers(constants: Constants, name: str, value: int) -> None:
    whole = constants.whole(name)
    assert (type(whole), whole) == (int, value)


@pytest.mark.parametrize(
    ("name", "value"),
    [("FLATTEST", 3.7320508), ("OBTUSE", -0.22), ("TINY", 0.0045), ("THIRD", 1 / 3), ("ANGLES", 30.0)],
)
def test_numbers_are_their_decimals_in_float64(constants: Constants, name: str, value: float) -> None:
    number = constants.number(name)
    assert (type(number), number) == (float, value)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("MISSING", "is not defined"),
        ("EMPTY", "is not defined"),
        ("SIZE_OF", "is not defined"),
        ("SHAPE", "is no number that Python computes"),
        ("INLINE", "is no number that Python computes"),
        ("EARLY", "is no number that Python computes: .LATE"),
        ("BY_ZERO", "is no number that Python computes"),
        ("STREAM", "is defined more than once"),
        ("FLATTEST", "is no whole number"),
    ],
)
def test_anything_else_is_refused(constants: Constants, name: str, reason: str) -> None:
    with pytest.raises(ValueError, match=rf"stage\.cl: {name} .*{reason}"):
        constants.whole(name)


@pytest.mark.parametrize(
    ("source", "value"),
    [
        ("#define A 1 + 2", 3),
        ("#define A 5 /* x */ + 2", 7),
        ("#define A (1 + \\\n 2) // 3", 3),
        ("#define B (1 + 2)\n#define A B * 3", 9),
        ("#define B -4\n#define A (3 - B)", 7),
        ("#define B ((7))\n#define A (B * B)", 49),
        ("#define A (0xFFFFFFFFu)", 4294967295),
        ("#define A ((1 + 2) * (3 + 4))", 21),
        ("#define A (-2147483647 - 1)", -2147483648),
        ("// #define A 1\n/*\n#define A 2\n*/\n#define A 3", 3),
        ("#ifndef K_CL\n#define K_CL\n#if WIDE\n#define X 1\n#endif\n#define A 3\n#endif", 3),
        ("#if WIDE\n#define A 3\n#endif", 3),
        ("#if 0\n#elif 1\n#endif\n#define A 3", 3),
        ("#define A 16777218.0f", 16777218),
    ],
)
def test_what_is_read_is_what_c_has(tmp_path: Path, source: str, value: int) -> None:
    assert _read(tmp_path, source).whole("A") == value


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("#define B 1 + 2\n#define A (B * 3)", "is no number that Python computes"),
        ("#define B (1) + (2)\n#define A (B * 3)", "is no number that Python computes"),
        ("#define A (3u - 5u)", "is no number that Python computes"),
        ("#define B 3u\n#define A (B - 5)", "is no number that Python computes"),
        ("#define A -3u", "is no number that Python computes"),
        ("#define A (0xFFFFFFFF + 1)", "is no number that Python computes"),
        ("#define A (65536 * 65536)", "is no number that Python computes"),
        ("#define A (1 << 31)", "is no number that Python computes"),
        ("#define A (1e30f * 1e30f)", "is no number that Python computes"),
        ("#define A True", "is no number that Python computes"),
        ("#if 0\n#define A 5\n#endif", "is defined below a condition"),
        ("#define WIDE 0\n#if WIDE\n#define A 5\n#endif", "is defined below a condition"),
        ("#if WIDE\n#else\n#define A 5\n#endif", "is defined below a condition"),
        ("#ifdef WIDE\n#define A 5\n#endif", "is defined below a condition"),
        ("#ifndef A\n#define A 5\n#endif", "is defined below a condition"),
        ("#ifndef K_CL\n#define K_CL\n#else\n#define A 5\n#endif", "is defined below a condition"),
        ("#define A 5\n#undef A", "is undefined again"),
        ("#define B 5\n#define A (B + 1)\n#undef B", "is no number that Python computes"),
        ("#define A 5\n#define A(x) 5", "is defined more than once"),
        ("/*\n#define A 5\n*/", "is not defined"),
        ("#define A 16777217.0f", "is 16777217, which the kernel's float32 rounds"),
    ],
)
def test_what_c_has_otherwise_is_refused(tmp_path: Path, source: str, reason: str) -> None:
    with pytest.raises(ValueError, match=f"A {reason}"):
        _read(tmp_path, source).whole("A")


def _read(folder: Path, source: str) -> Constants:
    (folder / "k.cl").write_text(source + "\n", encoding="utf-8")
    return constants_of(folder / "k.cl")


def test_a_file_is_read_once(constants: Constants) -> None:
    assert constants_of(constants.file) is constants
