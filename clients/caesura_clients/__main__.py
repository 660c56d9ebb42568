"""Start of the command `caesura`: Ctrl-C is caught before anything is imported, which takes a second."""

from __future__ import annotations

import sys

INTERRUPTED = 130  # exit code of a shell's command that SIGINT has ended


def main() -> None:
    """Run the command line; Ctrl-C ends it without a traceback, also while modules are imported."""
    try:
        from caesura_clients.cli import main as run  # noqa: PLC0415 - see the module

        run()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
