"""Errors for people: one sentence, and an exit code."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager

import typer

from shading_atlas_bench.errors import BenchError
from shading_atlas_bench.harness.console import make_console, styled
from shading_atlas_bench.harness.errors import StoppedError
from shading_atlas_bench.harness.watch.memory import ran_out

UNUSABLE_NAMES = {errno.ENAMETOOLONG, errno.ELOOP, errno.EACCES}  # wherever a path is looked up
SOME_FAILED, UNUSABLE, INTERRUPTED = 1, 2, 130  # exit codes


@contextmanager
def guarded() -> Iterator[None]:
    """Turn errors about arguments and input into one sentence on stderr and exit code 2; others are bugs and show."""
    try:
        yield
    except BenchError as error:
        make_console(stderr=True).print(styled("[bold red]bench:[/] {}", error), soft_wrap=True)
        raise typer.Exit(UNUSABLE) from None
    except OSError as error:
        if error.errno not in UNUSABLE_NAMES:
            raise
        sentence = f"{error.filename} cannot be used: {error.strerror}. Give another one."
        make_console(stderr=True).print(styled("[bold red]bench:[/] {}", sentence), soft_wrap=True)
        raise typer.Exit(UNUSABLE) from None
    except MemoryError:
        make_console(stderr=True).print(styled("[bold red]bench:[/] {}", ran_out()), soft_wrap=True)
        raise typer.Exit(UNUSABLE) from None
    except StoppedError as stopped:
        make_console(stderr=True).print(f"Stopped. {stopped!s}", soft_wrap=True)
        raise typer.Exit(INTERRUPTED) from None
    except KeyboardInterrupt:
        make_console(stderr=True).print("Stopped.")
        raise typer.Exit(INTERRUPTED) from None
