"""Converts demonstrations to episodes of a training set: frames at a fixed rate, each with its sub-task.

A frame contains the robot's state at its time. Vectors are interpolated between the two neighbouring samples,
a gripper keeps its newest value. Nothing is interpolated across a gap: a session with a gap is refused. The
frames contain a wrench only if its source is stated.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.columns import signal_columns
from caesura_protocol.errors import CaesuraError
from caesura_protocol.formats.sample_checks import is_flag
from caesura_protocol.formats.unvalidated_recording import Array
from caesura_protocol.messages import Gap, Kind, Phase, Segment
from caesura_protocol.number_words import counted
from caesura_protocol.plausibility import METRES
from caesura_protocol.recording import Recording
from caesura_protocol.rotations import align_signs

FLAG, OPENING = "a flag, 1 is closed", "an opening in m"
MAX_FPS = 100  # [1/s] unless another rate is asked for

#: What the person does in a segment of each kind.
VERBS: Mapping[Kind, str] = {
    "motion": "move",
    "contact": "press",
    "transport": "carry",
    "steady": "rest",
    "hold": "hold the load",
    "sliding": "slide in contact",
    "turning": "turn",
}


class EpisodeError(CaesuraError, ValueError):
    """A demonstration cannot be an episode; the message states its name, the value and the limit."""


@dataclass(frozen=True)
class EpisodeSource:
    """Results, samples and names of a session from which an episode is made."""

    station: str
    session: str
    task: str
    recording: Recording
    segments: tuple[Segment, ...]
    phases: tuple[Phase, ...] = ()
    gaps: tuple[Gap, ...] = ()
    began_s: float = 0.0  # [s] time of day at the session's time 0
    success: bool | None = None  # None: not stated

    @property
    def name(self) -> str:
        """Station and session, joined by a slash."""
        return f"{self.station}/{self.session}"


class FeatureSpec(NamedTuple):
    """Names, type, units and frames of a feature's numbers. The same in all episodes of a dataset."""

    names: tuple[str, ...]  # of its components
    dtype: str
    info: tuple[tuple[str, str], ...]  # unit, frame, source


class Subtask(NamedTuple):
    """A sub-task of an episode: its text and its first frame."""

    first_frame: int
    text: str


@dataclass(frozen=True)
class Episode:
    """One demonstration in frames.

    specs and values have the same keys, the names of the features; values: (n, width) each, n frames.
    """

    source: EpisodeSource
    fps: int
    specs: Mapping[str, FeatureSpec]
    values: Mapping[str, Array]
    subtasks: tuple[Subtask, ...]  # the first one from frame 0 on
    left_out: tuple[str, ...] = ()  # what the frames do not have of the demonstration, one sentence each

    @property
    def length(self) -> int:
        """The number of frames."""
        return len(self.values["observation.state"])


def episodes_of(sources: Sequence[EpisodeSource], fps: int | None = None) -> list[Episode]:
    """Return an episode for each demonstration, all with the same features and at the same rate.

    fps: frames a second; by default the rate of the slowest demonstration, at most MAX_FPS.
    Raises EpisodeError for a rate above that of the samples, a gap, a demonstration without segments or with
    fewer than two frames, and for demonstrations whose features or statements of success differ.
    """
    rates = [_rate(one) for one in sources]
    chosen = fps or max(1, min(MAX_FPS, *(round(rate) for rate in rates)))
    for one, rate in zip(sources, rates, strict=True):
        if chosen > 1.01 * rate:
            raise EpisodeError(f"{one.name}: {chosen} frames a second, and its samples come at {rate:.4g} Hz")
    gripper = _gripper(sources)
    made = [_episode(one, chosen, gripper) for one in sources]
    _check_alike(made)
    return made


def _rate(one: EpisodeSource) -> float:
    """Return the rate [Hz] of the samples from their median interval.

    Raises EpisodeError for a single sample.
    """
    times = np.unique(one.recording.t)
    if times.size < 2:
        raise EpisodeError(f"{one.name}: {times.size} sample, expected at least 2")
    return 1.0 / float(np.median(np.diff(times)))


def _gripper(sources: Sequence[EpisodeSource]) -> str:
    """Return the meaning of the gripper's numbers in all episodes. Raises EpisodeError for two meanings.

    A column of zeros alone is shut fingers or an open flag, and fits both.
    """
    found: dict[str, str] = {}
    for one in sources:
        column = one.recording.signals.get("gripper")
        if column is not None and column.any():
            found.setdefault(FLAG if is_flag(column[:, 0]) else OPENING, one.name)
    if len(found) > 1:
        raise EpisodeError(
            f"gripper is {FLAG} in {found[FLAG]} and {OPENING} in {found[OPENING]}: all episodes of a "
            "dataset have the same features. Export them separately"
        )
    return f"gripper {next(iter(found), 'as sent')}"


def _episode(one: EpisodeSource, fps: int, gripper: str) -> Episode:
    for gap in one.gaps:
        if gap.tn > gap.t0:
            raise EpisodeError(
                f"{one.name}: nothing was recorded from {gap.t0:.3f} to {gap.tn:.3f} s: an episode has no gap"
            )
    if not one.segments:
        raise EpisodeError(f"{one.name}: has no segment, expected at least 1")
    times, kept = np.unique(one.recording.t, return_index=True)
    count = int((times[-1] - times[0]) * fps + 1e-6) + 1
    if count < 2:
        raise EpisodeError(f"{one.name}: {count} frame at {fps} a second, expected at least 2")
    frames = times[0] + np.arange(count) / fps
    specs = _specs(one.recording, gripper)
    found = {
        signal: values_at(frames, times, _metric(one.recording, signal)[kept], signal)
        for signal in one.recording.signals
    }
    values = {
        name: np.hstack([found[signal] for signal in _PARTS[name] if signal in found]) for name in specs
    }
    subtasks = _subtasks(one, float(times[0]), fps, count)
    state = values["observation.state"]
    values["action"] = np.vstack([state[1:], state[-1:]])
    return Episode(
        source=one,
        fps=fps,
        specs=specs | {"action": specs["observation.state"]},
        values=values,
        subtasks=subtasks,
        left_out=tuple(_left_out(one, specs, len(subtasks), fps)),
    )


