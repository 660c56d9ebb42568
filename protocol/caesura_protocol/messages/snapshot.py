"""The snapshot of a session, for readers that join late or have lost messages."""

from __future__ import annotations

from caesura_protocol.messages.message import Message
from caesura_protocol.messages.program import Program
from caesura_protocol.messages.results import Changepoints, Hints, Posterior, Segments
from caesura_protocol.messages.session_and_service_status import SessionStatus


class Snapshot(Message):
    """The complete state of a session, with the last number of each stream.

    A reader that joins late, or has lost messages, starts from it.
    """

    status: SessionStatus
    changepoints: Changepoints
    segments: Segments
    posterior: Posterior | None
    program: Program
    hints: Hints | None = None  # None from an older service
