"""Clients of the segmenter: bridges, readers and the command line.

>>> from caesura_clients import connect
>>> with connect() as caesura:  # doctest: +SKIP
...     for update in caesura.results("cell-1"):
...         print(update.segments)
"""

from caesura_clients.client import Caesura, connect
from caesura_clients.results import Update
from caesura_protocol.errors import CaesuraError, NotFound, SourceError, Unreachable

Absent, BadSource = NotFound, SourceError  # the names before 0.2, kept for one release

__all__ = [
    "Absent",
    "BadSource",
    "Caesura",
    "CaesuraError",
    "NotFound",
    "SourceError",
    "Unreachable",
    "Update",
    "connect",
]
