"""The content of a recording's file, before it is validated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class UserStatements(NamedTuple):
    """A user's statements on the wrench and the arm of a file that states neither; None: not stated."""

    wrench_source: str | None = None  # a `WrenchSource`
    force_frame: str | None = None  # a `ForceFrame`
    robot: str | None = None  # the arm's name, or the path of its description


class UnvalidatedRecording(NamedTuple):
    """The unvalidated content of a recording's file.

    Signals by name, including `t`: (n,) or (n, width); options by name; names of other content. assumed: the
    reader's assumptions about what the file leaves open, one sentence each; lines: line numbers of the
    samples in a text file; has_calendar_time: whether the file has times of day, to which no unit applies;
    mapped_units: signals whose unit the mapping states, so that they are converted already.
    """

    arrays: dict[str, Array]
    options: dict[str, str]
    ignored: list[str]
    assumed: tuple[str, ...] = ()
    lines: tuple[int, ...] = ()
    has_calendar_time: bool = False
    mapped_units: frozenset[str] = frozenset()
