"""Clients of the segmenter: bridges, readers and the command line.

>>> from caesura_clients import connect
>>> with connect() as caesura:  # doctest: +SKIP
...     for update in caesura.results("cell-1"):
...         print(update.segments)

A name is imported at its first use, so that the command starts before the network libraries are loaded.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from caesura_clients.client import Caesura, connect
    from caesura_clients.session_state_reader import Update
    from caesura_protocol.errors import (
        AccessDenied,
        CaesuraError,
        NotFound,
        ProtocolError,
        SourceError,
        Unreachable,
    )
    from caesura_protocol.errors import NotFound as Absent
    from caesura_protocol.errors import SourceError as BadSource

# Name → module and name there; Absent and BadSource are the names before 0.2, kept for one release.
_PLACES = {
    "Caesura": ("caesura_clients.client", "Caesura"),
    "connect": ("caesura_clients.client", "connect"),
    "Update": ("caesura_clients.session_state_reader", "Update"),
    "AccessDenied": ("caesura_protocol.errors", "AccessDenied"),
    "CaesuraError": ("caesura_protocol.errors", "CaesuraError"),
    "NotFound": ("caesura_protocol.errors", "NotFound"),
    "ProtocolError": ("caesura_protocol.errors", "ProtocolError"),
    "SourceError": ("caesura_protocol.errors", "SourceError"),
    "Unreachable": ("caesura_protocol.errors", "Unreachable"),
    "Absent": ("caesura_protocol.errors", "NotFound"),
    "BadSource": ("caesura_protocol.errors", "SourceError"),
}

__all__ = [
    "Absent",
    "AccessDenied",
    "BadSource",
    "Caesura",
    "CaesuraError",
    "NotFound",
    "ProtocolError",
    "SourceError",
    "Unreachable",
    "Update",
    "connect",
]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, there = _PLACES[name]
    return getattr(import_module(module), there)
