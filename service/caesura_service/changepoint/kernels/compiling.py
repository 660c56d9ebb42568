"""How everything here is compiled, and where that is kept.

Without the interpreter, without counting references, and dividing as C does: a branch at every division would
keep loops from being done several numbers at a time. A product and a sum may be one instruction.

Numba keeps what it compiled by the file of a function, and does not see that a function which is called, or a
constant, has changed in another. So all of it is kept under a digest of all sources. Numba wants to write
where it reads: where the package cannot be written (an image), what is kept there is copied to where it can.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numba

HERE = Path(__file__).parent
config: Any = numba.config
njit: Any = numba.njit  # whose stubs do not know `_nrt`


def digest() -> str:
    """Of all sources."""
    sources = sorted(HERE.glob("*.py"))
    return hashlib.blake2b(b"\0".join(path.read_bytes() for path in sources), digest_size=8).hexdigest()


def cache_directory() -> Path:
    """Where compiled code is kept: as NUMBA_CACHE_DIR says, or in the package, or in a copy of that."""
    if config.CACHE_DIR:
        return Path(config.CACHE_DIR) / digest()
    ours = HERE / "__pycache__" / digest()
    if os.access(ours if ours.exists() else HERE, os.W_OK):
        return ours
    copy = _own_directory() / digest()
    if ours.exists() and not copy.exists():
        shutil.copytree(ours, copy, dirs_exist_ok=True)
    return copy


def _own_directory() -> Path:
    """Where this user alone writes: what lies there is run."""
    caches = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    mine = Path(caches) / "caesura" / "kernels"
    try:
        mine.mkdir(parents=True, exist_ok=True)
    except OSError:
        return Path(tempfile.mkdtemp(prefix="caesura-"))
    return mine if os.access(mine, os.W_OK) else Path(tempfile.mkdtemp(prefix="caesura-"))


config.CACHE_DIR = str(cache_directory())

_HOW = {"cache": True, "nogil": True, "error_model": "numpy", "_nrt": False}
compiled = njit(**_HOW, fastmath={"contract"})
inlined = njit(**_HOW, fastmath={"contract"}, forceinline=True)
# Sums and extremes of numbers may be taken in any order, which is the same one every time.
reducing = njit(**_HOW, fastmath={"reassoc", "contract", "nnan", "nsz"})
