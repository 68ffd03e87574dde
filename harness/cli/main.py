"""The command line: `bench run`, `sweep`, `list` and others; nothing heavy is imported until needed."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shading_atlas_bench.harness.cli.check import check
from shading_atlas_bench.harness.cli.claims import claims
from shading_atlas_bench.harness.cli.kernels import kernels
from shading_atlas_bench.harness.cli.stress import stress
from shading_atlas_bench.harness.cli.tables import tables
from shading_atlas_bench.harness.watch.ends import end_with_supervisor
from shading_atlas_bench.harness.workload.presets import LINKED_LISTS

if TYPE_CHECKING:
    from shading_atlas_bench.harness.workload.settings import Settings

app = typer.Typer(
    name="bench",
    help="Measure shading-atlas packers on identical scenes, paths, visible sets, shading and encoders.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

SOME_FAILED, UNUSABLE = 1, 2
OF_SWEEP = ("vary", "precision", "repetitions", "budget", "workers")
WORK, CLIENT, CODING, RUNNING = "What to run", "The client and its view cell", "Atlas and encoding", "How to run"


def _option(panel: str, help_text: str, *names: str, metavar: str | None = None) -> Any:
    return typer.Option(*names, help=help_text, metavar=metavar, rich_help_panel=panel)


Text, Number, Whole, Switch = str | None, float | None, int | None, bool | None
Method = Annotated[
    list[str] | None,
    _option(
        WORK,
        "all, a name, 'module:Class' or 'file.py:Class', then perhaps @published, then perhaps '\\[param=value,...]'; "
        "repeatable. Default: all",
        metavar="METHOD",
    ),
]
SceneName = Annotated[Text, _option(WORK, "A built-in scene or a file. Default: hall", metavar="NAME|FILE")]
Detail = Annotated[Whole, _option(WORK, "Triangles of a built-in scene", metavar="N")]
Unit = Annotated[
    Text,
    _option(
        WORK,
        "Of a file, whatever it states: m, cm, mm, km, in, ft, or metres. Default: as stated (glTF: m), else a guess",
        metavar="UNIT",
    ),
]
Repair = Annotated[
    Switch, _option(WORK, "Remove duplicate and degenerate faces and non-manifold edges first", "--repair")
]
Decimate = Annotated[Number, _option(WORK, "Keep this share of the triangles", metavar="RATIO")]
Opaque = Annotated[Switch, _option(WORK, "Make see-through materials opaque", "--opaque")]
PathName = Annotated[
    Text, _option(WORK, "walk, orbit, turntable, animation, or a file. Default: walk", metavar="NAME|FILE")
]
Motion = Annotated[Text, _option(WORK, "A recording of head motion. Default: synthetic", metavar="FILE")]
Frames = Annotated[Whole, _option(WORK, "Frames of the path. Default: 12", metavar="N")]
Size = Annotated[Text, _option(CLIENT, "The client's picture. Default: 960x540", metavar="WxH")]
Fov = Annotated[Number, _option(CLIENT, "Horizontal field of view. Default: 60", metavar="DEG")]
CellSize = Annotated[
    Text,
    _option(
        CLIENT,
        "View cell: radius in metres and field of view in degrees, or pvs1 (0.1,90), pvs2 (0.2,125), pvs3 (0.3,160). "
        "Default: 0.08,80",
        metavar="RADIUS,FOV",
    ),
]
Density = Annotated[
    Number,
    _option(CLIENT, "Density of the PVS views over the client's. Default: 2, more for tiny triangles", metavar="X"),
]
Latency = Annotated[Number, _option(CLIENT, "From server pose to display. Default: 50", metavar="MS")]
Bandwidth = Annotated[Number, _option(CLIENT, "Of the network, for network_ms. Default: 100", metavar="MBIT/S")]
Eye = Annotated[
    Text, _option(CLIENT, "Whose eye the reference is shaded for: client or server. Default: client", metavar="EYE")
]
Atlas = Annotated[Text, _option(CODING, "Texels of the atlas. Default: 2048x2048", metavar="WxH")]
Samples = Annotated[
    Number,
    _option(
        CODING,
        "Shading samples per pixel of the client's picture, for every method with an atlas, each by its own means. "
        "Default: each method's own rule",
        metavar="N",
    ),
]
Codec = Annotated[Text, _option(CODING, "h264, jpeg or none. Default: h264", metavar="CODEC")]
Crf = Annotated[Text, _option(CODING, "Rates to encode at. Default: 5,10,25,35", metavar="LIST")]
DisplayCrf = Annotated[Whole, _option(CODING, "The rate the client sees. Default: 25", metavar="N")]
DeviceName = Annotated[Text, _option(RUNNING, "Part of an OpenCL device's name", metavar="NAME")]
Seed = Annotated[Whole, _option(RUNNING, "Of scene, head motion and methods. Default: 0", metavar="N")]
Repeat = Annotated[Whole, _option(RUNNING, "Timings of every frame. Default: 1", metavar="N")]
NoSkip = Annotated[
    list[str] | None, _option(RUNNING, "Do what nothing needs all the same; repeatable, see --explain", metavar="NAME")
]
Metrics = Annotated[
    Text, _option(CLIENT, "Of flip, dssim, iwssim, psnr, delta_e, stretch. Default: all", metavar="LIST")
]
Explain = Annotated[bool, _option(RUNNING, "Also measure what every skip saves, and print it", "--explain")]
Timeout = Annotated[Number, _option(RUNNING, "For one packing. Default: 60", metavar="SECONDS")]
Out = Annotated[Path | None, _option(RUNNING, "Folder of the results. Default: a new one in runs/", metavar="DIR")]
Dump = Annotated[Switch, _option(RUNNING, "Also write every atlas, its owners and the pictures", "--dump")]
DryRun = Annotated[bool, _option(RUNNING, "Only say what would run, and for how long", "--dry-run")]
Vary = Annotated[
    list[str] | None,
    _option(
        WORK,
        "Values of a parameter, or of atlas, samples, crf, cell (RADIUS/FOV), size, fov, latency, pvs_density, scene; "
        "repeatable: the grid has every combination. Default: each parameter of each method in turn",
        metavar="NAME=V1,V2",
    ),
]
Precision = Annotated[
    float, _option(RUNNING, "Width of the 95 % interval of a cell's time to reach", metavar="PERCENT")
]
Repetitions = Annotated[int, _option(RUNNING, "Most timings of a cell", metavar="N")]
Budget = Annotated[float, _option(RUNNING, "For timing one cell again", metavar="SECONDS")]
Workers = Annotated[int, _option(RUNNING, "Cells side by side, for quality only: times do not compare", metavar="N")]
Config = Annotated[Path | None, _option(RUNNING, "Replay this run.json; other options override it", metavar="FILE")]
Preset = Annotated[
    Text,
    _option(
        WORK,
        "A paper's own experiment, which other options override: snakebinning-2021, tss-2019, and of bench run "
        "ppll-2014",
        metavar="NAME",
    ),
]


@app.command()
def run(
    context: typer.Context,
    method: Method = None,
    scene: SceneName = None,
    detail: Detail = None,
    unit: Unit = None,
    repair: Repair = None,
    decimate: Decimate = None,
    opaque: Opaque = None,
    path: PathName = None,
    head_motion: Motion = None,
    frames: Frames = None,
    size: Size = None,
    fov: Fov = None,
    cell: CellSize = None,
    pvs_density: Density = None,
    latency: Latency = None,
    bandwidth: Bandwidth = None,
    reference_eye: Eye = None,
    atlas: Atlas = None,
    samples: Samples = None,
    codec: Codec = None,
    crf: Crf = None,
    display_crf: DisplayCrf = None,
    device: DeviceName = None,
    seed: Seed = None,
    repeat: Repeat = None,
    timeout: Timeout = None,
    metrics: Metrics = None,
    no_skip: NoSkip = None,
    out: Out = None,
    dump: Dump = None,
    explain: Explain = False,
    dry_run: DryRun = False,
    config: Config = None,
    preset: Preset = None,
) -> None:
    """Run methods on a scene and write CSV and HTML.

    Exit codes: 0 every row is ok or skipped with a reason, 1 some rows failed, 2 unusable arguments or input.
    """
    from shading_atlas_bench.harness.cli.guard import guarded

    with guarded():
        if preset == LINKED_LISTS:
            from shading_atlas_bench.harness.experiments.ppll_2014 import (
                experiment_of,
                run_experiment,
                show_experiment,
            )

            wanted = experiment_of(_given(context.params, "out", "dry_run"))
            (show_experiment if dry_run else run_experiment)(wanted, out or Path("runs") / preset)
            return
        wanted = _settings_of(context.params)
        if dry_run:
            from shading_atlas_bench.harness.cli.dry_run import show_plan

            show_plan(wanted, out)
            return
        from shading_atlas_bench.harness.cli.summary import show_explained, show_summary
        from shading_atlas_bench.harness.console import TerminalProgress
        from shading_atlas_bench.harness.run.run import run as run_all

        outcome = run_all(wanted, out, TerminalProgress(), explained=explain)
        show_summary(outcome.folder)
        if outcome.explained is not None:
            show_explained(outcome.explained)
        raise typer.Exit(0 if outcome.well else SOME_FAILED)


def _given(options: dict[str, Any], *apart: str) -> dict[str, Any]:
    """The options that were given, but for those of these names."""
    absent = (None, (), [])
    return {
        name: value
        for name, value in options.items()
        if name not in apart and value is not False and value not in absent
    }


def _settings_of(options: dict[str, Any]) -> Settings:
    """The settings that the options of `bench run` mean, over those of `--config`, over the defaults."""
    from shading_atlas_bench.harness.workload import settings as s

    given = _given(options, "out", "dry_run", "explain", "config", *OF_SWEEP)
    config = options.get("config")
    if config and "preset" in given:
        raise s.SettingsError("--config and --preset both say what to run: give one of them.")
    base = s.read_settings(config).to_json() if config else {}
    return s.settings_of(given, base, str(config or "run"))


@app.command()
def sweep(
    context: typer.Context,
    method: Method = None,
    vary: Vary = None,
    scene: SceneName = None,
    detail: Detail = None,
    unit: Unit = None,
    repair: Repair = None,
    decimate: Decimate = None,
    path: PathName = None,
    head_motion: Motion = None,
    frames: Frames = None,
    size: Size = None,
    fov: Fov = None,
    cell: CellSize = None,
    pvs_density: Density = None,
    latency: Latency = None,
    reference_eye: Eye = None,
    atlas: Atlas = None,
    samples: Samples = None,
    codec: Codec = None,
    display_crf: DisplayCrf = None,
    device: DeviceName = None,
    seed: Seed = None,
    precision: Precision = 5.0,
    repetitions: Repetitions = 15,
    budget: Budget = 30.0,
    workers: Workers = 1,
    timeout: Timeout = None,
    out: Out = None,
    dry_run: DryRun = False,
    preset: Preset = None,
) -> None:
    """Measure run time against error over a grid of parameters and settings; write CSV and HTML.

    Exit codes: as of bench run.
    """
    from shading_atlas_bench.harness.cli.guard import guarded

    with guarded():
        from shading_atlas_bench.harness.sweep.wanted import read_wanted

        wanted = read_wanted(_settings_of(context.params), vary or (), precision, repetitions, budget, workers)
        if dry_run:
            from shading_atlas_bench.harness.cli.sweep_tables import show_grid

            show_grid(wanted, out)
            return
        from shading_atlas_bench.harness.cli.sweep_tables import show_sweep
        from shading_atlas_bench.harness.console import TerminalProgress
        from shading_atlas_bench.harness.sweep.run import sweep as run_sweep

        outcome = run_sweep(wanted, out, TerminalProgress())
        show_sweep(outcome.points, outcome.folder)
        raise typer.Exit(0 if outcome.well else SOME_FAILED)


@app.command("list")
def list_everything(scene: SceneName = None, unit: Unit = None) -> None:
    """Show the packers with their parameters, the scenes, paths, devices and metrics.

    With --scene only that scene: whether it is a place or an object and why, its unit, and how its walk starts.
    """
    from shading_atlas_bench.harness.cli.catalogue import show_catalogue
    from shading_atlas_bench.harness.cli.guard import guarded
    from shading_atlas_bench.harness.errors import InputError

    with guarded():
        if scene is not None:
            from shading_atlas_bench.harness.cli.scene_view import show_scene
            from shading_atlas_bench.harness.workload.settings import parse_unit

            show_scene(scene, None if unit is None else parse_unit(unit))
        elif unit is not None:
            raise InputError("--unit is for bench list --scene FILE: give both.")
        else:
            show_catalogue()


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder that `bench run`, `sweep` or `claims` wrote")],
) -> None:
    """Rebuild the CSV files and the HTML report from the results store."""
    from shading_atlas_bench.harness.cli.guard import guarded
    from shading_atlas_bench.harness.cli.report import show_report

    with guarded():
        show_report(folder)


@app.command()
def compare(
    first: Annotated[Path, typer.Argument(metavar="A", help="A folder that `bench run` wrote")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another one")],
) -> None:
    """Say per method and metric whether run B is better, worse or ambiguous against run A, by a rank test."""
    from shading_atlas_bench.harness.cli.comparison import show_comparison
    from shading_atlas_bench.harness.cli.guard import guarded

    with guarded():
        show_comparison(first, second)


@app.command()
def doctor(
    devices: Annotated[
        bool, typer.Option("--devices", help="Run every kernel on every OpenCL device, against its float64 twin")
    ] = False,
    device: Annotated[
        str | None, typer.Option(help="With --devices: only those with this in their names", metavar="NAME")
    ] = None,
) -> None:
    """Check devices, versions, a kernel against its float64 twin, and the system parts the suite needs.

    With --devices nothing but the devices, and these thoroughly: minutes for each. Exit codes: 0 all is well, 1
    something is not, 2 unusable arguments.
    """
    from shading_atlas_bench.harness.cli.examination import show_examination
    from shading_atlas_bench.harness.cli.guard import guarded
    from shading_atlas_bench.harness.errors import InputError

    with guarded():
        if devices:
            from shading_atlas_bench.harness.doctor.devices import check_devices

            well = check_devices(device)
        elif device is not None:
            raise InputError("--device is for bench doctor --devices: give both.")
        else:
            well = show_examination()
        if not well:
            raise typer.Exit(SOME_FAILED)


for command in (check, stress, kernels, claims, tables):
    app.command()(command)


def main() -> None:
    """Run the command line in this process."""
    end_with_supervisor()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a letter that the console lacks is printed as an escape
            stream.reconfigure(errors="backslashreplace")
    for argument in sys.argv[1:]:
        if any("\ud800" <= letter <= "\udfff" for letter in argument):  # bytes that Python could not decode
            encoding = sys.getfilesystemencoding()
            print(f"bench: {argument} is not a name in {encoding}: rename it, or use a UTF-8 locale.", file=sys.stderr)
            sys.exit(UNUSABLE)
    try:
        app()
    except KeyboardInterrupt:
        print("Interrupted.", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
