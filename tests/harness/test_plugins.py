"""Packers are found by name, module or file, and every mistake is answered with what is known."""

import re
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from textwrap import dedent

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from shading_atlas_bench.harness import plugins
from shading_atlas_bench.harness.plugins import (
    find_packers,
    label_of,
    load_packer,
    nearest,
    packer_names,
    published_values,
    variant_string,
)
from shading_atlas_bench.packers.interface import Packer
from shading_atlas_bench.reports.store.names import folder_name

SOURCE = """
    from shading_atlas_bench.packers.interface import Packer, Paper, Parameter

    class Grid(Packer):
        name = "grid"
        paper = Paper("One cell per triangle", 2026, "")
        parameters = {
            "cell": Parameter(8, (4, 8), "side of a cell", "texels"),
            "scale": Parameter(1.0, (0.5, 1.0), "of the footprint"),
            "reuse": Parameter(False, (False, True), "take freed cells"),
            "order": Parameter("id", ("id", "size"), "of the triangles"),
        }

        def pack(self, frame):
            pass

        def client(self, scene):
            pass

    class Unfinished(Packer):
        name = "unfinished"
        paper = Grid.paper

    class Claiming(Grid):
        name = "claiming"
        parameters = {"mipmaps": Parameter(3, (0, 3), "how many levels are sent", "levels", "ours")}

    number = 3
"""
ROOT = Path(__file__).parents[2]
DEFAULTS = "cell=8,mipmaps=true,order=id,reuse=false,scale=1.0"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "my_packer.py"
    path.write_text(dedent(SOURCE), encoding="utf-8")
    return path


