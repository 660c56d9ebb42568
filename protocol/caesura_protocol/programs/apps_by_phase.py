"""Groups apps by the phase in which they were taught; each group has a name that can be changed."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import accumulate
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from caesura_protocol.app_kinds import app_number, name_of_app
from caesura_protocol.errors import CaesuraError
from caesura_protocol.messages import App, Phase, PhaseName, ProgramEdit, ReplacePart
from caesura_protocol.number_words import interval
from caesura_protocol.programs.app_time_shifts import part_of

LONGEST_NAME = 64  # [characters], as the field says
AppNumber = Annotated[int, Field(ge=0)]
Time = tuple[float, float]  # from, to [s]


class Group(BaseModel):
    """The apps of one phase: apps `first` to `last` of a program, counted from 0, and the phase's name."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    first: AppNumber
    last: AppNumber
    name: PhaseName
    strokes: Annotated[int, Field(ge=1)] = 1  # of the phase as it was taught

    @property
    def strokes_in_words(self) -> str:
        """The number of strokes if there are several; edits of the program do not change it."""
        return "" if self.strokes == 1 else f"{self.strokes} strokes taught"

    @property
    def apps_in_words(self) -> str:
        """The numbers of the apps, for people."""
        if self.first == self.last:
            return f"app {app_number(self.first)}"
        return f"apps {app_number(self.first)}–{app_number(self.last)}"

    @property
    def heading(self) -> str:
        """The name, the strokes and the apps in one line, for people."""
        named = ", ".join(filter(None, (self.name, self.strokes_in_words)))
        return f"{named}: {self.apps_in_words}"


def groups_by_first(groups: Sequence[Group], count: int) -> dict[int, Group]:
    """Return groups by their first app, without those that a program of `count` apps cannot have.

    These are the groups in a changed file that go past its apps, or that share apps with an earlier group.
    """
    found: dict[int, Group] = {}
    free = 0  # the first app after the groups so far
    for group in sorted(groups, key=lambda one: one.first):
        if free <= group.first <= group.last < count:
            found[group.first] = group
            free = group.last + 1
    return found


def groups_of(
    apps: Sequence[App], phases: Sequence[Phase], edits: Sequence[ProgramEdit] = ()
) -> tuple[Group, ...]:
    """Return a group for each phase that has apps, named as the phase is, or by kind and number: `contact 1`.

    An app belongs to the phase of its first segment; one without segments to the phase at its time. A part
    that was taught again belongs to the phase with most of the time of the apps that it replaces. There is no
    group for a single phase, or for one whose apps no longer follow each other after edits.

    edits: of the program, oldest first.
    """
    groups: list[Group] = []
    if len(phases) < 2:
        return ()
    phases = tuple(phases)  # stored ones are decoded once
    counts: Counter[str] = Counter()
    owners = _phases_of(apps, phases, edits)
    for number, phase in enumerate(phases):
        members = [index for index, owner in enumerate(owners) if owner == number]
        counts[phase.kind] += bool(members)
        if members and not _is_divided(owners, number):
            name = phase.name or f"{phase.kind} {counts[phase.kind]}"
            groups.append(Group(first=members[0], last=members[-1], name=name, strokes=phase.strokes))
    return tuple(groups)


def ungrouped_notes(apps: Sequence[App], phases: Sequence[Phase]) -> Iterator[str]:
    """Yield a note on each phase without a group: an app from the phase before crosses it, or it has a name.

    apps: as they were inferred. A phase without a name in which no app acts is a rest, and needs no note.
    """
    apps, phases = tuple(apps), tuple(phases)  # stored ones are decoded once
    owners = set(_phases_of(apps, phases))
    for number, phase in enumerate(phases):
        if number in owners or len(phases) < 2:
            continue
        across = [
            name_of_app(i, app) for i, app in enumerate(apps) if app.t0 < phase.tn and phase.t0 < app.tn
        ]
        if across or phase.name is not None:
            called = phase.name or phase.kind
            when = interval(phase.t0, phase.tn, 1)
            why = f"it lies in {across[0]}, which begins in the phase before" if across else "it has no app"
            yield f"Phase {number + 1} ({called}) at {when} s is no group of the program: {why}."


