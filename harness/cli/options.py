"""The options of `bench run` and `bench sweep`, each declared once: for its command's help and for what it sets."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

WORK, CLIENT, CODING, RUNNING = "What to run", "The client and its view cell", "Atlas and encoding", "How to run"
RUN, SWEEP = "run", "sweep"
BOTH = (RUN, SWEEP)

Given = dict[str, Any]  # options that were given, by their names without dashes


@dataclass(frozen=True)
class Option:
    """An option of the command line.

    name: with underscores; a setting's name, or one that `settings_of` knows. kind: the type of its value; a `list` may
    be repeated, a `bool` takes no value. help: a phrase, with the default where there is one. default: where the value
    is not simply left out. commands: that have it. short: one letter for it, as it is typed.
    """

    name: str
    kind: type
    panel: str
    help: str
    metavar: str | None = None
    default: float | None = None
    commands: tuple[str, ...] = BOTH
    short: str | None = None

    @property
    def flag(self) -> str:
        """As it is typed."""
        return f"--{self.name.replace('_', '-')}"

    def parameter(self) -> inspect.Parameter:
        """As Typer takes it from a function's signature."""
        flags = [self.flag, *([self.short] if self.short else [])]
        info = typer.Option(self.default, *flags, help=self.help, metavar=self.metavar, rich_help_panel=self.panel)
        kind = list[str] if self.kind is list else self.kind
        annotation = kind if self.default is not None else kind | None
        return inspect.Parameter(self.name, inspect.Parameter.KEYWORD_ONLY, default=info, annotation=annotation)


