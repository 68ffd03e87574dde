"""The command line: `bench run`, `sweep`, `list` and others, a file each; nothing heavy is imported until needed."""

from __future__ import annotations

import errno
import io
import os
import sys
import unicodedata
from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption

from shading_atlas_bench.errors import visible
from shading_atlas_bench.harness.cli.catalogue import list_everything
from shading_atlas_bench.harness.cli.check import check
from shading_atlas_bench.harness.cli.claims import claims
from shading_atlas_bench.harness.cli.comparison import compare
from shading_atlas_bench.harness.cli.examination import doctor
from shading_atlas_bench.harness.cli.guard import UNUSABLE
from shading_atlas_bench.harness.cli.kernels import kernels
from shading_atlas_bench.harness.cli.report import report
from shading_atlas_bench.harness.cli.run import run
from shading_atlas_bench.harness.cli.stress import stress
from shading_atlas_bench.harness.cli.sweep import sweep
from shading_atlas_bench.harness.cli.tables import tables
from shading_atlas_bench.harness.progress import warnings_as_sentences
from shading_atlas_bench.harness.watch.ends import end_with_supervisor

if TYPE_CHECKING:
    from typer._click.core import Context, Parameter  # Typer brings a click of its own, and gives these no other names


class Command(TyperCommand):
    """A command whose help shows flags without a value, where Typer says `<bool>` behind them."""

    def get_params(self, ctx: Context) -> list[Parameter]:
        """Its options and arguments."""
        return _flags_alone(super().get_params(ctx))


class Commands(TyperGroup):
    """The same of all commands together."""

    def get_params(self, ctx: Context) -> list[Parameter]:
        """Their common options."""
        return _flags_alone(super().get_params(ctx))


def _flags_alone(parameters: list[Parameter]) -> list[Parameter]:
    for one in parameters:
        if isinstance(one, TyperOption) and one.is_flag:
            one.metavar = ""
    return parameters


app = typer.Typer(
    name="bench",
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)
FULL = {errno.ENOSPC, errno.EDQUOT}  # of a disk; whatever was to be written, that is no bug
COMMANDS: dict[str, Callable[..., None]] = {
    "run": run,
    "sweep": sweep,
    "list": list_everything,
    "report": report,
    "compare": compare,
    "doctor": doctor,
    "check": check,
    "stress": stress,
    "kernels": kernels,
    "claims": claims,
    "tables": tables,
}


def _tell_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version  # takes a tenth of the start

        print(version("shading-atlas-bench"))
        raise typer.Exit


@app.callback()
def _common(
    told: Annotated[
        bool,
        typer.Option("--version", help="Show the version and exit", callback=_tell_version, is_eager=True),
    ] = False,
) -> None:
    """Measure shading-atlas packers on identical scenes, paths, visible sets, shading and encoders."""


for name, command in COMMANDS.items():
    app.command(name, cls=Command)(command)


def _refuse(argument: str, why: str) -> None:
    print(f"bench: {visible(argument)} {why}", file=sys.stderr)
    sys.exit(UNUSABLE)


def main() -> None:
    """Run the command line in this process."""
    end_with_supervisor()
    warnings_as_sentences()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a letter that the console lacks is printed as an escape
            stream.reconfigure(errors="backslashreplace")
    for before, argument in pairwise(sys.argv):
        if "--out=" in (argument, f"{before}={argument}"):
            _refuse("--out", "is empty: give a folder, or leave it out.")
        kinds = {unicodedata.category(letter) for letter in argument}
        if "Cs" in kinds:  # bytes that Python could not decode
            _refuse(argument, f"is not a name in {sys.getfilesystemencoding()}: rename it, or use a UTF-8 locale.")
        if "Cc" in kinds:
            _refuse(argument, "has a control character: rename it.")
    try:
        try:
            app(prog_name="bench")
        finally:
            if sys.stdout:  # none where it was closed
                sys.stdout.flush()  # here, where its failing can be told
    except KeyboardInterrupt:
        print("Stopped.", file=sys.stderr)
        sys.exit(130)
    except OSError as error:
        unheard = error.filename is None and not _stdout_takes_more()
        if not unheard and error.errno not in FULL:
            raise
        if error.errno != errno.EPIPE:  # who closes a pipe has read enough
            what = "standard output" if unheard else error.filename or "a file"
            print(f"bench: {what} cannot be written ({error.strerror}): make room, and run again.", file=sys.stderr)
        sys.exit(UNUSABLE)


def _stdout_takes_more() -> bool:
    """Whether standard output can be written; where it cannot, it leads nowhere from now on."""
    try:
        print(flush=True)
    except OSError:
        with open(os.devnull, "w", encoding="utf-8") as nowhere:  # else Python tries once more as it ends
            os.dup2(nowhere.fileno(), sys.stdout.fileno())
        return False
    return True


if __name__ == "__main__":
    main()
