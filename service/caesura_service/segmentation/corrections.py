"""The corrections of a session, resolved to constraints of the filter and the program.

Rules
- A correction is resolved once, against the results shown when it is made, to observations and times. These
  never change, so corrections have the same effect whether they are applied from the first sample or at the
  end.
- Removing a changepoint forbids starts from the changepoint before it to the one after it. If only its own
  observation were forbidden, the filter would put it right beside.
- Of two corrections of one observation the later one counts.
- A kind, a force limit or a name applies to the segment, app or phase that covers the middle of the corrected
  one: so it is found again after its ends have moved.
- Undo revokes the last correction, take_back any of them. Redo restores the one revoked last, at its place
  among the others, and a new correction clears those that could be restored.
- A correction that set a changepoint cannot be revoked while a later one refers to that changepoint.
- A correction whose target is gone is listed as not applied, and is applied again once the target is back.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

from caesura_protocol import messages
from caesura_protocol.app_force_limit import LEAST_FORCE_N, is_press
from caesura_protocol.errors import NONE_THERE, ProtocolError
from caesura_protocol.messages import (
    MAX_CORRECTIONS,
    App,
    Change,
    Correction,
    Insert,
    LimitForce,
    Move,
    NamePhase,
    Phase,
    Redo,
    Relabel,
    Remove,
    TakeBack,
    Undo,
)
from caesura_service.journal import AppliedEdit, Resolution

REACH_S = 0.5  # a changepoint this close is meant
AHEAD_S = 5.0  # an insert may be so far ahead of the last observation while the demonstration goes on
READ_AS_S = 0.005  # a time this close to a changepoint reads as its own, in hundredths of a second
NAMED = 3  # changepoints that a refusal names
NAMED_RANGES = 16  # of the numbers of corrections, the newest
OVERLAP = 16  # apps that may begin before a time and reach beyond it, at most
# What a later correction did to the changepoint that an earlier one set.
_REFERS = {
    "move": "moved that changepoint on",
    "remove": "removed that changepoint",
    "relabel": "states what the segment is that it bounds",
}


@dataclass(frozen=True)
class ResolvedEdit:
    """A correction, resolved to observations and times."""

    inserted: float | None = None  # [s] the first start whose place on the grid ends after this
    starts: tuple[int, ...] = ()  # a segment starts there
    none: tuple[int, ...] = ()  # none starts there
    label: tuple[int, str] | None = None  # an observation, and the kind of the segment in which it lies
    force: tuple[float, float | None] | None = None  # [s] and [N] of the app that covers it
    name: tuple[float, str] | None = None  # [s] and what the phase that covers it is called
    meant: float | None = None  # [s] where the changepoint was that it removed or moved
    placed: float | None = None  # [s] where the changepoint is that it inserted or moved
    anew: bool = False  # was it resolved once more, because the journal has only what was asked for?
    made: Correction | None = field(default=None, compare=False)  # as the program lists it

    @property
    def number(self) -> int:
        """The revision that the correction made; 0 for one that is in no history."""
        return 0 if self.made is None else self.made.number

    def refers_to(self, index: int) -> bool:
        """Return whether the correction states if a segment starts at observation `index`."""
        return index in self.none or index in self.starts

    def recorded(self) -> Resolution:
        """Return the correction as the journal records it."""
        return Resolution(
            inserted=self.inserted,
            starts=self.starts,
            none=tuple(_runs(self.none)),
            label=self.label,
            force=self.force,
            name=self.name,
            meant=self.meant,
            placed=self.placed,
        )


def correction_of(recorded: Resolution) -> ResolvedEdit:
    """Return a correction from its record in the journal."""
    none = tuple(index for first, stop in recorded.none for index in range(first, stop))
    return ResolvedEdit(**vars(recorded) | {"none": none})


def _runs(indices: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Yield each run of consecutive numbers as its first and the one after its last; indices: rising."""
    breaks = [i for i in range(1, len(indices)) if indices[i] != indices[i - 1] + 1]
    for first, stop in pairwise([0, *breaks, len(indices)] if indices else ()):
        yield indices[first], indices[stop - 1] + 1