@pytest.fixture
def installed(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two packers as if installed: `grid`, and `broken`, whose module does not exist."""
    monkeypatch.syspath_prepend(str(file.parent))
    entries = [
        EntryPoint("grid", "my_packer:Grid", plugins.GROUP),
        EntryPoint("broken", "no_such_module:Packer", plugins.GROUP),
    ]
    monkeypatch.setattr(plugins, "entry_points", lambda group: entries)


def test_the_suite_offers_its_own_packers():
    assert "sas" in packer_names()


@pytest.mark.usefixtures("installed")
def test_by_installed_name():
    (packer,) = load_packer("grid[cell=4,reuse=true]")
    assert packer.name == "grid"
    assert variant_string(packer) == "cell=4,mipmaps=true,order=id,reuse=true,scale=1.0"


@pytest.mark.usefixtures("installed")
def test_names_import_nothing_and_a_broken_packer_says_so():
    assert packer_names() == ["broken", "grid"]
    for spec in ("broken", "all"):
        with pytest.raises(ValueError, match=r"'broken' \(no_such_module:Packer\) cannot be imported"):
            load_packer(spec)


def test_all_gives_one_of_each(monkeypatch: pytest.MonkeyPatch, file: Path):
    monkeypatch.syspath_prepend(str(file.parent))
    entry = EntryPoint("grid", "my_packer:Grid", plugins.GROUP)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry, entry])  # as a second copy of the metadata gives
    assert [variant_string(packer) for packer in load_packer("all")] == [DEFAULTS]
    assert [variant_string(packer) for packer in load_packer("all[]")] == [DEFAULTS]


def test_all_takes_common_parameters():
    for setting in ("", "@published"):
        usual = {packer.name: variant_string(packer) for packer in load_packer(f"all{setting}")}
        finest = {packer.name: variant_string(packer) for packer in load_packer(f"all{setting}[mipmaps=false]")}
        assert finest == {name: text.replace("mipmaps=true", "mipmaps=false") for name, text in usual.items()}
        assert all("mipmaps=true" in text for text in usual.values())


def test_one_name_from_two_packages_is_refused(monkeypatch: pytest.MonkeyPatch):
    entries = [EntryPoint("grid", f"{place}:Grid", plugins.GROUP) for place in ("a", "b")]
    monkeypatch.setattr(plugins, "entry_points", lambda group: entries)
    with pytest.raises(ValueError, match=r"a:Grid, b:Grid"):
        load_packer("grid")


def test_by_file_and_by_module(file: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(file.parent)
    monkeypatch.setattr("sys.path", [*sys.path])
    by_file = load_packer(f"{file}:Grid[scale=2]")
    by_relative_file = load_packer("my_packer.py:Grid[scale=2.0]")
    by_module = load_packer("my_packer:Grid[ scale = 2e0 ]")
    variants = [variant_string(packer) for (packer,) in (by_file, by_relative_file, by_module)]
    assert variants == ["cell=8,mipmaps=true,order=id,reuse=false,scale=2.0"] * 3


def test_as_published(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    text, own = file.read_text(encoding="utf-8"), '"texels"'
    assert text.count(own) == 1
    file.write_text(text.replace(own, f"{own}, published=16"), encoding="utf-8")
    ends = {
        "": DEFAULTS,
        "@published": DEFAULTS.replace("cell=8", "cell=16"),
        "@published[cell=2]": DEFAULTS.replace("cell=8", "cell=2"),
    }
    assert {end: variant_string(*load_packer(f"{file}:Grid{end}")) for end in ends} == ends
    folder = tmp_path / "a@b[1]"
    folder.mkdir()
    moved = file.rename(folder / file.name)
    assert "cell=16" in variant_string(*load_packer(f"{moved}:Grid@published"))


def test_what_is_published_is_a_value_that_can_be_set_and_stands_in_the_methods_readme():
    for name, packer in find_packers().items():
        published = published_values(packer)
        packer(**published)
        (made,) = load_packer(f"{name}@published")
        assert {key: getattr(made, key) for key in published} == published
        assert all(value != packer.parameters[key].default for key, value in published.items())
        readme = (ROOT / "packers" / name / "README.md").read_text(encoding="utf-8")
        defaults = readme.partition("## Defaults")[2].partition("\n## ")[0]
        assert all(f"| `{key}` |" in defaults for key in published), name
        assert f"`{name}@published`" in defaults
    assert len(load_packer("all@published")) == len(find_packers())


@pytest.mark.parametrize(
    ("spec", "label"),
    [
        ("snakebinning", "snakebinning"),
        ("snakebinning@published", "snakebinning@published"),
        ("snakebinning@published[assignment=best]", "snakebinning@published[assignment=best]"),
        ("snakebinning[points=false,enlarge=exact]", "snakebinning[points=false]"),
        ("tss[order=arrival]", "tss@published"),
        ("tss@published[strategy=lpacking,order=primitive]", "tss[strategy=lpacking]"),
        ("tss@published[strategy=lpacking]", "tss@published[strategy=lpacking]"),
        ("ppll[mipmaps=false,merge=paper]", "ppll@published[mipmaps=false]"),
    ],
)
def test_labels_name_what_differs_from_the_nearer_of_defaults_and_published(spec: str, label: str):
    assert label_of(load_packer(spec)[0]) == label


def test_equally_near_are_called_after_the_defaults(file: Path):
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace('"texels"', '"texels", published=16'), encoding="utf-8")
    assert label_of(load_packer(f"{file}:Grid[cell=2]")[0]) == "grid[cell=2]"
    assert label_of(load_packer(f"{file}:Grid[cell=16,scale=0.5]")[0]) == "grid@published[scale=0.5]"
    assert label_of(load_packer(f"{file}:Grid[cell=16,scale=0.5]")[0], ["cell"]) == "grid[scale=0.5]"
    assert label_of(load_packer(f"{file}:Grid[cell=16]")[0], ["cell"]) == "grid"


@st.composite
def packers(draw: st.DrawFn) -> Packer:
    """Any of the suite's packers with any of its parameters' known values."""
    kind = find_packers()[draw(st.sampled_from(packer_names()))]
    base = draw(st.sampled_from([{}, published_values(kind)]))
    changed = draw(st.lists(st.sampled_from(sorted(kind.parameters)), max_size=5))
    known = {name: kind.parameters[name] for name in changed}
    own = {name: draw(st.sampled_from([*one.sweep, one.default])) for name, one in known.items()}
    try:
        return kind(**base | own)
    except ValueError:  # a combination that cannot be
        return assume(False)


@settings(max_examples=80, deadline=None)
@given(packer=packers())
def test_a_label_is_the_method_argument_of_its_packer_alone(packer: Packer):
    (meant,) = load_packer(label_of(packer))
    assert (meant.name, variant_string(meant)) == (packer.name, variant_string(packer))


@settings(max_examples=30, deadline=None)
@given(found=st.lists(packers(), max_size=12))
def test_labels_are_unique(found: list[Packer]):
    variants = {(packer.name, variant_string(packer)) for packer in found}
    assert len({label_of(packer) for packer in found}) == len(variants)


def test_empty_brackets_mean_the_defaults(file: Path):
    assert variant_string(*load_packer(f"{file}:Grid[]")) == DEFAULTS


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("all[fit=0.5]", "'fit' is not a parameter of all methods, as mipmaps is: name the method that it belongs to"),
        ("all@published[fit=0.5]", "'fit' is not a parameter of all methods, as mipmaps is"),
        ("all[mipmaps=maybe]", "all: mipmaps must be true or false, not 'maybe'"),
        ("all[mipmaps]", "all: 'mipmaps' is not of the form parameter=value"),
        ("all[published]", "write all@published."),
        ("all[mipmaps=false]@published", "write all@published[mipmaps=false]."),
    ],
)
def test_all_refuses_what_only_some_have(spec: str, message: str):
    with pytest.raises(ValueError) as error:
        load_packer(spec)
    assert message in str(error.value)


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("gird", "no packer 'gird'. Did you mean 'grid'?"),
        ("zzz", "no packer 'zzz'. Known: broken, grid, all."),
        ("grid[cel=4]", "no parameter 'cel'. Did you mean 'cell'? Known: cell, mipmaps, order, reuse, scale."),
        ("grid[cell=4.5]", "cell must be a whole number, not '4.5'"),
        ("grid[cell=]", "cell must be a whole number, not ''"),
        ("grid[scale=big]", "scale must be a number, not 'big'"),
        ("grid[reuse=maybe]", "reuse must be true or false, not 'maybe'"),
        ("grid[order=sise]", "order cannot be 'sise'. Did you mean 'size'? Known: id, size."),
        ("grid[cell]", "'cell' is not of the form parameter=value"),
        ("grid[cell=4,cell=8]", "'cell' is given twice"),
        ("grid[cell=4", "is not of the form NAME, NAME[parameter=value,parameter=value] or NAME@published["),
        ("grid@published@published", "write grid@published or grid."),
        ("", "is not of the form NAME"),
        ("grid@publisched", "unknown setting @publisched: write grid@published or grid."),
        ("grid@", "no setting behind its @: write grid@published or grid."),
        ("grid@[cell=4]", "no setting behind its @: write grid@published[cell=4] or grid[cell=4]."),
        ("grid[cell=4]@published", "setting behind the brackets: write grid@published[cell=4]."),
        ("a[1].py:Grid[cell=4]@", "setting behind the brackets: write a[1].py:Grid@published[cell=4]."),
        ("grid@published[cell=4]@published", "setting behind the brackets: write grid@published[cell=4]."),
        ("grid[published]", "'published' is no parameter but a setting: write grid@published."),
        ("grid[@published, cell=4]", "write grid@published[cell=4]."),
        ("grid[cell=4,published=true]", "write grid@published[cell=4]."),
        ("my_packer:Gird", "no packer class 'Gird'. Did you mean 'Grid'?"),
        ("my_packer:Unfinished", "lacks client, pack"),
        ("my_packer:number", "is not a packer"),
        ("my_packer:Claiming", "has a parameter 'mipmaps' of its own"),
        ("my_pakcer:Grid", "The module 'my_pakcer' cannot be imported"),
        ("nowhere/my_packer.py:Grid", "There is no file nowhere/my_packer.py"),
    ],
)
def test_mistakes_are_answered_with_what_is_known(spec: str, message: str):
    with pytest.raises(ValueError) as error:
        load_packer(spec)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_that_fails_to_import_says_why(tmp_path: Path):
    path = tmp_path / "failing.py"
    path.write_text("1 / 0", encoding="utf-8")
    with pytest.raises(ValueError, match="ZeroDivisionError"):
        load_packer(f"{path}:Grid")


def test_folders_differ_by_parameters_and_are_safe_names():
    assert folder_name("sas", "a=1") == folder_name("sas", "a=1") != folder_name("sas", "a=2")
    assert folder_name("../my method", "").startswith(".._my_method-")


GRID = "from shading_atlas_bench.packers.example.grid import Grid\n\n\nclass Mine(Grid):\n    name = 'mine'\n"


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ("name = 'a' * 300", "files cannot have"),
        ("name = 'a\\ud800'", "files cannot have"),
        ("name = 3", "files cannot have"),
        ("name = property(lambda self: 'mine')", "files cannot have"),
        ("name = '../mine'", "files cannot have"),
        ("paper = None", "declares paper otherwise"),
        ("atlas = 'yes'", "declares atlas otherwise"),
        ("parameters = {'cell': 3}", "declares parameters otherwise"),
        ("skips = {'a': 'b'}", "declares skips otherwise"),
        ("__init__ = lambda self, **values: exit(3)", "cannot be made: SystemExit: 3"),
        ("__init__ = lambda self, **values: {}['key']", "cannot be made: KeyError: 'key'"),
        ("__init__ = lambda self, **values: setattr(self, 'mipmaps', [])", "the parameter mipmaps is a list"),
        ("__init__ = lambda self, **values: setattr(self, 'name', 'yours')", "changes its `name`"),
        ("raise SystemExit(3)", "cannot be imported: SystemExit: 3"),
        ("raise GeneratorExit", "cannot be imported: GeneratorExit"),
    ],
)
def test_a_packer_that_cannot_be_used_is_refused_when_it_is_loaded(tmp_path: Path, lines: str, says: str):
    file = tmp_path / "mine.py"
    file.write_text(f"{GRID}    {lines}\n", encoding="utf-8")
    with pytest.raises(ValueError, match=re.escape(says)) as refused:
        load_packer(f"{file}:Mine")
    assert str(refused.value).isprintable()


BROKEN = """
from shading_atlas_bench.packers.interface import Packer


class Whole(Packer):
    pass


class Mine(Packer):
    parameters = 3
"""


def test_what_is_wrong_in_a_file_is_told_with_its_place(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(BROKEN, encoding="utf-8")
    sentence = r"the class Mine has parameters that are no dict of names to Parameters \(mine\.py, line 9\)\.$"
    with pytest.raises(ValueError, match=sentence):
        load_packer(f"{file}:Mine")


def test_a_file_that_imports_its_neighbour_is_told_to_be_a_package(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("import base_of_mine\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"No module named 'base_of_mine' \(mine\.py, line 1\)\.$"):
        load_packer(f"{file}:Mine")
    (tmp_path / "base_of_mine.py").touch()
    with pytest.raises(ValueError, match=r"base_of_mine lies beside it: make a package of the folder"):
        load_packer(f"{file}:Mine")


@pytest.mark.parametrize(("word", "guess"), [("SAS", "'sas'"), ("snak", "'snakebinning'"), ("tsss", "'tss'")])
def test_a_name_that_is_nearly_known_is_guessed(word, guess):
    assert nearest(word, ["ppll", "sas", "snakebinning", "tss", "all"]).startswith(f" Did you mean {guess}?")


def test_a_name_like_no_other_is_not_guessed():
    assert nearest("quadstream", ["ppll", "sas"]) == " Known: ppll, sas."
    assert nearest("", ["ppll", "sas"]) == " Known: ppll, sas."
