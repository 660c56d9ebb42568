"""The largest of the parts that a note names, and the number of the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

T = TypeVar("T")


def largest_parts(
    found: Sequence[T], size: Callable[[T], float], text: Callable[[T], str], most: int, others: str
) -> Iterator[str]:
    """Yield the texts of the largest parts in their order, then how many `others` there are.

    most: the number of parts that are named.
    """
    largest = sorted(range(len(found)), key=lambda number: size(found[number]))[-most:]
    yield from (text(found[number]) for number in sorted(largest))
    if rest := len(found) - len(largest):
        yield f"{rest} {others}"
