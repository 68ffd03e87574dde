"""PoCL's cache of kernels: what is damaged is thrown away, the rest stays, and nobody's work is lost."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest

from shading_atlas_bench.kernels.runtime import kernel_cache
from shading_atlas_bench.kernels.runtime.kernel_cache import SEAL, discard, heal, refuses, seal

ROOT = Path(__file__).parents[2]
FILES = ("AB/ONE/program.bc", "AB/ONE/draw/64-1-1/draw.so", "AB/ONE/last_accessed", "CD/TWO/program.bc")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A sealed cache of two programs."""
    rng = np.random.default_rng(0)
    for name in FILES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(rng.bytes(3000))
    seal(tmp_path)
    return tmp_path


def programs(folder: Path) -> set[str]:
    return {path.name for path in folder.glob("*/*")}


def test_what_is_whole_stays(folder: Path):
    assert heal(folder) == 0
    assert programs(folder) == {"ONE", "TWO"}


@pytest.mark.parametrize("name", [FILES[0], FILES[1]])
@pytest.mark.parametrize("harm", ["flip", "empty", "half", "longer", "folder"])
def test_what_is_damaged_goes_and_takes_its_program(folder: Path, name: str, harm: str):
    file = folder / name
    content = bytearray(file.read_bytes())
    if harm == "folder":
        file.unlink()
        file.mkdir()
    else:
        content[1500] ^= harm == "flip"
        file.write_bytes(bytes({"empty": b"", "half": content[:1500], "longer": content + b"x"}.get(harm, content)))
    assert heal(folder) == 1
    assert programs(folder) == {"TWO"}
    seal(folder)
    assert heal(folder) == 0


@pytest.mark.parametrize("damage", [b"", b"{", b"[]", b'{"crc": 0, "files": {}}', b"\xff\xfe"])
def test_under_a_damaged_seal_nothing_is_believed(folder: Path, damage: bytes):
    (folder / SEAL).write_bytes(damage)
    heal(folder)
    assert programs(folder) == set()


def test_a_damaged_seal_of_one_file_shows(folder: Path):
    content = (folder / SEAL).read_text(encoding="utf-8")
    (folder / SEAL).write_text(content.replace("3000", "3001", 1), encoding="utf-8")
    heal(folder)
    assert programs(folder) == set()


def test_files_of_a_killed_process_stay_unless_the_system_started_since(folder: Path):
    for name in ("EF/KILLED/program.bc", "GH/TORN/program.bc", "IJ/EMPTY/program.bc"):
        (folder / name).parent.mkdir(parents=True)
        (folder / name).write_bytes(b"" if "EMPTY" in name else b"code")
    before = psutil.boot_time() - 60
    os.utime(folder / "GH/TORN/program.bc", (before, before))
    assert heal(folder) == 2
    assert programs(folder) == {"ONE", "TWO", "KILLED"}


def test_a_cache_that_cannot_be_read_is_no_error(tmp_path: Path):
    assert heal(tmp_path / "nowhere") == 0
    seal(tmp_path / "nowhere")
    discard(tmp_path / "nowhere")
    assert not (tmp_path / "nowhere").exists()


def test_only_a_kernel_compiled_since_then_counts(folder: Path):
    written = (folder / FILES[1]).stat().st_mtime
    assert kernel_cache.holds(folder, "draw", written)
    assert not kernel_cache.holds(folder, "draw", written + 1)
    assert not kernel_cache.holds(folder, "other", written)


def test_discarding_leaves_nothing(folder: Path):
    discard(folder)
    assert list(folder.iterdir()) == []


PROGRAM = """
import numpy as np
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.kernels.doctor.smoke import DEGREE, smoke, smoke_twin
device = Device.open()
x, c = np.linspace(-1, 1, 4096).astype(np.float32), np.ones(DEGREE + 1, np.float32)
values, hashes = smoke(device, x, c)
expected, true_hashes = smoke_twin(x, c)
assert abs(values - expected).max() < 1e-5 and np.array_equal(hashes, true_hashes)
"""


@pytest.mark.parametrize("harm", ["flip code", "flip program", "empty program", "empty code", "half", "no permission"])
def test_a_real_cache_that_is_damaged_is_made_again(tmp_path: Path, harm: str):
    """The same process as a user's: it must neither fail nor compute anything else."""

    def compute() -> None:
        environment = os.environ | {"POCL_CACHE_DIR": str(tmp_path), "BENCH_DEVICE": "Portable"}
        command = [sys.executable, "-c", PROGRAM]
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        if "No OpenCL device matches" in done.stderr:
            pytest.skip("there is no PoCL here")
        assert done.returncode == 0, done.stderr
        assert done.stderr == ""

    compute()
    kind = ".bc" if "program" in harm else ".so"
    files = [tmp_path / name for name in kernel_cache._files(tmp_path) if name.endswith(kind)]
    assert files
    for file in files:
        content = bytearray(file.read_bytes())
        for place in range(len(content) // 3, len(content), 97):
            content[place] ^= 0x55 if "flip" in harm else 0
        file.write_bytes(b"" if "empty" in harm else content[: len(content) // 2] if harm == "half" else content)
        if harm == "no permission":
            file.chmod(0)
    compute()
    assert heal(tmp_path) == 0


def test_a_folder_without_room_for_a_kernel_says_why(tmp_path: Path):
    resource = pytest.importorskip("resource", reason="files can be limited under Unix only")
    assert refuses(tmp_path) is None
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 16, hard))
    try:
        assert refuses(tmp_path) == "File too large"
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(tmp_path.iterdir()) == []
    assert refuses(tmp_path / "nowhere") == "No such file or directory"
