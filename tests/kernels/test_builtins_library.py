"""The library of built-ins is the one that suits the compiler, on every kind of processor; answers are remembered."""

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from shading_atlas_bench.kernels.cache import CacheError
from shading_atlas_bench.kernels.runtime import builtins_library, vendors
from shading_atlas_bench.kernels.runtime.builtins_library import (
    NEEDS,
    Answer,
    Package,
    ask,
    fitting,
    remembered_answer,
)
from shading_atlas_bench.kernels.runtime.vendors import Vendors, find_vendors, how_to_get_one, make_home

ROOT = Path(__file__).parents[2]
ALL = list(NEEDS)
AVX2 = NEEDS["avx2"] | {"AVX", "F16C", "SSE4_1", "SSSE3", "SSE2"}
AVX512 = AVX2 | NEEDS["avx512"]


@pytest.mark.parametrize(
    ("library", "macros", "fits"),
    [
        ("avx2", AVX2 | {"CLWB"}, "avx2"),  # a processor that the compiler knows by name
        ("avx512", AVX2 | {"CLWB"}, "avx2"),  # AVX-512 under a name of one without: the two disagree
        ("avx512", AVX512 | {"CLWB"}, "avx512"),
        ("avx512", AVX512, "avx512"),  # without clwb: the library suits, kernels say that they may use it
        ("avx512", AVX2 | {"AVX512F"}, "avx2"),  # AVX-512 without the parts that the library uses
        ("avx2", NEEDS["avx"] | {"SSE4_1", "SSSE3", "SSE2"}, "avx"),
        ("sse2", frozenset({"SSE2"}), "sse2"),
        ("avx512", frozenset(), "avx512"),  # nothing is known that would be better
        ("avx10", AVX512, "avx10"),  # a library of a newer PoCL
    ],
)
def test_the_widest_library_that_the_compiler_has_registers_for(library, macros, fits):
    assert fitting(Answer("3.0", frozenset(macros), library), ALL) == fits


def test_only_libraries_that_are_there_are_taken():
    assert fitting(Answer("3.0", frozenset(AVX2), "avx512"), ["avx512", "sse2"]) == "sse2"


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Package:
    """A package as PyPI's, of empty files, and a cache of its own."""
    libraries, companions = tmp_path / "site/pyopencl/.libs", tmp_path / "site/pocl_binary_distribution/.libs"
    share = companions / "share" / "pocl"
    for folder in (libraries, share / "include"):
        folder.mkdir(parents=True)
    for file in (libraries / "libpocl-1.so", libraries / "libOpenCL-1.so.1", companions / "libhwloc.so.15"):
        file.write_text(file.name, encoding="utf-8")
    for level in ("avx512", "avx2", "sse2"):
        (share / f"kernel-x86_64-unknown-linux-gnu-{level}.bc").write_text(level, encoding="utf-8")
    made = Package(libraries, companions)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(vendors, "installed_package", lambda: made)
    monkeypatch.setattr(vendors, "intel_driver", lambda: None)
    return made


def answers(monkeypatch: pytest.MonkeyPatch, answer: Answer | None) -> list[Path]:
    """Let the compiler answer so; returns where it is asked."""
    asked: list[Path] = []

    def say(home: Path) -> Answer | None:
        asked.append(home)
        return answer

    monkeypatch.setattr(builtins_library, "ask", say)
    return asked


def builtins_seen_from(home: Path, level: str) -> str:
    """What the driver finds that the home's .icd file names, where it looks for this library."""
    driver = Path((home / ".libs" / "pocl.icd").read_text(encoding="utf-8"))
    share = Path(os.path.normpath(driver.parent / "../../pocl_binary_distribution/.libs/share/pocl"))
    return (share / f"kernel-x86_64-unknown-linux-gnu-{level}.bc").read_text(encoding="utf-8")