def _ranges(numbers: Sequence[int]) -> list[int | str]:
    """Return rising numbers; consecutive ones are joined to a text of their range.

    >>> _ranges([1, 2, 3, 5])
    ['1 to 3', 5]
    """
    ranges = [f"{first} to {stop - 1}" if stop - first > 1 else first for first, stop in _runs(numbers)]
    return [*(["…"] if len(ranges) > NAMED_RANGES else []), *ranges[-NAMED_RANGES:]]


@dataclass(frozen=True)
class VisibleChangepoint:
    """A changepoint of the view."""

    t: float  # [s]
    start: int  # observation at which its segment starts
    t_low: float
    t_high: float
    between: tuple[int, ...]  # observations between the changepoint before it and the one after it
    after_gap: bool


@dataclass(frozen=True)
class VisibleSegment:
    """A segment of the view: observations start to end, the end not included."""

    t0: float  # [s]
    tn: float
    start: int
    end: int
    grows: bool  # its end is not known yet


@dataclass(frozen=True)
class EditContext:
    """The changepoints, segments, apps and phases that an operator may correct."""

    t_first: float  # [s] of the first observation and of the last one
    t_last: float
    finished: bool
    marks: Sequence[VisibleChangepoint]
    spans: Sequence[VisibleSegment]
    kinds: Sequence[str]
    apps: Sequence[App]
    phases: Sequence[Phase]
    place_of: Callable[[float], float | None]  # of a changepoint that is inserted at a time [s]; None: ahead
    force_limit_n: float | None = None  # [N] of the cell


@dataclass(frozen=True)
class EditHistory:
    """The corrections of a session, oldest first: those in effect, and those that were undone."""

    active: tuple[ResolvedEdit, ...] = ()
    undone: tuple[ResolvedEdit, ...] = ()
    revision: int = 0  # edits so far

    @property
    def listed(self) -> tuple[Correction, ...]:
        """All corrections that the program lists, by their numbers."""
        taken_back = (
            one.made.model_copy(update={"state": "undone"}) for one in self.undone if one.made is not None
        )
        applied = (one.made for one in self.active if one.made is not None)
        return tuple(sorted((*applied, *taken_back), key=lambda one: one.number))

    def up_to(self, number: int) -> EditHistory:
        """Return the corrections in effect, up to a number. Raises ProtocolError above the revision."""
        if number > self.revision:
            why = "the session has no such correction"
            raise ProtocolError("malformed", why, value=number, limit=self.revision)
        return EditHistory(tuple(one for one in self.active if one.number <= number), (), self.revision)

    def after(self, edit: messages.Edit, at: float, resolve: Callable[[Change], ResolvedEdit]) -> EditHistory:
        """Return the history with one more edit. at: time of day [s]; resolve: as `resolved`.

        Raises ProtocolError if there is nothing to undo or redo, and for more than MAX_CORRECTIONS.
        """
        active, undone, number = self.active, self.undone, self.revision + 1
        match edit.action:
            case Undo() | TakeBack() as action:
                one = self.taken_back(action)
                return EditHistory(
                    tuple(other for other in active if other is not one), (*undone, one), number
                )
            case Redo():
                if not undone:
                    raise ProtocolError("conflict", "there is nothing to redo", value=self.revision)
                again = sorted((*active, undone[-1]), key=lambda one: one.number)
                return EditHistory(tuple(again), undone[:-1], number)
            case change:
                if len(active) >= MAX_CORRECTIONS:
                    why = f"a session has {MAX_CORRECTIONS} corrections at most: undo some"
                    raise ProtocolError("conflict", why, limit=MAX_CORRECTIONS)
                one = resolve(change)
                made = Correction(
                    number=number,
                    author=edit.author,
                    at=at,
                    action=change,
                    meant=one.meant,
                    placed=one.placed,
                )
                return EditHistory((*active, replace(one, made=made)), (), number)

    def taken_back(self, action: Undo | TakeBack) -> ResolvedEdit:
        """Return the correction that an action revokes. Raises ProtocolError if there is none."""
        if isinstance(action, Undo):
            if not self.active:
                raise ProtocolError("conflict", "there is nothing to undo", value=self.revision)
            return self.active[-1]
        for one in self.active:
            if one.number == action.number:
                return one
        is_undone = action.number in [one.number for one in self.undone]
        why = "the correction is taken back already" if is_undone else "the session has no such correction"
        there = [one.number for one in self.active]
        raise ProtocolError("conflict", why, value=action.number, expected=_ranges(there) or NONE_THERE)

    def moved(self, action: messages.Action) -> Correction | None:
        """Return the correction that an undo, a redo or a take-back undoes or restores; None of a new one.

        Raises ProtocolError as `after`.
        """
        match action:
            case Undo() | TakeBack():
                return self.taken_back(action).made
            case Redo():
                return self.undone[-1].made if self.undone else None
            case _:
                return None

    def check_unreferred(self, one: ResolvedEdit, observation_at: Callable[[float], int]) -> None:
        """Check that no later correction refers to the changepoint that a correction set.

        observation_at: the observation at which an inserted changepoint starts a segment. Raises
        ProtocolError `conflict`, which names the newest such correction.
        """
        if one.inserted is None:
            return
        index = observation_at(one.inserted)
        later = [other for other in self.active if other.number > one.number and other.refers_to(index)]
        referring = [made for other in later if (made := other.made) and made.action.do in _REFERS]
        if referring:
            made = referring[-1]
            why = (
                f"correction {made.number} by {made.author} {_REFERS[made.action.do]}: "
                f"take correction {made.number} back first"
            )
            raise ProtocolError("conflict", why, value=one.number, expected=made.number)

    def again(self, edit: AppliedEdit, kinds: Sequence[str], at: float) -> EditHistory:
        """Return the history with one more of the journal's resolved edits.

        kinds: of segments in the session, which another version of the service may have changed; at: time of
        day [s]. Raises ProtocolError if the edit is invalid now.
        """

        def known(change: Change) -> ResolvedEdit:
            assert edit.resolution is not None
            correction = correction_of(edit.resolution)
            if correction.label is not None:
                _check_kind(correction.label[1], kinds)
            return correction

        return self.after(edit, at, known)

    def as_anew(self) -> EditHistory:
        """Return the history with its last correction marked: it was resolved again at a restart.

        Marked corrections are counted in a note of the program.
        """
        if not self.active:
            return self
        return replace(self, active=(*self.active[:-1], replace(self.active[-1], anew=True)))

    def passed_over(self) -> EditHistory:
        """Return the history with the next revision, for a recorded edit that cannot be applied again."""
        return replace(self, revision=self.revision + 1)


