"""The name of the distribution, and how an extra of it is installed."""

from __future__ import annotations

DISTRIBUTION = "caesura-teaching"  # the package index has another project under `caesura`


def installing(extra: str) -> str:
    """The command that installs an extra, as an error names it. README.md, Install, has the others.

    >>> installing("mcap")
    "pip install '.[mcap]' in a clone of Caesura"
    """
    return f"pip install '.[{extra}]' in a clone of Caesura"
