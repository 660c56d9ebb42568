"""The distribution: its name, its installed version, and the command that installs an extra."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, distribution, version
from typing import Any
from urllib.parse import urlsplit

from caesura_protocol.errors import SourceError

DISTRIBUTION = "caesura-teaching"  # the package index has another project under `caesura`
PACKAGES = ("caesura_protocol", "caesura_service", "caesura_clients", "caesura_lab")


def install_command(extra: str) -> str:
    """Return the command that installs an extra, for errors; it depends on how Caesura was installed.

    For a clone (PEP 610: `dir_info`, or no installation) it installs the clone; for a wheel it names the file
    or address; otherwise it names the distribution. README.md, Install, has the others.
    """
    installed = _installed_from()
    if installed is None:
        return f"pip install '{DISTRIBUTION}[{extra}]'"
    from urllib.request import url2pathname  # noqa: PLC0415 - it imports what speaks HTTP

    address = str(installed.get("url", ""))
    if "dir_info" in installed:
        return f"pip install '.[{extra}]' in a clone of Caesura"
    if address.startswith("file:"):
        return f"pip install '{url2pathname(urlsplit(address).path)}[{extra}]'"
    scheme = f"{installed['vcs_info']['vcs']}+" if "vcs_info" in installed else ""
    return f"pip install '{DISTRIBUTION}[{extra}] @ {scheme}{address}'"


def _installed_from() -> dict[str, Any] | None:
    """Return the origin that pip recorded (PEP 610, direct_url.json); None for an index."""
    try:
        recorded = distribution(DISTRIBUTION).read_text("direct_url.json")
    except PackageNotFoundError:
        return {"dir_info": {}}  # imported from a clone
    return None if recorded is None else json.loads(recorded)


def installed_version() -> str:
    """Return the installed version; `0+unknown` if the packages are imported without an installation."""
    try:
        return version(DISTRIBUTION)
    except PackageNotFoundError:
        return "0+unknown"


@contextmanager
def import_extra(extra: str, what: object) -> Iterator[None]:
    """Import a module of an extra. Raises SourceError, which names the extra, if it is not installed."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] in PACKAGES:
            raise
        raise SourceError(f"{what} needs {error.name}: {install_command(extra)}") from error
