"""Whatever dies or hangs under `bench`, the command ends with results and a sentence: packers, kernels, compilers."""

import csv
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from shading_atlas_bench.__main__ import main as bench_main
from shading_atlas_bench.harness.cli import supervisor
from shading_atlas_bench.harness.cli.supervisor import Supervisor
from shading_atlas_bench.harness.watch.ends import ended_by, overdue_steps, sentence_of
from shading_atlas_bench.kernels.journal import Journal, read_journal
from shading_atlas_bench.kernels.runtime.builtins_library import installed_package
from shading_atlas_bench.kernels.runtime.vendors import mirror
from tests.harness.commands import BAD, ROOT, bench
from tests.reports.synthetic import make_store

SMALL = ["run", "--frames", "3", "--size", "192x168", "--atlas", "256x256", "--codec", "none"]


def rows_of(folder: Path) -> dict[str, list[tuple[str, str]]]:
    """Status and reason of each frame, by method."""
    rows: dict[str, list[tuple[str, str]]] = {}
    with open(folder / "frames.csv", newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            rows.setdefault(row["method"], []).append((row["status"], row["reason"]))
    return rows


def test_packers_that_crash_or_hang_end_as_rows_and_stop_nobody_else(tmp_path: Path):
    folder = tmp_path / "run"
    names = ("Aborting", "AbortingBeside", "LeavingBeside", "Exiting", "Leaving")
    methods = [word for name in names for word in ("--method", f"{BAD}:{name}")]
    done = bench(*SMALL, *methods, "--method", "sas", "--out", str(folder))
    assert done.returncode == 1, done.stderr
    rows = rows_of(folder)
    assert [status for status, _ in rows["sas"]] == ["ok"] * 3
    assert [status for status, _ in rows["aborting"]] == ["ok", "ok", "failed"]
    assert rows["aborting"][2][1] == "frame 2: the process crashed (SIGABRT)."
    assert [status for status, _ in rows["aborting-beside"]] == ["failed"] * 3
    assert "measuring frame 0: the process crashed" in rows["aborting-beside"][0][1]
    assert [status for status, _ in rows["leaving-beside"]] == ["failed"] * 3
    assert "measuring frame 0: the process was ended with exit code 0" in rows["leaving-beside"][0][1]
    assert "Going on without it." in done.stderr
    assert [status for status, _ in rows["exiting"] + rows["leaving"]] == ["failed"] * 6
    assert "SystemExit: 0" in rows["exiting"][0][1]
    assert "the process was ended with exit code 0" in rows["leaving"][0][1]
    assert "leaving: warming up: the process was ended with exit code 0. Going on without it." in done.stderr


@pytest.mark.skipif(os.name == "nt", reason="needs a C library's sleep")
def test_a_hang_that_no_thread_can_interrupt_is_ended_from_outside(tmp_path: Path):
    folder = tmp_path / "run"
    done = bench(*SMALL, "--method", f"{BAD}:Holding", "--method", "sas", "--timeout", "2", "--out", str(folder))
    assert done.returncode == 1, done.stderr
    rows = rows_of(folder)
    assert [status for status, _ in rows["sas"]] == ["ok"] * 3
    assert rows["holding"] == [("timeout", "warming up: it took longer than --timeout 2 allows.")] * 3
    assert "bench: holding: warming up: it took longer than --timeout 2 allows. Going on without it." in done.stderr


def test_a_crash_beside_a_compiling_method_is_not_its_compilers(tmp_path: Path):
    folder, cache = tmp_path / "run", {"XDG_CACHE_HOME": str(tmp_path), "POCL_CACHE_DIR": str(tmp_path / "kernels")}
    done = bench(*SMALL, "--method", f"{BAD}:AbortingLater", "--method", "sas", "--out", str(folder), **cache)
    assert done.returncode == 1, done.stderr
    rows = rows_of(folder)
    assert [status for status, _ in rows["sas"]] == ["ok"] * 3
    assert [status for status, _ in rows["aborting-later"]] == ["failed"] * 3
    assert "passed over" not in done.stderr


@pytest.mark.skipif(os.name == "nt", reason="needs a C library's sleep")
def test_who_waits_for_a_hanging_method_is_not_blamed_for_it(tmp_path: Path):
    folder = tmp_path / "run"
    methods = ["--method", f"{BAD}:HoldingTheDevice", "--method", "sas"]
    done = bench(*SMALL, *methods, "--timeout", "1", "--out", str(folder))
    assert done.returncode == 1, done.stderr
    rows = rows_of(folder)
    assert [status for status, _ in rows["sas"]] == ["ok"] * 3
    assert [status for status, _ in rows["holding-the-device"]] == ["timeout"] * 3


def test_a_check_that_hangs_in_a_kernel_ends_with_a_sentence(tmp_path: Path):
    done = bench("check", f"{BAD}:Spinning", "--timeout", "1")
    assert done.returncode == 1
    assert "bench: spinning: check " in done.stderr
    assert "it took longer than 1 s." in done.stderr


@pytest.fixture
def unfit(tmp_path: Path) -> Path:
    """A folder of a PoCL whose library of built-ins has registers that this processor's compiler does not know."""
    package = installed_package()
    if package is None:
        pytest.skip("the PoCL of PyPI is not installed")
    if "avx512f" in Path("/proc/cpuinfo").read_text(encoding="utf-8"):
        pytest.skip("this processor has AVX-512, and so runs what others cannot")
    home = tmp_path / "pyopencl"
    for name, value in mirror(package, "avx2", "avx512").items():
        file = Path(os.path.normpath(home / name))
        file.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(value, str):
            file.write_text(value.replace("{home}", str(home)), encoding="utf-8")
        elif value == package.driver:
            shutil.copy(value, file)  # the loader takes links to one file for one driver
        else:
            file.symlink_to(value)
    return home / ".libs"


def test_a_compiler_that_dies_is_passed_over_from_then_on(unfit: Path, tmp_path: Path):
    cache = {
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
        "POCL_CACHE_DIR": str(tmp_path / "kernels"),
        "OCL_ICD_VENDORS": str(unfit),
        "BENCH_DEVICE": "",
    }
    done = bench(*SMALL, "--method", "sas", "--out", str(tmp_path / "first"), **cache)
    assert done.returncode == 0, done.stderr
    assert "Its kernel cache is thrown away, and it starts once more." in done.stderr
    assert "It is passed over from now on." in done.stderr
    assert "Used instead: " in done.stderr
    assert [status for status, _ in rows_of(tmp_path / "first")["sas"]] == ["ok"] * 3
    done = bench(*SMALL, "--method", "sas", "--out", str(tmp_path / "second"), **cache)
    assert done.returncode == 0, done.stderr
    assert "starts once more" not in done.stderr
    assert "Used instead: " in done.stderr


def journal_of(folder: Path) -> dict:
    state = read_journal(folder / "journal")
    assert state is not None
    return state


def journal_state(folder: Path, *, building: dict | None = None, ended: dict | None = None) -> dict:
    """What a process leaves that was at this."""
    journal = Journal(folder / "journal")
    journal.note(device={"key": "d", "name": "Device", "kernels": "k", "asked": False}, again=["--out", "there"])
    with journal.step("frame 1: m", 60, ended):
        if building:
            with journal.building(**building):
                return journal_of(folder)
        return journal_of(folder)


@pytest.fixture
def quiet(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "kernels").mkdir()
    monkeypatch.setattr("shading_atlas_bench.kernels.runtime.opencl.pocl_cache", lambda: tmp_path / "kernels")


ENDED = {"folder": "there", "method": "m", "variant": ""}
SEGV, ILL = -signal.SIGSEGV, -getattr(signal, "SIGILL", 4)


@pytest.mark.parametrize(
    ("code", "compiled", "ended", "codes", "died"),
    [
        (SEGV, False, ENDED, [None, None, 1], True),  # the compiler dies: again, passed over, and then in vain
        (SEGV, True, ENDED, [None, None], False),  # it ran, and a packer may have given it bad arguments
        (SEGV, True, None, [None, None, 1], True),  # nobody else is there to blame
        (ILL, True, ENDED, [None, None, 1], True),  # no argument makes an instruction illegal
        (1, False, ENDED, [None, None, 1], True),  # some compilers exit
    ],
)
def test_whose_fault_a_death_is(quiet, tmp_path, monkeypatch, code, compiled, ended, codes, died):
    monkeypatch.setattr(supervisor, "_compiled", lambda kernel: compiled)
    watched = Supervisor(["run"])
    watched.again = ["--out", "there"]
    state = journal_state(tmp_path, building={"what": "raster/tiles.draw", "kernel": "draw"}, ended=ended)
    assert [watched._judge(code, [], state) for _ in codes] == codes
    assert bool(list(tmp_path.rglob("died-d-k"))) == died
    (ended,) = watched.ended[:1]
    assert ended == ({"device": "d"} if died else ENDED) | {"status": "failed", "reason": ended["reason"]}


@pytest.mark.parametrize("building", [None, {"what": "raster/tiles.draw", "kernel": "draw"}])
@pytest.mark.parametrize("code", [SEGV, 1, 0, -9])
def test_suspects_side_by_side_are_tried_one_after_the_other(quiet, tmp_path, building, code):
    watched = Supervisor(["run"])
    watched.again = ["--out", "there"]
    state = journal_state(tmp_path, building=building, ended=ENDED)
    overdue = [*state["steps"].values()] if code == -9 else []
    state["steps"]["other"] = {
        **dict.fromkeys(("what", "who", "late"), "n"),
        "deadline": None,
        "ended": ENDED | {"method": "n"},
    }
    assert watched._judge(code, overdue, state) is None
    assert watched.serial
    assert watched.ended == []
    assert not watched.deaths


def test_a_kill_from_outside_blames_nobody(quiet, tmp_path, capsys):
    watched = Supervisor(["run"])
    watched.again = ["--out", "there"]
    assert watched._judge(-9, [], journal_state(tmp_path, ended=ENDED)) == 137
    assert watched.ended == []
    assert "memory" in capsys.readouterr().err


def test_only_steps_past_their_time_are_overdue(tmp_path):
    journal = Journal(tmp_path / "journal")
    with journal.step("slow", -1.0, ENDED), journal.step("fast", 60.0, ENDED), journal.step("endless"):
        overdue = overdue_steps(read_journal(tmp_path / "journal"))
    assert [step["what"] for step in overdue] == ["slow"]
    late = "slow: it did not end within -1 s."
    assert ended_by(overdue, "timeout") == [ENDED | {"status": "timeout", "reason": late}]
    assert sentence_of(overdue[0] | {"who": "m"}) == f"m: {late}"
    assert overdue_steps(read_journal(tmp_path / "journal")) == []
    assert overdue_steps(None) == []


def test_half_a_journal_is_none(tmp_path):
    journal = Journal(tmp_path / "journal")
    journal.note(again=["--out", "x" * 1000])
    content = (tmp_path / "journal").read_bytes()
    assert journal_of(tmp_path)["again"][1] == "x" * 1000
    for damaged in (content[:-1], content[:5], b"", content.replace(b"xx", b"xy", 1)):
        (tmp_path / "journal").write_bytes(damaged)
        assert read_journal(tmp_path / "journal") is None
    assert read_journal(tmp_path / "nowhere") is None


def test_a_shorter_state_leaves_nothing_of_the_longer_one(tmp_path):
    journal = Journal(tmp_path / "journal")
    journal.note(again=["x" * 1000])
    journal.note(again=["y"])
    assert journal_of(tmp_path)["again"] == ["y"]


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="asks Linux for the children of a process")
def test_the_watched_process_ends_with_its_supervisor(tmp_path: Path):
    command = [sys.executable, "-m", "shading_atlas_bench", *SMALL, "--frames", "600", "--out", str(tmp_path / "run")]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    until = time.monotonic() + 60
    while not children.read_text(encoding="utf-8") and time.monotonic() < until:
        os.sched_yield()
    process.kill()
    out, _ = process.communicate(timeout=60)  # ends when nobody has its standard output open any more
    assert b"report.html" not in out


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="asks Linux for the children of a process")
def test_ctrl_c_ends_in_one_line_while_everything_is_imported(tmp_path: Path):
    """A terminal sends it to all processes, compilers among them."""
    command = [sys.executable, "-m", "shading_atlas_bench", *SMALL, "--out", str(tmp_path / "run")]
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    ) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        until = time.monotonic() + 60
        while not children.read_text(encoding="utf-8") and time.monotonic() < until:
            os.sched_yield()
        os.killpg(process.pid, signal.SIGINT)
        said, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said == "bench: Stopped.\n"


