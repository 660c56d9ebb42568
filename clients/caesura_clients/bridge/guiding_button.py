"""Starts a demonstration at a press of the robot's hand-guiding button; ends it once it stays released.

Rules, for a bridge in standby that is started by the button:
  a press begins a demonstration; a button that was held before counts from its next press on
  the samples of `LEAD_S` before it belong to the demonstration: the arm rests then, which the tare needs
  it ends once the button was released for `released_s`; the samples after the release are left out then
  a press within that time goes on with it, and the samples in between belong to it: a hand may regrip
  a Stop ends it at once, with every sample so far
  a demonstration that Start began is ended by Stop alone; the button has no effect on it

The source's clock measures all times. Samples are held here from a press until a service has opened the
session, and from a release until the next press.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Literal, NamedTuple

from caesura_clients.bridge.sources import Chunk, Mark

LEAD_S = 0.5  # the tare takes 0.4 s
RELEASED_S = 2.0  # a hand regrips in less
WAITING_S = 30.0  # a press that no session has followed by then is forgotten

Deliver = Callable[[Chunk | Mark], None]
State = Literal["idle", "pressed", "opening", "taught", "over", "by_start"]


class Item(NamedTuple):
    """A chunk or mark of a source, and the state of the button when it was received."""

    content: Chunk | Mark
    is_pressed: bool

    @property
    def t(self) -> float:
        """Time of the newest sample [s]."""
        return self.content.t if isinstance(self.content, Mark) else float(self.content[-1, 0])


class GuidingButton:
    """The session requests of the hand-guiding button, and the assignment of samples to sessions.

    changed: set when the button requests a start or an end; deliver: called with each chunk or mark of the
    open session; released_s [s]: how long the button must be released to end a demonstration that it began.
    """

    def __init__(self, changed: threading.Event, deliver: Deliver, released_s: float = RELEASED_S) -> None:
        self._changed, self._deliver, self._released_s = changed, deliver, released_s
        self._lock = threading.Lock()
        self._state: State = "idle"
        self._was_pressed = True  # as far as is known: a press is seen after a release only
        self._waiting: deque[Item] = deque()  # not looked at yet
        self._kept: deque[Item] = deque()  # the newest ones before a press; those since a release

    @property
    def is_over(self) -> bool:
        """Whether the button has been released for `released_s`, which ends the demonstration."""
        return self._state == "over"

    def take(self, content: Chunk | Mark, is_pressed: bool) -> None:
        """Take a chunk or mark of the source, with the state of the button; called in the source's thread."""
        if not isinstance(content, Mark) and not len(content):
            return
        with self._lock:
            self._waiting.append(Item(content, is_pressed))
            if self._waiting[-1].t - self._waiting[0].t > WAITING_S:
                self._waiting.popleft()
                self._state = "idle" if self._state == "pressed" else self._state
            self._advance()

    def accept(self) -> bool:
        """Return whether a press requests a demonstration; the caller answers with `begin` or `end`."""
        with self._lock:
            if self._state != "pressed":
                return False
            self._state = "opening"
            return True

    def begin(self) -> None:
        """Record that a session is open, requested by a press or begun by Start."""
        with self._lock:
            if self._state == "opening":
                self._state = "taught"
            else:
                self._state = "by_start"
                self._kept.clear()
                self._waiting.clear()
            self._advance()

    def end(self) -> None:
        """Record that the session is closed, or was not opened. Only a later press requests the next one."""
        with self._lock:
            self._advance()
            if self._state == "taught":
                self._deliver_kept()
            if self._state != "pressed":
                self._state = "idle"
                self._kept.clear()
            self._advance()

    def _advance(self) -> None:
        """Process the held items whose session the current state determines."""
        while self._waiting and self._state in {"idle", "taught", "by_start"}:
            item = self._waiting.popleft()
            if self._state == "idle":
                self._watch(item)
            elif self._state == "taught":
                self._teach(item)
            else:
                self._deliver(item.content)
            self._was_pressed = item.is_pressed

    def _watch(self, item: Item) -> None:
        """Hold an item while no session is open; request a session if it is a press after a release."""
        self._kept.append(item)
        while item.t - self._kept[0].t > LEAD_S:
            self._kept.popleft()
        if item.is_pressed and not self._was_pressed:
            self._state = "pressed"
            self._changed.set()

    def _teach(self, item: Item) -> None:
        """Deliver an item of a session that the button began, or keep it while the button is released.

        Kept items are delivered at the next press; a release of `released_s` ends the session.
        """
        if item.is_pressed:
            self._deliver_kept()
            self._deliver(item.content)
            return
        if self._was_pressed:
            self._deliver_kept()
        self._kept.append(item)
        if item.t - self._kept[0].t >= self._released_s:
            self._state = "over"
            self._kept.clear()
            self._changed.set()

    def _deliver_kept(self) -> None:
        while self._kept:
            self._deliver(self._kept.popleft().content)
