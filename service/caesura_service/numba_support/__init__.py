"""Compilation of the `kernels` of each room, its cache, and whether numba is available."""

from __future__ import annotations

import fcntl
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

logger = logging.getLogger(__name__)


@cache
def has_kernels() -> bool:
    """Return whether numba is installed. Without it the NumPy reference is used, a hundred times slower."""
    try:
        import numba  # noqa: F401, PLC0415
    except ImportError:
        logger.warning("numba is not installed: segmentation is slow; install the extra 'service'")
        return False
    return True


def is_compiled() -> bool:
    """Return whether all compiled code is cached; otherwise the first segmentation compiles it."""
    from caesura_service.numba_support.decorators import completion_mark  # noqa: PLC0415 - imports numba

    return completion_mark().is_file()


def mark_compiled() -> None:
    """State that all compiled code is cached: an interrupted compilation leaves a part of it."""
    from caesura_service.numba_support.decorators import completion_mark  # noqa: PLC0415 - imports numba

    completion_mark().touch()


@contextmanager
def compiling_alone() -> Iterator[None]:
    """Wait until no other process compiles for the same cache.

    The system frees the lock of a process that is killed.
    """
    from caesura_service.numba_support.decorators import completion_mark  # noqa: PLC0415 - imports numba

    mark = completion_mark()
    mark.parent.mkdir(parents=True, exist_ok=True)
    with mark.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
