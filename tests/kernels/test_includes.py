"""Files that a kernel includes: put in place here, whatever C allows in the line, and never by the driver."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from shading_atlas_bench.kernels.device import KERNEL, Device, source_with_includes
from shading_atlas_bench.kernels.runtime.opencl import DeviceError

OWN = "#define VALUE 7\n"
KERNEL_TEXT = "__kernel void k(__global int *out) { out[0] = VALUE; }\n"


@pytest.mark.parametrize(
    "line",
    [
        '#include "v.cl"',
        '#include"v.cl"',
        ' \t#\tinclude  "v.cl"  ',
        '#include "v.cl" // its value',
        '# include "v.cl" /* its\nvalue */',
        '/* its\nvalue */ #/**/include/**/"v.cl"',
        '#include \\\n "v.cl"',
        '// say "\n#include "v.cl"',
        '/* #include "gone.cl" */\n#include "v.cl"',
        '// #include "gone.cl" \\\n#include "gone.cl"\n#include "v.cl"',
    ],
)
def test_a_file_beside_it_is_taken_and_none_of_the_working_folder(
    device: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    folder, other = tmp_path / "own", tmp_path / "other"
    for place, text in ((folder, OWN), (other, "#define VALUE 8\n")):
        place.mkdir()
        (place / "v.cl").write_text(text, encoding="utf-8")
    monkeypatch.chdir(other)
    file = folder / "k.cl"
    file.write_text(f"{line}\n{KERNEL_TEXT}", encoding="utf-8")
    assert source_with_includes(file).count(OWN) == 1
    out = device.zeros(1, np.int32)
    device.launch("structs/k", device.build(file).k, 1, out, local=1)
    assert out.get()[0] == 7


@pytest.mark.parametrize(
    "line",
    [
        "#include <v.cl>",
        "#define FILE\n#include FILE",
        '#include "v.cl" further',
        '#inc\\\nlude "v.cl"',
        '%:include "v.cl"',
        '??=include "v.cl"',
        '#import "v.cl"',
        '#include_next "v.cl"',
    ],
)
def test_what_the_driver_would_look_for_is_refused(tmp_path: Path, line: str) -> None:
    (tmp_path / "v.cl").write_text(OWN, encoding="utf-8")
    (tmp_path / "k.cl").write_text(f"{line}\n{KERNEL_TEXT}", encoding="utf-8")
    with pytest.raises(DeviceError, match=r'k\.cl has the line .*: write #include "FILE", a file beside it or below'):
        source_with_includes(tmp_path / "k.cl")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "k.cl").write_text('#include "gone.cl"\n', encoding="utf-8")
    with pytest.raises(DeviceError, match=r"gone\.cl is missing"):
        source_with_includes(tmp_path / "k.cl")


@pytest.mark.parametrize(
    "head",
    [
        "__kernel void f(",
        "kernel\nvoid f (",
        "  __kernel __attribute__((reqd_work_group_size(1, 1, 1))) void f(",
        "__attribute__((vec_type_hint(float4))) __kernel void f(",
        "__kernel void __attribute__((reqd_work_group_size(1,1,1)))\n__attribute__((vec_type_hint(int))) f(",
    ],
)
def test_kernels_are_found_whatever_attributes_they_have(head: str) -> None:
    assert KERNEL.findall(f"inline int g(int a) {{ return a; }}\n{head}__global int *out) {{}}\n") == ["f"]
