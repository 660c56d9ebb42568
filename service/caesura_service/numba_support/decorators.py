"""The decorators that compile every kernel, and the place of their cache.

Kernels are compiled without the interpreter, without reference counting, and with C's division: a branch at
every division would prevent vectorised loops. A product and a sum may be fused into one instruction.

Numba caches compiled code by the file of a function, and does not notice a change of a called function or
constant in another file. So a package's compiled code is cached under a digest of all its kernel sources; a
kernel calls none of another package. Numba writes to the directory from which it reads: if that is read-only
(a container image), its content is copied to a writable one.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba

config: Any = numba.config
njit: Any = numba.njit  # whose stubs do not know `_nrt`
GIVEN = config.CACHE_DIR  # as NUMBA_CACHE_DIR says
SERVICE = Path(__file__).parents[1]
PACKAGES = (SERVICE / "changepoint" / "kernels", SERVICE / "signals" / "kernels")


def digest(room: Path) -> str:
    """Return a digest of all sources of a package's kernels, and of this module, as 16 hex digits."""
    sources = (Path(__file__), *sorted(room.glob("*.py")))
    return hashlib.blake2b(b"\0".join(path.read_bytes() for path in sources), digest_size=8).hexdigest()


@cache
def cache_directory(room: Path) -> Path:
    """Return the directory of a package's compiled code: in NUMBA_CACHE_DIR, in the package, or a copy of
    that.
    """
    if GIVEN:
        return Path(GIVEN) / digest(room)
    own = room / "__pycache__" / digest(room)
    if os.access(own if own.exists() else room, os.W_OK):
        return own
    copy = _own_directory() / digest(room)
    if own.exists() and not copy.exists():
        shutil.copytree(own, copy, dirs_exist_ok=True)
    return copy


def completion_mark() -> Path:
    """Return the file that exists once all kernels are cached, for this processor, numba and directory."""
    processor = config.CPU_NAME or llvmlite.binding.get_host_cpu_name()
    made_for = (*map(digest, PACKAGES), processor, numba.__version__, str(SERVICE))
    name = hashlib.blake2b("\0".join(made_for).encode(), digest_size=8).hexdigest()
    return cache_directory(PACKAGES[0]) / f"complete-{name}"


def _own_directory() -> Path:
    """Return the cache in this user's home, or else a new temporary directory.

    It belongs to this user, because its content is executed.
    """
    caches = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    mine = Path(caches) / "caesura" / "kernels"
    try:
        mine.mkdir(parents=True, exist_ok=True)
    except OSError:
        return Path(tempfile.mkdtemp(prefix="caesura-"))
    return mine if os.access(mine, os.W_OK) else Path(tempfile.mkdtemp(prefix="caesura-"))


def _kept(**how: object) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a function and caches the code in the directory of its package."""
    compile_ = njit(cache=True, nogil=True, error_model="numpy", _nrt=False, **how)

    def decorate(function: Callable[..., Any]) -> Any:
        config.CACHE_DIR = str(cache_directory(Path(function.__code__.co_filename).parent))
        return compile_(function)

    return decorate


compiled = _kept(fastmath={"contract"})
inlined = _kept(fastmath={"contract"}, forceinline=True)
# Sums and extremes of numbers may be taken in any order, which is the same one every time.
reducing = _kept(fastmath={"reassoc", "contract", "nnan", "nsz"})
