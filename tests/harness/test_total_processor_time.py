"""The time of a process for which no process waits is counted."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="prctl is of Linux")
TOOL = Path(__file__).with_name("total_processor_time.py")
USES_S = 0.5
LEAVES_AN_ORPHAN = f"""
import os, sys, time
if os.fork() == 0:
    while time.process_time() < {USES_S}:
        pass
    os._exit(0)
os._exit(3)
"""


def test_an_orphan_counts_and_the_exit_code_is_that_of_the_command():
    command = [sys.executable, TOOL, sys.executable, "-c", LEAVES_AN_ORPHAN]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    assert ended.returncode == 3
    found = re.fullmatch(r"(\d+\.\d) s of CPU in \d+\.\d s\n", ended.stderr)
    assert found is not None, ended.stderr
    assert float(found[1]) >= USES_S
