"""The log of sessions: one line an event, with station and session as fields.

What a peer can cause as often as it likes (a refusal, a question for batches, a question without an answer)
is logged once in QUIET_S for each station and reason, with the number of suppressed lines.
"""

from __future__ import annotations

import logging
from typing import Any

from caesura_protocol.messages import Gap
from caesura_service.monitoring.log_throttle import LogThrottle
from caesura_service.monitoring.registry_calls import Change, RegistryCall
from caesura_service.publishing.events import ReplayEnded, RequestReplay
from caesura_service.publishing.session_state import SessionState

logger = logging.getLogger(__name__)

QUIET_S = 10.0
GAP_REASONS = {
    "source": "the robot's samples paused",
    "evicted": "the samples were refused, or no bridge has them any more",
}


class SessionEventLogger:
    """Steps in, log lines out."""

    def __init__(self) -> None:
        self._quiet = LogThrottle(QUIET_S)

    def take(self, step: RegistryCall, now: float) -> None:
        """Log what a step has changed. now: [s]"""
        for change in step.changes:
            _tell_change(change)
        for output in step.outputs:
            if isinstance(output, RequestReplay):
                asked = f"asks for batches {output.first} to {output.last}"
                self._tell(logging.INFO, now, ("asked",), output.station, output.session, asked)
        if isinstance(step.message, ReplayEnded) and not (step.message.answered or step.message.evicted):
            why = f"its bridge did not answer for batches from {step.message.first} on"
            self._tell(logging.WARNING, now, ("unanswered",), step.station, step.message.session, why)
        if step.refusal is not None:
            name = step.message.session if step.message else None
            self._tell(
                logging.WARNING,
                now,
                ("refused", step.refusal.code),
                step.station,
                name,
                f"refused: {step.refusal.message}",
                step.refused,
            )

    def _tell(
        self,
        level: int,
        now: float,
        about: tuple[str, ...],
        station: str | None,
        session: str | None,
        what: str,
        times: int = 1,
    ) -> None:
        held = self._quiet.kept_back((station, *about), now, times)
        if held is None:
            return
        more = f" (and {held} more like it)" if held else ""
        _say(level, station, session, f"{what}{more}")


def _tell_change(change: Change) -> None:
    before, after = change.before, change.after
    if after is None:
        return  # forgotten: the worker says why
    if before is None:
        if after.is_open and not after.view.samples:
            wrench = after.view.wrench
            source = f"wrench {wrench.source}{'' if wrench.stated else ' (assumed)'}"
            _say_of(after, logging.INFO, f"opened, preset {after.preset}, {source}")
        return
    for gap in after.view.gaps[len(before.view.gaps) :] if after.view.gaps is not before.view.gaps else ():
        _say_of(after, logging.WARNING, _gap(gap))
    if after.revision > before.revision:
        _say_of(after, logging.INFO, f"corrected by {after.program_header.author}: revision {after.revision}")
    if before.is_open and after.lifecycle == "closed":
        _say_of(after, logging.INFO, _closed(after))


def _gap(gap: Gap) -> str:
    why = GAP_REASONS.get(gap.reason, gap.reason)
    return f"gap from {gap.t0:.2f} to {gap.tn:.2f} s ({gap.reason}): {why}"


def _closed(state: SessionState) -> str:
    view, counters = state.view, state.counters
    lost = (
        f", {len(view.gaps)} gaps of {sum(gap.tn - gap.t0 for gap in view.gaps):.2f} s" if view.gaps else ""
    )
    return (
        f"closed: {len(view.segments)} segments in {_duration(state):.1f} s, "
        f"{view.samples} samples in {counters.batches} batches{lost}"
    )


def _duration(state: SessionState) -> float:
    segments = state.view.segments
    return segments[-1].tn - segments[0].t0 if segments else 0.0


def _say_of(state: SessionState, level: int, what: str) -> None:
    _say(level, state.station, state.session, what)


def _say(level: int, station: str | None, session: str | None, what: str) -> None:
    fields: dict[str, Any] = {"station": station, "session": session}
    who = "/".join(name for name in (station, session) if name) or "a client"
    logger.log(level, "%s %s", who, what, extra={name: value for name, value in fields.items() if value})
