"""Reads a source for a bridge in standby, and passes its samples to the current session.

A live source is read continuously, in a separate thread. So the loss of a robot is noticed before a start,
and samples from before the start are discarded. A source that can wait, such as a recording, is read from its
beginning for each session.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Self

from caesura_clients.bridge.guiding_button import GuidingButton
from caesura_clients.bridge.sources import Chunk, Mark, Source, button_pressed
from caesura_protocol.errors import SourceError

Take = Callable[[Chunk | Mark], None]


class SourceFeed:
    """Passes the content of a source to `take` between `begin` and `end`.

    changed: set when the source ends or fails. After a `take` that raises, `take` is not called again; the
    error is stored in `rejection`. released_s [s]: the hand-guiding button also begins sessions, and ends
    those after it was released for so long; None: it does not.
    """

    def __init__(self, source: Source, changed: threading.Event, released_s: float | None = None) -> None:
        self.failure: SourceError | None = None  # of the source
        self.rejection: Exception | None = None  # of the session that took its samples
        self.has_ended = False
        self._source = source
        self._changed = changed
        self._take: Take | None = None
        self._over = threading.Event()
        self._thread: threading.Thread | None = None
        self.button = None if released_s is None else GuidingButton(changed, self._offer, released_s)

    def __enter__(self) -> Self:
        if not self._source.can_wait:
            self._start(self._source.chunks())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop reading; the thread of a source that yields nothing ends at its next chunk."""
        self._over.set()

    @property
    def is_lost(self) -> bool:
        """Whether the source must be opened again."""
        return self.failure is not None or (self.has_ended and not self._source.can_wait)

    @property
    def was_read(self) -> bool:
        """Whether a session has read a source that can wait; always False for a live source."""
        return self._source.can_wait and self._thread is not None

    def begin(self, take: Take) -> None:
        """Pass samples to `take` from now on."""
        self.rejection = None
        self._take = take
        if self.button is not None:
            self.button.begin()
        if self._source.can_wait:
            self.has_ended, self.failure = False, None
            self._over = threading.Event()
            self._start(self._source.chunks())

    def end(self) -> None:
        """Stop passing samples; one chunk may still be in progress."""
        if self.button is not None:
            self.button.end()
        self._take = None
        if self._source.can_wait:
            self._over.set()

    def _start(self, chunks: Iterator[Chunk | Mark]) -> None:
        over = self._over
        self._thread = threading.Thread(target=self._run, args=(chunks, over), name="source", daemon=True)
        self._thread.start()

    def _run(self, chunks: Iterator[Chunk | Mark], over: threading.Event) -> None:
        try:
            for item in chunks:
                if over.is_set():
                    return
                self._pass_on(item)
            self.has_ended = not over.is_set()
        except Exception as error:
            if not over.is_set():
                self.failure = error if isinstance(error, SourceError) else SourceError(_words(error))
        finally:
            self._changed.set()

    def _pass_on(self, item: Chunk | Mark) -> None:
        if self.button is None:
            self._offer(item)
        else:
            self.button.take(item, button_pressed(self._source) or False)

    def _offer(self, item: Chunk | Mark) -> None:
        take = self._take
        if take is None:
            return
        try:
            take(item)
        except Exception as error:  # the session's affair: a live source is read on for the next one
            self.rejection = error
            self._take = None
            self._changed.set()


def _words(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"
