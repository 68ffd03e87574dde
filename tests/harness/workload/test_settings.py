"""Options of a run: what is refused, and that a saved run reads back the same."""

import json

import pytest

from shading_atlas_bench.harness.workload.presets import LINKED_LISTS as LISTS
from shading_atlas_bench.harness.workload.presets import PRESETS
from shading_atlas_bench.harness.workload.settings import (
    Settings,
    SettingsError,
    parse_cell,
    parse_crfs,
    parse_size,
    parse_unit,
    read_settings,
    settings_of,
)


@pytest.mark.parametrize(
    ("values", "option"),
    [
        ({"frames": 0}, "--frames"),
        ({"width": 8}, "--size"),
        ({"atlas_width": 10000}, "--atlas"),
        ({"fov": 0.5}, "--fov"),
        ({"fov": 90, "cell_fov": 80}, "field of view"),
        ({"cell_radius": -1}, "radius"),
        ({"latency": -5}, "--latency"),
        ({"codec": "av1"}, "--codec"),
        ({"crf": (60,)}, "--crf"),
        ({"crf": ()}, "--crf"),
        ({"unit": 0}, "--unit"),
        ({"unit": float("inf")}, "--unit"),
        ({"decimate": 1.5}, "--decimate"),
        ({"repeat": 0}, "--repeat"),
        ({"timeout": 0}, "--timeout"),
        ({"fov": float("nan")}, "--fov"),
        ({"timeout": float("inf")}, "--timeout is inf: give 0.001 to 1,000,000 seconds"),
        ({"timeout": 1e10}, "--timeout"),
        ({"timeout": float("nan")}, "--timeout"),
        ({"cell_radius": float("inf")}, "radius"),
        ({"bandwidth": 1e-300}, "--bandwidth"),
        ({"repeat": 10**400}, "--repeat"),
        ({"frames": 10**400}, "--frames"),
        ({"unit": 1e300}, "--unit"),
        ({"scene": "a\0b"}, "zero"),
    ],
)
def test_unusable_values_are_refused_by_the_option_s_name(values, option):
    with pytest.raises(SettingsError, match=option):
        Settings(**values)


@pytest.mark.parametrize("text", ["960", "axb", "960x540x3", "1.5x2", "x", "", "infx90", "nanxnan", "1e400x1"])
def test_malformed_sizes_are_refused(text):
    with pytest.raises(SettingsError, match="--size"):
        parse_size(text, "--size", "960x540")


def test_cells_are_presets_or_pairs():
    assert parse_cell("pvs2") == parse_cell("0.2,125")
    with pytest.raises(SettingsError, match="pvs1"):
        parse_cell("pvs9")
    for text in ("inf,80", "0.1,nan", "-inf,inf"):
        with pytest.raises(SettingsError, match=r"--cell is .*: give two finite numbers"):
            parse_cell(text)


def test_a_preset_is_a_paper_s_experiment_and_options_override_it():
    published = settings_of({"preset": "snakebinning-2021"})
    assert published.methods == ("snakebinning@published", "sas@published", "tss@published")
    assert (published.width, published.height, published.atlas_width, published.atlas_height) == (
        1920,
        1080,
        8192,
        4096,
    )
    assert (published.cell_radius, published.cell_fov) == (0.1, 90)
    assert (published.scene, published.codec, published.frames) == ("village", "h264", 12)
    assert settings_of({"preset": "snakebinning-2021", "scene": "hall"}).scene == "hall"
    smaller = settings_of({"preset": "snakebinning-2021", "size": "320x180", "codec": "none", "method": ["sas"]})
    assert (smaller.methods, smaller.width, smaller.codec, smaller.atlas_width) == (("sas",), 320, "none", 8192)
    texels = settings_of({"preset": "tss-2019"})
    assert texels.atlas_width * texels.atlas_height == 24 * 2**20, "the paper's 24 Mpix"
    assert (texels.cell_radius, texels.cell_fov) == (0.1, 60 + 40)
    assert (texels.scene, texels.codec) == ("village", "jpeg")
    assert all("smallest of the paper's three view cells" in PRESETS[name].meaning for name in PRESETS if name != LISTS)
    with pytest.raises(SettingsError, match="Known: snakebinning-2021, tss-2019, ppll-2014"):
        settings_of({"preset": "ppll-2015"})
    with pytest.raises(SettingsError, match="only bench run takes it"):
        settings_of({"preset": LISTS})


