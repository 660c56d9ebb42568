"""The thread between ring and network: publishes numbered batches, repeated batches and heartbeats."""

from __future__ import annotations

import threading
from types import TracebackType
from typing import Self

from caesura_clients.bridge.batch_sender import BatchSender


class SendThread:
    """Publishes numbered batches until the sender has ended; an error is stored, and ends the bridge."""

    def __init__(
        self,
        sender: BatchSender,
        name: str,
        *,
        tick_s: float,
        max_latency_s: float,
        heartbeat_s: float,
        over: threading.Event,
    ) -> None:
        self.failure: Exception | None = None
        self._sender = sender
        self._tick_s = tick_s
        self._max_latency_s = max_latency_s
        self._heartbeat_s = heartbeat_s
        self._over = over
        self.thread = threading.Thread(target=self._run, name=name, daemon=True)

    def __enter__(self) -> Self:
        self.thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self.thread.join()

    def _run(self) -> None:
        try:
            while not self._over.is_set():
                self._sender.wait(self._tick_s)
                self._sender.flush(older_than_s=self._max_latency_s)
                self._sender.put_waiting()
                self._sender.heartbeat(idle_s=self._heartbeat_s)
            self._sender.put_waiting()
        except Exception as error:
            self.failure = error
            self._over.set()
