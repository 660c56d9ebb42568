"""Payload of a `control` query, and its answers."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from caesura_protocol.errors import ErrorCode
from caesura_protocol.messages.corrections import Correction, Edit, EditEffect, Preview
from caesura_protocol.messages.field_types import Count, Name, Shown, Up
from caesura_protocol.messages.message import Message
from caesura_protocol.messages.program_edits import EditProgram, ProgramEdit
from caesura_protocol.messages.session_commands import Close, Describe, Open

Command = Annotated[Open | Close | Edit | Preview | Describe | EditProgram, Field(discriminator="type")]


class Control(Message):
    """Command of a bridge or an operator to a station's session; payload of a `control` query."""

    command: Command


class Ack(Message):
    """Reply of the service that has executed a command."""

    session: Name
    next_seq: Count  # the batch that the service waits for
    state: Literal["open", "closed"]
    revision: Count = 0  # how many edits the session has had; undo and redo count
    effect: EditEffect | None = None  # of a preview, or of an edit `with_effect`; None from an older service
    lost: Count = (
        0  # batches before `next_seq` that the session lacks: refused, or no bridge has them any more
    )
    up: Up | None = None  # that the session weighs against; None: not stated, or an older service, and z
    # What an undo, a redo or a take-back has undone or restored; None of other commands, and from an older
    # service.
    correction: Correction | None = None
    program_edit: ProgramEdit | None = None  # without the apps that it holds


class Error(Message):
    """A refusal in the form in which it is sent (`reply_err`)."""

    code: ErrorCode
    message: str
    value: Shown = None
    limit: Shown = None
    expected: Shown = None
