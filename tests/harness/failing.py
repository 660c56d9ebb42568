"""Calls to the disk that fail in another process while a context lasts: `failing.c` is preloaded there."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from harness.power import build

SOURCE = Path(__file__).with_name("failing.c")
# Those that the library knows.
KINDS = (
    "open",
    "stat",
    "read",
    "write",
    "sync",
    "truncate",
    "fallocate",
    "map",
    "chmod",
    "mkdir",
    "unlink",
    "rename",
)
_ORDER = struct.Struct("i60s56sq")  # `struct order` of the library


class FailingCalls:
    """Lets calls of one process fail that concern the files of a directory."""

    def __init__(self, directory: Path, beside: Path) -> None:
        """directory: whose files are concerned; beside: where the library goes. Both are made."""
        self.directory, beside = directory.resolve(), beside.resolve()
        for made in (self.directory, beside):
            made.mkdir(parents=True, exist_ok=True)
        self._library, self._orders = beside / "failing.so", beside / "orders"
        build(SOURCE, self._library)
        self._orders.write_bytes(bytes(_ORDER.size))
        with self._orders.open("r+b") as file:
            self._shared = mmap.mmap(file.fileno(), _ORDER.size)

    def command(self, command: Sequence[str]) -> list[str]:
        """The same command, in which calls may fail."""
        by = {"LD_PRELOAD": self._library, "FAILING_IN": self.directory, "FAILING_BY": self._orders}
        return ["env", *(f"{name}={value}" for name, value in by.items()), *command]

    @contextmanager
    def failing(self, kinds: Sequence[str], error: int, suffix: str = "") -> Iterator[None]:
        """While the context lasts each call of these kinds fails, on paths that end with the suffix."""
        named = f" {' '.join(kinds)} ".encode()
        self._shared[:] = _ORDER.pack(0, named, suffix.encode(), 0)
        self._shared[:4] = struct.pack("i", error)
        try:
            yield
        finally:
            self._shared[:4] = bytes(4)

    @property
    def failed(self) -> int:
        """Calls that have failed since `failing` was last entered."""
        return int(_ORDER.unpack(self._shared[:])[3])
