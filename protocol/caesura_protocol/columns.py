"""Columns of a sample matrix, by signal. Robots differ only in their number of joints."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from itertools import takewhile

from caesura_protocol.messages import COLUMNS_OF_SIGNAL

JOINT_SIGNALS = ("q", "tau")  # with one column a joint


def signal_columns(columns: Collection[str]) -> dict[str, tuple[str, ...]]:
    """Return the complete signals, each with its columns.

    >>> signal_columns(["t", "px", "py", "pz", "fx", "q1", "q2"])
    {'pos': ('px', 'py', 'pz'), 'q': ('q1', 'q2')}
    """
    there = set(columns)
    found = {}
    for signal, names in COLUMNS_OF_SIGNAL.items():
        present = tuple(takewhile(there.__contains__, names))
        if present and (signal in JOINT_SIGNALS or len(present) == len(names)):
            found[signal] = present
    return found


def columns_of(signals: Iterable[str], joints: int) -> tuple[str, ...]:
    """Return the columns of a sample matrix with these signals, time first. joints: of the robot."""
    width = dict.fromkeys(JOINT_SIGNALS, joints)
    return ("t", *(column for s in signals for column in COLUMNS_OF_SIGNAL[s][: width.get(s)]))


def missing_columns(signal: str, columns: Collection[str]) -> tuple[str, ...]:
    """Return the missing columns of an incomplete signal; none if it is complete or absent.

    >>> missing_columns("q", ["q1", "q3"]), missing_columns("pos", ["px"]), missing_columns("tau", [])
    (('q2',), ('py', 'pz'), ())
    """
    names = COLUMNS_OF_SIGNAL[signal]
    places = [place for place, name in enumerate(names) if name in columns]
    if not places:
        return ()
    expected = names[: places[-1] + 1] if signal in JOINT_SIGNALS else names
    return tuple(name for name in expected if name not in columns)
