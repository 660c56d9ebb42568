"""Makes the allocator return large blocks of memory to the system as soon as they are freed.

glibc raises the size threshold for that with every large block that a program frees, up to 32 MB. A long task
program is encoded again at each change, and its freed blocks then fragment the heap. Of 15 MB by which an
hour of work grew a session, 13 were unused fragments (`tests/bench/hour.py`).
"""

from __future__ import annotations

import ctypes

LARGE_BYTES = 256 * 1024
_M_MMAP_THRESHOLD = -3  # malloc.h


def return_large_blocks() -> bool:
    """Make the allocator unmap freed blocks of `LARGE_BYTES` or more; return False for another allocator."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except AttributeError:
        return False
    return bool(mallopt(_M_MMAP_THRESHOLD, LARGE_BYTES))
