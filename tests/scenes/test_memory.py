"""The memory that a process may have is the machine's, or what the tightest limit leaves of it."""

import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from shading_atlas_bench import memory
from shading_atlas_bench.scenes.memory import check_memory
from shading_atlas_bench.scenes.model import SceneError

OTHER = "22 1 0:20 / /proc rw,nosuid - proc proc rw\n30 22 0:28 / {}/cpu rw shared:9 - cgroup cgroup rw,cpu\n"
V2 = "31 22 0:26 {root} {{}} rw,nosuid shared:4 - cgroup2 cgroup2 rw,nsdelegate\n"
V1 = "35 22 0:32 {root} {{}}/memory rw,relatime shared:5 - cgroup cgroup rw,memory\n"


def process(folder: Path, mounts: str, groups: str, limits: dict[str, str]) -> Path:
    """What the kernel says of a process, with its groups' folders below `groups` and limits in some of their files."""
    for name, text in limits.items():
        file = folder / "groups" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f"{text}\n", encoding="ascii")
    (folder / "mountinfo").write_text((OTHER + mounts).replace("{}", str(folder / "groups")), encoding="utf-8")
    (folder / "cgroup").write_text(groups, encoding="utf-8")
    return folder


# What is mounted, the process' groups, limits in files, and the tightest.
GROUPS = {
    "none": ("", "0::/a\n", {}, None),
    "version 2": (V2.format(root="/"), "0::/a.slice/b.scope\n", {"a.slice/b.scope/memory.max": "700"}, 700),
    "above it": (V2.format(root="/"), "0::/a/b\n", {"a/b/memory.max": "700", "a/memory.max": "600"}, 600),
    "no limit": (V2.format(root="/"), "0::/a/b\n", {"a/b/memory.max": "max", "a/memory.max": "max"}, None),
    "of another": (V2.format(root="/"), "0::/a/b\n", {"a/c/memory.max": "700"}, None),
    "in a container": (V2.format(root="/"), "0::/\n", {"memory.max": "500"}, 500),
    "version 1": (
        V1.format(root="/"),
        "4:memory:/a/b\n1:cpu:/x\n",
        {"memory/a/b/memory.limit_in_bytes": "400", "memory/memory.limit_in_bytes": "9223372036854771712"},
        400,
    ),
    "version 1 in a container": (
        V1.format(root="/docker/1f"),
        "5:cpu,memory:/docker/1f\n",
        {"memory/memory.limit_in_bytes": "300"},
        300,
    ),
    "both": (
        V1.format(root="/") + V2.format(root="/"),
        "4:memory:/a\n0::/b\n",
        {"memory/a/memory.limit_in_bytes": "200", "b/memory.max": "max"},
        200,
    ),
}


@pytest.mark.parametrize("case", GROUPS)
def test_the_limit_of_a_control_group_is_found(tmp_path, case):
    mounts, groups, limits, least = GROUPS[case]
    assert memory.group_limit(process(tmp_path, mounts, groups, limits)) == least
    assert memory.group_limit(tmp_path / "none") is None


def test_the_tightest_bound_counts_and_is_named(monkeypatch):
    machine = psutil.virtual_memory().total
    for group, addresses, words in (
        (None, None, f"this machine's memory, {machine / 1e9:,.1f} GB"),
        (machine * 2, machine * 3, "this machine's memory"),
        (10**9, 2 * 10**9, r"the memory that its control group \(cgroup\) may have, 1\.0 GB: use a larger machine\."),
        (None, 10**9, r"the memory that a limit \(ulimit -v\) allows, 1\.0 GB"),
    ):
        monkeypatch.setattr(memory, "group_limit", lambda group=group: group)
        monkeypatch.setattr(memory, "address_limit", lambda addresses=addresses: addresses)
        half = min(group or machine, addresses or machine, machine) // 2
        check_memory(half, "This")
        with pytest.raises(SceneError, match=rf"^This takes .* GB, more than half of {words}"):
            check_memory(half + 1, "This")


@pytest.mark.skipif(sys.platform == "win32", reason="there is no ulimit here")
def test_a_file_that_the_limit_of_addresses_does_not_leave_room_for_is_refused(tmp_path):
    """A file with a hole of 1.1 GB, and 2 GB of addresses."""
    with (tmp_path / "a.stl").open("wb") as file:
        file.truncate(1_100_000_000)
    program = "import sys; from shading_atlas_bench.scenes.load import load_scene; load_scene(sys.argv[1])"
    command = f'ulimit -v {2_000_000_000 // 1024}; exec "$@"'
    arguments = ["sh", "-c", command, "sh", sys.executable, "-c", program, str(tmp_path / "a.stl")]
    told = subprocess.run(arguments, capture_output=True, check=False)
    assert b"a.stl takes 1.1 GB, more than half of the memory that a limit (ulimit -v) allows, 2.0 GB" in told.stderr
