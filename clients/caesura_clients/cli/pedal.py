"""`caesura bridge --marker`: every line of standard input, a key or a pedal, forces a changepoint."""

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
    """Mark a changepoint at each line of `keys`, by default of stdin, while the context lasts.

    The thread waits for a line that may never come, so it is not joined: it ends by itself.
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
