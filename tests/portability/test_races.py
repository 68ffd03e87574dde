"""The kernels under Oclgrind: that what it finds is told."""

import shutil
import sys

import pytest

from tests.portability.races import EXPLAINED, MISSING, Race, check, races_in, under_oclgrind

needs_oclgrind = pytest.mark.skipif(not shutil.which("oclgrind"), reason=MISSING)

LOG = """
Write-write data race at global memory address 0x3000000000008
\tKernel: mark_visible
\t
\tFirst entity:  Global(1,0,0) Local(1,0,0) Group(0,0,0)
\tstore i8 1, i8 addrspace(1)* %arrayidx41, align 1, !dbg !88
\tAt line 24 (column 33) of input.cl:
\t  flags[row[i]] = 1;
\t
\tSecond entity: Global(3,0,0) Local(3,0,0) Group(0,0,0)
\tstore i8 1, i8 addrspace(1)* %arrayidx41, align 1, !dbg !88
\tAt line 24 (column 33) of input.cl:
\t  flags[row[i]] = 1;
\t

"""

PROGRAM = """
import numpy as np
from shading_atlas_bench.kernels.device import Device
import pyopencl as cl
device = Device.open("oclgrind")
kernel = cl.Program(device.context, '''{source}''').build(cache_dir=False).planted
device.launch("test", kernel, 64, device.zeros(64, np.int32))
device.finish()
"""
RACE = "kernel void planted(global int *a) {\n  a[0] = get_global_id(0);\n}"
BEYOND = "kernel void planted(global int *a) {\n  a[get_global_id(0) + 1] = 3;\n}"


def test_a_log_is_read():
    assert races_in(LOG) == [Race("mark_visible", "Write-write data race", "flags[row[i]] = 1;")]
    assert races_in(LOG)[0] in EXPLAINED
    assert races_in("") == []


@needs_oclgrind
@pytest.mark.parametrize(
    ("source", "what", "line"),
    [
        (RACE, "Write-write data race", "a[0] = get_global_id(0);"),
        (BEYOND, "Invalid write of size 4", "a[get_global_id(0) + 1] = 3;"),
    ],
)
def test_a_planted_fault_is_found(source, what, line):
    found, failure = under_oclgrind([sys.executable, "-W", "ignore", "-c", PROGRAM.format(source=source)])
    assert not failure
    assert found == [Race("planted", what, line)]


@needs_oclgrind
@pytest.mark.parametrize("name", ["common/scan", "raster/building", "snakebinning/counting"])
def test_cases_are_clean(name):
    assert check(name) == ([], "")
