"""Rules of OpenCL C 1.2 that drivers forgive and others do not."""

import re

import pytest

from shading_atlas_bench.kernels.device import kernel_files, stage_name

COMMENT = re.compile(r"//.*")
DOUBLES = re.compile(r"\b(?:convert_)?double\d*\b")
ASKS = re.compile(r"^#pragma OPENCL EXTENSION cl_khr_fp64 : enable$", re.MULTILINE)


def faults_of(source: str) -> list[str]:
    """What a source does that not every OpenCL takes."""
    code = COMMENT.sub("", source)
    faults = []
    if re.search(r"(?<!static )\binline\b", code):
        faults.append("inline without static: C99 (6.7.4p7) gives calls that are not inlined no body")
    asked = ASKS.search(code)
    used = DOUBLES.search(code)
    if used and not (asked and asked.start() < used.start()):
        faults.append("double without #pragma OPENCL EXTENSION cl_khr_fp64 : enable before it")
    return faults


@pytest.mark.parametrize("path", kernel_files(), ids=stage_name)
def test_sources_keep_to_the_language(path):
    assert faults_of(path.read_text(encoding="utf-8")) == []


def test_faults_are_found():
    assert faults_of("// inline double\nstatic inline int f(void);\n") == []
    assert len(faults_of("__attribute__((always_inline)) inline int f(void);")) == 1
    assert len(faults_of("double8 a;")) == 1
    assert len(faults_of("double8 a;\n#pragma OPENCL EXTENSION cl_khr_fp64 : enable\n")) == 1
    assert faults_of("#pragma OPENCL EXTENSION cl_khr_fp64 : enable\ndouble8 a = convert_double8(b);\n") == []
