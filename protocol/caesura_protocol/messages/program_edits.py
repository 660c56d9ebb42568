"""Edits of a task program, and their command."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from caesura_protocol.app_kinds import AppKind
from caesura_protocol.messages.apps import App
from caesura_protocol.messages.corrections import Redo, Undo
from caesura_protocol.messages.field_types import (
    Amount,
    AppField,
    AppLabel,
    Author,
    Count,
    EditState,
    FiniteVector,
    Listed,
    Name,
    Newtons,
    Note,
    Seconds,
    ShortTag,
    SpeedFactor,
    TaskName,
    Tolerance,
)
from caesura_protocol.messages.limits import MAX_PART_APPS
from caesura_protocol.messages.message import Message


class AppReference(Message):
    """A reference to an app, from its kind and time when it was edited.

    It refers to the app of this kind with this start, or else to the one whose time overlaps most.
    """

    kind: AppKind
    t0: Seconds  # [s]
    tn: Seconds  # [s]
    added: Count | None = None  # the number of the program edit that added it; None: it was taught


class ChangeApp(Message):
    """Change values of an app. A field that is None is unchanged."""

    do: Literal["change"] = "change"
    app: AppReference
    name: AppLabel | None = None
    note: Note | None = None
    target: FiniteVector | None = None  # [m] base frame; its path keeps the via points
    target_name: AppLabel | None = None  # such as "above the tray"
    speed: SpeedFactor | None = None  # a factor of the taught speed
    force_n: Newtons | None = None  # [N] in the direction that was taught
    tolerance_m: Tolerance | None = None  # that its path has to keep
    gripper_width: Amount | None = None  # [m]
    as_taught: Annotated[Listed[AppField], Field(max_length=8)] = ()  # fields that lose their edits


class MoveApp(Message):
    """Move an app to another place in the program."""

    do: Literal["move"] = "move"
    app: AppReference
    after: AppReference | None  # None: first


class DeleteApp(Message):
    """Delete an app from the program."""

    do: Literal["delete"] = "delete"
    app: AppReference


class DuplicateApp(Message):
    """Insert a copy of an app after it."""

    do: Literal["duplicate"] = "duplicate"
    app: AppReference


class InsertApp(Message):
    """Insert a new app, which was not taught.

    Without a `target` it has that of the app before it, or, in the first place, that of the app after it. It
    is refused without another field that its kind needs, such as the force of a press.
    """

    do: Literal["insert"] = "insert"
    after: AppReference | None  # None: first
    kind: AppKind
    seconds: Annotated[float, Field(gt=0.0, le=600.0)] = 2.0  # that it takes
    name: AppLabel | None = None
    target: FiniteVector | None = None  # [m] base frame
    force: FiniteVector | None = None  # [N] that the robot exerts, base frame
    gripper_width: Amount | None = None  # [m]


class ReplacePart(Message):
    """Replace the apps from `first` to `last` by those of another session of the station.

    The service copies the apps at the time of the edit. Later changes of that session have no effect.
    """

    do: Literal["replace_part"] = "replace_part"
    first: AppReference  # where it begins, the first new app begins
    last: AppReference
    session: Name  # closed, with apps, of the same robot and wrench source


class NameProgram(Message):
    """Name the program."""

    do: Literal["name"] = "name"
    name: TaskName


ProgramChange = Annotated[
    ChangeApp | MoveApp | DeleteApp | DuplicateApp | InsertApp | ReplacePart | NameProgram,
    Field(discriminator="do"),
]
ProgramAction = Annotated[
    ChangeApp | MoveApp | DeleteApp | DuplicateApp | InsertApp | ReplacePart | NameProgram | Undo | Redo,
    Field(discriminator="do"),
]


class EditProgram(Message):
    """Command: edit the program of a session, open or closed. Edits do not change the inferred program.

    Refused if the program has another `edit_revision`: another operator's edit came first.
    """

    type: Literal["edit_program"] = "edit_program"
    session: Name
    revision: Count  # `edit_revision` of the program, as the author has seen it
    author: Author
    action: ProgramAction


class ProgramEdit(Message):
    """An edit of a program, and its outcome."""

    number: Count  # of this one, from 1; undo and redo count
    author: Author
    at: Seconds  # [s] time of day (UTC)
    action: Annotated[ProgramChange, ShortTag]
    state: EditState
    reason: str | None = None  # why it is not applied; of an applied one which app has changed since
    apps: Annotated[
        Listed[App], Field(max_length=MAX_PART_APPS)
    ] = ()  # of `replace_part`: as they were taught
