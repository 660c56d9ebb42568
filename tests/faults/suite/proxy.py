"""A TCP proxy that is a bad line: it delays, stalls, cuts, and holds connections half open."""

from __future__ import annotations

import asyncio
import random
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from clients.conftest import free_port


class Proxy:
    """Between an endpoint and whoever connects to `endpoint`. Its attributes may be set from any thread."""

    def __init__(self, target: str, seed: int = 0) -> None:
        self.jitter_s = 0.0  # each piece waits up to so long; their order stays
        self.flows = True  # else nothing passes, and nobody is told
        self.port = free_port()
        self.endpoint = f"tcp/127.0.0.1:{self.port}"
        self._host, _, port = target.removeprefix("tcp/").partition(":")
        self._to = int(port)
        self._rng = random.Random(seed)
        self._open: set[asyncio.StreamWriter] = set()
        self._loop = asyncio.new_event_loop()

    def cut(self) -> None:
        """Close every connection."""
        self._loop.call_soon_threadsafe(self._cut)

    def _cut(self) -> None:
        for writer in self._open:
            writer.transport.abort()
        self._open.clear()

    async def _end(self) -> None:
        """Let go of whatever is still passed."""
        passing = asyncio.all_tasks() - {asyncio.current_task()}
        for task in passing:
            task.cancel()
        await asyncio.gather(*passing, return_exceptions=True)

    async def _serve(self) -> None:
        async with await asyncio.start_server(self._connected, "127.0.0.1", self.port) as server:
            await server.serve_forever()

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            far_reader, far_writer = await asyncio.open_connection(self._host, self._to)
        except OSError:
            writer.transport.abort()
            return
        self._open |= {writer, far_writer}
        await asyncio.gather(self._pass(reader, far_writer), self._pass(far_reader, writer))

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            while piece := await reader.read(1 << 16):
                await asyncio.sleep(self._rng.uniform(0.0, self.jitter_s))
                while not self.flows:
                    await asyncio.sleep(0.02)
                writer.write(piece)
                await writer.drain()
        self._open.discard(writer)
        writer.transport.abort()


@contextmanager
def proxied(target: str) -> Iterator[Proxy]:
    """A proxy that runs in a thread of its own while the context lasts."""
    proxy = Proxy(target)

    def run() -> None:
        with suppress(asyncio.CancelledError):
            proxy._loop.run_until_complete(serving)
        proxy._loop.run_until_complete(proxy._end())

    serving = proxy._loop.create_task(proxy._serve())
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield proxy
    finally:
        proxy.cut()
        proxy._loop.call_soon_threadsafe(serving.cancel)
        thread.join()
        proxy._loop.close()
