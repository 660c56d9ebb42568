"""The size from which on a force belongs to a press, and not to its touch or release."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PRESS_SHARE = 0.7  # of the size that a tenth of the observations exceed


def pressed_from(sizes: NDArray[np.float64]) -> float:
    """Return the size from which on a force is pressed: `PRESS_SHARE` of the upper decile.

    An impact at the touch is over before the next observation, so the first size counts as no larger than the
    second. sizes: (n,) [N] of at least one force, from the touch on.
    """
    held = np.sort(np.append(sizes[:2].min(), sizes[1:]))
    below, share = divmod(0.9 * (len(held) - 1), 1.0)  # as np.quantile, which takes twenty times as long
    low, high = held[int(below)], held[min(int(below) + 1, len(held) - 1)]
    return PRESS_SHARE * float(low + share * (high - low))
