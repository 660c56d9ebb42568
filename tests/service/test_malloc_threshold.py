"""Memory of large blocks goes back to the system, whatever was freed before."""

from __future__ import annotations

import subprocess
import sys

import pytest

from caesura_service.malloc_threshold import return_large_blocks

# Blocks between two that stay: where the allocator has raised its threshold, they leave holes in the heap.
RESIDENT_AFTER = """
import sys
from caesura_service.malloc_threshold import return_large_blocks

if sys.argv[1] == "returned":
    assert return_large_blocks()
del (raises := {0: b"x" * (1 << 23)})[0]
def resident():
    return int(open("/proc/self/statm").read().split()[1]) * 4096
before, kept = resident(), []
for _ in range(64):
    large = b"x" * (1 << 20)
    kept.append(b"x" * 100_000)
    small, large = large, None
    kept.append(small)
del kept[1::2], small
print(resident() - before)
"""


def grown_by(how: str) -> int:
    """[bytes] by which a process has grown that has freed 64 blocks of 1 MiB between others."""
    command = [sys.executable, "-c", RESIDENT_AFTER, how]
    return int(subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout)


@pytest.mark.skipif(not return_large_blocks(), reason="the allocator is not glibc's")
def test_freed_blocks_leave_no_holes():
    most = 64 * 100_000 + (8 << 20)
    assert grown_by("kept") > 64 << 20
    assert grown_by("returned") < most
