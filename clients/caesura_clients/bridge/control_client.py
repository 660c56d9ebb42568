"""The commands of a bridge to the service: open and close a session.

Both commands are idempotent, so they may be repeated after a lost answer. An Ack states the next batch that
the service expects, so a repeated command also shows how far the service has come.
"""

from __future__ import annotations

from caesura_protocol.codec import decode, encode
from caesura_protocol.errors import ErrorCode
from caesura_protocol.keys import station_key
from caesura_protocol.messages import Ack, Close, Control, Open, SessionStatus
from caesura_protocol.transport.transport_interface import QUERY_TIMEOUT_S, Transport

TRY_AGAIN: frozenset[ErrorCode] = frozenset({"overloaded", "internal"})


class ControlClient:
    """Client of the `control` key of one station."""

    def __init__(self, transport: Transport, station: str) -> None:
        self._transport = transport
        self._key = station_key(station, "control")
        self.postponed: str | None = None  # why the last command was refused for now; None where it was not

    def ask(self, command: Open | Close, *, timeout_s: float = QUERY_TIMEOUT_S) -> Ack | None:
        """Send a command; return the Ack, or None without an answer. Raises ProtocolError for a refusal.

        None also stands for an internal error of the service: it may not recur, and the service logs it.
        """
        content = encode(Control(command=command))
        answers = self._transport.query(self._key, content, timeout_s=timeout_s)
        if answers.replies:
            reply = answers.replies[0]
            self.postponed = None
            return decode(reply.payload, reply.encoding, Ack)
        refusals = [refusal for refusal in answers.refusals if refusal.code not in TRY_AGAIN]
        if refusals:
            raise refusals[0]
        self.postponed = answers.refusals[0].message if answers.refusals else None
        return None

    def close_left_open(
        self, status: SessionStatus, *, last_seq: int | None = None, success: bool | None = None
    ) -> Ack | None:
        """Close a session whose bridge is gone, after the service's last batch.

        last_seq: of that batch; by default as its status counts. Raises as `ask`: a refusal whose `expected`
        is another number means that a bridge sends batches, or has just done so.
        """
        if last_seq is None:
            last_seq = status.batches + status.lost - 1
        return self.ask(Close(session=status.session, last_seq=last_seq, success=success))