def test_so_does_one_that_comes_earlier(monkeypatch, capsys):
    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(supervisor, "main", interrupted)
    with pytest.raises(SystemExit) as ended:
        bench_main()
    assert ended.value.code == 130
    assert capsys.readouterr().err == "bench: Stopped.\n"


def test_who_does_not_end_when_told_to_is_ended_within_five_seconds():
    """A process that hangs in a compiler, or is stopped, does not hear of TERM."""
    deaf = (
        "import signal; from shading_atlas_bench.harness.cli import supervisor;"
        "supervisor.COMMAND_LINE = 'tests.harness.deaf';"
        "raise SystemExit(supervisor.Supervisor(['run']).run())"
    )
    with subprocess.Popen([sys.executable, "-c", deaf], cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        child = int(process.stdout.readline())
        process.terminate()
        start = time.monotonic()
        assert process.wait(timeout=60) == supervisor.INTERRUPTED
    assert time.monotonic() - start < 5.5
    assert not Path(f"/proc/{child}").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device here")
@pytest.mark.parametrize("arguments", [["report"], ["compare"], ["--version"]])
def test_standard_output_on_a_full_disk_is_named(arguments: list[str], tmp_path: Path):
    make_store(tmp_path, frames=2)
    folders = {"report": [str(tmp_path)], "compare": [str(tmp_path)] * 2}.get(arguments[0], [])
    command = [sys.executable, "-m", "shading_atlas_bench", *arguments, *folders]
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = subprocess.run(command, cwd=ROOT, stdout=full, stderr=subprocess.PIPE, text=True, timeout=300)
    assert done.returncode == 2
    assert done.stderr.startswith("bench: standard output cannot be written (No space left on device): make room")
    assert done.stderr.count("\n") == 1


def test_a_kernel_cache_without_room_is_named_and_no_device_blamed(quiet, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("shading_atlas_bench.kernels.runtime.kernel_cache.refuses", lambda folder: "disk full")
    state = journal_state(tmp_path, building={"what": "raster/tiles.draw", "kernel": "draw"})
    assert Supervisor(["run"])._judge(SEGV, [], state) == 1
    assert "Its kernel cache" in capsys.readouterr().err
    assert not list(tmp_path.rglob("died-*"))
