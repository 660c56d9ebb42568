"""Consecutive batches of a session whose payloads differ only in number, times and samples.

A robot sends the same header thousands of times. After one payload has been decoded and validated, another
one with the same bytes around its number, its `t0` and its samples has the same values in all other fields.
So it is not decoded, validated and encoded again for the journal. Remaining errors of such a payload, such as
a value that is no number, are found in the samples by the batch receiver, which then receives each batch
separately.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from struct import Struct
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.codec import FLOAT_OF_SIZE, decode, encode, encoding_of
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import SampleBatch
from caesura_protocol.msgpack_packer import Packing

ENCODING = encoding_of(SampleBatch)
_BIN_HEADERS = ((1 << 8, 2), (1 << 16, 3), (1 << 32, 5))  # [bytes] of samples below a size, by msgpack
_SMALL_SEQ = 1 << 7  # numbers below it are their own type byte
_T0 = Struct(">d")
_NUMBERS = {4: Struct("<f"), 8: Struct("<d")}
_PACKING = Packing()


@dataclass(frozen=True, slots=True)
class BatchLayout:
    """The places of the number, `t0` and the samples in a payload, and the bytes around them."""

    message: SampleBatch  # of one such payload; the others differ in `seq`, `t0` and `samples`
    size: int  # [bytes]
    seq_at: int
    seq_end: int
    t0_at: int
    samples_at: int
    samples_end: int
    last_at: int  # the time of the last sample, less t0
    head: bytes  # before the number
    middle: bytes  # between the number and t0
    before: bytes  # between t0 and the samples
    tail: bytes
    number: Struct  # of the samples

    @classmethod
    def of(cls, payload: bytes) -> Self | None:
        """Return the layout of a payload; None if it is not a valid batch or not encoded as by `encode`."""
        try:
            message = decode(payload, ENCODING, SampleBatch)
            if encode(message).payload != payload:
                return None
        except ProtocolError:
            return None
        row, rest = divmod(len(message.samples), message.n)
        item, more = divmod(row, len(message.columns))
        if rest or more or item not in _NUMBERS:
            return None
        seq_at = 1 + _packed("session", message.session, "epoch", message.epoch, "seq")
        seq_end = seq_at + _packed(message.seq)
        seq_at += seq_end - seq_at > 1  # its type byte
        t0_at = seq_end + _packed("n", message.n, "columns", message.columns, "t0") + 1
        size = len(message.samples)
        header = next(length for below, length in _BIN_HEADERS if size < below)
        samples_at = t0_at + _T0.size + _packed("samples") + header
        return cls(
            message=message,
            size=len(payload),
            seq_at=seq_at,
            seq_end=seq_end,
            t0_at=t0_at,
            samples_at=samples_at,
            samples_end=samples_at + size,
            last_at=samples_at + size - row,
            head=payload[:seq_at],
            middle=payload[seq_end:t0_at],
            before=payload[t0_at + _T0.size : samples_at],
            tail=payload[samples_at + size :],
            number=_NUMBERS[item],
        )

    def seq_of(self, payload: bytes) -> int | None:
        """Return the number of a batch; None if its payload has another layout."""
        is_alike = (
            len(payload) == self.size
            and payload.startswith(self.head)
            and payload[self.seq_end : self.t0_at] == self.middle
            and payload[self.t0_at + _T0.size : self.samples_at] == self.before
            and payload.endswith(self.tail)
        )
        if not is_alike:
            return None
        seq = int.from_bytes(payload[self.seq_at : self.seq_end], "big")
        has_type_byte = self.seq_end - self.seq_at > 1 or self.message.seq >= _SMALL_SEQ
        return seq if has_type_byte or seq < _SMALL_SEQ else None

    def t0_of(self, payload: bytes) -> float:
        """Return `t0` [s] of a payload with this layout."""
        t0: float = _T0.unpack_from(payload, self.t0_at)[0]
        return t0

    def t_last_of(self, payload: bytes) -> float:
        """Return the time of the last sample [s] of a payload with this layout."""
        since: float = self.number.unpack_from(payload, self.last_at)[0]
        return self.t0_of(payload) + since


class BatchBlock(NamedTuple):
    """Consecutive batches, numbered without a gap. All payloads have the layout."""

    layout: BatchLayout
    first: int  # number of the first one
    payloads: Sequence[bytes]

    @property
    def session(self) -> str:
        """The name of the session of these batches."""
        return self.layout.message.session

    def after(self, count: int) -> Self:
        """Return the block without its first `count` batches."""
        return self._replace(first=self.first + count, payloads=self.payloads[count:])

    def samples(self) -> NDArray[np.float64]:
        """Return the samples (n, columns) of all, session time [s] first, as `codec.matrix_of` of each."""
        layout, message = self.layout, self.layout.message
        start, end = layout.samples_at, layout.samples_end
        joined = b"".join([payload[start:end] for payload in self.payloads])
        dtype = FLOAT_OF_SIZE[layout.number.size]
        matrix: NDArray[np.float64] = np.frombuffer(joined, dtype).astype(np.float64)
        matrix = matrix.reshape(-1, len(message.columns))
        matrix[:, 0] += np.repeat([layout.t0_of(payload) for payload in self.payloads], message.n)
        return matrix


def _packed(*values: object) -> int:
    """Return the length [bytes] of the values, packed one after the other."""
    return sum(len(_PACKING.pack(value)) for value in values)
