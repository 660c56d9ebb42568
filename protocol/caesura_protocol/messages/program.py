"""A task program with its corrections and edits."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from caesura_protocol.messages.apps import App
from caesura_protocol.messages.corrections import Correction
from caesura_protocol.messages.field_types import Count, ForceLimit, Listed, Name, Seconds, TaskName, Up
from caesura_protocol.messages.limits import MAX_CORRECTIONS, MAX_GAPS, MAX_PROGRAM_EDITS
from caesura_protocol.messages.message import Message
from caesura_protocol.messages.program_edits import ProgramEdit
from caesura_protocol.messages.results import Gap
from caesura_protocol.messages.session_and_service_status import WrenchReport


class Program(Message):
    """The task program of a session, as far as it has been taught."""

    station: Name
    session: Name
    instance: Name
    epoch: Count
    version: Count
    t: Seconds
    complete: bool  # the session is closed
    apps: Listed[App]
    notes: Listed[str] = ()  # what a reader must know, e.g. that the wrench carries no contact
    revision: Count = 0  # how many edits the session has had; undo and redo count
    author: str | None = None  # of the last edit
    edited: float | None = None  # [s] time of day (UTC) of the last edit
    gaps: Annotated[Listed[Gap], Field(max_length=MAX_GAPS)] = ()  # the newest ones
    wrench: WrenchReport | None = None  # what the force in it is worth
    force_limit_n: ForceLimit | None = None  # of the cell: no app exerts more; None: as it was taught
    robot: Name | None = None  # on which it was taught; None: not stated
    up: Up | None = None  # away from gravity, base frame, as it was taught; None: not stated
    name: TaskName | None = None  # that a person gave it
    edit_revision: Count = 0  # how many `EditProgram` it has had; undo and redo count
    edits: Annotated[Listed[ProgramEdit], Field(max_length=MAX_PROGRAM_EDITS)] = ()  # oldest first
    corrections: Annotated[Listed[Correction], Field(max_length=MAX_CORRECTIONS)] = ()  # oldest first
