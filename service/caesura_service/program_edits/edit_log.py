"""The log of a program's edits: which are in effect, which were undone, and how many there may be.

Undo revokes the last edit, redo restores it, and a new edit clears the edits that could be redone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    MAX_PROGRAM_EDITS,
    MAX_TAUGHT_AGAIN_HELD,
    App,
    EditProgram,
    Program,
    ProgramAction,
    ProgramEdit,
    Redo,
    Undo,
)


class EditLog(NamedTuple):
    """The edits of a session's program."""

    active: tuple[ProgramEdit, ...] = ()
    undone: tuple[ProgramEdit, ...] = ()  # the last one is the first to be made once more
    revision: int = 0  # edits so far; undo and redo count

    @property
    def listed(self) -> tuple[ProgramEdit, ...]:
        """The edits that a program lists, oldest first."""
        taken_back = (edit.model_copy(update={"state": "undone"}) for edit in reversed(self.undone))
        return (*self.active, *taken_back)

    def takes(self, command: EditProgram, apps: Sequence[App] = ()) -> bool:
        """Return whether a command is the next edit of this log.

        One for an instance with other edits may not be.
        """
        try:
            self.after(command, 0.0, apps)
        except ProtocolError:
            return False
        return command.revision == self.revision

    def after(self, command: EditProgram, at: float, apps: Sequence[App] = ()) -> EditLog:
        """Return the log with one more edit, without a check that it applies.

        at: time of day [s]; apps: those of a `ReplacePart`. Raises ProtocolError if there is nothing to undo
        or redo, or the log is full.
        """
        active, undone, number = self.active, self.undone, self.revision + 1
        action = command.action
        if isinstance(action, Undo):
            if not active:
                raise ProtocolError("conflict", "the program has no edit to undo")
            return EditLog(active[:-1], (*undone, active[-1]), number)
        if isinstance(action, Redo):
            if not undone:
                raise ProtocolError("conflict", "the program has no edit to redo")
            return EditLog((*active, undone[-1]), undone[:-1], number)
        if len(active) >= MAX_PROGRAM_EDITS:
            why = f"a program has {MAX_PROGRAM_EDITS} edits at most: undo some"
            raise ProtocolError("conflict", why, limit=MAX_PROGRAM_EDITS)
        held = len(apps) + sum(len(edit.apps) for edit in active)
        if held > MAX_TAUGHT_AGAIN_HELD:
            why = (
                f"the edits would hold {held} apps that were taught again, with those replaced since, of "
                f"{MAX_TAUGHT_AGAIN_HELD} at most: undo some"
            )
            raise ProtocolError("conflict", why, limit=MAX_TAUGHT_AGAIN_HELD)
        made = ProgramEdit(
            number=number, author=command.author, at=at, action=action, state="applied", apps=tuple(apps)
        )
        return EditLog((*active, made), (), number)

    def moved(self, action: ProgramAction) -> ProgramEdit | None:
        """Return the edit that an undo or a redo undoes or restores, without its apps; None of a new one."""
        edits = {"undo": self.active, "redo": self.undone}.get(action.do, ())
        return edits[-1].model_copy(update={"apps": ()}) if edits else None


def log_of(program: Program) -> EditLog:
    """Return the log of the edits that a program lists."""
    bare = {"state": "applied", "reason": None}
    active = (edit.model_copy(update=bare) for edit in program.edits if edit.state != "undone")
    undone = (edit.model_copy(update=bare) for edit in reversed(program.edits) if edit.state == "undone")
    return EditLog(tuple(active), tuple(undone), program.edit_revision)
