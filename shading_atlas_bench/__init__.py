"""The comparative benchmark of shading-atlas packers.

Folders beside this file are links to those at the top of the repository. What a packer or a script needs first is here:
the packer interface, `edge_pixels`, `load_scene`, and `run` with its `Settings`. Each is imported when it is asked for.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from shading_atlas_bench.harness.run.run import run as run
    from shading_atlas_bench.harness.workload.settings import Settings as Settings
    from shading_atlas_bench.kernels.samples import Samples as Samples
    from shading_atlas_bench.packers.interface import Client as Client
    from shading_atlas_bench.packers.interface import ClientScene as ClientScene
    from shading_atlas_bench.packers.interface import Frame as Frame
    from shading_atlas_bench.packers.interface import Packer as Packer
    from shading_atlas_bench.packers.interface import Paper as Paper
    from shading_atlas_bench.packers.interface import Parameter as Parameter
    from shading_atlas_bench.packers.interface import Payload as Payload
    from shading_atlas_bench.packers.interface import ServerScene as ServerScene
    from shading_atlas_bench.packers.interface import View as View
    from shading_atlas_bench.packers.screen_size import edge_pixels as edge_pixels
    from shading_atlas_bench.scenes.load import load_scene as load_scene

INTERFACE = "packers.interface"
MODULES = {
    "Client": INTERFACE,
    "ClientScene": INTERFACE,
    "Frame": INTERFACE,
    "Packer": INTERFACE,
    "Paper": INTERFACE,
    "Parameter": INTERFACE,
    "Payload": INTERFACE,
    "Samples": "kernels.samples",
    "ServerScene": INTERFACE,
    "Settings": "harness.workload.settings",
    "View": INTERFACE,
    "edge_pixels": "packers.screen_size",
    "load_scene": "scenes.load",
    "run": "harness.run.run",
}
__all__ = list(MODULES)

if Path(__file__).with_name("kernels").is_file():  # what Git makes of a link where it may make none
    raise ImportError(
        f"The folders in {Path(__file__).parent} are no links but text files: clone the repository again with "
        "git clone -c core.symlinks=true (on Windows, switch on its developer mode first)."
    )


def __getattr__(name: str) -> Any:
    """A public name, imported now. Raises AttributeError for others."""
    if name not in MODULES:
        raise AttributeError(f"The package {__name__!r} has no {name!r}; there are {', '.join(MODULES)}.")
    return getattr(import_module(f"{__name__}.{MODULES[name]}"), name)
