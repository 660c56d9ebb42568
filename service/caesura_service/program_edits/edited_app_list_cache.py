"""Caches the apps after the first edits of a log, so that one more edit applies only that edit.

Rules
- A draft is an `EditedAppList`: the apps after the first edits of a log.
- A draft is valid for the same inferred apps (the same object), limits of force and edits (the same objects).
- A cached draft is never changed: a longer one is made from a copy. So several threads may use the cache.
- Cached are the newest few drafts, and one for each STEP edits: undo and older versions start from those.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from operator import is_
from types import MappingProxyType
from typing import NamedTuple

from caesura_protocol.messages import App, Correction, LimitForce, ProgramEdit
from caesura_service.program_edits.edited_app_list import EditedAppList

STEP = 64  # edits between two drafts that are remembered
NEWEST = 3  # drafts: after the last edit, after one that is refused, and of another version
AT_ONCE = 64  # apps that are read between two pauses
PROGRAMS = 2  # inferred programs: the current one, and that of a previewed correction


def go_on() -> None:
    """Continue at once: the default pause after an edit."""


class _Drafts(NamedTuple):
    """Drafts of one inferred program."""

    apps: Sequence[App]
    bare: EditedAppList
    steps: Mapping[int, EditedAppList] = MappingProxyType({})  # by the number of edits
    newest: tuple[EditedAppList, ...] = ()

    def is_of(self, apps: Sequence[App], force_limit_n: float | None, limits: Sequence[LimitForce]) -> bool:
        same_limits = (self.bare.force_limit_n, self.bare.limits) == (force_limit_n, limits)
        return self.apps is apps and same_limits

    def longest(self, edits: Sequence[ProgramEdit]) -> EditedAppList:
        """Return the draft that lacks the fewest of these edits; without one, that of no edit."""
        known = (draft for draft in (*self.steps.values(), *self.newest) if _begins(draft.edits, edits))
        return max(known, key=lambda draft: len(draft.edits), default=self.bare)

    def with_drafts(
        self, steps: Mapping[int, EditedAppList], used: EditedAppList, made: EditedAppList
    ) -> _Drafts:
        newest = (made, *(draft for draft in (used, *self.newest) if draft is not made))
        kept = tuple({id(draft): draft for draft in newest}.values())[:NEWEST]
        return self._replace(steps=MappingProxyType({**self.steps, **steps}), newest=kept)


class EditedAppListCache:
    """The cached drafts of one session, for each of its last inferred programs."""

    def __init__(self) -> None:
        self._programs: tuple[_Drafts, ...] = ()  # the last one used first

    def draft(
        self,
        apps: Sequence[App],
        edits: Sequence[ProgramEdit],
        force_limit_n: float | None = None,
        corrections: Sequence[Correction] = (),
        pause: Callable[[], None] = go_on,
    ) -> EditedAppList:
        """Return the inferred apps with these edits; do not change the draft. pause: called after each edit.

        force_limit_n: of the cell [N]; corrections: of the session, which may limit the force of an app.
        """
        limits = _limits(corrections)
        found = next((one for one in self._programs if one.is_of(apps, force_limit_n, limits)), None)
        program = found or _Drafts(apps, EditedAppList(_read(apps, pause), force_limit_n, limits))
        used = program.longest(edits)
        made = used if len(used.edits) == len(edits) else used.copy()
        steps: dict[int, EditedAppList] = {}
        for edit in edits[len(used.edits) :]:
            made.apply(edit)
            if len(made.edits) % STEP == 0:
                steps[len(made.edits)] = made
                made = made.copy()
            pause()
        self._remember(program.with_drafts(steps, used, made))
        return made

    def _remember(self, program: _Drafts) -> None:
        """Store the drafts of a program as the last used ones.

        Only this step changes the cache, because another call may have changed it during a pause.
        """
        others = (
            one
            for one in self._programs
            if not one.is_of(program.apps, program.bare.force_limit_n, program.bare.limits)
        )
        self._programs = (program, *others)[:PROGRAMS]


def _read(apps: Sequence[App], pause: Callable[[], None]) -> list[App]:
    """Return all apps, read a few at a time, because they may have to be decoded."""
    read: list[App] = []
    for first in range(0, len(apps), AT_ONCE):
        read += apps[first : first + AT_ONCE]
        pause()
    return read


def _begins(some: Sequence[ProgramEdit], edits: Sequence[ProgramEdit]) -> bool:
    """Return whether `edits` begin with `some`, by identity."""
    return len(some) <= len(edits) and all(map(is_, some, edits))


def _limits(corrections: Sequence[Correction]) -> tuple[LimitForce, ...]:
    return tuple(
        one.action for one in corrections if isinstance(one.action, LimitForce) and one.state == "applied"
    )
