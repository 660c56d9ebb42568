"""What is costly to compute, computed once a test run and shared by all of its processes.

Each process of pytest-xdist would compute the same simulation again. The first that needs a result writes it
to the folder of the run; the others wait for it and read it. Nothing is kept from one run to the next.
"""

from __future__ import annotations

import copyreg
import fcntl
import os
import pickle
from collections.abc import Callable
from functools import cache, wraps
from hashlib import sha256
from pathlib import Path
from types import MappingProxyType
from typing import ParamSpec, TypeVar

Given = ParamSpec("Given")
Result = TypeVar("Result")
RUN = "CAESURA_TEST_RUN"  # of the environment: the folder, which tests/conftest.py makes and removes


def read_only(content: dict[str, object]) -> MappingProxyType[str, object]:
    return MappingProxyType(content)


copyreg.pickle(MappingProxyType, lambda proxy: (read_only, (dict(proxy),)))  # the signals of a recording


def once_a_run(compute: Callable[Given, Result]) -> Callable[Given, Result]:
    """Cache a function of values that pickle, and of nothing else. No caller changes a result."""

    @cache
    def found(given: bytes) -> Result:
        args, options = pickle.loads(given)
        if RUN not in os.environ:
            return compute(*args, **options)
        name = sha256(f"{compute.__module__}.{compute.__qualname__}".encode() + given).hexdigest()
        file = Path(os.environ[RUN]) / name
        with file.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not file.exists():
                file.write_bytes(pickle.dumps(compute(*args, **options)))
        result: Result = pickle.loads(file.read_bytes())
        return result

    @wraps(compute)
    def shared(*args: Given.args, **options: Given.kwargs) -> Result:
        return found(pickle.dumps((args, options)))

    return shared
