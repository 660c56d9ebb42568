"""Packing with msgpack, with one packer per thread: a new one allocates a buffer for every message."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import msgpack  # type: ignore[import-untyped]

KEPT_BYTES = 1 << 20  # of the buffer, which grows with its longest payload


class Packing(threading.local):
    """Packs values; any thread may call it."""

    def __init__(self, default: Callable[[Any], Any] | None = None) -> None:
        """Store the fallback. default: returns a value that replaces one of a type unknown to msgpack."""
        self._default = default
        self._packer = msgpack.Packer(default=default)

    def pack(self, value: object) -> bytes:
        """Pack a value. Raises as msgpack and `default` do."""
        payload: bytes = self._packer.pack(value)
        if len(payload) > KEPT_BYTES:
            self._packer = msgpack.Packer(default=self._default)
        return payload
