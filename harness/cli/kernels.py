"""The command `bench kernels`; nothing heavy is imported until it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from shading_atlas_bench.harness.cli.guard import guarded

Names = Annotated[
    list[str] | None,
    typer.Option(
        "--kernel", metavar="NAME", help="A folder, file or function below kernels/; repeatable. Default: all"
    ),
]
Variants = Annotated[
    list[str] | None,
    typer.Option("--variant", metavar="NAME", help="default, contracted or relaxed; repeatable"),
]
Out = Annotated[Path, typer.Option(metavar="DIR", help="Folder of the results")]
Repeat = Annotated[int, typer.Option(metavar="N", help="Timings of every kernel")]
DeviceName = Annotated[str | None, typer.Option(metavar="NAME", help="Part of an OpenCL device's name")]


def kernels(
    kernel: Names = None,
    variant: Variants = None,
    out: Out = Path("runs/kernels"),
    repeat: Repeat = 5,
    device: DeviceName = None,
) -> None:
    """Measure every kernel's time against its error, in each build variant; write CSV and HTML."""
    with guarded():
        from shading_atlas_bench.harness.kernel_timing.timing import TimingRequest, bench_kernels

        chosen = {"variants": tuple(variant)} if variant else {}
        bench_kernels(TimingRequest(tuple(kernel or ()), repeat=repeat, device=device, **chosen), out)
