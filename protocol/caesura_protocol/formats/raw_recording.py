"""The content of a recording's file, before it is validated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class RawRecording(NamedTuple):
    """Signals by name, `t` among them: (n,) or (n, width); options by name; the names of the rest."""

    arrays: dict[str, Array]
    options: dict[str, str]
    ignored: list[str]
