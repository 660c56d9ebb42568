"""Entry point of the command `caesura`. It handles Ctrl-C before the imports, which take a second.

An import can turn KeyboardInterrupt into another error: pydantic does, while it builds a schema. So the
handler also records that the signal arrived.
"""

from __future__ import annotations

import signal
import sys
from types import FrameType

INTERRUPTED = 130  # exit code of a shell's command that SIGINT has ended


def main() -> None:
    """Run the command line; Ctrl-C ends it without a traceback, also while modules are imported."""
    interrupts: list[int] = []

    def interrupt(number: int, _frame: FrameType | None) -> None:
        interrupts.append(number)
        raise KeyboardInterrupt

    if (
        signal.getsignal(signal.SIGINT) is signal.default_int_handler
    ):  # a shell ignores it for what runs behind it
        signal.signal(signal.SIGINT, interrupt)
    try:
        from caesura_clients.cli import main as run  # noqa: PLC0415 - see the module

        run()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except Exception:
        if not interrupts:
            raise
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
