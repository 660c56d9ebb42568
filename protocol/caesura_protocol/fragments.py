"""Divides results that are too long for one message into fragments, and reassembles them in the reader.

Fragments may be lost, repeated, or mixed with those of another message on the same key, because a session can
briefly have two owners. The stored bytes are limited per key and in total. Messages to the service are never
fragmented.
"""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import blake2b

from caesura_protocol.codec import Encoded, check_size, decode, encode, encoding_of
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import MAX_MESSAGE_BYTES, MAX_WHOLE_BYTES, PIECE_BYTES, Message, Piece

UNFINISHED = 2  # messages on one key, of which pieces are kept
HELD_BYTES = 2 * MAX_WHOLE_BYTES  # of the pieces on all keys; past it the key that has waited longest goes
PIECE_COST = 256  # [bytes] of one beside its payload


def fragment(message: Message) -> Iterator[Encoded]:
    """Encode a message for the wire, in fragments if it is too long.

    Raises ProtocolError `too_large` over MAX_WHOLE_BYTES.
    """
    payload, encoding = encode(message, limit=MAX_WHOLE_BYTES)
    if len(payload) <= MAX_MESSAGE_BYTES:
        yield Encoded(payload, encoding)
        return
    whole = int.from_bytes(blake2b(payload, digest_size=6).digest(), "big")
    starts = range(0, len(payload), PIECE_BYTES)
    for number, start in enumerate(starts):
        part = payload[start : start + PIECE_BYTES]
        yield encode(Piece(encoding=encoding, whole=whole, number=number, count=len(starts), payload=part))


class Reassembler:
    """Joins fragments into messages. An incomplete message is dropped for a newer one on its key."""

    def __init__(self) -> None:
        self._held: dict[str, dict[int, dict[int, bytes]]] = {}  # by key, message and number
        self.held_bytes = 0

    @property
    def unfinished(self) -> int:
        """The number of incomplete messages."""
        return sum(map(len, self._held.values()))

    def add(self, key: str, content: Encoded) -> Encoded | None:
        """Add a fragment; return the message that it completes, None while fragments are missing.

        Raises ProtocolError.
        """
        if content.encoding != encoding_of(Piece):
            check_size(content.payload)
            return content
        piece = decode(content.payload, content.encoding, Piece)
        if piece.number >= piece.count:
            raise ProtocolError("malformed", "there is no such piece", value=piece.number, limit=piece.count)
        messages = self._held.setdefault(key, {})
        parts = messages.setdefault(piece.whole, {})
        if piece.number not in parts:
            parts[piece.number] = piece.payload
            self.held_bytes += len(piece.payload) + PIECE_COST
        if parts.keys() == {*range(piece.count)}:
            self._drop(key, piece.whole)
            return Encoded(b"".join(parts[number] for number in range(piece.count)), piece.encoding)
        for stale in [*messages][:-UNFINISHED]:
            self._drop(key, stale)
        while self.held_bytes > HELD_BYTES:
            oldest = next(iter(self._held))
            self._drop(oldest, next(iter(self._held[oldest])))
        return None

    def _drop(self, key: str, whole: int) -> None:
        """Remove all fragments of a message."""
        messages = self._held[key]
        self.held_bytes -= sum(len(part) + PIECE_COST for part in messages.pop(whole).values())
        if not messages:
            del self._held[key]
