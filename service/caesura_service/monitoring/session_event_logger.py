"""The log of sessions: one line an event, with station and session as fields.

Events that a peer can cause without limit (a refusal, a replay request, a query without an answer) are logged
at LOG_RATE for each station and reason, with the number of suppressed lines.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, NamedTuple

from caesura_protocol.messages import Gap, SampleBatch
from caesura_protocol.number_words import counted
from caesura_protocol.token_bucket import LOG_RATE, SENDERS, RateLimit
from caesura_service.monitoring.registry_call_effects import Change, RegistryCall
from caesura_service.publishing.events import ReplayEnded, RequestReplay
from caesura_service.publishing.session_state import SessionState

logger = logging.getLogger(__name__)

SENDERS_OF_STATION = 8  # sessions with their bridges, of which the newest are compared


class Sender(NamedTuple):
    """A session with the bridge that sends it."""

    session: str
    bridge: str


GAP_REASONS = {
    "source": "the robot's samples paused",
    "evicted": "the samples were refused, or no bridge has them any more",
}


class SessionEventLogger:
    """Logs the effects of calls of the registry."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """clock: monotonic [s]."""
        self._rate = RateLimit(LOG_RATE, clock=clock)
        self._suppressed: dict[str, int] = {}  # lines since the last one; of the newest SENDERS
        self._senders: dict[str, dict[Sender, bool]] = {}  # of a station, the newest last; was it warned of?

    def log_call(self, call: RegistryCall) -> None:
        """Log the effects of a call."""
        for change in call.changes:
            _log_change(change)
        for output in call.outputs:
            if isinstance(output, RequestReplay):
                asked = f"asks for batches {output.first} to {output.last}"
                self._log_throttled(logging.INFO, ("asked",), output.station, output.session, asked)
        if isinstance(call.message, ReplayEnded) and not (call.message.answered or call.message.evicted):
            why = f"its bridge did not answer for batches from {call.message.first} on"
            self._log_throttled(logging.WARNING, ("unanswered",), call.station, call.message.session, why)
        if call.refusal is not None:
            name = call.message.session if call.message else None
            self._log_throttled(
                logging.WARNING,
                ("refused", call.refusal.code),
                call.station,
                name,
                f"refused: {call.refusal.message}",
                call.refused,
            )
        if isinstance(call.message, SampleBatch) and call.changes and call.refusal is None:
            self._log_second_bridge(call.station or "", call.message)

    def _log_second_bridge(self, station: str, batch: SampleBatch) -> None:
        """Warn once if a session continues that another bridge appeared to have replaced by its own."""
        if batch.bridge is None:
            return
        sender, known = Sender(batch.session, batch.bridge), self._senders.setdefault(station, {})
        last = next(reversed(known), sender)
        warned = known.pop(sender, None)  # None: it is new
        if second := warned is False and last.bridge != sender.bridge:
            known[last] = True
            both = f"{last.session} of bridge {last.bridge} and {sender.session} of bridge {sender.bridge}"
            what = f"is taught by two bridges at once, {both}: give one of them another --station"
            _log(logging.WARNING, station, None, what)
        known[sender] = second or bool(warned)
        for oldest in [*known][:-SENDERS_OF_STATION]:
            del known[oldest]
        if len(self._senders) > SENDERS:
            del self._senders[next(iter(self._senders))]

    def _log_throttled(
        self,
        level: int,
        about: tuple[str, ...],
        station: str | None,
        session: str | None,
        what: str,
        times: int = 1,
    ) -> None:
        key = " ".join((station or "", *about))
        before = self._suppressed.pop(key, 0) + times - 1
        if self._rate.allows(key):
            _log(level, station, session, f"{what} (and {before} more like it)" if before else what)
            return
        self._suppressed[key] = before + 1
        if len(self._suppressed) > SENDERS:
            del self._suppressed[next(iter(self._suppressed))]


def _log_change(change: Change) -> None:
    before, after = change.before, change.after
    if after is None:
        return  # deleted: the worker logs the reason
    if before is None:
        if after.is_open and not after.view.samples:
            wrench = after.view.wrench
            source = f"wrench {wrench.source}{'' if wrench.stated else ' (assumed)'}"
            _log_state(after, logging.INFO, f"opened, preset {after.preset}, {source}")
        return
    for gap in after.view.gaps[len(before.view.gaps) :] if after.view.gaps is not before.view.gaps else ():
        _log_state(after, logging.WARNING, _gap(gap))
    if after.revision > before.revision:
        _log_state(
            after, logging.INFO, f"corrected by {after.program_header.author}: revision {after.revision}"
        )
    if before.is_open and after.lifecycle == "closed":
        _log_state(after, logging.INFO, _closed(after))


def _gap(gap: Gap) -> str:
    why = GAP_REASONS.get(gap.reason, gap.reason)
    return f"gap from {gap.t0:.2f} to {gap.tn:.2f} s ({gap.reason}): {why}"


def _closed(state: SessionState) -> str:
    view, counters = state.view, state.counters
    lasted_s = sum(gap.tn - gap.t0 for gap in view.gaps)
    lost = f", {counted(len(view.gaps), 'gap')} of {lasted_s:.2f} s" if view.gaps else ""
    return (
        f"closed: {counted(len(view.segments), 'segment')} in {_duration(state):.1f} s, "
        f"{counted(view.samples, 'sample')} in {counted(counters.batches, 'batch')}{lost}"
    )


def _duration(state: SessionState) -> float:
    segments = state.view.segments
    return segments[-1].tn - segments[0].t0 if segments else 0.0


def _log_state(state: SessionState, level: int, what: str) -> None:
    _log(level, state.station, state.session, what)


def _log(level: int, station: str | None, session: str | None, what: str) -> None:
    fields: dict[str, Any] = {"station": station, "session": session}
    who = "/".join(name for name in (station, session) if name) or "a client"
    logger.log(level, "%s %s", who, what, extra={name: value for name, value in fields.items() if value})