def test_a_library_that_does_not_suit_is_replaced_under_its_own_name(package, monkeypatch):
    asked = answers(monkeypatch, Answer("3.0", frozenset(AVX2), "avx512"))
    found = find_vendors()
    assert (found.library, found.mirrored, found.driver) == ("avx2", True, "3.0")
    assert found.home
    assert builtins_seen_from(found.home, "avx512") == "avx2"
    assert builtins_seen_from(found.home, "sse2") == "sse2"
    assert (found.home / "../pocl_binary_distribution/.libs/libhwloc.so.15").read_text(
        encoding="utf-8"
    ) == "libhwloc.so.15"
    assert find_vendors() == found
    assert len(asked) == 1  # the answer is remembered


@pytest.mark.parametrize("macros", [AVX512 | {"CLWB"}, AVX512])
def test_a_library_that_suits_is_left_alone(package, monkeypatch, macros):
    answers(monkeypatch, Answer("3.0", frozenset(macros), "avx512"))
    found = find_vendors()
    assert (found.library, found.mirrored) == ("avx512", False)
    assert found.home
    assert Path((found.home / ".libs" / "pocl.icd").read_text(encoding="utf-8")) == package.driver


def test_a_compiler_that_cannot_answer_is_left_alone_and_asked_again(package, monkeypatch):
    asked = answers(monkeypatch, None)
    assert find_vendors().library is None
    find_vendors()
    assert len(asked) == 2


def test_other_packages_and_other_processors_are_asked_anew(package, monkeypatch):
    asked = answers(monkeypatch, Answer("3.0", frozenset(AVX2), "avx512"))
    first = find_vendors()
    monkeypatch.setattr(builtins_library, "processor", lambda: "another one")
    find_vendors()
    assert len(asked) == 2
    (package.libraries / "libpocl-1.so").write_text("a newer one", encoding="utf-8")
    find_vendors()
    assert len(asked) == 3
    package.driver.rename(package.driver.with_name("libpocl-2.so"))
    assert find_vendors().home != first.home


@pytest.mark.parametrize("damage", ["{", "[]", '{"driver": "3.0", "macros": []}', ""])
def test_a_damaged_memory_is_asked_anew(package, monkeypatch, damage, tmp_path):
    asked = answers(monkeypatch, Answer("3.0", frozenset(AVX2), "avx512"))
    remembered_answer(package, tmp_path)
    (file,) = (tmp_path / "cache").rglob("answer-*.json")
    file.write_text(damage, encoding="utf-8")
    with pytest.warns(UserWarning, match="was damaged"):
        assert (answer := remembered_answer(package, tmp_path))
    assert answer.library == "avx512"
    assert len(asked) == 2
    assert (answer := remembered_answer(package, tmp_path))
    assert answer.library == "avx512"
    assert len(asked) == 2


@pytest.mark.parametrize("harm", ["gone", "elsewhere", "edited", "file"])
def test_a_damaged_home_is_made_again(package, monkeypatch, harm):
    answers(monkeypatch, Answer("3.0", frozenset(AVX2), "avx512"))
    home = find_vendors().home
    assert home
    link = home / ".libs" / package.driver.name
    if harm == "edited":
        (home / ".libs" / "pocl.icd").write_text("nowhere", encoding="utf-8")
    else:
        link.unlink()
        if harm == "elsewhere":
            link.symlink_to(package.libraries / "libOpenCL-1.so.1")
        elif harm == "file":
            link.write_text("", encoding="utf-8")
    assert find_vendors().home == home
    assert link.readlink() == package.driver
    assert builtins_seen_from(home, "avx512") == "avx2"


def test_two_runs_at_once_make_one_home(package):
    entries = {".libs/pocl.icd": "{home}/x", ".libs/link": package.driver}
    with ThreadPoolExecutor(8) as pool:
        homes = {*pool.map(lambda _: make_home(entries), range(64))}
    (home,) = homes
    assert (home / ".libs" / "pocl.icd").read_text(encoding="utf-8") == f"{home}/x"
    assert [entry.name for entry in home.parents[1].iterdir()] == [home.parent.name]


