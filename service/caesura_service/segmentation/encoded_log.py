"""Final messages, stored as the codec's own bytes and decoded when they are read.

A log only grows, so another thread may read the part that a view shows. Old messages are in a file.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from itertools import pairwise
from typing import Generic, TypeVar, overload

from caesura_protocol.codec import PreEncoded, decode, encode, encoding_of
from caesura_protocol.messages import Message
from caesura_service.segmentation.overflow_file import AppendLog

M = TypeVar("M", bound=Message)

AT_ONCE = 64  # messages that are read, or compared by their bytes, before it is known whether more need be


class EncodedMessageLog(Generic[M]):
    """Encoded messages of one type, in order. It only grows."""

    def __init__(self, model: type[M]) -> None:
        self._model = model
        self._log, self._ends = (
            AppendLog(),
            array("q", [0]),
        )  # [bytes] where each begins, and the last one ends

    def __len__(self) -> int:
        return len(self._ends) - 1

    def extend(self, messages: Iterable[M]) -> None:
        """Append messages."""
        for message in messages:
            self._log.append(encode(message).payload)
            self._ends.append(len(self._log))

    def payloads(self, start: int, stop: int) -> bytes:
        """Return the stored bytes of the messages from start to stop, which is not included."""
        return self._log.read(self._ends[start], self._ends[stop]) if start < stop else b""

    def read(self, start: int, stop: int) -> tuple[M, ...]:
        """Return the messages from start to stop, which is not included."""
        if start >= stop:
            return ()
        encoding, ends = encoding_of(self._model), self._ends[start : stop + 1]
        packed = self._log.read(ends[0], ends[-1])
        spans = pairwise(end - ends[0] for end in ends)
        return tuple(decode(packed[first:last], encoding, self._model) for first, last in spans)


class MessageSequence(PreEncoded, Sequence[M]):  # noqa: PLW1641 - without a hash, as a list
    """The messages of a log at one time, followed by other messages. Immutable.

    first: the number of messages left out at the beginning.
    """

    def __init__(self, kept: EncodedMessageLog[M], rest: Iterable[M], *, first: int = 0) -> None:
        self._kept = kept
        self._start, self._stop = min(first, len(kept)), len(kept)
        self._rest = tuple(rest)[first - self._start :]

    def __len__(self) -> int:
        return self._stop - self._start + len(self._rest)

    @overload
    def __getitem__(self, index: int) -> M: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[M, ...]: ...
    def __getitem__(self, index: int | slice) -> M | tuple[M, ...]:
        if isinstance(index, int):
            at = range(len(self))[index]
            return self._between(at, at + 1)[0]
        kept = self._stop - self._start
        if index.start is not None and index.start >= kept and index.stop is index.step is None:
            return self._rest[index.start - kept :]  # the common case: no stored message is read
        start, stop, step = index.indices(len(self))
        return self._between(start, stop) if step == 1 else self._between(0, len(self))[index]

    def __iter__(self) -> Iterator[M]:
        return iter(self._between(0, len(self)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence):
            return NotImplemented
        first = alike(self, other)
        return len(self) == len(other) and self[first:] == tuple(other[first:])

    def parts(self) -> Iterator[bytes | M]:
        """Yield the stored messages as one block of bytes, then the others; nothing is decoded."""
        yield self._kept.payloads(self._start, self._stop)
        yield from self._rest

    def since(self, first: int) -> MessageSequence[M]:
        """Return the sequence without its first `first` messages; nothing is decoded."""
        kept = self._stop - self._start
        other = copy(self)
        other._start += min(first, kept)
        other._rest = self._rest[max(first - kept, 0) :]
        return other

    def __repr__(self) -> str:
        return repr(tuple(self))

    def _between(self, start: int, stop: int) -> tuple[M, ...]:
        kept = self._stop - self._start
        old = self._kept.read(self._start + start, self._start + min(stop, kept)) if start < kept else ()
        return old + self._rest[max(start - kept, 0) : max(stop - kept, 0)]


def since(messages: Sequence[M], first: int) -> Sequence[M]:
    """Return the messages from number `first` on; stored ones stay encoded."""
    return messages.since(first) if isinstance(messages, MessageSequence) else messages[first:]


def packed(model: type[M], messages: Iterable[M]) -> MessageSequence[M]:
    """Return the messages as a sequence that stores all of them encoded."""
    kept = EncodedMessageLog(model)
    kept.extend(messages)
    return MessageSequence(kept, ())


def alike(one: Sequence[M], other: Sequence[M]) -> int:
    """Return a lower bound on the length of the common prefix of two sequences, from their stored bytes."""
    if (
        not (isinstance(one, MessageSequence) and isinstance(other, MessageSequence))
        or one._start != other._start
    ):
        return 0
    start, stop = one._start, min(one._stop, other._stop)
    if one._kept is other._kept:
        return stop - start
    for first in range(start, stop, AT_ONCE):
        last = min(first + AT_ONCE, stop)
        if one._kept.payloads(first, last) != other._kept.payloads(first, last):
            return first - start
    return max(stop - start, 0)
