"""`caesura bridge --marker`: forces a changepoint at every line of standard input, from a key or a pedal."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

import typer

from caesura_clients.bridge import Bridge
from caesura_clients.refusal_words import refusal_words
from caesura_protocol.errors import CaesuraError, ProtocolError


@contextmanager
def marking(bridge: Bridge, keys: TextIO | None = None) -> Iterator[None]:
    """Force a changepoint at each line of `keys`, by default of stdin, while the context lasts.

    The thread blocks on a line that may never come, so it is a daemon thread and is not joined.
    """
    over = threading.Event()
    wanted = keys or sys.stdin

    def run() -> None:
        for _ in wanted:
            if over.is_set():
                return
            typer.echo(_mark(bridge), err=True)

    threading.Thread(target=run, name=f"marker {bridge.station}", daemon=True).start()
    try:
        yield
    finally:
        over.set()


def _mark(bridge: Bridge) -> str:
    """Mark a boundary and return text on the result; a failed mark does not end the demonstration."""
    try:
        ack = bridge.mark()
    except ProtocolError as refusal:
        return f"no mark: {refusal_words(refusal)}"
    except CaesuraError as error:
        return f"no mark: {error}"
    return f"marked, revision {ack.revision}"
