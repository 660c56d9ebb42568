"""Status of a session and of an instance of the service."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from caesura_protocol.errors import ErrorCode
from caesura_protocol.messages.field_types import (
    Amount,
    Count,
    Counted,
    ForceFrame,
    HandOnRobot,
    LengthUnit,
    Listed,
    Name,
    Seconds,
    StatusText,
    Up,
    Vector,
    WrenchSource,
)
from caesura_protocol.messages.limits import MAX_BUDGETS, MAX_DAMAGED
from caesura_protocol.messages.message import Message
from caesura_protocol.messages.results import Gap, Result
from caesura_protocol.messages.session_commands import Description, DescriptionAuthor


class WrenchReport(Message):
    """Report on the wrench of a session: its source, frame and tare, and the models that use it."""

    source: WrenchSource  # the one in use
    stated: bool = True  # False: the session does not state its source, and `source` is assumed
    hand_on_robot: HandOnRobot = "unknown"
    contact_models: bool  # are contact and free space distinguished?
    transport_models: bool  # is a load weighed?
    tare: Vector | None  # [N] bias taken off; None while there has been no rest to take it from
    note: str
    frame: ForceFrame = "base"  # of the samples' forces; those of results are in the base frame
    frame_stated: bool = True  # False: a recording that is played does not state it, and `frame` is assumed
    up: Up | None = None  # away from gravity, base frame; None: not stated, z is assumed


class Refusal(Message):
    """The last refused message, with the error that its sender received."""

    code: ErrorCode
    message: str


class Budget(Message):
    """Budget of a station for one resource, and its use so far, in the unit of the resource."""

    per_s: Amount  # so much comes back every second
    at_once: Amount  # so much may be used at once, after a pause
    used: Amount  # of `at_once`, now; work may exceed it, because its cost is known only after it
    refused: Count  # messages that were dropped or refused because of it, since the service started


class StationBudgets(Message):
    """Budgets of one station at an instance of the service. The service holds back messages beyond them.

    Dropped samples are requested again; commands are refused as `overloaded`.
    """

    station: Name
    work: Budget  # [s] of the worker's time
    messages: Budget  # samples and heartbeats; replayed ones do not count
    bytes: Budget  # of these
    commands: Budget
    previews: Budget | None = None  # [s] of the worker's time, not among `work`; None: an older service
    queries: Budget | None = None  # for its sessions and its program, of any reader; None: an older service
    tokens: Budget | None = None  # changes of its liveliness token; None: an older service


class SessionStatus(Result):
    """Status of a session: its progress, its losses and its revision."""

    state: Literal["open", "closed"]
    preset: Name
    wrench: WrenchReport
    delay_s: float  # [s] what conditioning adds before a sample is looked at
    batches: Count
    samples: Count
    observations: Count
    duplicates: Count  # batches that came again
    repeats: Count  # samples whose time did not advance
    waiting_for: Count | None  # the batch that is missing, where one is
    gaps: Listed[Gap]  # the newest MAX_GAPS
    refused: Counted
    last_refusal: Refusal | None
    hypotheses: Count
    capped: Count  # steps on which the limit on hypotheses bit
    gaps_before: Count = 0  # gaps that are not listed
    lost: Count = 0  # batches that were given up, or whose content was refused; each is in a gap
    dropped: Count = 0  # batches for which the service had no room, and asked again
    overloaded: bool = False  # its station's share of the service's queue, or the queue, is filling up
    revision: Count = 0  # how many edits it has had; undo and redo count
    undoable: bool = False  # is there a correction to take back?
    redoable: bool = False  # is there one that was taken back?
    length_unit: LengthUnit = "m"  # of the samples' positions; results are in metres
    budgets: StationBudgets | None = None  # of its station; None from an older service
    description: Description = Description()  # what people state about it
    described: Count = 0  # how often `Describe` has changed that
    described_by: Listed[DescriptionAuthor] = ()  # of its fields that `Describe` has changed
    opened: Seconds | None = None  # [s] time of day (UTC) of its opening; None where that is not known


class DamagedSession(Message):
    """A session in a journal that no query finds: its results are unreadable, or records are damaged."""

    station: Name
    session: Name
    why: StatusText
    opened: Seconds | None = None  # [s] time of day (UTC) of its opening; None where that is not known
    set_aside: bool = False  # records are damaged, and its name is free; False: its samples can be read


class JournalReport(Message):
    """Report on the journal of an instance: its kind, its size, its limit, and the reason if it fails."""

    kind: Literal["memory", "sqlite"]
    commit_s: Annotated[float, Field(ge=0.0)]  # [s] a record waits at most so long to be written
    size: Count  # [bytes] of all sessions
    size_limit: Count  # [bytes] past which closed sessions are dropped, oldest first
    waiting: Count = 0  # [bytes] not yet written
    disk_free: Count | None = None  # [bytes] that its disk has left; None: in memory, or not known
    trouble: str | None = None  # why nothing can be written now
    damaged: Annotated[Listed[DamagedSession], Field(max_length=MAX_DAMAGED)] = ()  # the newest ones
    damaged_before: Count = 0  # further ones that are not listed


class ServiceStatus(Message):
    """Status of an instance of the service: its load, its journal, and budgets of stations."""

    instance: Name
    epoch: Count
    version: str
    sessions_open: Count
    sessions_closed: Count
    messages: Count
    refused: Counted
    last_refusal: Refusal | None
    queue: Count
    queue_capacity: Count
    dropped: Count
    journal: JournalReport | None = None  # None from an older instance
    overloaded: bool = False  # more than it can do arrives; said before anything is dropped
    time: Seconds | None = None  # [s] of day (UTC) there, at publishing; None from an older instance
    # Of the stations that come nearest to a limit, or that were refused something, fullest first.
    budgets: Annotated[Listed[StationBudgets], Field(max_length=MAX_BUDGETS)] = ()
    queries: Budget | None = None  # that name no station, of any reader; None from an older instance
