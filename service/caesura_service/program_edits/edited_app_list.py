"""The apps of a program while edits are applied to them, one after the other.

Rules
- An edit that does not apply changes nothing.
- An app is found by its key, or by time among the taught ones, without a search through all apps.
- An app is represented by a number, which does not change when it is moved. Its model is built once, after
  all edits.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any

from caesura_protocol.app_force_limit import (
    CUT_SHARE,
    LEAST_FORCE_N,
    is_path_limited,
    is_press,
    with_force_limit,
)
from caesura_protocol.app_kinds import APP_KINDS, app_title
from caesura_protocol.messages import (
    App,
    AppChange,
    AppReference,
    ChangeApp,
    DeleteApp,
    DuplicateApp,
    InsertApp,
    LimitForce,
    MoveApp,
    NameProgram,
    ProgramEdit,
    ReplacePart,
    Vector,
)
from caesura_protocol.number_words import interval
from caesura_protocol.programs.app_time_shifts import earlier, is_taught_again
from caesura_service.program_edits.app_time_index import AppTimeIndex
from caesura_service.program_edits.editable_app_fields import FIELDS, LACKS, value
from caesura_service.program_edits.edited_app import SLACK_S, AppKey, EditedApp, common_share, keys_meant

NAMED = 3  # apps in the reason of an edit that is not applied: a reference may span all of them
OTHER_S = 2 * SLACK_S  # by which an end of an app has moved, for the program to say so
LEAST_COMMON = 0.5  # of the time of two apps together, for them to be the same
MOST_M, MOST_N = 100.0, 10_000.0  # a target and a force that are beyond any robot: sums of them stay numbers


class NotApplicableError(Exception):
    """An edit does not apply; the message is the reason."""


class EditedAppList:
    """The apps of a program after some edits, and the outcome of each edit."""

    def __init__(
        self, apps: Sequence[App], force_limit_n: float | None = None, limits: Sequence[LimitForce] = ()
    ) -> None:
        """force_limit_n: of the cell [N]; limits: of corrections."""
        self.force_limit_n, self.limits = force_limit_n, tuple(limits)
        self.edits: list[ProgramEdit] = []  # as they were given
        self.known: list[ProgramEdit] = []  # and what became of each
        self.name: str | None = None  # of the program
        inferred = tuple(apps)
        self._taught = AppTimeIndex(inferred)
        self._items = [EditedApp(app) for app in inferred]  # by their numbers
        self._order = list(range(len(inferred)))  # their numbers, as the program has them
        self._by_key: dict[AppKey, tuple[int, ...]] = {}
        for number, item in enumerate(self._items):
            self._by_key[item.key] = (*self._by_key.get(item.key, ()), number)
        self._deleted: dict[AppKey, int] = {}  # the last edit that took such an app out
        self._deleted_by: dict[int, int] = {}  # the edit that took an app out
        self._replacing: set[int] = set()  # edits that put others in the place of apps
        self._other_times: list[str] = []  # apps of the last edit that had other times when it was made

    def copy(self) -> EditedAppList:
        """Return another draft with the same apps."""
        other = EditedAppList.__new__(type(self))
        other.force_limit_n, other.limits, other.name = self.force_limit_n, self.limits, self.name
        other._taught, other._other_times = self._taught, []
        other.edits, other.known = self.edits.copy(), self.known.copy()
        other._items, other._order = self._items.copy(), self._order.copy()
        other._by_key, other._deleted = self._by_key.copy(), self._deleted.copy()
        other._deleted_by, other._replacing = self._deleted_by.copy(), self._replacing.copy()
        return other

    @property
    def items(self) -> list[EditedApp]:
        """The apps in the order of the program."""
        return [self._items[number] for number in self._order]

    @property
    def taught_again(self) -> int:
        """The number of apps that were taught again."""
        return sum(is_taught_again(item.inferred) for item in self.items)

    def apply(self, edit: ProgramEdit) -> None:
        """Apply an edit, or list it with the reason why it does not apply."""
        self._other_times = []
        self.edits.append(edit)
        try:
            self._apply(edit)
        except NotApplicableError as error:
            self.known.append(edit.model_copy(update={"state": "not_applied", "reason": str(error)}))
        else:
            reason = "; ".join(dict.fromkeys(self._other_times)) or None
            is_known = edit.state == "applied" and edit.reason == reason
            found = edit if is_known else edit.model_copy(update={"state": "applied", "reason": reason})
            self.known.append(found)

    def place(self, wanted: AppReference) -> int:
        """Return the index of the app that a reference names. Raises NotApplicableError if there is none.

        An app that was at another time when it was edited is noted, for the reason of the edit.
        """
        index = self._find(wanted)
        found = self._at(index).inferred
        if wanted.added is None and max(abs(found.t0 - wanted.t0), abs(found.tn - wanted.tn)) > OTHER_S:
            there = f"'{app_title(found.kind)}' at {_seconds(found)}"
            self._other_times.append(f"{there} was at {_seconds(wanted)} when it was edited")
        return index

    # --- which app is meant ---------------------------------------------------------------------------------

    def _find(self, wanted: AppReference) -> int:
        """Return the index of the app with the key, or else of the taught one nearest in time."""
        same = [number for key in keys_meant(wanted) for number in self._by_key.get(key, ())]
        if len(same) == 1:
            return self._order.index(same[0])
        shares = {number: self._common(wanted, number) for number in same or self._alike(wanted)}
        most = max(shares.values(), default=0.0)
        if not same and most < LEAST_COMMON:
            raise NotApplicableError(self._missing(wanted))
        return self._last_of([number for number, share in shares.items() if share == most])

    def _common(self, wanted: AppReference, number: int) -> float:
        return common_share(wanted, self._items[number].inferred)

    def _alike(self, wanted: AppReference) -> list[int]:
        """Return the taught apps of the kind and about the time of a reference; none for an added one."""
        return [number for number in self._near(wanted) if self._items[number].inferred.kind == wanted.kind]

    def _near(self, wanted: AppReference) -> list[int]:
        if wanted.added is not None:
            return []
        return [number for number in self._taught.near(wanted) if number not in self._deleted_by]

    def _last_of(self, numbers: Collection[int]) -> int:
        """Return the index of the app among these that comes last in the program."""
        if len(numbers) == 1:
            (number,) = numbers
            return self._order.index(number)
        among = set(numbers)
        return max(index for index, number in enumerate(self._order) if number in among)

    def _missing(self, wanted: AppReference) -> str:
        what = f"the app '{app_title(wanted.kind)}'"
        if (edit := self._deletion(wanted)) is not None:
            return f"{what} was {'replaced' if edit in self._replacing else 'deleted'} by edit {edit}"
        if wanted.added is not None:
            return f"{what} that edit {wanted.added} added is not in the program"
        apps = {number: self._items[number].inferred for number in self._near(wanted)}
        near = {number for number, app in apps.items() if app.t0 < wanted.tn and wanted.t0 < app.tn}
        first = [number for number in self._order if number in near][:NAMED] if near else []
        named = [f"'{app_title(apps[number].kind)}' at {_seconds(apps[number])}" for number in first]
        more = f" and {len(near) - NAMED} more" if len(near) > NAMED else ""
        now = f": now there is {', '.join(named)}{more}" if named else ""
        return f"{what} at {_seconds(wanted)} is no longer in the program{now}"

    def _deletion(self, wanted: AppReference) -> int | None:
        """Return the number of the edit that deleted the app; None if none did."""
        exact = [(1.0, self._deleted[key]) for key in keys_meant(wanted) if key in self._deleted]
        gone = [] if wanted.added is not None else self._taught.near(wanted)
        of_kind = [number for number in gone if self._items[number].inferred.kind == wanted.kind]
        alike = [
            (self._common(wanted, one), self._deleted_by[one]) for one in of_kind if one in self._deleted_by
        ]
        likeness, edit = max((*exact, *alike), default=(0.0, 0))
        return edit if likeness >= LEAST_COMMON else None

    # --- what each edit does --------------------------------------------------------------------------------

    def _apply(self, edit: ProgramEdit) -> None:
        match edit.action:
            case ChangeApp() as change:
                number = self._order[self.place(change.app)]
                self._items[number] = self._changed(self._items[number], change, edit)
            case MoveApp(app=app, after=after):
                self._move(app, after, edit)
            case DeleteApp(app=app):
                index = self.place(app)
                self._take_out(index, index + 1, edit)
            case DuplicateApp(app=app):
                index = self.place(app)
                copy = self._at(index).app.model_copy(update={"added": edit.number})
                self._put(index + 1, [EditedApp(copy).marked(edit, "added")])
            case InsertApp() as insert:
                index = self._behind(insert.after)
                made = self._new(insert, index, edit.number)
                self._put(index, [EditedApp(made).marked(edit, "added")])
            case ReplacePart() as replace:
                self._replace(replace, edit)
            case NameProgram(name=name):
                self.name = name

    def _at(self, index: int) -> EditedApp:
        return self._items[self._order[index]]

    def _put(self, index: int, items: Sequence[EditedApp]) -> None:
        """Insert new apps into the program, the first one at `index`."""
        numbers = range(len(self._items), len(self._items) + len(items))
        self._items += items
        self._order[index:index] = numbers
        for number, item in zip(numbers, items, strict=True):
            self._by_key[item.key] = (*self._by_key.get(item.key, ()), number)

    def _take_out(self, first: int, stop: int, edit: ProgramEdit) -> None:
        """Remove the apps from index `first` to `stop`, which is not included, from the program."""
        for number in self._order[first:stop]:
            key = self._items[number].key
            self._by_key[key] = tuple(one for one in self._by_key[key] if one != number)
            self._deleted[key] = max(self._deleted.get(key, 0), edit.number)
            self._deleted_by[number] = edit.number
        del self._order[first:stop]

    def _replace(self, part: ReplacePart, edit: ProgramEdit) -> None:
        """Replace a part by the apps of an edit."""
        first, last = self.place(part.first), self.place(part.last)
        if last < first:
            raise NotApplicableError("the last app of the part comes before the first one")
        if not edit.apps:
            raise NotApplicableError(f"session {part.session} has no apps")
        begins = self._at(first).inferred  # an app that an edit added is named by that edit, at any time
        later_s = (part.first.t0 if begins.added is None else begins.t0) - edit.apps[0].t0
        self._replacing.add(edit.number)
        self._state_lost_values([self._at(index) for index in range(first, last + 1)], edit)
        self._take_out(first, last + 1, edit)
        self._put(first, [self._taught_again(app, later_s, edit) for app in edit.apps])

    def _state_lost_values(self, items: Sequence[EditedApp], edit: ProgramEdit) -> None:
        """State in earlier edits that this one replaces apps whose values they set."""
        lost: dict[int, list[str]] = {}
        for item in items:
            app = item.inferred
            replaced = f"edit {edit.number} replaced '{app_title(app.kind)}' at {_seconds(app)}"
            for number in {mark.edit for mark in item.marks if mark.field in item.values}:
                lost.setdefault(number, []).append(replaced)
        for index, one in enumerate(self.known):
            if one.number in lost:
                reasons = filter(None, (one.reason, *lost[one.number]))
                self.known[index] = one.model_copy(update={"reason": "; ".join(reasons)})

    def _taught_again(self, app: App, later_s: float, edit: ProgramEdit) -> EditedApp:
        """Return an app of another session, at times of this one and within the force limit of its cell.

        later_s: [s] added to its times.
        """
        limited = app if self.force_limit_n is None else with_force_limit(app, self.force_limit_n)
        mark = AppChange(field="taught_again", author=edit.author, edit=edit.number)
        changes = {"segments": (), "added": edit.number, "changes": (mark,)}
        return EditedApp(earlier(limited, -later_s).model_copy(update=changes))

    def _behind(self, after: AppReference | None) -> int:
        return 0 if after is None else self.place(after) + 1

    def _move(self, app: AppReference, after: AppReference | None, edit: ProgramEdit) -> None:
        index, place = self.place(app), self._behind(after)
        if place == index + 1:
            raise NotApplicableError("an app cannot come after itself")
        number = self._order.pop(index)
        self._items[number] = self._items[number].marked(edit, "place")
        self._order.insert(place - (index < place), number)

    def _changed(self, item: EditedApp, change: ChangeApp, edit: ProgramEdit) -> EditedApp:
        given = {name: getattr(change, name) for name in FIELDS if getattr(change, name) is not None}
        if not given and not change.as_taught:
            raise NotApplicableError("it changes no field")
        item = item.without(change.as_taught)
        for name, wanted in given.items():
            self._check(name, wanted, item.inferred)
            item = item.marked(edit, name, value(item.inferred, name))
        return item.with_values(given)

    def _check(self, name: str, value: Any, app: App) -> None:
        """Check that an app may have this value in a field. Raises NotApplicableError."""
        lacks = LACKS[name](app) if name in LACKS else ""
        if lacks:
            raise NotApplicableError(f"'{app_title(app.kind)}' {lacks}")
        if name == "force_n":
            self._check_force(value, presses=True)
            self._check_corrected_force(value, app)
        if name == "target":
            self._check_target(value)

    def _check_target(self, target: Vector) -> None:
        if max(map(abs, target)) > MOST_M:
            raise NotApplicableError(f"its target is more than {1000 * MOST_M:.0f} mm away from the base")

    def _check_force(self, newtons: float, presses: bool) -> None:
        most = self.force_limit_n
        if presses and not is_press(newtons):
            raise NotApplicableError(f"{newtons:g} N is less than the least of a press, {LEAST_FORCE_N:g} N")
        if newtons > MOST_N:
            raise NotApplicableError(f"{newtons:g} N is more than any robot exerts")
        if most is not None and newtons > most:
            raise NotApplicableError(f"{newtons:g} N is more than the cell's force limit, {most:g} N")

    def _check_corrected_force(self, newtons: float, app: App) -> None:
        """Check a force against the limit that a correction sets for an app that was taught."""
        if not app.segments:
            return
        given = [one.newton for one in self.limits if app.t0 <= one.t <= app.tn]
        most = given[-1] if given else None
        if is_path_limited(app):  # as it was resolved; its time may lie in another app since
            most = math.hypot(*(app.force or ()))
        if most is not None and newtons > most * (1.0 + CUT_SHARE):
            raise NotApplicableError(
                f"{newtons:g} N is more than the limit that a correction sets for the app, {most:g} N"
            )

    def _new(self, insert: InsertApp, index: int, number: int) -> App:
        facts = APP_KINDS[insert.kind]
        before = self._at(index - 1).app if index else None
        following = self._at(index).app if index < len(self._order) else None
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
                raise NotApplicableError(f"'{facts.title}' needs a {name}")
        return app


def _seconds(app: App | AppReference) -> str:
    return f"{interval(app.t0, app.tn, 2, ' to ')} s"
