"""Parameters: what they refuse, and that packers declare them as what they are."""

import pytest

from shading_atlas_bench.packers.interface import Packer, Parameter
from shading_atlas_bench.packers.ppll import PerPixelLinkedLists
from shading_atlas_bench.packers.sas import ShadingAtlasStreaming
from shading_atlas_bench.packers.snakebinning import SnakeBinning
from shading_atlas_bench.packers.tss import TessellatedShadingStreaming


@pytest.mark.parametrize(
    ("value", "objection"),
    [(1.0, None), (0.5, "is 0.5: give 1 or more"), (3, "is 3: give 2 or less"), ("2", "is '2': give a number")],
)
def test_a_number_has_limits_and_is_no_text(value, objection):
    assert Parameter(1.0, (1.0, 2.0), "a number", limits=(1.0, 2.0)).objection(value) == objection


def test_a_text_is_one_of_its_choices():
    parameter = Parameter("one", ("one", "two"), "a text", choices=("one", "two"))
    assert parameter.objection("two") is None
    assert parameter.objection("three") == "is 'three': give one of one, two"


@pytest.mark.parametrize("kind", [PerPixelLinkedLists, ShadingAtlasStreaming, TessellatedShadingStreaming])
def test_every_parameter_is_declared_with_the_type_of_its_default(kind: type[Packer]):
    """Type checkers believe what the class declares."""
    declared = {name: text for base in kind.__mro__ for name, text in vars(base).get("__annotations__", {}).items()}
    defaults = {name: type(parameter.default).__name__ for name, parameter in kind.parameters.items()}
    assert {name: declared.get(name) for name in defaults} == defaults


def test_an_unknown_parameter_is_refused_with_those_that_there_are():
    with pytest.raises(ValueError, match=r"sas has no parameter 'side'; it has: bias, complete, .*, superblock\."):
        ShadingAtlasStreaming(side=128)


def test_only_lists_fill_no_atlas():
    kinds = (PerPixelLinkedLists, ShadingAtlasStreaming, SnakeBinning, TessellatedShadingStreaming)
    assert [kind.atlas for kind in kinds] == [False, True, True, True]
