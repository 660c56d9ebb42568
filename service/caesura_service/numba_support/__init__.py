"""Compilation of the `kernels` of each room, its cache, and whether numba is available."""

from __future__ import annotations

import logging
from functools import cache
from pathlib import Path

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
    """Return whether the filter's compiled code is cached; otherwise the first segmentation compiles it."""
    from caesura_service.numba_support.decorators import cache_directory  # noqa: PLC0415 - imports numba

    kept = cache_directory(Path(__file__).parents[1] / "changepoint" / "kernels")
    return any(kept.rglob("*.nbc"))
