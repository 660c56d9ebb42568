"""What conditioning costs a station: µs of processor time a batch of 20 samples, and where they go.

A recording is conditioned batch by batch; what each part was asked is written down and asked again by itself,
many times, which pure functions allow: as cheap as it can be. "kinematics" is a share of "flange rows". "all
of it" is the conditioning of one session as it runs, "of many" that of as many sessions in turn as a service
has. An observation is five batches at 1 kHz.
Usage: python tests/bench/conditioning_cost.py [RECORDING …] [--rounds N] [--json DIR]
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
from machine import machine, options, report
from numpy.typing import NDArray

from caesura_protocol.formats.read import load_recording
from caesura_service.robot import Robot, load_panda
from caesura_service.signals import Conditioner, SampleLayout, conditioning
from caesura_service.signals.grid_resampler import Resampler
from caesura_service.signals.gripper_events import GripperTracker
from caesura_service.signals.savitzky_golay import SavitzkyGolay
from caesura_service.signals.tare import TareEstimator

RECORDING = Path(__file__).resolve().parents[2] / "data" / "pick_and_place.npz"
BATCH, SAMPLES, SESSIONS = 20, 6000, 32
JOINTS, TAU = (tuple(f"{name}{i}" for i in range(1, 8)) for name in ("q", "tau"))
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
Call = Callable[[], object]

#: Part → where its functions are looked up.
PARTS: Mapping[str, tuple[tuple[Any, str], ...]] = {
    "taking": ((SampleLayout, "take"),),
    "resampling": ((Resampler, "advance"),),
    "flange rows": ((conditioning, "flange_rows"),),
    "kinematics": ((Robot, "flange_poses"), (Robot, "wrenches_of_joint_torques")),
    "gripper": ((GripperTracker, "advance"),),
    "filtering": ((Conditioner, "_fit"), (SavitzkyGolay, "tail")),
    "tare": ((TareEstimator, "advance"),),
    "observations": tuple((conditioning, name) for name in ("tared_row", "turned_to", "observation_of")),
}


class Stream(NamedTuple):
    """A session's samples, in batches."""

    name: str
    layout: SampleLayout
    batches: list[NDArray[np.float64]]


def main() -> None:
    """Condition each recording as it is, and the same with nothing but joints and their torques."""
    parser = options(__doc__)
    parser.add_argument("recordings", nargs="*", type=Path, default=[RECORDING], metavar="RECORDING")
    parser.add_argument("--rounds", type=int, default=15)
    asked = parser.parse_args()
    print(", ".join(f"{name} {value}" for name, value in machine().items()))
    streams = [stream for path in asked.recordings for stream in streams_of(path)]
    costs = [measured(stream, asked.rounds) for stream in streams]
    rows = [(name, *(cost[name] for cost in costs)) for name in costs[0]]
    report(
        "conditioning_cost",
        f"µs of processor time a batch of {BATCH} samples",
        ("part", *(stream.name for stream in streams)),
        rows,
        asked.json,
    )


def streams_of(path: Path) -> Iterator[Stream]:
    """As recorded; and, where there are joints and a wrench, as joint torques that amount to it."""
    recording, robot = load_recording(path), load_panda()
    matrix, columns = recording.matrix()[:SAMPLES], recording.columns
    layout = SampleLayout(
        columns,
        recording.wrench_source,
        recording.force_frame,
        pose_of_joints=lambda q: robot.flange_poses(q),  # noqa: PLW0108 it is looked up when called
        wrench_of_joint_torques=lambda q, tau: robot.wrenches_of_joint_torques(q, tau),  # noqa: PLW0108
    )
    yield Stream(path.stem, layout, batches(matrix))
    if set(JOINTS) | set(WRENCH) <= set(columns):
        q, wrench = (matrix[:, [columns.index(name) for name in names]] for names in (JOINTS, WRENCH))
        tau = [robot.joint_torques_of_wrench(*row) for row in zip(q, wrench, strict=True)]
        torques = replace(layout, columns=("t", *JOINTS, *TAU), wrench_source="joint_torque_estimate")
        yield Stream(f"{path.stem}, torques", torques, batches(np.column_stack([matrix[:, 0], q, tau])))


def batches(matrix: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Whole ones."""
    return [matrix[i : i + BATCH] for i in range(0, len(matrix) - BATCH + 1, BATCH)]


def measured(stream: Stream, rounds: int) -> Mapping[str, float]:
    """µs a batch by part, and of the whole; the last one is µs an observation."""
    calls, observations = written_down(stream)
    works: dict[str, Callable[[], object]] = {name: partial(again, asked) for name, asked in calls.items()}
    works["all of it"] = partial(conditioned, stream)
    works["of many"] = partial(conditioned, stream, SESSIONS)
    taken: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(rounds):
        for name, work in works.items():
            taken[name].append(thread_seconds(work))
    total = {name: 1e6 * statistics.median(each) for name, each in taken.items()}
    total["of many"] /= SESSIONS
    a_batch = {name: spent / len(stream.batches) for name, spent in total.items()}
    return {**a_batch, "an observation": total["all of it"] / observations}


def conditioned(stream: Stream, sessions: int = 1) -> int:
    """Condition it all in so many sessions at once; how many observations that came to."""
    conditioners = [Conditioner(stream.layout) for _ in range(sessions)]
    return sum(len(each.push(batch).observations) for batch in stream.batches for each in conditioners)


def written_down(stream: Stream) -> tuple[Mapping[str, list[Call]], int]:
    """What each part is asked while the stream is conditioned, and how many observations it came to."""
    calls: dict[str, list[Call]] = {name: [] for name in PARTS}
    with ExitStack() as stack:
        for part, places in PARTS.items():
            for holder, name in places:
                noted = noting(getattr(holder, name), calls[part])
                stack.enter_context(mock.patch.object(holder, name, noted))
        observations = conditioned(stream)
    return calls, observations


def noting(function: Callable[..., object], calls: list[Call]) -> Callable[..., object]:
    """The same function, which writes down what it is asked."""

    def noted(*args: Any, **named: Any) -> object:
        calls.append(partial(function, *args, **named))
        return function(*args, **named)

    return noted


def again(calls: list[Call]) -> None:
    """Ask the same again."""
    for call in calls:
        call()


def thread_seconds(work: Callable[[], object]) -> float:
    """Processor time of this thread that it takes [s]."""
    before = time.thread_time()
    work()
    return time.thread_time() - before


if __name__ == "__main__":
    main()
