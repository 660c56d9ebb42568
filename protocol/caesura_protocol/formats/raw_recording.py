"""The content of a recording's file, before it is validated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class WrenchStatement(NamedTuple):
    """Statements of a user on a wrench whose file states nothing; None: not stated."""

    source: str | None = None
    force_frame: str | None = None


class RawRecording(NamedTuple):
    """Signals by name, `t` among them: (n,) or (n, width); options by name; the names of the rest.

    assumed: what the reader assumes where the file leaves it open, a sentence each; lines: of the samples in
    a text file; has_calendar_time: the file has times of day, which are no numbers of a unit.
    """

    arrays: dict[str, Array]
    options: dict[str, str]
    ignored: list[str]
    assumed: tuple[str, ...] = ()
    lines: tuple[int, ...] = ()
    has_calendar_time: bool = False
