"""The state of a session, from its snapshot and the results published since.

Results are published with DROP, so a reader must expect gaps. Changepoints and segments are sent as `first`
and a list that replaces everything from `first` on; after a gap in their numbers the reader queries the
snapshot. Status, posterior, hints and program are complete in each message, and only the newest counts. If
two instances answer for a session (a partitioned network), the one with the highest epoch is right.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

from caesura_protocol.messages import (
    Changepoint,
    Changepoints,
    Hint,
    Hints,
    Phase,
    Posterior,
    Program,
    Segment,
    Segments,
    SessionStatus,
    Snapshot,
)

Published = Changepoints | Segments | Posterior | Hints | SessionStatus | Program
PUBLISHED: tuple[type[Published], ...] = (Changepoints, Segments, Posterior, Hints, SessionStatus, Program)
Outcome = Literal["changed", "unchanged", "hole"]


@dataclass(frozen=True)
class Update:
    """The complete state of one session at one time: status, segments, phases, hints, program."""

    status: SessionStatus
    changepoints: tuple[Changepoint, ...]
    segments: tuple[Segment, ...]
    posterior: Posterior | None
    program: Program
    phases: tuple[Phase, ...] = ()
    hints: tuple[Hint, ...] = ()  # active ones, and the newest of those that are cleared

    @property
    def station(self) -> str:
        """The name of the station at which the session is taught."""
        return self.status.station

    @property
    def session(self) -> str:
        """The name of the session."""
        return self.status.session

    @property
    def t(self) -> float:
        """Time of the newest observation in the results [s].

        The posterior is published more often than the status.
        """
        posterior_s = self.status.t if self.posterior is None else self.posterior.t
        return max(self.status.t, posterior_s, self.program.t)

    @property
    def closed(self) -> bool:
        """Whether the demonstration is over."""
        return self.status.state == "closed"


class SessionReader:
    """The state of one session from its results: a fold over messages, without a network or a clock."""

    def __init__(self) -> None:
        self.update: Update | None = None
        self._owner = (-1, "")  # epoch and instance; the higher is right
        self._last: dict[type[Published], int] = {}

    def restart(self, snapshot: Snapshot) -> Outcome:
        """Start again from a snapshot, unless its sender has been replaced."""
        owner = (snapshot.status.epoch, snapshot.status.instance)
        if owner < self._owner:
            return "unchanged"
        before, self._owner = self.update, owner
        streams = (snapshot.status, snapshot.changepoints, snapshot.segments)
        self._last = {type(stream): stream.seq for stream in streams}
        self._last[Posterior] = -1 if snapshot.posterior is None else snapshot.posterior.seq
        self._last[Hints] = -1 if snapshot.hints is None else snapshot.hints.seq
        self._last[Program] = snapshot.program.version
        self.update = Update(
            snapshot.status,
            snapshot.changepoints.changepoints,
            snapshot.segments.segments,
            snapshot.posterior,
            snapshot.program,
            snapshot.segments.phases,
            snapshot.hints.hints if snapshot.hints else (),
        )
        return "unchanged" if self.update == before else "changed"

    def receive(self, message: Published) -> Outcome:
        """Apply a published message. A `hole` changes nothing: the caller must query a snapshot."""
        owner = (message.epoch, message.instance)
        if owner < self._owner:
            return "unchanged"
        if self.update is None or owner > self._owner:
            return "hole"
        if isinstance(message, SessionStatus) and self.update.closed and message.state == "open":
            return "hole"  # a name that is used again
        number = message.version if isinstance(message, Program) else message.seq
        last = self._last[type(message)]
        if number < last:
            return "unchanged"
        after = _applied(self.update, message, next_one=number <= last + 1)
        if after is None:
            return "hole"
        before, self.update = self.update, after
        self._last[type(message)] = number
        return "unchanged" if after == before else "changed"


def _applied(update: Update, message: Published, *, next_one: bool) -> Update | None:
    """Return the state after a message, which may be applied twice.

    None if there is a gap before its list.
    """
    match message:
        case SessionStatus() | Posterior() | Hints() | Program():
            return replace(update, **_replaced(message))
        case Changepoints() if next_one and message.first <= len(update.changepoints):
            return replace(update, changepoints=update.changepoints[: message.first] + message.changepoints)
        case Segments() if next_one and _goes_on(update, message):
            return replace(
                update,
                segments=update.segments[: message.first] + message.segments,
                phases=update.phases[: message.first_phase] + message.phases,
            )
    return None


def _replaced(message: SessionStatus | Posterior | Hints | Program) -> dict[str, Any]:
    """Return the fields of an update that a complete message replaces."""
    match message:
        case SessionStatus():
            return {"status": message}
        case Posterior():
            return {"posterior": message}
        case Hints():
            return {"hints": message.hints}
    return {"program": message}


def _goes_on(update: Update, message: Segments) -> bool:
    """Return whether the lists of a message begin at or before the end of the reader's lists."""
    return message.first <= len(update.segments) and message.first_phase <= len(update.phases)
