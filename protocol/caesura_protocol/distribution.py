"""The distribution: its name, its installed version, and how an extra of it is installed."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

DISTRIBUTION = "caesura-teaching"  # the package index has another project under `caesura`


def installing(extra: str) -> str:
    """The command that installs an extra, as an error names it. README.md, Install, has the others.

    >>> installing("mcap")
    "pip install '.[mcap]' in a clone of Caesura"
    """
    return f"pip install '.[{extra}]' in a clone of Caesura"


def installed_version() -> str:
    """The version that is installed; `0+unknown` where the packages are imported without an installation."""
    try:
        return version(DISTRIBUTION)
    except PackageNotFoundError:
        return "0+unknown"
