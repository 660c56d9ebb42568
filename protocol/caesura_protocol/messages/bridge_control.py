"""Commands of an operator to a bridge in standby, and the bridge's state."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from caesura_protocol.messages.field_types import LINE, BridgeState, Count, Name, StatusText
from caesura_protocol.messages.limits import MAX_SOURCE
from caesura_protocol.messages.message import Message
from caesura_protocol.messages.session_commands import Description


class Start(Message):
    """Command to a bridge in standby: open a session and send samples. The same id starts only once."""

    type: Literal["start"] = "start"
    id: Name  # of this command; its sender chooses it, and repeats it where no answer came
    session: Name | None = None  # None: named after the time
    description: Description = Description()


class Stop(Message):
    """Command to a bridge in standby: send the remaining samples and close the session.

    Repeating it is no error.
    """

    type: Literal["stop"] = "stop"
    session: Name | None = None  # None: the current one
    success: bool | None = None  # of the demonstration; None: not stated


class BridgeControl(Message):
    """Command of an operator to a bridge in standby; payload of a `bridge_control` query."""

    command: Annotated[Start | Stop, Field(discriminator="type")]


class BridgeAck(Message):
    """Reply of a bridge that has executed a command."""

    session: Name  # that was started or stopped
    state: BridgeState  # of the bridge, now
    lost: Count = 0  # of a stop: batches that the session lacks, as of `Ack`


class BridgeStatus(Message):
    """State of a bridge in standby: published once a second, and at every change."""

    station: Name
    bridge: Name
    state: BridgeState
    source: Annotated[str, Field(max_length=MAX_SOURCE, pattern=LINE)]  # its name, such as `franky`
    session: Name | None = None  # that is being taught or stored
    description: Description | None = None  # with which that was started
    problem: StatusText | None = None  # why it cannot be started or stored now
    last_session: Name | None = None  # the one before
    outcome: StatusText | None = None  # what became of the one before, in words
