"""Compilation of the `kernels` of each room, its cache, and whether numba is available."""

from __future__ import annotations

import logging
from functools import cache

logger = logging.getLogger(__name__)


@cache
def has_kernels() -> bool:
    """Whether numba is installed. Without it everything works, a hundred times slower."""
    try:
        import numba  # noqa: F401, PLC0415
    except ImportError:
        logger.warning("numba is not installed: segmentation is slow; the extra 'service' has it")
        return False
    return True