OPTIONS = (
    Option(
        "method",
        list,
        WORK,
        "all, a name, 'module:Class' or 'file.py:Class', then perhaps @published, then perhaps '\\[param=value,...]'; "
        "several with commas between, or repeatable. Default: all",
        "METHOD",
    ),
    Option(
        "vary",
        list,
        WORK,
        "Values of a parameter, or of atlas, samples, crf, cell (RADIUS/FOV), size, fov, latency, pvs_density, scene; "
        "repeatable: the grid has every combination. Default: each parameter of each method in turn",
        "NAME=V1,V2",
        commands=(SWEEP,),
    ),
    Option("scene", str, WORK, "A built-in scene or a file. Default: hall", "NAME|FILE"),
    Option("detail", int, WORK, "Triangles of a built-in scene", "N"),
    Option(
        "unit",
        str,
        WORK,
        "Of a file, whatever it states: m, cm, mm, km, in, ft, or metres. Default: as stated (glTF: m), else a guess",
        "UNIT",
    ),
    Option("repair", bool, WORK, "Remove duplicate and degenerate faces and non-manifold edges first"),
    Option("decimate", float, WORK, "Keep this share of the triangles", "RATIO"),
    Option("opaque", bool, WORK, "Make see-through materials opaque"),
    Option("max_texture", int, WORK, "Longest side of a texture; larger ones are reduced. Default: 8192", "TEXELS"),
    Option("allow_outside", bool, WORK, "Read files outside of its folder that a scene names, too"),
    Option("path", str, WORK, "walk, orbit, turntable, animation, or a file. Default: walk", "NAME|FILE"),
    Option("head_motion", str, WORK, "A recording of head motion. Default: synthetic", "FILE"),
    Option("frames", int, WORK, "Frames of the path. Default: 12", "N"),
    Option(
        "config",
        Path,
        WORK,
        "Replay this run.json, but no code that it names; other options override it",
        "FILE",
        commands=(RUN,),
    ),
    Option(
        "preset",
        str,
        WORK,
        "A paper's own experiment, which other options override: snakebinning-2021, tss-2019, and of bench run "
        "ppll-2014",
        "NAME",
    ),
    Option("size", str, CLIENT, "The client's picture. Default: 960x540", "WxH"),
    Option("fov", float, CLIENT, "Horizontal field of view. Default: 60", "DEG"),
    Option(
        "cell",
        str,
        CLIENT,
        "View cell: radius in metres and field of view in degrees, or pvs1 (0.1,90), pvs2 (0.2,125), pvs3 (0.3,160). "
        "Default: 0.08,80",
        "RADIUS,FOV",
    ),
    Option(
        "pvs_density",
        float,
        CLIENT,
        "Density of the PVS views over the client's. Default: 2, more for tiny triangles",
        "X",
    ),
    Option("latency", float, CLIENT, "From server pose to display. Default: 50", "MS"),
    Option("bandwidth", float, CLIENT, "Of the network, for network_ms. Default: 100", "MBIT/S"),
    Option(
        "reference_eye", str, CLIENT, "Whose eye the reference is shaded for: client or server. Default: client", "EYE"
    ),
    Option(
        "metrics",
        str,
        CLIENT,
        "Of flip, dssim, iwssim, psnr, delta_e, stretch. Default: all",
        "LIST",
        commands=(RUN,),
    ),
    Option("atlas", str, CODING, "Texels of the atlas; one number for a square. Default: 2048x2048", "WxH"),
    Option(
        "samples",
        float,
        CODING,
        "Shading samples per pixel of the client's picture, for every method with an atlas, each by its own means. "
        "Default: each method's own rule",
        "N",
    ),
    Option("codec", str, CODING, "h264, jpeg or none. Default: h264", "CODEC"),
    Option("crf", str, CODING, "Rates to encode at. Default: 5,10,25,35", "LIST", commands=(RUN,)),
    Option("display_crf", int, CODING, "The rate the client sees. Default: 25", "N"),
    Option("device", str, RUNNING, "Part of an OpenCL device's name", "NAME"),
    Option("seed", int, RUNNING, "Of scene, head motion and methods. Default: 0", "N"),
    Option("repeat", int, RUNNING, "Timings of every frame. Default: 1", "N", commands=(RUN,)),
    Option(
        "precision", float, RUNNING, "Width of the 95 % interval of a cell's time to reach", "PERCENT", 5.0, (SWEEP,)
    ),
    Option("repetitions", int, RUNNING, "Most timings of a cell", "N", 15, (SWEEP,)),
    Option("budget", float, RUNNING, "For timing one cell again", "SECONDS", 30.0, (SWEEP,)),
    Option("workers", int, RUNNING, "Cells side by side, for quality only: times do not compare", "N", 1, (SWEEP,)),
    Option(
        "no_skip",
        list,
        RUNNING,
        "Do what nothing needs all the same; repeatable, see --explain",
        "NAME",
        commands=(RUN,),
    ),
    Option("explain", bool, RUNNING, "Also measure what every skip saves, and print it", commands=(RUN,)),
    Option(
        "timeout",
        float,
        RUNNING,
        "For one packing; for importing and making a packer 10 or more. Default: 60",
        "SECONDS",
    ),
    Option(
        "memory",
        str,
        RUNNING,
        "Memory that it may take, like 500M or 4G; where it is short, fewer methods go through a frame together, or "
        "fewer workers run. Default: 60 % of the machine's, or 90 % where one method at a time needs it",
        "SIZE",
    ),
    Option("out", Path, RUNNING, "Folder of the results. Default: a new one in runs/", "DIR"),
    Option("dump", bool, RUNNING, "Also write every atlas, its owners and the pictures", commands=(RUN,)),
    Option("verbose", bool, RUNNING, "In the end print every rate, sizes and ratios, too", commands=(RUN,), short="-v"),
    Option("dry_run", bool, RUNNING, "Only say what would run, and for how long"),
)


def with_options(command: str) -> Callable[[Callable[[Given], None]], Callable[..., None]]:
    """Make a function of the options given a command of this name, which takes all options that are its own."""
    signature = inspect.Signature([option.parameter() for option in OPTIONS if command in option.commands])

    def wrap(function: Callable[[Given], None]) -> Callable[..., None]:
        def run(**values: object) -> None:
            function({name: value for name, value in values.items() if not (value is None or value is False)})

        run.__doc__ = function.__doc__
        vars(run)["__signature__"] = signature
        run.__annotations__ = {name: parameter.annotation for name, parameter in signature.parameters.items()}
        return run

    return wrap
