"""Notes on the parts of a finished demonstration that its program does not contain."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from caesura_protocol.messages import App, Segment, Vector
from caesura_service.cooperative_scheduler import GivingWay, give_way
from caesura_service.program import (
    BEGINS_MOVING,
    ENDS_MOVING,
    Moment,
    detours,
    parts_in_no_app_note,
    turned_biases_note,
    unreproduced_load_changes_note,
    unreproduced_pulls_note,
    unreproduced_torques_note,
    unreproduced_touches_note,
)
from caesura_service.segmentation.observation_store import ObservationStore


def notes_on_parts_in_no_app(
    segments: Sequence[Segment],
    apps: Sequence[App],
    history: ObservationStore,
    fingers: Iterable[str],
    *,
    has_forces: bool,
    up: Vector,
) -> Iterator[str]:
    """Yield the notes on what is in no app. Work gives way at each segment and app.

    apps: as inferred, at least one; fingers: texts on motion of the fingers; has_forces: whether contacts are
    inferred from the wrench; up: away from gravity, base frame.
    """
    segments, apps = tuple(GivingWay(segments)), tuple(GivingWay(apps))  # decoded once
    in_turns, moment = GivingWay(apps), history.moment

    def moment_in_turns(t: float) -> Moment:
        give_way()  # an app may last for an hour
        return moment(t)

    if _moves(history, 1):
        yield BEGINS_MOVING
    ways = detours(in_turns, *history.all_poses())
    if note := parts_in_no_app_note(segments, apps, moment, up, (*ways, *fingers)):
        yield note
    if has_forces:
        span = history.t(0), history.t_last
        missed = (
            unreproduced_torques_note(in_turns, history.torques, *span),
            unreproduced_pulls_note(in_turns, moment, up),
            unreproduced_load_changes_note(in_turns, moment_in_turns, up),
            unreproduced_touches_note(in_turns, moment, *span, GivingWay),
            turned_biases_note(in_turns, moment_in_turns, *span),
        )
        yield from filter(None, missed)
    if _moves(history, len(history) - 1):
        yield ENDS_MOVING


def _moves(history: ObservationStore, index: int) -> bool:
    """Return whether the flange has moved since the observation before; False if that is unknown."""
    known = 0 < index < len(history) and not history.after_gap(index)
    return known and not history.rests(index)