class FilterConstraints:
    """The corrections of a session as constraints of the filter, by observation, in order."""

    def __init__(self, corrections: Sequence[ResolvedEdit] = ()) -> None:
        known: dict[int, tuple[int, bool]] = {}
        for order, one in enumerate(corrections):
            known |= dict.fromkeys(one.none, (order, False)) | dict.fromkeys(one.starts, (order, True))
        inserted = [
            (one.inserted, order) for order, one in enumerate(corrections) if one.inserted is not None
        ]
        self._known = known
        self._inserted = sorted(inserted, reverse=True)
        self._certain: set[int] = set()
        self._placed: set[int] = set()
        self.anew = sum(one.anew for one in corrections)  # corrections that were resolved once more
        given = enumerate(one.label for one in corrections if one.label is not None)
        self._labels = {index: (order, kind) for order, (index, kind) in given}  # the last one of each place
        self._labelled = sorted(self._labels)
        self._forces = [one.force for one in corrections if one.force is not None]
        self._made = [one for one in corrections if one.made is not None]
        self._names = [one.name for one in corrections if one.name is not None]

    def start(self, index: int, until: float) -> bool | None:
        """Return whether a segment starts at observation `index`; None without a correction.

        until: times [s] before it belong to this observation or an earlier one. Call it once per observation.
        """
        if index == 0:
            return None
        said = [self._known[index]] if index in self._known else []
        while self._inserted and self._inserted[-1][0] < until:
            said.append((self._inserted.pop()[1], True))
            self._placed.add(index)
        answer = max(said)[1] if said else None
        if answer:
            self._certain.add(index)
        return answer

    def is_placed(self, index: int) -> bool:
        """Return whether a correction states the time of a start at this observation."""
        return index in self._placed

    def is_certain(self, index: int) -> bool:
        """Return whether a correction sets a start at this observation."""
        return index in self._certain

    def label(self, start: int, end: int) -> str | None:
        """Return the kind that the newest correction gives to the segment from start to end.

        None without one. start, end: observations, the end not included.
        """
        inside = self._labelled[bisect_left(self._labelled, start) : bisect_left(self._labelled, end)]
        return max(map(self._labels.__getitem__, inside))[1] if inside else None

    def force_limit(self, app: App) -> float | None:
        """Return the force limit of an app [N]; None without a correction."""
        given = [newton for t, newton in self._forces if app.t0 <= t <= app.tn]
        return given[-1] if given else None

    def named(self, phase: Phase) -> Phase:
        """Return the phase with the name that it was given."""
        given = [name for t, name in self._names if phase.t0 <= t < phase.tn]
        return phase.model_copy(update={"name": given[-1]}) if given else phase

    def unapplied(
        self, apps: Sequence[App], phases: Sequence[Phase], is_beyond: Callable[[float], bool]
    ) -> Mapping[int, str]:
        """Return why corrections are not applied, by their numbers; those that are applied are left out.

        apps: of the program, in the order of their beginnings; phases: as they are named; is_beyond: a test
        whether a time [s] will never be observed.
        """
        reasons = {}
        for one in self._made:
            if one.inserted is not None and is_beyond(one.inserted):
                reasons[one.number] = f"the session ended before {one.inserted:.2f} s"
            elif one.force is not None and not _is_exerted(one.force[0], apps):
                reasons[one.number] = f"no app exerts a force at {one.force[0]:.2f} s any more"
        if len({t for t, _ in self._names}) > 1:
            reasons |= self._replaced_names(phases)
        return reasons

    def _replaced_names(self, phases: Sequence[Phase]) -> Iterator[tuple[int, str]]:
        """Yield the number of each correction whose name another one replaces, and the reason.

        Two phases that were named have become one. A name that was given at the same time is a new one.
        """
        named = [(one.number, *one.name) for one in self._made if one.name is not None]
        for phase in phases:
            within = [(number, t, name) for number, t, name in named if phase.t0 <= t < phase.tn]
            for number, t, name in within:
                if t != within[-1][1] and name != phase.name:
                    yield number, f"its phase is now one with that at {within[-1][1]:.2f} s, {phase.name!r}"

    def notes(self, unapplied: Mapping[int, str]) -> Iterator[str]:
        """Yield a note with author and reason for each correction that is not applied."""
        made_by = {one.number: one.made for one in self._made if one.made is not None} if unapplied else {}
        for number, reason in unapplied.items():
            made = made_by[number]
            yield f"Correction {number} by {made.author} ({made.action.do}) is not applied: {reason}."

    @property
    def limits_forces(self) -> bool:
        """Return whether a correction limits a force."""
        return bool(self._forces)


