"""Finds values and times that no session accepts, each with its sample, limit and remedy.

They are found while a file is read; values also in the first second of a bridge's source. The service refuses
the same values, and states only the sample. It leaves out samples whose time does not increase; this module
reports those that follow a step back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.number_words import counted
from caesura_protocol.plausibility import LEAST_SAMPLES, METRES, likely_opening_unit
from caesura_protocol.recording import Recording, RecordingError
from caesura_protocol.sample_limits import HOLE_S, LATEST_S, LEAP_S, NORM_TOLERANCE, WIDEST_M

QUATERNION_NORM = 1e-3  # by which that of a quaternion with few digits differs from 1
SHOWN = 3  # steps back that are listed
FAR_S = 1e6  # from here on times are shown from the first sample on: six digits do not separate them
REPEATED_SHARE = 0.1
UNSORTED_SHARE = 0.1
MOST_STRAY = 3  # samples that follow each other
LEVEL = 2 * MOST_STRAY + 1  # samples whose median is where a place is, though some of them stray
WIDEST_FINGERS_M = 0.3  # that a column of openings has; a share of an opening reaches 1
NEGATIVE_OPENING_M = 0.01  # by which an opening may be below 0: the zero of its sensor is off
LEAST_LEAP_S = 0.01  # times of samples that came in a burst are closer
#: Factor and unit of a recording's places, and the speed and the leap above which no arm's are.
LEAPS: Mapping[str, Callable[[Recording], tuple[float, str, float, float]]] = {
    "pos": lambda recording: (METRES[recording.length_unit], "m", 5.0, 0.02),
    "q": lambda _: (1.0, "rad", 20.0, 0.1),
}


def check_values(recording: Recording) -> None:
    """Raise RecordingError for the first value of a signal that no session accepts.

    A recording of fewer than LEAST_SAMPLES samples is not checked.
    """
    if recording.t.size < LEAST_SAMPLES:
        return
    for found in wrong_values(recording.signals, recording.place):
        raise RecordingError(f"{recording.name}: {found}")


def check_time_steps(recording: Recording) -> None:
    """Raise RecordingError if most samples have the time of the one before, as in whole seconds, or if the
    samples are not in the order of time: their steps are then no sign of a unit.
    """
    t = recording.t
    earlier = t[1:] < t[:-1]
    if t.size >= LEAST_SAMPLES and earlier.mean() > UNSORTED_SHARE:
        row = int(earlier.argmax()) + 1
        raise RecordingError(
            f"{recording.name}: {recording.place(row)}: t is {t[row]:.10g} after {t[row - 1]:.10g}, and "
            f"{earlier.sum()} of {t.size} samples are earlier than the one before; sort the samples by t"
        )
    repeated = t[1:] == t[:-1]
    if (
        t.size >= LEAST_SAMPLES
        and repeated.mean() > 0.5
        and np.min(np.diff(np.unique(t)), initial=np.inf) > HOLE_S
    ):
        row = int(repeated.argmax()) + 1
        raise RecordingError(
            f"{recording.name}: {recording.place(row)}: t is {t[row]:.10g}, as in the sample before, and so "
            f"it is in {repeated.sum()} of {t.size} samples; expected a time of its own for each: write the "
            "fractions of a second too"
        )


def left_out(recording: Recording) -> tuple[str, ...]:
    """Return sentences on the samples that are left out because their time does not increase.

    There is one for each step back, for at most SHOWN of them, and one on many repeated times.
    """
    t = recording.t
    shown = _times_shown(t)
    repeated = int((t[1:] == t[:-1]).sum())
    highest = np.maximum.accumulate(t)
    back = np.flatnonzero(t[1:] < highest[:-1])
    first = back[np.diff(back, prepend=-2) > 1] + 1  # samples that are left out, one after the other
    found = []
    for row in first[:SHOWN].tolist():
        later = np.flatnonzero(t[row:] > highest[row - 1])
        count = int(later[0]) if later.size else t.size - row
        left_out = f"{counted(count, 'sample')} {'is' if count == 1 else 'are'} left out"
        found.append(
            f"{recording.place(row).capitalize()}: time goes back from {shown[:row].max():.6g} s to "
            f"{shown[row]:.6g} s. {left_out} until it has advanced again, and no sample says "
            "how long that took. If a clock was set there, divide the file."
        )
    if first.size > SHOWN:
        found.append(f"Time goes back {counted(first.size - SHOWN, 'more time')}.")
    if repeated > REPEATED_SHARE * t.size:
        found.append(
            f"{repeated} of {t.size} samples have the time of the one before, and are left out. Are they "
            "written twice, or are digits of their times cut off?"
        )
    return tuple(found)


def stray_places(recording: Recording) -> str | None:
    """Return text on samples far from those before and after, which are close to each other.

    None without any. A lost value that was written as 0 appears so. No robot moves there and back within a
    few samples.
    """
    signal = "pos" if "pos" in recording.signals else "q"
    scale, unit, speed, least = LEAPS[signal](recording)
    t, places = recording.t, scale * recording.signals[signal]
    stray = np.zeros(t.size, bool)
    for run in range(1, MOST_STRAY + 1):
        if t.size <= run + 1:
            break
        before, first, last, after = places[: -run - 1], places[1:-run], places[run:-1], places[run + 1 :]
        limit = least + speed * np.maximum(t[run + 1 :] - t[: -run - 1], LEAST_LEAP_S)
        leap = np.minimum(_distances(before, first), _distances(last, after))
        found = np.flatnonzero((leap > limit) & (_distances(before, after) < 0.5 * leap))
        for offset in range(run):
            stray[found + 1 + offset] = True
    if not stray.any():
        return None
    row = int(stray.argmax())
    leapt = float(_distances(places[row - 1 : row], places[row : row + 1])[0])
    return (
        f"{recording.place(row).capitalize()}: {signal} leaps by {leapt:.3g} {unit} and comes back. "
        f"{stray.sum()} of {t.size} samples lie so apart from those before and after. Are they lost values? "
        "Leave these samples out."
    )


def leaping_places(recording: Recording) -> str | None:
    """Return text on jumps after which the robot continues elsewhere, faster than an arm can move.

    None without any. Without positions the joints are checked. Causes are a changed base frame, or two
    recordings in one file. Values that jump back are `stray_places`.
    """
    signal = "pos" if "pos" in recording.signals else "q"
    scale, unit, speed, least = LEAPS[signal](recording)
    t, places = recording.t, scale * recording.signals[signal]
    steps = _distances(places[:-1], places[1:])
    found = []
    for row in np.flatnonzero(steps > least + speed * np.maximum(np.diff(t), LEAST_LEAP_S)).tolist():
        before, after = places[max(0, row + 1 - LEVEL) : row + 1], places[row + 1 : row + 1 + LEVEL]
        settled = np.array([np.median(before, axis=0), np.median(after, axis=0)])
        if _distances(settled[:1], settled[1:])[0] > 0.5 * steps[row]:
            found.append(row + 1)
    if not found:
        return None
    more = f" So it does {counted(len(found) - 1, 'more time')}." if len(found) > 1 else ""
    leapt = f"{signal} leaps by {steps[found[0] - 1]:.3g} {unit}"
    return (
        f"{recording.place(found[0]).capitalize()}: {leapt}, faster than an arm moves, and goes on from "
        f"there.{more} Was a frame changed, or are these two recordings? Divide the file there."
    )


def _distances(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    distances: NDArray[np.float64] = np.linalg.norm(other - one, axis=1)
    return distances


def check_clock(recording: Recording) -> None:
    """Raise RecordingError for a time beyond ±LATEST_S, or one that goes back or leaps ahead.

    It may go back by at most HOLE_S, and leap by at most LEAP_S. A recording of fewer than LEAST_SAMPLES
    samples is not checked.
    """
    t = recording.t
    if t.size < LEAST_SAMPLES:
        return
    if (row := _first(np.abs(t) > LATEST_S)) is not None:
        raise RecordingError(
            f"{recording.name}: {recording.place(row)}: t is {t[row]:g}, expected a time [s] within "
            f"±{LATEST_S:g}: state its unit with --time-unit ms, us or ns"
        )
    shown = _times_shown(t)
    highest = np.maximum.accumulate(t)[:-1]
    for steps, limit, verb in ((highest - t[1:], HOLE_S, "goes back"), (t[1:] - highest, LEAP_S, "leaps")):
        if (row := _first(steps > limit)) is not None:
            before_s = shown[: row + 1].max()
            raise RecordingError(
                f"{recording.name}: {recording.place(row + 1)}: time {verb} from {before_s:.6g} "
                f"s to {shown[row + 1]:.6g} s, expected within {limit:g} s: two recordings in one file, or a "
                "clock that was set; divide the file there"
            )


def is_quaternion(joints: NDArray[np.float64] | None) -> bool:
    """Return whether four joints (n, 4) are a quaternion: their squares add up to 1 in every sample."""
    if joints is None or joints.ndim != 2 or joints.shape[1] != 4 or len(joints) < LEAST_SAMPLES:
        return False
    return bool((np.abs(np.linalg.norm(joints, axis=1) - 1.0) < QUATERNION_NORM).all())


def wrong_values(signals: Mapping[str, NDArray[np.float64]], place: Callable[[int], str]) -> Iterator[str]:
    """Yield a text on each signal (n, width) with values that no session takes; the first such row is named.

    place: names a row.
    """
    if is_quaternion(signals.get("q")):
        yield (
            "q1 to q4 have norm 1 in every sample, as a quaternion has and joints have not: name the columns "
            "qx, qy, qz, qw as they are, or the array quat"
        )
    if "quat" in signals:
        norms = np.linalg.norm(signals["quat"], axis=1)
        if (row := _first(np.abs(norms - 1.0) > NORM_TOLERANCE)) is not None:
            remedy = "divide each quaternion by its norm"
            if norms[row] == 0.0:
                remedy = "leave out the samples that have no orientation, or quat"
            yield (
                f"{place(row)}: quaternion has norm {norms[row]:g}, expected 1 ± {NORM_TOLERANCE:g}: {remedy}"
            )
    if "gripper" in signals:
        yield from _wrong_openings(signals["gripper"][:, 0], place)


def _wrong_openings(openings: NDArray[np.float64], place: Callable[[int], str]) -> Iterator[str]:
    """Yield errors for openings that are counts, percent, fractions, negative, or in another unit."""
    widths = np.abs(openings)
    if (row := _first(widths > WIDEST_M)) is not None:
        likely = "are they counts of a gripper? Convert counts or percent to its opening"
        if unit := likely_opening_unit(float(widths.max())):
            likely = f"are they {unit}? Divide them by {1.0 / METRES[unit]:g}. Convert counts and percent"
        yield (
            f"{place(row)}: gripper is {openings[row]:g}, expected an opening [m] or a closed flag "
            f"within ±{WIDEST_M:g}: {likely}, or leave out gripper"
        )
    if (row := _first(openings < -NEGATIVE_OPENING_M)) is not None:
        yield (
            f"{place(row)}: gripper is {openings[row]:g}, expected an opening of 0 m or more, or a "
            "closed flag (0 open, 1 closed): write it so, or leave out gripper"
        )
    if not is_flag(openings) and (row := _first(widths > WIDEST_FINGERS_M)) is not None:
        between = openings[(openings != 0.0) & (openings != 1.0)][0]
        yield (
            f"{place(row)}: gripper is {openings[row]:g}, expected an opening of at most "
            f"{WIDEST_FINGERS_M:g} m, or a flag, which is 0 or 1, and it is {between:g} too: is it a share "
            "of the opening? Multiply it by the widest opening [m], round it to a flag (1 closed), or leave "
            "out gripper"
        )


def is_flag(openings: NDArray[np.float64]) -> bool:
    """Return whether a gripper's column is a flag, closed (1) or not (0), and not an opening."""
    return bool(((openings == 0.0) | (openings == 1.0)).all() and (openings == 1.0).any())


def _times_shown(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return times [s] as displayed: large ones, such as times of day, relative to the first sample."""
    return t - t[0] if abs(t[0]) > FAR_S else t


def _first(wrong: NDArray[np.bool_]) -> int | None:
    return int(wrong.argmax()) if wrong.any() else None
