"""Values that no session takes, found while a file is read: each with its sample, its limit and a remedy.

The service refuses the same values, but only names a sample.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.plausibility import LEAST_SAMPLES
from caesura_protocol.recording import Recording, RecordingError
from caesura_protocol.sample_limits import HOLE_S, LATEST_S, LEAP_S, NORM_TOLERANCE, WIDEST_M

WIDEST_MM = 200.0


def check_values(recording: Recording) -> None:
    """Raise RecordingError for the first value of a signal that no session takes; not of a few samples."""
    if recording.t.size < LEAST_SAMPLES:
        return
    for found in _wrong_values(recording):
        raise RecordingError(f"{recording.name}: {found}")


def check_clock(recording: Recording) -> None:
    """Raise RecordingError where a time is no time, goes back by more than a pause, or leaps."""
    t = recording.t
    if t.size < LEAST_SAMPLES:
        return
    if (row := _first(np.abs(t) > LATEST_S)) is not None:
        raise RecordingError(
            f"{recording.name}: {recording.place(row)}: t is {t[row]:g}, expected a time [s] within "
            f"±{LATEST_S:g}: state its unit with --time-unit ms, us or ns"
        )
    highest = np.maximum.accumulate(t)[:-1]
    for steps, limit, verb in ((highest - t[1:], HOLE_S, "goes back"), (t[1:] - highest, LEAP_S, "leaps")):
        if (row := _first(steps > limit)) is not None:
            raise RecordingError(
                f"{recording.name}: {recording.place(row + 1)}: time {verb} from {highest[row]:.6g} s to "
                f"{t[row + 1]:.6g} s, expected within {limit:g} s: two recordings in one file, or a clock "
                "that was set; divide the file there"
            )


def _wrong_values(recording: Recording) -> Iterator[str]:
    if "quat" in recording.signals:
        norms = np.linalg.norm(recording.signals["quat"], axis=1)
        if (row := _first(np.abs(norms - 1.0) > NORM_TOLERANCE)) is not None:
            remedy = "divide each quaternion by its norm"
            if norms[row] == 0.0:
                remedy = "leave out the samples that have no orientation, or quat"
            yield (
                f"{recording.place(row)}: quaternion has norm {norms[row]:g}, expected 1 ± "
                f"{NORM_TOLERANCE:g}: {remedy}"
            )
    if "gripper" in recording.signals:
        widths = np.abs(recording.signals["gripper"][:, 0])
        if (row := _first(widths > WIDEST_M)) is not None:
            likely = "are they mm? Divide them by 1000"
            if widths.max() > WIDEST_MM:
                likely = "are they counts of a gripper? Convert them to its opening"
            yield (
                f"{recording.place(row)}: gripper is {recording.signals['gripper'][row, 0]:g}, expected an "
                f"opening [m] or a closed flag within ±{WIDEST_M:g}: {likely}, or leave out gripper"
            )


def _first(wrong: NDArray[np.bool_]) -> int | None:
    return int(wrong.argmax()) if wrong.any() else None
