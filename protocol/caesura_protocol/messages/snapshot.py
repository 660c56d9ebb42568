"""Everything that a late reader needs."""

from __future__ import annotations

from caesura_protocol.messages.message import Message
from caesura_protocol.messages.program import Program
from caesura_protocol.messages.results import Changepoints, Hints, Posterior, Segments
from caesura_protocol.messages.status import SessionStatus


class Snapshot(Message):
    """Everything so far, with the last number of each stream: where a late or lossy reader starts."""

    status: SessionStatus
    changepoints: Changepoints
    segments: Segments
    posterior: Posterior | None
    program: Program
    hints: Hints | None = None  # None from an older service
