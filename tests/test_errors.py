"""Errors for people say one sentence that can be printed, whatever names are in it."""

import pytest
import typer

from shading_atlas_bench.errors import BenchError
from shading_atlas_bench.harness.cli.guard import guarded
from shading_atlas_bench.kernels.runtime.opencl import DeviceError
from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import SceneError

HOSTILE = "a\ud800\x1b[2J\u202e\nb"


def test_a_hostile_name_is_told_in_one_line_of_letters_that_can_be_written():
    with pytest.raises(SceneError) as raised:
        load_scene(HOSTILE)
    sentence = str(raised.value)
    assert sentence.encode()
    assert sentence.isprintable()
    assert r"a\ud800\x1b[2J\u202e\nb" in sentence


def test_a_sentence_says_what_to_do_however_long_a_name_in_it_is():
    sentence = str(SceneError(f"There is no scene {'a' * 10**6}: give another one."))
    assert sentence.startswith("There is no scene aaa")
    assert sentence.endswith("aaa: give another one.")
    assert len(sentence) < 2000


def test_a_log_keeps_its_lines():
    assert str(DeviceError("It does not build: ", log="line 1\nline 2\x1b")) == "It does not build: line 1\nline 2\\x1b"


def test_the_command_line_knows_all_of_them(capsys: pytest.CaptureFixture[str]):
    class OwnError(BenchError):
        """Of a module that the command line has never heard of."""

    with pytest.raises(typer.Exit) as ended, guarded():
        raise OwnError(HOSTILE)
    assert ended.value.exit_code == 2
    assert capsys.readouterr().err == "bench: a\\ud800\\x1b[2J\\u202e\\nb\n"