def with_states(corrections: Sequence[Correction], unapplied: Mapping[int, str]) -> tuple[Correction, ...]:
    """Return corrections as the program lists them. unapplied: reasons, by number."""

    def stated(one: Correction) -> Correction:
        reason = unapplied.get(one.number)
        if one.state == "undone" or one.reason == reason:
            return one
        state = "applied" if reason is None else "not_applied"
        return one.model_copy(update={"state": state, "reason": reason})

    return tuple(map(stated, corrections))


def _is_exerted(t: float, apps: Sequence[App]) -> bool:
    """Whether an app exerts a force at a time [s]; apps: in the order of their beginnings.

    At most `OVERLAP` of them are read, of the thousands that an hour may have.
    """
    behind = bisect_right(apps, t, key=lambda app: app.t0)
    near = (apps[index] for index in range(max(0, behind - OVERLAP), behind))
    return any(app.force is not None and t <= app.tn for app in near)


def resolved(action: Change, shown: EditContext) -> ResolvedEdit:
    """Return a correction, resolved against the view.

    Raises ProtocolError, which lists the existing times, if it has no target.
    """
    match action:
        case Insert(t=t):
            return _inserted(t, shown)
        case Remove(t=t):
            mark = _meant(t, shown)
            return ResolvedEdit(none=mark.between, meant=mark.t)
        case Move(t=t, to=to):
            _check_time(to, shown, ahead=True)
            mark = _meant(t, shown)
            return ResolvedEdit(inserted=to, none=mark.between, meant=mark.t, placed=shown.place_of(to))
        case Relabel(t=t, kind=kind):
            return _relabelled(t, kind, shown)
        case LimitForce(t=t, newton=newton):
            return ResolvedEdit(force=(_limited(t, newton, shown), newton))
        case NamePhase(t=t, name=name):
            return ResolvedEdit(name=(_named(t, shown), name))


