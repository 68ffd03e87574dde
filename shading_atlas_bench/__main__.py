"""`bench`, and `python -m shading_atlas_bench`."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line. Ctrl-C ends it in one line, also while it is being imported."""
    try:
        from shading_atlas_bench.harness.cli.supervisor import main as run

        run()
    except KeyboardInterrupt:
        print("bench: Stopped.", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
