"""What of a session's copy was refused, where its copies in several journals exclude each other.

An instance that is frozen between its last look at the epochs and a record has that record in its journal,
although it was refused. The successor may have acknowledged another change in its place. So where two copies
exclude each other, that one counts whose instance completed the last takeover of the station. It had read the
other one before, and an earlier owner has acknowledged nothing since. A copy that only goes on where the
other one ends excludes nothing. Batches exclude nothing either: they are equal in every copy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import takewhile
from typing import NamedTuple, TypeVar

from caesura_protocol.messages import Describe, EditProgram
from caesura_service.journal.applied_edits import AppliedEdit
from caesura_service.journal.journal import Copy, Recordable, Refused

CHANGES = (AppliedEdit, Describe, EditProgram)
C = TypeVar("C")


class Changes(NamedTuple):
    """Changes of a session by people, oldest first; of either kind each follows from the one before."""

    edits: tuple[Recordable, ...]
    neutral: tuple[Recordable, ...]  # descriptions and edits of the program: they alter no result

    @classmethod
    def of(cls, messages: Iterable[Recordable]) -> Changes:
        """Divide the changes of a session by their kind."""
        made = tuple(messages)
        edits = tuple(message for message in made if isinstance(message, AppliedEdit))
        return cls(edits, tuple(message for message in made if not isinstance(message, AppliedEdit)))


def last_owned(copies: Sequence[C], extent: Callable[[C], Copy]) -> C:
    """Return the copy of the last owner, the first one where that is unknown."""
    return max(copies, key=lambda copy: extent(copy).owner_epoch)


def refused_in(
    mine: Copy, counting: Copy, changes: Callable[[], tuple[Changes | None, Changes | None]]
) -> Refused | None:
    """Return what of a copy was refused, as the last owner's copy counts; None where all may stay.

    changes: reads those of both, each None where it cannot be read; asked only where both have some.
    """
    if mine.owner_epoch >= counting.owner_epoch:
        return None
    edits, described = mine.edits, mine.described
    if min(edits, counting.edits) or min(described, counting.described):
        made, counted = changes()
        if made is not None and counted is not None:
            edits = _beside(made.edits, counted.edits)
            described = _beside(made.neutral, counted.neutral)
    has_gone_on = counting.last_seq > mine.last_seq and counting.touched > mine.touched
    close = mine.closed and has_gone_on
    is_all = not close and (edits, described) == (mine.edits, mine.described)
    return None if is_all else Refused(edits, described, close)


def _beside(made: Sequence[Recordable], counted: Sequence[Recordable]) -> int:
    """Return how many changes stay: up to the first one in whose place another one counts."""
    common = min(len(made), len(counted))
    same = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(made, counted, strict=False)))
    return len(made) if same == common else same
