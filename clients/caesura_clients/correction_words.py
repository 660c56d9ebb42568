"""Corrections as text, the same on the command line and in the dashboard."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from caesura_protocol.app_kinds import name_of_app
from caesura_protocol.messages import (
    Ack,
    Action,
    AppOutline,
    Change,
    Correction,
    EditEffect,
    Insert,
    LimitForce,
    Move,
    PhaseOutline,
    Redo,
    Relabel,
    Remove,
    Segment,
    SegmentOutline,
    Since,
)
from caesura_protocol.number_words import counted, fixed
from caesura_protocol.session_time_display import NO_OFFSET, SessionClock

NOTHING_CHANGES = "Nothing changes."  # of an edit without an effect
ELSEWHERE = (
    "Results change elsewhere, too: another version of the service had inferred them, and an edit infers the "
    "session again."
)

_WORDS: Mapping[str, str] = {
    "insert": "inserted a changepoint at {t} s",
    "remove": "removed the changepoint at {t} s",
    "move": "moved the changepoint at {t} s to {to} s",
    "relabel": "named the segment at {t} s {kind}",
    "limit_force": "limited the force at {t} s to {newton} N",
    "name_phase": "named the phase at {t} s '{name}'",
    "undo": "took the last correction back",
    "redo": "made the correction that was taken back last once more",
    "take_back": "took correction {number} back",
}
LEAST_MM = 0.1  # by which a target moves, to be stated
SURE = 2.0  # standard deviations of a load that is there
LISTED = 3  # segments or apps that a sentence names, before and after
_UNLIMITED = "lifted the limit of the force at {t} s"


def in_words(action: Action, clock: SessionClock = NO_OFFSET) -> str:
    """Return text on an applied action, to follow the name of its author. clock: of its session.

    >>> in_words(Move(t=4.2, to=4.55))
    'moved the changepoint at 4.20 s to 4.55 s'
    """
    values = action.model_dump()
    times = {name: clock.shown(values[name]) for name in ("t", "to") if name in values}
    lifts = isinstance(action, LimitForce) and action.newton is None
    newton = "" if values.get("newton") is None else f"{values['newton']:g}"
    return (_UNLIMITED if lifts else _WORDS[action.do]).format(**(values | times | {"newton": newton}))


def described(correction: Correction, clock: SessionClock = NO_OFFSET) -> str:
    """Return text on a correction, with its author and the times at which its changepoints lie.

    A correction that an older service has made states the times that were asked for.

    >>> made = Correction(number=1, author="Maria", at=0.0, action=Move(t=4.2, to=4.5))
    >>> described(made.model_copy(update={"meant": 4.25, "placed": 4.55}))
    'Maria moved the changepoint at 4.25 s to 4.55 s'
    """
    return f"{correction.author} {in_words(_as_made(correction), clock)}"


def _as_made(correction: Correction) -> Change:
    """Return the action with the times of its changepoints, as far as the correction states them."""
    action = correction.action
    times = ("t", correction.meant), ("to" if isinstance(action, Move) else "t", correction.placed)
    return action.model_copy(update={name: t for name, t in times if t is not None})


def no_corrections(revision: int) -> str:
    """Return why a session lists no corrections; a revision above 0 states that it has been corrected.

    >>> no_corrections(0)
    'no corrections'
    """
    if not revision:
        return "no corrections"
    return f"revision {revision}: its corrections, made under an older version of the service, are not listed"


def relabel_doubt(action: Action | Since, effect: EditEffect) -> str:
    """Return why a segment that is relabelled as a transport may carry nothing; empty without a doubt."""
    if not isinstance(action, Relabel):
        return ""
    there = [one for one in effect.segments_after if one.t0 <= action.t <= one.tn]
    apps = [one for one in effect.apps_after if one.t0 <= action.t <= one.tn and one.load_kg is not None]
    return transport_doubt(there[-1], apps[-1] if apps else None) if there else ""


def transport_doubt(segment: Segment | SegmentOutline, app: AppOutline | None = None) -> str:
    """Return why a transport may carry nothing: its load may be 0. Empty for other kinds.

    Also empty if the load is certainly not 0, and if it is unknown. app: that the segment is in. Its load is
    the mean of all its segments, and the page states it.
    """
    weighed = segment if app is None else app
    load_kg, sd_kg = weighed.load_kg, weighed.load_sd_kg or 0.0
    if segment.kind != "transport" or load_kg is None or abs(load_kg) > SURE * sd_kg:
        return ""
    load = f"{fixed(round(load_kg, 2) + 0.0, 2)} ± {fixed(sd_kg, 2)} kg"
    return f"Its load is {load}: is something carried there?"


def changepoint_meant(action: Remove | Move, effect: EditEffect) -> float:
    """Return the time [s] of the changepoint that a correction removed or moved.

    The correction states a time near it. The result is the nearest changepoint that is gone, or else the
    stated time.
    """
    left = {one.t0 for one in effect.segments_after}
    gone = [one.t0 for one in effect.segments_before[1:] if one.t0 not in left]
    return min(gone, key=lambda place: abs(place - action.t), default=action.t)


def changepoint_made(action: Insert | Move, effect: EditEffect) -> float:
    """Return the time [s] of the changepoint that a correction makes.

    It lies at the start of an observation: the new one nearest to the stated time, or else that time.
    """
    wanted = action.to if isinstance(action, Move) else action.t
    there = {one.t0 for one in effect.segments_before}
    made = [one.t0 for one in effect.segments_after if one.t0 not in there]
    return min(made, key=lambda place: abs(place - wanted), default=wanted)


def landed(action: Action, effect: EditEffect | None) -> Action:
    """Return a correction with the times of the changepoints that it has removed and made, by its effect."""
    times: dict[str, float] = {}
    if effect is not None and isinstance(action, Remove | Move):
        times["t"] = changepoint_meant(action, effect)
    if effect is not None and isinstance(action, Insert | Move):
        times["to" if isinstance(action, Move) else "t"] = changepoint_made(action, effect)
    return action.model_copy(update=times)


def moved_words(action: Action, ack: Ack, clock: SessionClock = NO_OFFSET) -> str:
    """Return text on the correction that an undo, a redo or a take-back undid or restored.

    Empty for other actions, and where the service does not state it. clock: of the session.
    """
    moved, effect = ack.correction, ack.effect
    if moved is None:
        return ""
    if effect is not None and not isinstance(action, Redo):
        swapped = {"segments_before": effect.segments_after, "segments_after": effect.segments_before}
        effect = effect.model_copy(update=swapped)
    return described(moved.model_copy(update={"action": landed(moved.action, effect)}), clock)


def since_words(action: Since) -> str:
    """Return the heading of an effect that states what corrections have changed.

    >>> since_words(Since(number=3))
    'what the corrections after 3 have changed:'
    """
    return f"what the corrections{f' after {action.number}' if action.number else ''} have changed:"


def effect_words(effect: EditEffect, clock: SessionClock = NO_OFFSET) -> list[str]:
    """Return sentences on the segments, apps and phases that an edit changes. clock: of its session."""
    segments = _becomes(
        [_segment(one, clock) for one in effect.segments_before],
        [_segment(one, clock) for one in effect.segments_after],
    )
    said = [*segments, *_apps(effect, clock), *_phases(effect, clock)]
    if effect.more:
        said.append(f"{effect.more} segments, apps and phases are not listed")
    sentences = [f"{words[0].upper()}{words[1:]}." for words in said] or [NOTHING_CHANGES]
    return [*sentences, *filter(None, [elsewhere_words(effect)])]


def elsewhere_words(effect: EditEffect) -> str:
    """Return why an edit changes results that its effect does not list; empty if it changes none."""
    return ELSEWHERE if effect.inferred_again else ""


def _phases(effect: EditEffect, clock: SessionClock) -> Iterator[str]:
    """Yield text on phases whose kind or name changed; changed times are stated with the segments."""
    before, after = effect.phases_before, effect.phases_after
    if [(one.kind, one.name) for one in before] != [(one.kind, one.name) for one in after]:
        yield from _becomes([_phase(one, clock) for one in before], [_phase(one, clock) for one in after])


def _apps(effect: EditEffect, clock: SessionClock) -> Iterator[str]:
    """Yield texts on changed apps: on their values if all kinds stay the same, else on which are replaced."""
    before, after, first = effect.apps_before, effect.apps_after, effect.first_app
    if [one.kind for one in before] == [one.kind for one in after]:
        pairs = enumerate(zip(before, after, strict=True), first)
        changed = ((name_of_app(i, new), ", ".join(_values(old, new, clock))) for i, (old, new) in pairs)
        found = [f"{name}: {values}" for name, values in changed if values]
        yield from found[:LISTED]
        if len(found) > LISTED:
            yield f"values of {counted(len(found) - LISTED, 'more app')} change"
        return
    yield from _becomes(
        [name_of_app(i, one) for i, one in enumerate(before, first)],
        [name_of_app(i, one) for i, one in enumerate(after, first)],
    )


def _becomes(before: Sequence[str], after: Sequence[str]) -> Iterator[str]:
    if before and after:
        yield f"{_listed(before)} {'becomes' if len(before) == 1 else 'become'} {_listed(after)}"
    elif before:
        yield f"{_listed(before)} {'is' if len(before) == 1 else 'are'} left out"
    elif after:
        yield f"{_listed(after)} {'is' if len(after) == 1 else 'are'} added"


def _listed(names: Sequence[str]) -> str:
    """Return the first few names, and the number of further ones."""
    few = [*names] if len(names) <= LISTED + 1 else [*names[:LISTED], f"{len(names) - LISTED} more"]
    return " and ".join([", ".join(few[:-1]), few[-1]]) if len(few) > 1 else few[0]


def _phase(one: PhaseOutline, clock: SessionClock) -> str:
    name = one.kind if one.name is None else f"{one.name} ({one.kind})"
    return f"phase {name} {_span(one, clock)}"


def _segment(one: SegmentOutline, clock: SessionClock) -> str:
    return f"{one.kind} {_span(one, clock)}"


def _span(one: SegmentOutline | AppOutline | PhaseOutline, clock: SessionClock) -> str:
    return f"{clock.interval(one.t0, one.tn, ' to ')} s"


def _values(old: AppOutline, new: AppOutline, clock: SessionClock) -> Iterator[str]:
    """Yield text on the values of an app that differ after rounding for display."""
    if _span(old, clock) != _span(new, clock):
        yield f"{_span(old, clock)} becomes {_span(new, clock)}"
    if old.target and new.target and (moved := 1000 * math.dist(old.target, new.target)) >= LEAST_MM:
        yield f"target moves by {moved:.1f} mm"
    pairs = (
        ("force", "N", 1, math.hypot(*(old.force or ())), math.hypot(*(new.force or ()))),
        ("load", "kg", 2, old.load_kg or 0.0, new.load_kg or 0.0),
        ("gripper width", "mm", 0, 1000 * (old.gripper_width or 0.0), 1000 * (new.gripper_width or 0.0)),
    )
    for name, unit, decimals, *both in pairs:
        was, is_now = (fixed(value, decimals) for value in both)
        if was != is_now:
            yield f"{name} {was} {unit} becomes {is_now} {unit}"