def _inserted(t: float, shown: EditContext) -> ResolvedEdit:
    _check_time(t, shown, ahead=True)
    there = next((mark for mark in shown.marks if abs(mark.t - t) <= READ_AS_S), None)
    if there is not None:
        return ResolvedEdit(starts=(there.start,), placed=there.t)
    return ResolvedEdit(inserted=t, placed=shown.place_of(t))


def _check_time(t: float, shown: EditContext, *, ahead: bool = False) -> None:
    last = shown.t_last + (AHEAD_S if ahead and not shown.finished else 0.0)
    if not shown.spans:
        raise ProtocolError("conflict", "nothing has been observed yet", value=t)
    if not shown.t_first <= t <= last:
        limit = [shown.t_first, last]
        raise ProtocolError("malformed", "the time is outside the demonstration", value=t, limit=limit)


def _meant(t: float, shown: EditContext) -> VisibleChangepoint:
    """Return the changepoint that a correction names by its time."""
    _check_time(t, shown)
    near = sorted(shown.marks, key=lambda mark: abs(mark.t - t))
    for mark in near:
        if abs(mark.t - t) <= REACH_S or mark.t_low <= t <= mark.t_high:
            break
    else:
        raise _nothing_near("there is no changepoint near this time", t, [round(mark.t, 3) for mark in near])
    if mark.after_gap:
        why = "samples are missing there: behind a gap a segment always begins"
        raise ProtocolError("conflict", why, value=t, limit=mark.t)
    return mark


def _relabelled(t: float, kind: str, shown: EditContext) -> ResolvedEdit:
    _check_time(t, shown)
    _check_kind(kind, shown.kinds)
    span = next((span for span in shown.spans if span.t0 <= t < span.tn), shown.spans[-1])
    ends = (span.start,) if span.grows else (span.start, span.end)
    inside = tuple(range(span.start + 1, span.end))
    return ResolvedEdit(starts=ends, none=inside, label=((span.start + span.end) // 2, kind))


def _check_kind(kind: str, kinds: Sequence[str]) -> None:
    if kind not in kinds:
        why = "this session has no such kind of segment"
        raise ProtocolError("malformed", why, value=kind, expected=list(kinds))


def _limited(t: float, newton: float | None, shown: EditContext) -> float:
    """Return the middle [s] of the app whose force a correction limits."""
    most = shown.force_limit_n
    if newton is not None and most is not None and newton > most:
        why = "no app exerts more than the cell's force limit"
        raise ProtocolError("malformed", why, value=newton, limit=most)
    if newton is not None and not is_press(newton):
        why = "that is less than the least of a press"
        raise ProtocolError("malformed", why, value=newton, limit=LEAST_FORCE_N)
    _check_time(t, shown)
    exerting = [app for app in shown.apps if app.force is not None]
    near = sorted(exerting, key=lambda app: max(app.t0 - t, t - app.tn))
    if not near or not near[0].t0 <= t <= near[0].tn:
        spans = [[round(app.t0, 3), round(app.tn, 3)] for app in near]
        raise _nothing_near("no app exerts a force there", t, spans)
    return 0.5 * (near[0].t0 + near[0].tn)


def _named(t: float, shown: EditContext) -> float:
    """Return the middle [s] of the phase that a correction names."""
    _check_time(t, shown)
    phase = next((phase for phase in shown.phases if phase.t0 <= t < phase.tn), shown.phases[-1])
    return 0.5 * (phase.t0 + phase.tn)


def _nothing_near(what: str, t: float, nearest: list[Any]) -> ProtocolError:
    near = nearest[:NAMED] or NONE_THERE
    return ProtocolError("conflict", what, value=t, limit=REACH_S, expected=near)