def test_a_home_that_cannot_be_made_is_one_sentence(package, monkeypatch):
    monkeypatch.setattr(vendors, "_fill", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(CacheError, match="No space left on device"):
        make_home({".libs/pocl.icd": "x"})


def test_intels_runtime_is_shown_beside_pocl(package, monkeypatch, tmp_path):
    asked = answers(monkeypatch, Answer("3.0", frozenset(AVX2), "avx2"))
    monkeypatch.setattr(vendors, "intel_driver", lambda: tmp_path / "libintelocl.so")
    home = find_vendors().home
    assert home
    assert [path.name for path in (asked[0] / ".libs").iterdir()] == ["pocl.icd"]  # Intel's is not to answer for it
    assert (home / ".libs" / "intel.icd").read_text(encoding="utf-8") == str(tmp_path / "libintelocl.so")
    assert (home / ".libs" / "pocl.icd").is_file()


@pytest.mark.parametrize(
    ("system", "machine", "words"),
    [
        ("linux", "x86_64", "pyopencl[pocl]"),
        ("linux", "aarch64", "pocl-opencl-icd"),
        ("win32", "AMD64", "intel-opencl-rt"),
        ("darwin", "arm64", "conda-forge"),
        ("freebsd14", "amd64", "an OpenCL runtime"),
    ],
)
def test_each_system_has_a_way_to_a_runtime(system, machine, words):
    assert words in how_to_get_one(system, machine)


def test_drivers_are_named_to_loaders_without_a_home_once_and_find_what_lies_beside_them(monkeypatch, tmp_path):
    driver = tmp_path / "Library" / "bin" / "intelocl64.dll"
    monkeypatch.setenv("PATH", "before")
    monkeypatch.setenv("OCL_ICD_FILENAMES", "other.dll")
    for _ in range(2):
        Vendors(files=(driver,)).show()
    assert os.environ["OCL_ICD_FILENAMES"] == f"{driver}{os.pathsep}other.dll"
    assert os.environ["PATH"].split(os.pathsep)[0] == str(driver.parent)


@pytest.mark.skipif(builtins_library.installed_package() is None, reason="the PoCL of PyPI is not installed")
def test_the_real_compiler_answers(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    package = builtins_library.installed_package()
    assert package
    home = make_home({".libs/pocl.icd": str(package.driver)})
    answer = ask(home)
    assert answer
    assert answer.library in package.builtins
    assert "SSE2" in answer.macros
    assert fitting(answer, package.builtins) in package.builtins
    shutil.rmtree(home)
    assert ask(home) is None  # nobody is there to answer


MIRRORED = """
import json
from shading_atlas_bench.kernels.cache import cache_folder, read_checked, write_checked
from shading_atlas_bench.kernels.runtime import builtins_library as library
from shading_atlas_bench.kernels.runtime.vendors import make_home
package = library.installed_package()
library.remembered_answer(package, make_home({".libs/pocl.icd": str(package.driver)}))
(file,) = cache_folder("opencl").glob("answer-*.json")
known = json.loads(read_checked(file)) | {"macros": ["AVX", "SSE2"]}  # as if the compiler knew no more
write_checked(file, json.dumps(known).encode())
from shading_atlas_bench.kernels.device import Device
from tests.kernels.test_elementary import test_the_bits_are_the_same_everywhere
device = Device.open("Portable")
test_the_bits_are_the_same_everywhere(device)
print(device.description["builtins"])
"""


@pytest.mark.skipif(
    builtins_library.installed_package() is None
    or " avx2 " not in f"{builtins_library.processor()} "
    or " avx512f " in builtins_library.processor(),
    reason="needs the PoCL of PyPI and a processor with AVX2 and no wider registers",
)
def test_kernels_run_with_a_library_in_place_of_another(tmp_path):
    """The whole way, as on a processor that the compiler does not know, with another library of equal registers."""
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path), "BENCH_DEVICE": ""}
    environment.pop("POCL_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, "-c", MIRRORED], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "avx, for its own does not suit its compiler\n"
