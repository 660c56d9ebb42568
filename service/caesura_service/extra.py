"""Checks that the packages of the extra `service` are installed.

None of them is imported, because that takes a second.
"""

from __future__ import annotations

from importlib.util import find_spec

PACKAGES = (
    *("cryptography", "greenlet", "numba", "pinocchio", "prometheus_client", "pythonjsonlogger", "scipy"),
)


def check_installed() -> None:
    """Raise ModuleNotFoundError, which names the package, if a package of the extra is missing."""
    for name in PACKAGES:
        if find_spec(name) is None:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
