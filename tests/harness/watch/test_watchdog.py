"""Time limits: raised inside their block and nowhere else, in whatever thread."""

import contextlib
import json
import subprocess
import sys
import threading
from types import SimpleNamespace
from typing import Any

import pytest

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.run.loop import Run
from shading_atlas_bench.harness.watch.watchdog import (
    ENDED,
    PackTimeoutError,
    _Alarm,
    answer_within,
    ended_steps,
    time_limit,
)
from shading_atlas_bench.harness.workload.settings import Settings


def busy(rounds: int = 10**9) -> None:
    for _ in range(rounds):
        pass


def test_a_loop_is_ended_in_any_thread():
    ended = []

    def loop() -> None:
        try:
            with time_limit(0.05, "looping"):
                busy()
        except PackTimeoutError:
            ended.append(threading.current_thread().name)  # numbers are used again once a thread has ended

    threads = [threading.Thread(target=loop) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert len(set(ended)) == 3


def test_an_alarm_that_is_off_raises_nothing():
    alarm = _Alarm(threading.get_ident())
    alarm.switch_on()
    alarm.switch_off()
    alarm.ring()
    busy(1000)
    assert alarm._rang


def test_one_that_rang_before_its_block_raises_in_it():
    with pytest.raises(PackTimeoutError), time_limit(0.0, "nothing"):
        busy()


def test_the_error_says_what_the_limit_was_wherever_it_is_caught():
    with time_limit(0.05, "looping"), pytest.raises(PackTimeoutError, match=r"^it took longer than 0\.05 s\.$"):
        busy()
    with time_limit(0.05, "looping", late="it slept"), pytest.raises(PackTimeoutError, match=r"^it slept\.$"):
        busy()


def test_what_hangs_is_told_of_whatever_its_code_makes_of_the_error():
    def hang() -> None:
        try:
            busy()
        except PackTimeoutError:
            raise KeyError("of its own") from None

    sentence = r"^mine cannot be used: making it took longer than 0\.05 s\.$"
    with pytest.raises(InputError, match=sentence), answer_within(0.05, "mine", "making it"):
        hang()
    with pytest.raises(KeyError), answer_within(60, "mine", "making it"):
        raise KeyError("at once")


def test_a_profiler_sees_it_end() -> None:
    program = """
import sys
from shading_atlas_bench.harness.watch.watchdog import time_limit
sys.setprofile(lambda *event: None)
with time_limit(60, "profiled"):
    pass
"""
    assert subprocess.run([sys.executable, "-c", program], timeout=60, check=False).returncode == 0


def test_steps_that_ended_are_found_by_their_facts(tmp_path, monkeypatch):
    assert ended_steps() == []
    many = [{"folder": "x" * 200, "method": "m", "step": k, "status": "failed", "reason": "r"} for k in range(1000)]
    (tmp_path / "ended").write_text(json.dumps(many), encoding="utf-8")
    monkeypatch.setenv(ENDED, str(tmp_path / "ended"))
    assert ended_steps(method="m", step=999) == [many[-1]]
    assert ended_steps(method="n") == []


def test_preparing_may_take_ten_packings_and_warming_up_three(monkeypatch):
    asked = []

    @contextlib.contextmanager
    def limit(seconds, what, ended, *, who, late):
        assert (who, late) == ("m", "it took longer than --timeout 6 allows")
        asked.append((seconds, what))
        yield

    monkeypatch.setattr("shading_atlas_bench.harness.run.loop.time_limit", limit)
    packer = SimpleNamespace(skip=lambda host: "", rare_costs=lambda: ())
    pipeline: Any = SimpleNamespace(
        packer=packer, dead=None, method="m", variant="v", prepare=lambda: 1.0, warm_up=lambda *_: None
    )
    runs: Any = Run.__new__(Run)
    runs.frames, runs.settings, runs.tried, runs.folder = 2, Settings(timeout=6.0), 1, "folder"
    runs.session = SimpleNamespace(scene=SimpleNamespace(host=None), source=SimpleNamespace(work=None))
    runs.store = SimpleNamespace(notes={})
    runs._prepare(pipeline, finished=0)
    assert pipeline.dead is None
    assert asked == [(6.0, "preparing"), (60.0, "preparing"), (18.0, "warming up")]
