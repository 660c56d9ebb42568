"""Makes the payloads that update a session's drawing: rows that the browser does not have yet.

Rows have plain values. A segment is [t0, tn, kind, probability, final, corrected, runner-up, start, load,
deviation]. Its start is [px, py, pz] [m]; load and deviation are [kg] or None. A phase is [t0, tn, kind,
probability, final, strokes, name]. A changepoint is [t, probability, final, t_low, t_high, corrected]. A
column of run lengths is [t, [[length, probability], …]]. A correction is [number, words, time of day, state,
reason]. Times are on the clock of the samples; `start` is the time that is displayed as 0. Signals are not in
the payload: a page requests those that it shows (`signal_ring.py`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from caesura_clients.correction_words import described
from caesura_clients.dashboard.station_summary import reached, session_clock
from caesura_clients.session_state_reader import Update
from caesura_protocol.messages import Changepoint, Correction, Phase, Posterior, Segment
from caesura_protocol.session_time_display import NO_OFFSET, SessionClock

Cells = list[Any]
LEAST_PROBABILITY = 1e-3  # of a run length that is drawn


@dataclass(frozen=True)
class SentState:
    """The content of one session that a browser has been sent."""

    session: str = ""
    update: Update | None = None


def delta(sent: SentState, update: Update | None) -> tuple[SentState, dict[str, Any]]:
    """Return the content that the browser has after the update, and the payload that it lacks.

    sent: its content before. The payload is empty if nothing is new. Without an update it resets the page.
    """
    if update is None:
        return SentState(), ({"reset": True} if sent.session else {})
    payload: dict[str, Any] = {}
    if update.session != sent.session:
        sent, payload = SentState(update.session), {"reset": True, "session": update.session}
    if update is not sent.update:
        payload |= _changes(sent.update, update)
    return SentState(update.session, update), payload


def beginning(update: Update | None) -> tuple[SentState, dict[str, Any]]:
    """Return the same as `delta` for a new page: enough to request samples, without the long rows.

    The payload also has `t`, the time [s] that the session has reached.
    """
    if update is None:
        return SentState(), {}
    short = replace(update, segments=update.segments[:1], phases=(), changepoints=())
    sent, payload = delta(SentState(), short)
    return sent, payload | {"t": round(reached(update), 3)}


def _changes(before: Update | None, after: Update) -> dict[str, Any]:
    changes: dict[str, Any] = {"t": round(reached(after), 3), "closed": after.closed}
    start_s = session_clock(after).start_s
    if before is None or start_s != session_clock(before).start_s:
        changes["start"] = start_s
    known_segments = before.segments if before else ()
    if before is None or after.segments != known_segments:
        first = common(known_segments, after.segments)
        changes["segments"] = {"first": first, "rows": [segment_row(one) for one in after.segments[first:]]}
    known_phases = before.phases if before else ()
    if before is None or after.phases != known_phases:
        first = common(known_phases, after.phases)
        changes["phases"] = {"first": first, "rows": [phase_row(one) for one in after.phases[first:]]}
    known = before.changepoints if before else ()
    if before is None or after.changepoints != known:
        first = common(known, after.changepoints)
        rows = [changepoint_row(one) for one in after.changepoints[first:]]
        changes["changepoints"] = {"first": first, "rows": rows}
    wrench = after.status.wrench
    if before is None or wrench != before.status.wrench:
        takes_off = wrench.frame == "base" and any(wrench.tare or ())  # a withdrawn tare takes nothing off
        changes |= {"frame": wrench.frame, "tare": wrench.tare if takes_off else None}
    return changes


def common(before: Sequence[object], after: Sequence[object]) -> int:
    """Return how many items at the beginning of two sequences are equal."""
    pairs = zip(before, after, strict=False)
    return next((i for i, (a, b) in enumerate(pairs) if a != b), min(len(before), len(after)))


def segment_row(one: Segment) -> Cells:
    """Return a segment's row of cells, in the order that the module states."""
    return [
        round(one.t0, 3),
        round(one.tn, 3),
        one.kind,
        round(one.probability, 3),
        one.certainty == "final",
        one.corrected,
        one.runner_up,
        [round(value, 4) for value in one.position_start],
        one.load_kg,
        one.load_sd_kg,
    ]


def phase_row(one: Phase) -> Cells:
    """Return a phase's row of cells, in the order that the module states."""
    final = one.certainty == "final"
    times = [round(one.t0, 3), round(one.tn, 3)]
    return [*times, one.kind, round(one.probability, 3), final, one.strokes, one.name]


def changepoint_row(one: Changepoint) -> Cells:
    """Return a changepoint's row of cells, in the order that the module states.

    Times are exact: a correction names the changepoint by its time.
    """
    final = one.certainty == "final"
    return [one.t, round(one.probability, 3), final, one.t_low, one.t_high, one.corrected]


def correction_rows(corrections: Iterable[Correction], clock: SessionClock = NO_OFFSET) -> list[Cells]:
    """Return the rows of corrections, in the order that the module states. clock: of the session."""
    return [
        [one.number, described(one, clock), one.at, one.state, one.reason and clock.text(one.reason)]
        for one in corrections
    ]


def run_lengths(posteriors: Iterable[Posterior]) -> list[Cells]:
    """Return a column of the run-length image per posterior: how long the current segment may have lasted."""
    return [
        [
            round(one.t, 2),
            [
                [round(one.t - start, 2), round(probability, 3)]
                for start, probability in zip(one.starts, one.probabilities, strict=True)
                if probability >= LEAST_PROBABILITY
            ],
        ]
        for one in posteriors
    ]
