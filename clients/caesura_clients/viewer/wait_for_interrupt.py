"""Waits for the interrupt that ends a command."""

from __future__ import annotations

import signal
import threading


def wait_for_the_end() -> None:
    """Wait for Ctrl-C or SIGTERM."""
    over = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: over.set())
    while not over.wait(3600.0):
        pass
