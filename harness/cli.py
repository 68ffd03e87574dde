"""The command line: `bench run`, `list`, `report`, `compare`, `doctor`; nothing heavy is imported until needed."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

app = typer.Typer(
    name="bench",
    help="Measure shading-atlas packers on identical scenes, paths, visible sets, shading and encoders.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

SOME_FAILED, UNUSABLE = 1, 2
WORK, CLIENT, CODING, RUNNING = "What to run", "The client and its view cell", "Atlas and encoding", "How to run"


def _option(panel: str, help_text: str, *names: str, metavar: str | None = None) -> Any:
    return typer.Option(*names, help=help_text, metavar=metavar, rich_help_panel=panel)


@app.command()
def run(
    method: Annotated[
        list[str] | None,
        _option(
            WORK,
            "all, a name, 'name\\[param=value,...]', 'module:Class' or 'file.py:Class'; repeatable. Default: all",
            metavar="METHOD",
        ),
    ] = None,
    scene: Annotated[
        str | None, _option(WORK, "A built-in scene or a file. Default: hall", metavar="NAME|FILE")
    ] = None,
    detail: Annotated[int | None, _option(WORK, "Triangles of a built-in scene", metavar="N")] = None,
    unit: Annotated[float | None, _option(WORK, "Metres per unit of a file. Default: 1", metavar="M")] = None,
    repair: Annotated[
        bool | None, _option(WORK, "Remove duplicate and degenerate faces and non-manifold edges first", "--repair")
    ] = None,
    decimate: Annotated[float | None, _option(WORK, "Keep this share of the triangles", metavar="RATIO")] = None,
    path: Annotated[
        str | None, _option(WORK, "walk, orbit, turntable, animation, or a file. Default: walk", metavar="NAME|FILE")
    ] = None,
    head_motion: Annotated[
        str | None, _option(WORK, "A recording of head motion. Default: synthetic", metavar="FILE")
    ] = None,
    frames: Annotated[int | None, _option(WORK, "Frames of the path. Default: 12", metavar="N")] = None,
    size: Annotated[str | None, _option(CLIENT, "The client's picture. Default: 960x540", metavar="WxH")] = None,
    fov: Annotated[float | None, _option(CLIENT, "Horizontal field of view. Default: 60", metavar="DEG")] = None,
    cell: Annotated[
        str | None,
        _option(
            CLIENT,
            "View cell: radius in metres and field of view in degrees, or pvs1, pvs2, pvs3. Default: 0.08,80",
            metavar="RADIUS,FOV",
        ),
    ] = None,
    pvs_density: Annotated[
        float | None, _option(CLIENT, "Density of the PVS views over the client's. Default: 2", metavar="X")
    ] = None,
    latency: Annotated[float | None, _option(CLIENT, "From server pose to display. Default: 50", metavar="MS")] = None,
    atlas: Annotated[str | None, _option(CODING, "Texels of the atlas. Default: 2048x2048", metavar="WxH")] = None,
    codec: Annotated[str | None, _option(CODING, "h264, jpeg or none. Default: h264", metavar="CODEC")] = None,
    crf: Annotated[str | None, _option(CODING, "Rates to encode at. Default: 5,10,25,35", metavar="LIST")] = None,
    display_crf: Annotated[int | None, _option(CODING, "The rate the client sees. Default: 25", metavar="N")] = None,
    device: Annotated[str | None, _option(RUNNING, "Part of an OpenCL device's name", metavar="NAME")] = None,
    seed: Annotated[int | None, _option(RUNNING, "Of scene, head motion and methods. Default: 0", metavar="N")] = None,
    repeat: Annotated[int | None, _option(RUNNING, "Timings of every frame. Default: 1", metavar="N")] = None,
    timeout: Annotated[float | None, _option(RUNNING, "For one packing. Default: 60", metavar="SECONDS")] = None,
    out: Annotated[
        Path | None, _option(RUNNING, "Folder of the results. Default: a new one in runs/", metavar="DIR")
    ] = None,
    dump: Annotated[
        bool | None, _option(RUNNING, "Also write every atlas, its owners and the pictures", "--dump")
    ] = None,
    dry_run: Annotated[bool, _option(RUNNING, "Only say what would run, and for how long", "--dry-run")] = False,
    config: Annotated[
        Path | None, _option(RUNNING, "Replay this run.json; other options override it", metavar="FILE")
    ] = None,
) -> None:
    """Run methods on a scene and write CSV and HTML.

    Exit codes: 0 every row is ok or skipped with a reason, 1 some rows failed, 2 unusable arguments or input.
    """
    from harness import settings as s

    def build() -> s.Settings:
        given: dict[str, Any] = {
            "scene": scene, "detail": detail, "unit": unit, "repair": repair, "decimate": decimate, "path": path,
            "head_motion": head_motion, "frames": frames, "fov": fov, "pvs_density": pvs_density, "latency": latency,
            "codec": codec, "display_crf": display_crf, "device": device, "seed": seed, "repeat": repeat,
            "timeout": timeout, "dump": dump,
        }  # fmt: skip
        if method:
            given["methods"] = tuple(method)
        if size:
            given["width"], given["height"] = s.parse_size(size, "--size")
        if atlas:
            given["atlas_width"], given["atlas_height"] = s.parse_size(atlas, "--atlas")
        if cell:
            parsed = s.parse_cell(cell)
            given["cell_radius"], given["cell_fov"] = parsed.radius, parsed.fov
        if crf:
            given["crf"] = s.parse_crfs(crf)
        base = s.read_settings(config).to_json() if config else {}
        return s.Settings.from_json(base | {k: v for k, v in given.items() if v is not None}, str(config or "run"))

    from harness.console import guarded

    with guarded():
        wanted = build()
        if dry_run:
            from harness.plan import show_plan

            show_plan(wanted, out)
            return
        from harness.run import run as run_all

        raise typer.Exit(0 if run_all(wanted, out) else SOME_FAILED)


@app.command("list")
def list_everything() -> None:
    """Show the packers with their parameters, the scenes, paths, devices and metrics."""
    from harness.console import guarded, show_catalogue

    with guarded():
        show_catalogue()


@app.command()
def report(folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder that `bench run` wrote")]) -> None:
    """Rebuild the CSV files and the HTML report from the results store."""
    from harness.console import guarded, show_report

    with guarded():
        show_report(folder)


@app.command()
def compare(
    first: Annotated[Path, typer.Argument(metavar="A", help="A folder that `bench run` wrote")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another one")],
) -> None:
    """Say per method and metric whether run B is better, worse or ambiguous against run A, by a rank test."""
    from harness.console import guarded, show_comparison

    with guarded():
        show_comparison(first, second)


@app.command()
def doctor() -> None:
    """Check devices, versions, a kernel against its float64 twin, and the system parts the suite needs."""
    from harness.console import guarded, show_examination

    with guarded():
        if not show_examination():
            raise typer.Exit(SOME_FAILED)


def main() -> None:
    """The entry point of `bench`."""
    try:
        app()
    except KeyboardInterrupt:
        print("Interrupted; finished frames are kept, the same command goes on from there.", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
