"""What is costly to compute, computed once a test run and shared by all of its processes.

Each process of pytest-xdist would compute the same simulation again. The first that needs a result writes it
to a folder; the others wait for it and read it. `once_a_run` keeps nothing from one run to the next.
`once_a_version` keeps results in pytest's cache, under a digest of all that the function imports: own modules
and their data, the libraries' versions, and the processor, by which arithmetic differs in its last bit. One
version of a function is kept. `pytest --cache-clear` forgets it.
"""

from __future__ import annotations

import copyreg
import fcntl
import os
import pickle
import platform
import shutil
from collections.abc import Callable, Iterable
from functools import cache, wraps
from hashlib import sha256
from importlib.metadata import version
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from types import MappingProxyType
from typing import Any, ParamSpec, TypeVar

import grimp
from pydantic import BaseModel

Given = ParamSpec("Given")
Result = TypeVar("Result")
RUN = "CAESURA_TEST_RUN"  # of the environment: the folder, which tests/conftest.py makes and removes
KEPT = "CAESURA_TESTS_KEPT"  # of the environment: a folder of pytest's cache
OWN = ("caesura_protocol", "caesura_service", "caesura_clients", "caesura_lab")
LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "pin", "pydantic")  # that the functions compute with


def read_only(content: dict[str, object]) -> MappingProxyType[str, object]:
    return MappingProxyType(content)


copyreg.pickle(MappingProxyType, lambda proxy: (read_only, (dict(proxy),)))  # the signals of a recording


def once_a_run(compute: Callable[Given, Result]) -> Callable[Given, Result]:
    """Cache a function of values that pickle, and of nothing else. No caller changes a result."""
    return _shared(compute, lambda: Path(os.environ[RUN]))


def once_a_version(compute: Callable[Given, Result]) -> Callable[Given, Result]:
    """As `once_a_run`; later runs read the result until something that the function imports has changed."""

    def folder() -> Path:
        if KEPT not in os.environ:
            return Path(os.environ[RUN])
        mine = Path(os.environ[KEPT]) / f"{compute.__module__}.{compute.__qualname__}"
        found = mine / version_of(compute.__module__)
        if not found.exists():
            shutil.rmtree(mine, ignore_errors=True)
        found.mkdir(parents=True, exist_ok=True)
        return found

    return _shared(compute, cache(folder))


def _shared(compute: Callable[Given, Result], folder: Callable[[], Path]) -> Callable[Given, Result]:
    results: dict[str, Result] = {}

    def found(name: str, *args: Given.args, **options: Given.kwargs) -> Result:
        if RUN not in os.environ:
            return compute(*args, **options)
        with (Path(os.environ[RUN]) / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            file = folder() / name
            if not file.exists():
                part = file.with_suffix(".part")  # of a process that may be killed while it writes
                part.write_bytes(pickle.dumps(compute(*args, **options)))
                part.replace(file)
        result: Result = pickle.loads(file.read_bytes())
        return result

    @wraps(compute)
    def shared(*args: Given.args, **options: Given.kwargs) -> Result:
        written = BytesIO()
        _ByValue(written).dump((compute.__module__, compute.__qualname__, args, options))
        name = sha256(written.getvalue()).hexdigest()
        if name not in results:
            results[name] = found(name, *args, **options)
        return results[name]

    return shared


class _ByValue(pickle.Pickler):
    """Writes equal messages alike: as they pickle themselves, they name their fields in any order."""

    def reducer_override(self, one: Any) -> Any:
        return (type(one), (one.model_dump_json(),)) if isinstance(one, BaseModel) else NotImplemented


@once_a_run
def version_of(module: str) -> str:
    """Digest of a module, of all own modules that it imports and their data, and of what computes them."""
    digest = sha256("\n".join([platform.python_version(), *map(version, LIBRARIES), _processor()]).encode())
    for file in sorted(_files_of(imported_by(module))):
        digest.update(str(file).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def imported_by(module: str) -> set[str]:
    """Own modules that a module imports, directly or not, with the packages that they are in, and itself."""
    found = {module, *_graph().find_upstream_modules(module)}
    for name in list(found):
        parts = name.split(".")
        found |= {".".join(parts[:count]) for count in range(1, len(parts))}
    return found


@cache
def _graph() -> grimp.ImportGraph:
    """The imports of all own modules, as they were when the process first asked."""
    return grimp.build_graph(*OWN, cache_dir=None)


def _files_of(modules: Iterable[str]) -> Iterable[Path]:
    """Source of each module, and the data of packages below the top."""
    for name in modules:
        spec = find_spec(name)
        assert spec is not None
        assert spec.origin is not None
        source = Path(spec.origin)
        yield source
        if source.name == "__init__.py" and "." in name:
            yield from (
                one for one in source.parent.rglob("*") if one.is_file() and one.suffix not in {".py", ".pyc"}
            )


def _processor() -> str:
    """The processor's model, where Linux states it."""
    file = Path("/proc/cpuinfo")
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    return next((line for line in lines if line.startswith("model name")), platform.processor())