def _left_out(one: EpisodeSource, specs: Mapping[str, FeatureSpec], subtasks: int, fps: int) -> Iterator[str]:
    """Yield a sentence on signals that are in no feature, and one on segments that are no sub-task."""
    there = [signal for name in specs for signal in _PARTS[name]]
    if absent := [signal for signal in one.recording.signals if signal not in there]:
        source = one.recording.wrench_source or "not stated"
        yield f"{one.name}: {', '.join(absent)} left out: the source of the wrench is {source}."
    if (missed := len(one.segments) - subtasks) > 0:
        yield (
            f"{one.name}: {counted(missed, 'segment')} without a frame at {fps} a second, and so without a "
            "sub-task: meta/caesura.json has them."
        )


#: Feature → the signals whose columns it has, in this order.
_PARTS: Mapping[str, tuple[str, ...]] = {
    "observation.state": ("q", "pos", "quat", "gripper"),
    "observation.wrench": ("force", "torque"),
    "observation.external_torque": ("tau",),
}


def _specs(recording: Recording, gripper: str) -> dict[str, FeatureSpec]:
    """Return the features of a recording; those of its wrench only if the source is stated.

    gripper: the meaning of its numbers.
    """
    stated = recording.wrench_source not in {None, "none"}
    source = ("source", str(recording.wrench_source))
    frame = recording.force_frame + (", assumed" if "force_frame" in recording.assumptions else "")
    described: dict[str, tuple[str, tuple[tuple[str, str], ...]]] = {
        "observation.state": ("float32", (("unit", f"q rad; p m, base frame; {gripper}"),)),
        # 32 bits hold a force above 16 N no better than to 1e-6 N.
        "observation.wrench": (
            "float64",
            (("unit", "f N, m Nm: neither tared nor filtered"), ("frame", frame), source),
        ),
        "observation.external_torque": ("float64", (("unit", "Nm"), source)),
    }
    specs, there = {}, signal_columns(recording.columns)
    for name, (dtype, info) in described.items():
        signals = [signal for signal in _PARTS[name] if signal in there]
        if signals and (stated or name == "observation.state"):
            columns = tuple(c for s in signals for c in there[s])
            specs[name] = FeatureSpec(columns, dtype, info)
    return specs


def _metric(recording: Recording, signal: str) -> Array:
    values = recording.signals[signal]
    return values * METRES[recording.length_unit] if signal == "pos" else values


def values_at(frames: Array, times: Array, values: Array, signal: str) -> Array:
    """Return the values (n, width) of a signal at the frames (n,) [s], from samples at times (m,) [s]."""
    if signal == "gripper":  # a width or a flag: half open was never reported
        newest = np.searchsorted(times, frames + 1e-9, side="right") - 1
        held: Array = values[newest]
        return held
    if signal == "quat":
        values = values.copy()
        align_signs(values)
    found = np.column_stack([np.interp(frames, times, column) for column in values.T])
    if signal == "quat":
        found /= np.linalg.norm(found, axis=1, keepdims=True)
    return found


def _subtasks(one: EpisodeSource, start_s: float, fps: int, count: int) -> tuple[Subtask, ...]:
    """Return each segment from the frame nearest to its start; one too short for a frame is left out."""
    starts: dict[int, str] = {}
    for number, segment in enumerate(one.segments):
        nearest = round((segment.t0 - start_s) * fps) if number else 0
        if nearest < count:
            starts[max(nearest, 0)] = _text(number, segment, one.phases)
    return tuple(Subtask(first, text) for first, text in sorted(starts.items()))


def _text(number: int, segment: Segment, phases: Sequence[Phase]) -> str:
    """Return the text of a segment, after the name that an operator gave to its phase.

    number: index of the segment.
    """
    named = [phase.name for phase in phases if phase.first_segment <= number <= phase.last_segment]
    prefix = f"{named[0]}: " if named and named[0] else ""
    return prefix + VERBS[segment.kind]


def subtask_of_frame(subtasks: Sequence[Subtask], count: int) -> NDArray[np.int64]:
    """Return the number (count,) of each frame's sub-task."""
    starts = [one.first_frame for one in subtasks]
    return np.searchsorted(starts, np.arange(count), side="right").astype(np.int64) - 1


def _check_alike(episodes: Sequence[Episode]) -> None:
    """Raise EpisodeError if two episodes do not fit into one dataset."""
    first = episodes[0]
    for other in episodes[1:]:
        pair = (first.source.name, other.source.name)
        for feature in dict.fromkeys((*first.specs, *other.specs)):
            one, two = first.specs.get(feature), other.specs.get(feature)
            if one != two:
                raise EpisodeError(
                    f"{feature} is {_described(one)} in {pair[0]} and {_described(two)} in {pair[1]}: all "
                    "episodes of a dataset have the same features. Export them separately"
                )
        if (first.source.success is None) != (other.source.success is None):
            stated, open_ = pair if first.source.success is not None else pair[::-1]
            raise EpisodeError(
                f"success is stated for {stated} and not for {open_}: state it for all, or none"
            )


def _described(spec: FeatureSpec | None) -> str:
    if spec is None:
        return "absent"
    return f"{', '.join(spec.names)} ({'; '.join(': '.join(pair) for pair in spec.info)})"
