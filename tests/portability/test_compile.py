"""What clang accepts for GPUs, and what `python -m tests.portability.compile` reads."""

import pytest

from shading_atlas_bench.kernels.device import KERNEL, kernel_names
from tests.portability.builds import Build, builds_of_cases
from tests.portability.compile import MISSING, TARGETS, Usage, compile_for, find_clang, parse_usage

needs_clang = pytest.mark.skipif(not find_clang(), reason=MISSING)
both_targets = pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)

PTXAS = """
ptxas info    : 0 bytes gmem
ptxas info    : Compiling entry function 'draw' for 'sm_75'
ptxas info    : Function properties for helper
    64 bytes stack frame, 4 bytes spill stores, 4 bytes spill loads
ptxas info    : Function properties for draw
    144 bytes stack frame, 8 bytes spill stores, 12 bytes spill loads
ptxas info    : Used 51 registers, used 0 barriers, 144 bytes cumulative stack size, 472 bytes cmem[0]
ptxas info    : Compiling entry function 'fill' for 'sm_75'
ptxas info    : Function properties for fill
    0 bytes stack frame, 0 bytes spill stores, 0 bytes spill loads
ptxas info    : Used 10 registers, 384 bytes cmem[0]
"""


@pytest.fixture(scope="module")
def builds() -> list[Build]:
    return builds_of_cases()


def test_cases_build_every_kernel(builds):
    noted = {f"{build.path}.{name}" for build in builds for name in KERNEL.findall(build.source)}
    assert set(kernel_names()) <= noted
    assert all("-cl-std=CL1.2" in build.options for build in builds)


@needs_clang
@both_targets
def test_clang_accepts_every_source(builds, target, tmp_path):
    clang = find_clang()
    assert clang
    for build in builds:
        assert compile_for(target, clang, build, tmp_path / "result", "-fsyntax-only") == ""


@needs_clang
@both_targets
def test_what_does_not_compile_is_told(target, tmp_path):
    called = Build("planted.cl", ("-cl-std=CL1.2",), "kernel void f(global int *a) { a[0] = missing(1); }")
    clang = find_clang()
    assert clang
    assert "missing" in compile_for(target, clang, called, tmp_path / "result")
    fine = Build("fine.cl", ("-cl-std=CL1.2", "-DN=3"), "kernel void f(global float *a) { a[N] = cbrt(a[0]); }")
    assert compile_for(target, clang, fine, tmp_path / "result") == ""
    assert (tmp_path / "result").stat().st_size > 100


def test_what_ptxas_says_is_read():
    expected = [Usage("name", "draw", 51, 144, 8, 12), Usage("name", "fill", 10, 0, 0, 0)]
    assert parse_usage("name", PTXAS) == expected
