"""The packers' tests: a room on the device, and `--packer`, which runs the conformance kit on one packer."""

from __future__ import annotations

import pytest

from shading_atlas_bench.packers.interface import ServerScene
from tests.packers.rooms import room, server_of

DOCUMENTED = "packers/example/grid.py:Grid"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--packer",
        metavar="PACKER",
        help="run the conformance kit on this packer only: a name, file.py:Class or package.module:Class",
    )


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Tests that take a `packer_spec` run once for every built-in packer and the documentation's example."""
    if "packer_spec" in metafunc.fixturenames:
        from shading_atlas_bench.harness.plugins import packer_names

        chosen = metafunc.config.getoption("--packer", default=None)
        specs = [chosen] if chosen else [*packer_names(), DOCUMENTED]
        metafunc.parametrize("packer_spec", specs, scope="module", ids=[s.rpartition(":")[2] for s in specs])


@pytest.fixture(scope="module")
def scene(device) -> ServerScene:
    """The room on the device."""
    return server_of(device, room())
