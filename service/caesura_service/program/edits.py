"""Edits of a program, a layer on what was inferred: the same edits are applied to every new program.

Rules
- An edit names an app by its kind and the time at which it begins. After a correction it is the app of this
  kind whose time is most nearly the same, if half of both times is common.
- Edits are applied one after the other. One whose app is gone is listed as not applied, with the reason.
- One whose app has other times by now, as after a correction that joined two apps, is applied, with a note.
- A field of an app has the value of its last edit. Apps that are taught later follow in their own order.
- No force is above the limit of the cell, or above that which a correction sets for the app.
- Apps that were taught again are part of their edit, at constant times: the first one begins where the part
  began when it was replaced.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from caesura_protocol.app_kinds import APP_KINDS, app_title
from caesura_protocol.errors import ProtocolError
from caesura_protocol.force_limit import (
    CUT_SHARE,
    LEAST_FORCE_N,
    is_path_limited,
    is_press,
    with_force_limit,
)
from caesura_protocol.messages import (
    MAX_TAUGHT_AGAIN,
    App,
    AppChange,
    AppField,
    AppReference,
    ChangeApp,
    ChangedField,
    Correction,
    DeleteApp,
    DuplicateApp,
    InsertApp,
    LimitForce,
    MoveApp,
    NameProgram,
    Program,
    ProgramEdit,
    ReplacePart,
    Vector,
)
from caesura_protocol.number_words import interval
from caesura_protocol.programs.app_times import earlier, is_taught_again
from caesura_service.program.app_fields import FIELDS, LACKS, SETTERS, value
from caesura_service.program.edit_log import EditLog

SLACK_S = 0.15  # by which the time of an app is widened at both ends before two are compared
NAMED = 3  # apps in the reason of an edit that is not applied: a reference may span all of them
OTHER_S = 2 * SLACK_S  # by which an end of an app has moved, for the program to say so
LEAST_COMMON = 0.5  # of the time of two apps together, for them to be the same
MOST_M, MOST_N = 100.0, 10_000.0  # a target and a force that are beyond any robot: sums of them stay numbers


def with_edits(program: Program, log: EditLog) -> Program:
    """The inferred program with these edits; its notes name those that do not apply, or to another time."""
    if not log.revision:
        return program
    made = apply(program.apps, log.active, program.force_limit_n, program.corrections)
    taken_back = log.listed[len(log.active) :]
    changes = {
        "apps": made.apps,
        "name": made.name,
        "edit_revision": log.revision,
        "edits": (*made.edits, *taken_back),
        "notes": (*program.notes, *(_note(edit) for edit in made.edits if edit.reason)),
    }
    return program.model_copy(update=changes)


def at_edit(program: Program, log: EditLog, number: int) -> Program:
    """The inferred program with the edits that count, up to a number: a version of it; 0 for none."""
    bare = program.model_copy(update={"edits": (), "edit_revision": 0})
    return with_edits(bare, EditLog(tuple(edit for edit in log.active if edit.number <= number), (), number))


def check_applies(program: Program, log: EditLog) -> None:
    """Check that the last edit of a log applies to the inferred program. Raises ProtocolError `conflict`."""
    made = apply(program.apps, log.active, program.force_limit_n, program.corrections)
    if not made.edits:
        return
    if _is_left_out(made.edits[-1]):
        raise ProtocolError("conflict", str(made.edits[-1].reason))
    standing = sum(map(is_taught_again, made.apps))
    if isinstance(made.edits[-1].action, ReplacePart) and standing > MAX_TAUGHT_AGAIN:
        why = (
            f"the program would have {standing} apps that were taught again, of {MAX_TAUGHT_AGAIN} at most: "
            "replace or undo some of them"
        )
        raise ProtocolError("conflict", why, limit=MAX_TAUGHT_AGAIN)


def _is_left_out(edit: ProgramEdit) -> bool:
    return edit.state == "not_applied"


def _note(edit: ProgramEdit) -> str:
    applied = "not applied" if _is_left_out(edit) else "applied"
    return f"Edit {edit.number} by {edit.author} ({edit.action.do}) is {applied}: {edit.reason}."


class EditedApps(NamedTuple):
    """Apps after edits, and what became of each edit."""

    apps: tuple[App, ...]
    edits: tuple[ProgramEdit, ...]
    name: str | None  # of the program


def apply(
    apps: Sequence[App],
    edits: Sequence[ProgramEdit],
    force_limit_n: float | None = None,
    corrections: Sequence[Correction] = (),
) -> EditedApps:
    """Apply edits to inferred apps, oldest first.

    force_limit_n: of the cell [N]; corrections: of the session, which may limit the force of an app.
    """
    draft = _Draft([_item(app) for app in apps], force_limit_n, corrections)
    known: list[ProgramEdit] = []
    for edit in edits:
        try:
            draft.apply(edit)
        except _NotApplicableError as error:
            known.append(edit.model_copy(update={"state": "not_applied", "reason": str(error)}))
        else:
            reason = "; ".join(dict.fromkeys(draft.other_times)) or None
            known.append(edit.model_copy(update={"state": "applied", "reason": reason}))
    return EditedApps(tuple(item.app for item in draft.items), tuple(known), draft.name)


class _NotApplicableError(Exception):
    """An edit does not apply; says why."""


class _Item(NamedTuple):
    """An app as it was inferred or added, and what was set since: values by field, and marks."""

    inferred: App
    key: tuple[object, ...]
    t0: float  # [s] of the inferred app, as `tn`
    tn: float
    values: Mapping[AppField, Any] = MappingProxyType({})
    marks: tuple[AppChange, ...] = ()

    @property
    def app(self) -> App:
        """The app with its edits; the inferred one itself without any."""
        if not self.marks:
            return self.inferred
        app = self.inferred
        for name in FIELDS:
            if name in self.values:
                app = app.model_copy(update=SETTERS[name](app, self.values[name]))
        marks = {mark.field: mark for mark in (*app.changes, *self.marks)}
        return app.model_copy(update={"changes": tuple(marks.values())})

    def marked(self, edit: ProgramEdit, field: ChangedField, inferred: Any = None) -> _Item:
        """With a mark of the last edit of a field."""
        mark = AppChange(field=field, author=edit.author, edit=edit.number, inferred=inferred)
        return self._replace(marks=(*(one for one in self.marks if one.field != field), mark))

    def without(self, fields: Collection[str]) -> _Item:
        """Without the edits of some fields."""
        values = {name: value for name, value in self.values.items() if name not in fields}
        marks = tuple(mark for mark in self.marks if mark.field not in fields)
        return self._replace(values=values, marks=marks)


def _item(app: App) -> _Item:
    """An app without edits."""
    return _Item(app, _key(app), app.t0, app.tn)


class _Draft:
    """The apps while edits are applied; an edit that does not apply changes nothing."""

    def __init__(
        self, items: list[_Item], force_limit_n: float | None, corrections: Sequence[Correction]
    ) -> None:
        self.items = items
        self.name: str | None = None
        self._force_limit_n = force_limit_n
        self._limits = [
            one.action for one in corrections if isinstance(one.action, LimitForce) and one.state == "applied"
        ]
        self.other_times: list[str] = []  # apps of the last edit that had other times when it was made
        self._deleted: list[tuple[App, ProgramEdit]] = []

    def apply(self, edit: ProgramEdit) -> None:
        """Apply an edit. Raises _NotApplicableError."""
        self.other_times = []
        match edit.action:
            case ChangeApp() as change:
                index = self._place(change.app)
                self.items[index] = self._changed(self.items[index], change, edit)
            case MoveApp(app=app, after=after):
                self._move(app, after, edit)
            case DeleteApp(app=app):
                self._deleted.append((self.items.pop(self._place(app)).inferred, edit))
            case DuplicateApp(app=app):
                index = self._place(app)
                copy = self.items[index].app.model_copy(update={"added": edit.number})
                self.items.insert(index + 1, _item(copy).marked(edit, "added"))
            case InsertApp() as insert:
                index = self._behind(insert.after)
                made = self._new(insert, index, edit.number)
                self.items.insert(index, _item(made).marked(edit, "added"))
            case ReplacePart() as replace:
                self._replace(replace, edit)
            case NameProgram(name=name):
                self.name = name

    def _replace(self, part: ReplacePart, edit: ProgramEdit) -> None:
        """Put the apps of an edit in the place of a part."""
        first, last = self._place(part.first), self._place(part.last)
        if last < first:
            raise _NotApplicableError("the last app of the part comes before the first one")
        if not edit.apps:
            raise _NotApplicableError(f"session {part.session} has no apps")
        self._deleted += [(item.inferred, edit) for item in self.items[first : last + 1]]
        begins = self.items[first].inferred  # an app that an edit added is named by that edit, at any time
        later_s = (part.first.t0 if begins.added is None else begins.t0) - edit.apps[0].t0
        self.items[first : last + 1] = [self._taught_again(app, later_s, edit) for app in edit.apps]

    def _taught_again(self, app: App, later_s: float, edit: ProgramEdit) -> _Item:
        """An app of another session, at times of this one and within the force limit of its cell."""
        limited = app if self._force_limit_n is None else with_force_limit(app, self._force_limit_n)
        mark = AppChange(field="taught_again", author=edit.author, edit=edit.number)
        changes = {"segments": (), "added": edit.number, "changes": (mark,)}
        return _item(earlier(limited, -later_s).model_copy(update=changes))

    def _place(self, wanted: AppReference) -> int:
        """The index of the app that is meant. Raises _NotApplicableError."""
        keys = _keys(wanted)
        same = [index for index, item in enumerate(self.items) if item.key in keys]
        likeness = [(_common(wanted, self.items[index].inferred), index) for index in same] or [
            (_likeness(wanted, self.items[index].inferred), index) for index in self._near(wanted)
        ]
        most, best = max(likeness, default=(0.0, 0))
        if not same and most < LEAST_COMMON:
            raise _NotApplicableError(self._missing(wanted))
        found = self.items[best].inferred
        if wanted.added is None and max(abs(found.t0 - wanted.t0), abs(found.tn - wanted.tn)) > OTHER_S:
            there = f"'{app_title(found.kind)}' at {_seconds(found)}"
            self.other_times.append(f"{there} was at {_seconds(wanted)} when it was edited")
        return best

    def _near(self, wanted: AppReference) -> list[int]:
        """The indices of apps of about this time; every edit may look at every app."""
        first, last = wanted.t0 - 2 * SLACK_S, wanted.tn + 2 * SLACK_S
        return [index for index, item in enumerate(self.items) if item.t0 < last and first < item.tn]

    def _missing(self, wanted: AppReference) -> str:
        what = f"the app '{app_title(wanted.kind)}'"
        deleted = [(_likeness(wanted, app), edit.number) for app, edit in self._deleted]
        likeness, number = max(deleted, default=(0.0, 0))
        if likeness >= LEAST_COMMON:
            replaced = any(
                edit.number == number and edit.action.do == "replace_part" for _, edit in self._deleted
            )
            return f"{what} was {'replaced' if replaced else 'deleted'} by edit {number}"
        if wanted.added is not None:
            return f"{what} that edit {wanted.added} added is not in the program"
        apps = [self.items[index].inferred for index in self._near(wanted)]
        near = [app for app in apps if app.added is None and app.t0 < wanted.tn and wanted.t0 < app.tn]
        named = [f"'{app_title(app.kind)}' at {_seconds(app)}" for app in near[:NAMED]]
        more = f" and {len(near) - NAMED} more" if len(near) > NAMED else ""
        now = f": now there is {', '.join(named)}{more}" if named else ""
        return f"{what} at {_seconds(wanted)} is no longer in the program{now}"

    def _behind(self, after: AppReference | None) -> int:
        return 0 if after is None else self._place(after) + 1

    def _move(self, app: AppReference, after: AppReference | None, edit: ProgramEdit) -> None:
        index, place = self._place(app), self._behind(after)
        if place == index + 1:
            raise _NotApplicableError("an app cannot come after itself")
        moved = self.items.pop(index).marked(edit, "place")
        self.items.insert(place - (index < place), moved)

    def _changed(self, item: _Item, change: ChangeApp, edit: ProgramEdit) -> _Item:
        given = {name: getattr(change, name) for name in FIELDS if getattr(change, name) is not None}
        if not given and not change.as_taught:
            raise _NotApplicableError("it states no field")
        item = item.without(change.as_taught)
        for name, wanted in given.items():
            self._check(name, wanted, item.inferred)
            item = item.marked(edit, name, value(item.inferred, name))
        return item._replace(values={**item.values, **given})

    def _check(self, name: str, value: Any, app: App) -> None:
        """Check that an app has such a value. Raises _NotApplicableError."""
        lacks = LACKS[name](app) if name in LACKS else ""
        if lacks:
            raise _NotApplicableError(f"'{app_title(app.kind)}' {lacks}")
        if name == "force_n":
            self._check_force(value, presses=True)
            self._check_corrected_force(value, app)
        if name == "target":
            self._check_target(value)

    def _check_target(self, target: Vector) -> None:
        if max(map(abs, target)) > MOST_M:
            raise _NotApplicableError(f"its target is more than {MOST_M:g} m away")

    def _check_force(self, newtons: float, presses: bool) -> None:
        most = self._force_limit_n
        if presses and not is_press(newtons):
            raise _NotApplicableError(f"{newtons:g} N is less than the least of a press, {LEAST_FORCE_N:g} N")
        if newtons > MOST_N:
            raise _NotApplicableError(f"{newtons:g} N is more than any robot exerts")
        if most is not None and newtons > most:
            raise _NotApplicableError(f"{newtons:g} N is more than the cell's force limit, {most:g} N")

    def _check_corrected_force(self, newtons: float, app: App) -> None:
        """Check a force against the limit that a correction sets for an app that was taught."""
        if not app.segments:
            return
        given = [one.newton for one in self._limits if app.t0 <= one.t <= app.tn]
        most = given[-1] if given else None
        if is_path_limited(app):  # as it was resolved; its time may lie in another app since
            most = math.hypot(*(app.force or ()))
        if most is not None and newtons > most * (1.0 + CUT_SHARE):
            raise _NotApplicableError(
                f"{newtons:g} N is more than the limit that a correction sets for the app, {most:g} N"
            )

    def _new(self, insert: InsertApp, index: int, number: int) -> App:
        facts = APP_KINDS[insert.kind]
        before = self.items[index - 1].app if index else None
        following = self.items[index].app if index < len(self.items) else None
        near = before or following
        if insert.target is not None:
            self._check_target(insert.target)
        if insert.force is not None:
            self._check_force(math.hypot(*insert.force), facts.presses)
        t0 = before.tn if before else following.t0 if following else 0.0
        app = App(
            kind=insert.kind,
            t0=t0,
            tn=t0 + (insert.seconds if facts.needs else 0.0),
            target=insert.target or (near.target if near else None),
            orientation=near.orientation if near else None,
            joints=near.joints if near and insert.target is None else None,
            force=insert.force if facts.presses else None,
            force_taught=insert.force if facts.presses else None,
            load_kg=None,
            load_sd_kg=None,
            gripper_width=insert.gripper_width,
            confidence=1.0,
            segments=(),
            name=insert.name,
            added=number,
        )
        for name in facts.needs:
            if getattr(app, name) is None:
                raise _NotApplicableError(f"'{facts.title}' needs a {name}")
        return app


def _key(app: App) -> tuple[object, ...]:
    """What distinguishes an app from others: one edit may have put several in place."""
    if app.added is None:
        return (app.kind, app.t0)
    return (app.added, app.kind, app.t0) if is_taught_again(app) else (app.added,)


def _keys(wanted: AppReference) -> tuple[tuple[object, ...], ...]:
    """The keys of an app that a reference surely means."""
    if wanted.added is None:
        return ((wanted.kind, wanted.t0),)
    return (wanted.added,), (wanted.added, wanted.kind, wanted.t0)


def _likeness(wanted: AppReference, app: App) -> float:
    """How nearly an app is the one that is meant, from 0 to 1."""
    if _key(app) in _keys(wanted):
        return 1.0
    if wanted.kind != app.kind or wanted.added is not None or app.added is not None:
        return 0.0
    return _common(wanted, app)


def _common(wanted: AppReference, app: App) -> float:
    """The share of the time of two apps together that is common to both."""
    t0, tn = max(wanted.t0, app.t0), min(wanted.tn, app.tn)
    first, last = min(wanted.t0, app.t0), max(wanted.tn, app.tn)
    return max(0.0, tn - t0 + 2 * SLACK_S) / (last - first + 2 * SLACK_S)


def _seconds(app: App | AppReference) -> str:
    return f"{interval(app.t0, app.tn, 2, ' to ')} s"
