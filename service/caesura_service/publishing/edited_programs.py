"""Makes a session's program with its edits, and earlier versions of it; caches the last ones.

Rules
- The worker gives way to other stations after each edit and app. Any thread may call it.
- A cache belongs to the state of its session. It is cleared after SESSIONS others were used.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from operator import is_
from threading import Lock
from typing import NamedTuple

from caesura_protocol.messages import App, Program
from caesura_service.cooperative_scheduler import give_way
from caesura_service.program_edits import EditedAppListCache, EditLog, at_edit, check_applies, with_edits
from caesura_service.segmentation.encoded_log import packed

NEWEST = 3  # programs of a session that are kept, at a few megabytes each at most
SESSIONS = 4  # whose edited programs are kept: a garbage collection takes 7 ms for each of an hour


class _Made(NamedTuple):
    """A program and references to the objects from which it was made, so that their ids are not reused."""

    inferred: tuple[object, ...]
    log: EditLog
    number: int | None
    program: Program

    def is_of(self, inferred: tuple[object, ...], log: EditLog, number: int | None) -> bool:
        return all(map(is_, self.inferred, inferred)) and self.log is log and self.number == number


class EditedPrograms:
    """The programs of one session with its edits."""

    def __init__(self) -> None:
        self._drafts = EditedAppListCache()
        self._made: tuple[_Made, ...] = ()  # the last one asked for first

    def edited(self, header: Program, inferred: Program, log: EditLog, number: int | None = None) -> Program:
        """Return the program with these edits, made once for each version; its apps are encoded.

        header: the object from which `inferred` was made, with its apps; number: of the last edit to apply.
        """
        _recently_used.add(self)
        made_of = (header, inferred.apps)
        found = next((one for one in self._made if one.is_of(made_of, log, number)), None)
        made = found or _Made(made_of, log, number, self._program(inferred, log, number))
        self._made = (made, *(one for one in self._made if one is not made))[:NEWEST]
        return made.program

    def check_applies(self, inferred: Program, log: EditLog) -> None:
        """Check that the last edit of a log applies. Raises ProtocolError `conflict`."""
        _recently_used.add(self)
        check_applies(inferred, log, self._drafts, give_way)

    def clear(self) -> None:
        """Drop all drafts and programs."""
        self._drafts, self._made = EditedAppListCache(), ()

    def _program(self, inferred: Program, log: EditLog, number: int | None) -> Program:
        if number is None:
            made = with_edits(inferred, log, self._drafts, give_way)
        else:
            made = at_edit(inferred, log, number, self._drafts, give_way)
        return made.model_copy(update={"apps": packed(App, _in_slices(made.apps))})

    def __eq__(self, other: object) -> bool:
        """Return True for any other cache: a cache has no influence on the results of a state."""
        return isinstance(other, EditedPrograms)

    def __hash__(self) -> int:
        return hash(EditedPrograms)


def _in_slices(apps: Iterable[App]) -> Iterator[App]:
    for app in apps:
        yield app
        give_way()


class _RecentlyUsed:
    """Limits the number of sessions that keep their edited programs."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._sessions: dict[int, EditedPrograms] = {}  # by their ids, the last one used last

    def add(self, used: EditedPrograms) -> None:
        """Mark a cache as used now; beyond SESSIONS, clear the least recently used one."""
        with self._lock:
            self._sessions.pop(id(used), None)
            self._sessions[id(used)] = used
            if len(self._sessions) > SESSIONS:
                self._sessions.pop(next(iter(self._sessions))).clear()


_recently_used = _RecentlyUsed()
