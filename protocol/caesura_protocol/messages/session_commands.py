"""Commands that begin, end and describe a session."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from caesura_protocol.messages.field_types import (
    Assumptions,
    Author,
    Columns,
    Count,
    DescriptionField,
    ForceFrame,
    ForceLimit,
    HandOnRobot,
    LengthUnit,
    Listed,
    Name,
    Note,
    Quantity,
    Tag,
    TaskName,
    Tolerance,
    Up,
    WrenchSource,
)
from caesura_protocol.messages.limits import MAX_TAGS
from caesura_protocol.messages.message import Message


class Description(Message):
    """Operators' statements about a session. They change no result."""

    task: TaskName | None = None  # the name under which it is found again
    operator: Author | None = None  # who teaches
    note: Note | None = None
    tags: Annotated[Listed[Tag], Field(max_length=MAX_TAGS)] = ()
    success: bool | None = None  # None: not stated
    deleted: bool = False  # lists leave it out; its samples stay until the journal's limits remove them


class DescriptionAuthor(Message):
    """Author of the present value of a field of a description."""

    field: DescriptionField
    author: Author


class Open(Message):
    """Command: open a session. Repeating the same opening is no error."""

    type: Literal["open"] = "open"
    session: Name
    epoch: Count = 0
    columns: Columns
    wrench_source: WrenchSource | None = None  # None: not stated; the service takes the conservative reading
    hand_on_robot: HandOnRobot = "unknown"
    force_frame: ForceFrame = "base"
    length_unit: LengthUnit = "m"
    preset: Name | None = None  # None: the service's own choice
    bridge: Name | None = None  # names this bridge; another one needs a higher epoch to take the session over
    force_limit_n: ForceLimit | None = None  # of the cell: no app exerts more; None: as it was taught
    path_tolerance_m: Tolerance | None = None  # of the apps' paths; None: the service's own choice
    path_tolerance_rad: Tolerance | None = None
    robot: Name | None = None  # which arm this is; None: not stated
    up: Up | None = None  # away from gravity, base frame; None: not stated, z is assumed
    declared_units: Listed[Quantity] = ()  # whose unit a person declared: implausible values are believed
    assumed: Assumptions = ()  # options that the recording leaves open: the program's notes say so
    description: Description | None = None  # as it begins; `Describe` changes it


class Close(Message):
    """Command: close the session; all batches up to `last_seq` belong to it."""

    type: Literal["close"] = "close"
    session: Name
    last_seq: Annotated[int, Field(ge=-1)]
    bridge: Name | None = None
    success: bool | None = None  # of the demonstration; None leaves the description as it is


class Describe(Message):
    """Command: replace the description of a session, open or closed.

    Refused if the description is neither `before` nor `description`: another operator's change came first. To
    undo it, send the command with the two exchanged.
    """

    type: Literal["describe"] = "describe"
    session: Name
    author: Author
    before: Description  # as the author has seen it
    description: Description
