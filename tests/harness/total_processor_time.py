"""Runs a command and prints the processor time of all processes that it starts.

    python tests/harness/total_processor_time.py make test

The kernel adds the time of a process to the process that waits for it. So `time` and `harness.processor_time`
miss those for which no process waits, such as Chromium's. Here they become children of this process, which
waits for all of them and ends with the last. Linux only: prctl(2).
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import suppress

CHILD_SUBREAPER = 36  # PR_SET_CHILD_SUBREAPER


def run(command: Sequence[str]) -> int:
    """Run a command to the end of its last process; return its own exit code."""
    if ctypes.CDLL(None).prctl(CHILD_SUBREAPER, 1, 0, 0, 0) != 0:
        raise OSError("prctl: this process cannot adopt orphans")
    signal.signal(signal.SIGINT, lambda *_: None)  # the command gets it too, and ends
    child, code = os.posix_spawnp(command[0], command, os.environ), 1
    with suppress(ChildProcessError):  # no process is left
        while True:
            ended, status = os.wait()
            if ended == child:
                code = os.waitstatus_to_exitcode(status)
    return code


if __name__ == "__main__":
    began = time.monotonic()
    exit_code = run(sys.argv[1:])
    used = os.times()
    wall_s = time.monotonic() - began
    print(f"{used.children_user + used.children_system:.1f} s of CPU in {wall_s:.1f} s", file=sys.stderr)
    sys.exit(exit_code)