def edited_group_notes(
    apps: Sequence[App], phases: Sequence[Phase], edits: Sequence[ProgramEdit] = ()
) -> Iterator[str]:
    """Yield a note on each phase that is no group because of edits.

    They put other apps between its apps, or replaced all of them, and it has a name. edits: of the program,
    oldest first.
    """
    phases = tuple(phases)  # stored ones are decoded once
    owners = _phases_of(apps, phases, edits)
    replaced_by = {
        number: (edit, _main_phase(phases, time))
        for edit, time in _replaced_times(edits).items()
        for number in _shares(phases, time)
    }
    for number, phase in enumerate(phases):
        why = ""
        if _is_divided(owners, number):
            why = "apps of another one were put between its apps"
        elif phase.name is not None and number not in owners and number in replaced_by:
            edit, main = replaced_by[number]
            why = f"edit {edit} replaced what was taught in its time, and more of phase {(main or 0) + 1}"
        if why:
            yield f"Phase {number + 1} ({phase.name or phase.kind}) is no group of the program: {why}."


def renamed(groups: Sequence[Group], names: Sequence[str]) -> tuple[Group, ...]:
    """Return the groups with names given as `OLD=NEW`, where OLD is a group's name or its number from 1.

    Raises CaesuraError for any other text, for an unknown group, and for a name of several groups.
    """
    found = list(groups)
    for given in names:
        old, separator, new = (part.strip() for part in given.partition("="))
        known = [one.name for one in found]
        number = known.index(old) if old in known else int(old) - 1 if old.isdecimal() else -1
        if not separator or not 0 <= number < len(found):
            there = ", ".join(f"{i} {name!r}" for i, name in enumerate(known, 1)) or "none"
            raise CaesuraError(f"cannot name {given!r}: expected GROUP=NAME with one of the groups {there}")
        if known.count(old) > 1:
            numbers = " or ".join(str(i) for i, name in enumerate(known, 1) if name == old)
            raise CaesuraError(
                f"cannot name {given!r}: {known.count(old)} groups have that name, use {numbers}"
            )
        if not 1 <= len(new) <= LONGEST_NAME:
            raise CaesuraError(f"cannot name {given!r}: expected a name of 1 to {LONGEST_NAME} characters")
        found[number] = found[number].model_copy(update={"name": new})
    return tuple(found)


def _is_divided(owners: Sequence[int | None], number: int) -> bool:
    """Return whether apps of other phases lie between those of a phase."""
    members = [index for index, owner in enumerate(owners) if owner == number]
    return bool(members) and bool({*owners[members[0] : members[-1]]} - {number, None})


def _phases_of(
    apps: Sequence[App], phases: Sequence[Phase], edits: Sequence[ProgramEdit] = ()
) -> list[int | None]:
    """Return the number of the last phase that begins no later than each app. phases: in order.

    The times of an app that was taught again are those of another session: its phase is that of the part, or
    None for a part of unknown time. Without edits the numbers rise: an app without segments may begin before
    the one before it ends.
    """
    firsts, starts = [one.first_segment for one in phases], [one.t0 for one in phases]
    begun = (
        bisect_right(firsts, app.segments[0]) if app.segments else bisect_right(starts, app.t0)
        for app in apps
    )
    owners = [max(count - 1, 0) for count in begun]
    if not any(app.changes for app in apps):
        return [*accumulate(owners, max)]
    parts = {edit: _main_phase(phases, time) for edit, time in _replaced_times(edits).items()}
    edit_of = map(part_of, apps)
    return [owner if edit is None else parts.get(edit) for edit, owner in zip(edit_of, owners, strict=True)]


def _replaced_times(edits: Sequence[ProgramEdit]) -> dict[int, Time]:
    """Return the time that each part that was taught again had at first, by the number of its edit.

    A part may replace apps of an earlier one: it has the time of that one.
    """
    times: dict[int, Time] = {}
    for edit in edits:
        action = edit.action
        if isinstance(action, ReplacePart) and edit.state == "applied":
            begins, ends = (
                times.get(one.added or 0, (one.t0, one.tn)) for one in (action.first, action.last)
            )
            times[edit.number] = begins[0], ends[1]
    return times


def _shares(phases: Sequence[Phase], time: Time) -> dict[int, float]:
    """Return how long each phase that a time overlaps does so [s], by the numbers of the phases."""
    shares = {i: min(one.tn, time[1]) - max(one.t0, time[0]) for i, one in enumerate(phases)}
    return {number: seconds for number, seconds in shares.items() if seconds > 0.0}


def _main_phase(phases: Sequence[Phase], time: Time) -> int | None:
    """Return the number of the phase that overlaps a time longest; None without one."""
    shares = _shares(phases, time)
    return max(shares, key=lambda number: shares[number], default=None)
