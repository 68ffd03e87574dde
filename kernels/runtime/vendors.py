"""What the OpenCL loader is shown beside the system's runtimes: the PoCL of pip, mirrored if need be, and Intel's.

pyopencl's loader reads `.icd` files from the `.libs` folder of pyopencl's home, and from the system's folder (or the
one that OCL_ICD_VENDORS names), which is left as it is. The home is replaced by a folder in the cache, named after all
that it was made from.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import platform
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from shading_atlas_bench.kernels.cache import CacheError, cache_folder
from shading_atlas_bench.kernels.runtime.builtins_library import (
    Package,
    fitting,
    installed_package,
    remembered_answer,
)

# Below an environment's prefix; the .icd files that Intel ships name a path of their build machine.
INTEL = ("lib/libintelocl.so", "Library/bin/intelocl64.dll", "Library/lib/intelocl64.dll")
Entries = dict[str, str | Path]  # by path within the home: a file's text, or what a link points to


@dataclass(frozen=True)
class Vendors:
    """What the loader is shown.

    home: to be taken as pyopencl's home; None where nothing is to be added. files: drivers for loaders that know no
    home (Windows). driver: the version of pip's PoCL. library: of the built-ins that it links. mirrored: whether that
    is not its own choice.
    """

    home: Path | None = None
    files: tuple[Path, ...] = ()
    driver: str | None = None
    library: str | None = None
    mirrored: bool = False

    def show(self) -> None:
        """Tell the loader; after pyopencl is imported, which sets its home itself, and before it is first used."""
        if self.home:
            os.environ["PYOPENCL_HOME"] = str(self.home)
        if self.files:
            known = os.environ.get("OCL_ICD_FILENAMES", "")
            missing = [str(file) for file in self.files if str(file) not in known]
            os.environ["OCL_ICD_FILENAMES"] = os.pathsep.join([*missing, *filter(None, [known])])
            # What a driver needs lies beside it, where Windows looks only by PATH.
            folders = [str(file.parent) for file in self.files]
            os.environ["PATH"] = os.pathsep.join([*folders, os.environ.get("PATH", "")])


def find_vendors() -> Vendors:
    """Find pip's PoCL and Intel's runtime in this environment, and make the folder that shows them."""
    package = installed_package()
    intel = intel_driver()
    if os.name == "nt":
        return Vendors(files=(intel,) if intel else ())
    entries: Entries = {".libs/intel.icd": str(intel)} if intel else {}
    if package is None:
        return Vendors(make_home(entries)) if entries else Vendors()
    alone: Entries = {".libs/pocl.icd": str(package.driver)}  # a home in which nobody else could answer
    answer = remembered_answer(package, make_home(alone))
    if answer is None:
        return Vendors(make_home(entries | alone))
    library = fitting(answer, package.builtins)
    if library == answer.library:
        return Vendors(make_home(entries | alone), (), answer.driver, library)
    mirrored = make_home(entries | mirror(package, answer.library, library))
    return Vendors(mirrored, (), answer.driver, library, True)


def intel_driver() -> Path | None:
    """Intel's runtime in this environment; None where it is not installed."""
    return next((file for name in INTEL if (file := Path(sys.prefix) / name).is_file()), None)


def how_to_get_one(system: str = sys.platform, machine: str | None = None) -> str:
    """How to get a runtime for any processor of such a system, to follow a colon: what README.md says under Start."""
    machine = (machine or platform.machine()).lower()
    if system == "linux" and machine == "x86_64":
        return "pip install 'pyopencl[pocl]' brings one for any CPU"
    if system == "linux":
        return "install PoCL (Debian, Ubuntu: apt install pocl-opencl-icd)"
    if system == "win32" and machine == "amd64":
        return "pip install intel-opencl-rt intel-cmplr-lib-rt brings one for any CPU"
    if system == "darwin":
        return "install PoCL (conda install -c conda-forge pyopencl pocl)"
    return "install an OpenCL runtime"


def mirror(package: Package, wanted: str, library: str) -> Entries:
    """Links that mirror the package, with `library` where the driver looks for the library `wanted`.

    The driver looks for its library relative to where it was loaded from, so the links keep the package's folders.
    """
    builtins = package.builtins
    links: Entries = {f".libs/{file.name}": file for file in package.libraries.glob("*.so*")}
    for file in package.companions.iterdir():
        if file.is_file():
            links[f"../pocl_binary_distribution/.libs/{file.name}"] = file
    share = "../pocl_binary_distribution/.libs/share/pocl"
    for file in (package.companions / "share" / "pocl").iterdir():
        target = builtins[library] if file == builtins[wanted] else file
        links[f"{share}/{file.name}"] = target
    links[".libs/pocl.icd"] = "{home}/.libs/" + package.driver.name
    return links


def make_home(entries: Entries) -> Path:
    """The folder of these files and links, made if it is missing or damaged; safe for several processes at once.

    `{home}` in a text stands for the folder's own path. Raises CacheError if it cannot be made.
    """
    text = json.dumps({name: str(value) for name, value in entries.items()}, sort_keys=True)
    root = cache_folder("opencl") / f"home-{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    home = root / "pyopencl"
    if _is_whole(home, entries):
        return home
    made = Path(tempfile.mkdtemp(dir=root.parent, suffix=".part"))
    try:
        _fill(made / "pyopencl", home, entries)
        if not _is_whole(home, entries):
            shutil.rmtree(root, ignore_errors=True)
            with contextlib.suppress(OSError):  # another process was faster
                made.rename(root)
    except OSError as error:
        raise CacheError(f"{root} cannot be made ({error.strerror}): set XDG_CACHE_HOME to another folder.") from error
    finally:
        shutil.rmtree(made, ignore_errors=True)
    if not _is_whole(home, entries):
        raise CacheError(f"{root} cannot be made: delete it, or set XDG_CACHE_HOME to another folder.")
    return home


def _fill(folder: Path, home: Path, entries: Entries) -> None:
    for name, value in entries.items():
        file = Path(os.path.normpath(folder / name))
        file.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(value, Path):
            file.symlink_to(value)
        else:
            file.write_text(value.replace("{home}", str(home)), encoding="utf-8")


def _is_whole(home: Path, entries: Entries) -> bool:
    return all(_is_as(Path(os.path.normpath(home / name)), home, value) for name, value in entries.items())


def _is_as(file: Path, home: Path, value: str | Path) -> bool:
    try:
        if isinstance(value, Path):
            return file.readlink() == value and file.exists()
        return file.read_bytes() == value.replace("{home}", str(home)).encode()
    except OSError:
        return False
