"""A recorded edit: the command and its resolved form.

A replay needs the resolved form. The target of a command (the changepoint nearest to 3.2 s) depends on the
results shown when it was made. The resolved form (no segment starts at observations 20 to 31) does not. So a
replay collects edits without filtering in between. Only applied edits are recorded.

A record also has what its acknowledgement stated, for an author who repeats the edit after a lost answer.
"""

from __future__ import annotations

from caesura_protocol.messages import App, Correction, Edit, EditEffect, EditProgram, Message, ProgramEdit

Run = tuple[int, int]  # observations: the first one, and the one behind the last


class Resolution(Message):
    """The resolved form of a correction; observations by their number, as in `segmentation.corrections`."""

    inserted: float | None = None  # [s]
    starts: tuple[int, ...] = ()
    none: tuple[Run, ...] = ()
    label: tuple[int, str] | None = None
    force: tuple[float, float | None] | None = None  # [s], [N]
    name: tuple[float, str] | None = None  # [s], of a phase
    meant: float | None = None  # [s], as `Correction` states it
    placed: float | None = None  # [s]


class AppliedEdit(Edit):
    """An applied edit in its recorded form."""

    resolution: Resolution | None = None  # of undo and redo: none
    version: int | None = None  # of the program that the edit made; None in journals before version 4
    effect: EditEffect | None = None  # if the author requested it
    moved: Correction | None = None  # that an undo, a redo or a take-back has undone or restored

    @classmethod
    def type_name(cls) -> str:
        """Return the command's name: older journals hold commands, and are read as this type."""
        return Edit.type_name()

    @property
    def is_resolved(self) -> bool:
        """Whether the record has its resolved form; records of older journals do not."""
        return self.version is not None


class AppliedProgramEdit(EditProgram):
    """An applied edit of the program in its recorded form. The record contains the apps that it inserts.

    So the session in which they were taught may be edited, corrected or deleted later.
    """

    apps: tuple[App, ...] = ()  # of `replace_part`
    moved: ProgramEdit | None = None  # that an undo or a redo has undone or restored

    @classmethod
    def type_name(cls) -> str:
        """Return the command's name, as for `AppliedEdit`."""
        return EditProgram.type_name()
