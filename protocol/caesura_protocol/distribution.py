"""The distribution: its name, its installed version, and how an extra of it is installed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version

from caesura_protocol.errors import SourceError

DISTRIBUTION = "caesura-teaching"  # the package index has another project under `caesura`
PACKAGES = ("caesura_protocol", "caesura_service", "caesura_clients", "caesura_lab")


def install_command(extra: str) -> str:
    """Return the command that installs an extra, for errors. README.md, Install, has the others.

    >>> installing("mcap")
    "pip install '.[mcap]' in a clone of Caesura"
    """
    return f"pip install '.[{extra}]' in a clone of Caesura"


def installed_version() -> str:
    """Return the installed version; `0+unknown` where the packages are imported without an installation."""
    try:
        return version(DISTRIBUTION)
    except PackageNotFoundError:
        return "0+unknown"


@contextmanager
def import_extra(extra: str, what: object) -> Iterator[None]:
    """Import a module of an extra. Raises SourceError, which names the extra, where it is not installed."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] in PACKAGES:
            raise
        raise SourceError(f"{what} needs {error.name}: {install_command(extra)}") from error
