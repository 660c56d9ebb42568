"""What `--speed optimal` gains and costs: times, shares of the limits at 1 kHz, distance off the path, ms.

Taught, fast and shorter are of the program; "runs" is how much shorter the simulated robot takes.

Usage: python tests/bench/retiming.py
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).parents[1]))

from caesura_lab.execution.executor import SimulatedCell, run
from caesura_lab.retiming import optimal
from caesura_lab.teacher.person import THESIS
from caesura_lab.teacher.scenarios import SCENARIOS
from caesura_protocol.formats.read import load_recording
from caesura_protocol.programs.document import ProgramFile, document_of_apps
from caesura_protocol.reproduced_path import curve_of
from caesura_service.offline_segmentation import segment_recording
from caesura_service.robot import Robot, load_panda
from harness.joint_motion import followed, joints_followed, shares

DATA = Path(__file__).parents[2] / "data"
RECORDINGS = ("pick_and_place", "dispenser", "three_point")


def worst_shares(program: ProgramFile, robot: Robot) -> np.ndarray:
    """Largest shares (3,) of a Panda's joint velocities, accelerations and jerks in what is re-timed."""
    found = []
    for index in program.timing.retimed if program.timing else ():
        app = program.apps[index]
        following = program.apps[index + 1] if index + 1 < len(program.apps) else None
        start = app.path.start
        q, *_ = robot.nearest_joints(start.position, start.orientation, np.array(app.joints))
        found.append(shares(joints_followed(robot, followed(app, following), q)))
    return np.max(found, axis=0)


def off_path_mm(taught: ProgramFile, fast: ProgramFile) -> float:
    """Largest distance [mm] between the two programs' paths, either way."""
    worst = 0.0
    for index in fast.timing.retimed if fast.timing else ():
        one, other = (curve_of(p.apps[index]).sampled(500)[:, :3] for p in (taught, fast))
        worst = max(worst, cKDTree(one).query(other)[0].max(), cKDTree(other).query(one)[0].max())
    return 1000.0 * worst


def seconds_of_run(program: ProgramFile, scenario: str) -> float:
    """How long the simulated robot takes from the beginning of the first app to the end of the last."""
    spans = run(program.apps, SimulatedCell(SCENARIOS[scenario], THESIS), program.safety).spans
    return float(spans[-1][1] - spans[0][0])


def main() -> None:
    """Print a row for each recording."""
    robot = load_panda()
    print(
        "recording        taught   fast  shorter   runs  moves  velocity  acceleration  jerk  off path    CPU"
    )
    for name in RECORDINGS:
        taught = document_of_apps(segment_recording(load_recording(DATA / f"{name}.npz")).apps, name)
        took = []
        for _ in range(5):
            began = time.thread_time()
            fast = optimal(taught, robot=robot)
            took.append(time.thread_time() - began)
        timing = fast.timing
        moves = [sum(p.apps[i].tn - p.apps[i].t0 for i in timing.retimed) for p in (taught, fast)]
        velocity, acceleration, jerk = worst_shares(fast, robot)
        shorter = 1.0 - timing.seconds / timing.taught_s
        print(
            f"{name:<15} {timing.taught_s:6.2f} s {timing.seconds:5.2f} s {shorter:6.1%}"
            f" {1.0 - seconds_of_run(fast, name) / seconds_of_run(taught, name):6.1%}"
            f" {1.0 - moves[1] / moves[0]:7.1%} {velocity:8.2f} {acceleration:13.2f} {jerk:5.2f}"
            f" {off_path_mm(taught, fast):6.2f} mm {1000.0 * min(took):4.0f} ms"
        )


if __name__ == "__main__":
    main()