def test_rates_are_refused_where_the_coding_has_none_wherever_that_is_said():
    for options, base in (
        ({"codec": "none", "crf": "5"}, {}),
        ({"preset": "tss-2019", "crf": "5"}, {}),
        ({"display_crf": 5}, Settings(codec="jpeg").to_json()),
    ):
        with pytest.raises(SettingsError, match=r"for --codec h264, not (none|jpeg)"):
            settings_of(options, base)
    assert settings_of({"preset": "tss-2019", "codec": "h264", "crf": "5"}).crf == (5,)


def test_units_are_names_or_metres():
    assert [parse_unit(text) for text in ("m", "cm", "mm", "km", "in", "ft")] == [1, 0.01, 0.001, 1000, 0.0254, 0.3048]
    assert parse_unit(" 0.5 ") == 0.5
    assert settings_of({"unit": "in"}).unit == 0.0254
    for text in ("furlong", "", "1 m", "M"):
        with pytest.raises(SettingsError, match="m, cm, mm, km, in, ft"):
            parse_unit(text)


def test_rates_are_a_list_and_the_displayed_one_is_always_encoded():
    assert parse_crfs("5, 10") == (5, 10)
    assert Settings(crf=(35, 5), display_crf=25).crfs == (5, 25, 35)
    assert Settings(codec="none").crfs == ()
    with pytest.raises(SettingsError):
        parse_crfs("5;10")


def test_a_saved_run_reads_back_the_same(tmp_path):
    wanted = Settings(methods=("sas[bias_step=0.5]",), crf=(10,), unit=0.01)
    file = tmp_path / "run.json"
    file.write_text(json.dumps({"settings": wanted.to_json()}), encoding="utf-8")
    assert read_settings(file) == wanted


def test_a_saved_run_does_not_allow_what_only_its_user_may(tmp_path):
    file = tmp_path / "run.json"
    file.write_text(json.dumps({"settings": Settings(allow_outside=True).to_json()}), encoding="utf-8")
    assert not read_settings(file).allow_outside
    assert settings_of({"allow_outside": True}, read_settings(file).to_json()).allow_outside


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"settings": {"colour": 1}}', '{"settings": {"frames": "many"}}'])
def test_a_damaged_run_file_is_one_sentence(tmp_path, content):
    file = tmp_path / "run.json"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(SettingsError):
        read_settings(file)


@pytest.mark.parametrize(
    ("texts", "methods"),
    [
        (["sas,tss"], ("sas", "tss")),
        (["sas[reuse=true,fit=0.5],tss@published", "ppll"], ("sas[reuse=true,fit=0.5]", "tss@published", "ppll")),
        (["all"], ("all",)),
        (["sas,"], ("sas", "")),
        (["my.module:A,my.module:B[a=1,b=2]"], ("my.module:A", "my.module:B[a=1,b=2]")),
    ],
)
def test_methods_are_listed_with_commas_outside_of_brackets(texts, methods):
    assert settings_of({"method": texts}).methods == methods


def test_a_file_with_a_comma_in_its_name_is_one_method(tmp_path, monkeypatch):
    (tmp_path / "mine,too.py").write_text("", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert settings_of({"method": ["mine,too.py:A[a=1,b=2]"]}).methods == ("mine,too.py:A[a=1,b=2]",)


def test_one_number_is_a_square_atlas_and_no_picture():
    settings = settings_of({"atlas": "1024"})
    assert (settings.atlas_width, settings.atlas_height) == (1024, 1024)
    with pytest.raises(SettingsError, match=r"--size is '1024': give two numbers like 960x540\."):
        settings_of({"size": "1024"})
    with pytest.raises(SettingsError, match=r"--atlas is .*: give two numbers like 2048x1024 or 2048\."):
        settings_of({"atlas": "big"})
