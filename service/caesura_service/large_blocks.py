"""The return of memory to the system: a large block goes back once it is no longer used.

The allocator of glibc raises the size from which it does so with every such block that a program frees, up to
32 MB. A long program is encoded anew at each change of it, and the blocks of these bytes then leave holes. Of
15 MB by which an hour of work grew a session, 13 were holes (`tests/bench/hour.py`).
"""

from __future__ import annotations

import ctypes

LARGE_BYTES = 256 * 1024
_M_MMAP_THRESHOLD = -3  # malloc.h


def return_large_blocks() -> bool:
    """Return blocks of `LARGE_BYTES` or more when they are freed; False where the allocator is another."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except AttributeError:
        return False
    return bool(mallopt(_M_MMAP_THRESHOLD, LARGE_BYTES))
