"""Messages that nothing can change any more, kept as the codec's own bytes and read when somebody asks.

What is kept only grows, so another thread may read what a view shows of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Generic, TypeVar, overload

from caesura_protocol.codec import decode, encode, encoding_of
from caesura_protocol.messages import Message

M = TypeVar("M", bound=Message)


class Kept(Generic[M]):
    """Messages of one type, in order, in a fifth of the memory."""

    def __init__(self, model: type[M]) -> None:
        self._model = model
        self._packed: list[bytes] = []

    def __len__(self) -> int:
        return len(self._packed)

    def extend(self, messages: Iterable[M]) -> None:
        """Keep these too."""
        self._packed += [encode(message).payload for message in messages]

    def read(self, start: int, stop: int) -> tuple[M, ...]:
        """Those from start to stop, which is not included."""
        encoding = encoding_of(self._model)
        return tuple(decode(packed, encoding, self._model) for packed in self._packed[start:stop])


class Shown(Sequence[M]):  # noqa: PLW1641 - without a hash, as a list
    """What a view shows: of what is kept all but the `first` ones, as far as it went then, and the rest."""

    def __init__(self, kept: Kept[M], rest: Iterable[M], *, first: int = 0) -> None:
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
        start, stop, step = index.indices(len(self))
        return self._between(start, stop) if step == 1 else self._between(0, len(self))[index]

    def __iter__(self) -> Iterator[M]:
        return iter(self._between(0, len(self)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence):
            return NotImplemented
        first = alike(self, other)
        return len(self) == len(other) and self[first:] == tuple(other[first:])

    def __repr__(self) -> str:
        return repr(tuple(self))

    def _between(self, start: int, stop: int) -> tuple[M, ...]:
        kept = self._stop - self._start
        old = self._kept.read(self._start + start, self._start + min(stop, kept)) if start < kept else ()
        return old + self._rest[max(start - kept, 0) : max(stop - kept, 0)]


def packed(model: type[M], messages: Iterable[M]) -> Shown[M]:
    """All of these, packed."""
    kept = Kept(model)
    kept.extend(messages)
    return Shown(kept, ())


def alike(one: Sequence[M], other: Sequence[M]) -> int:
    """So many of the first are the same ones, at least: both show them of the same that is kept."""
    if not (isinstance(one, Shown) and isinstance(other, Shown)):
        return 0
    if one._kept is not other._kept or one._start != other._start:
        return 0
    return min(one._stop, other._stop) - one._start
