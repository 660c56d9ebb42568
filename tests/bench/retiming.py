"""What `--speed optimal` gains and costs: times, shares of the limits at 1 kHz, distance off the path, ms.

Taught, fast and shorter are of the program; "runs" is how much shorter the simulated robot takes. Shares of
the joints' velocity, acceleration and jerk, and of the flange's acceleration and jerk, are the largest.

Usage: python tests/bench/retiming.py [ROBOT]
A Panda's recordings are those in data/. Another robot is guided through the same tasks by the same person.
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
from caesura_lab.teacher.scenarios import SCENARIOS, moved
from caesura_lab.teacher.simulated_teaching import PANDA, teach
from caesura_protocol.formats.read import load_recording
from caesura_protocol.programs.default_safety import safety_for
from caesura_protocol.programs.document import ProgramFile, document_of_apps
from caesura_protocol.programs.safety import Safety
from caesura_protocol.recording import Recording
from caesura_protocol.reproduced_path import curve_of
from caesura_service.offline_segmentation import segment_recording
from caesura_service.robot import Robot, load_robot
from harness.joint_motion import DT, followed, joints_followed

DATA = Path(__file__).parents[2] / "data"
LOW_M = -0.2
RECORDINGS = ("pick_and_place", "dispenser", "three_point")


def worst_shares(program: ProgramFile, robot: Robot) -> np.ndarray:
    """Largest shares (5,) of velocity, acceleration and jerk of the joints, and of the flange's last two."""
    arm, found = robot.description, []
    limits = (robot.velocity_limits, robot.acceleration_limits, robot.jerk_limits)
    of_flange = {2: arm.flange_acceleration_limit, 3: arm.flange_jerk_limit}
    for index in program.timing.retimed if program.timing else ():
        app = program.apps[index]
        following = program.apps[index + 1] if index + 1 < len(program.apps) else None
        start, curve = app.path.start, followed(app, following)
        q, *_ = robot.nearest_joints(start.position, start.orientation, np.array(app.joints))
        joints = joints_followed(robot, curve, q)
        places = np.array([curve.at(float(t))[0][:3] for t in np.arange(0.0, float(curve.t[-1]), DT)])
        shares = [np.abs(np.diff(joints, n, axis=0)).max(0) / DT**n / limits[n - 1] for n in (1, 2, 3)]
        sizes = [np.linalg.norm(np.diff(places, n, axis=0), axis=1) / DT**n / of_flange[n] for n in of_flange]
        found.append([float(one.max()) for one in (*shares, *sizes)])
    return np.max(found, axis=0)


def with_low_floor(safety: Safety) -> Safety:
    """The limits, with a floor below the tasks of arms whose tasks stand lower than a Panda's."""
    x, y, _ = safety.workspace_low
    return safety.model_copy(update={"workspace_low": (x, y, LOW_M)})


def recorded(name: str, robot: str) -> Recording:
    """The recording of a task."""
    return load_recording(DATA / f"{name}.npz") if robot == PANDA else teach(name, robot=robot).recording


def off_path_mm(taught: ProgramFile, fast: ProgramFile) -> float:
    """Largest distance [mm] between the two programs' paths, either way."""
    worst = 0.0
    for index in fast.timing.retimed if fast.timing else ():
        one, other = (curve_of(p.apps[index]).sampled(500)[:, :3] for p in (taught, fast))
        worst = max(worst, cKDTree(one).query(other)[0].max(), cKDTree(other).query(one)[0].max())
    return 1000.0 * worst


def seconds_of_run(program: ProgramFile, scenario: str, robot: Robot) -> float:
    """How long the simulated robot takes from the beginning of the first app to the end of the last."""
    placed = moved(SCENARIOS[scenario], robot.description.task_offset_m)
    spans = run(program.apps, SimulatedCell(placed, THESIS), program.safety, robot=robot).spans
    return float(spans[-1][1] - spans[0][0])


def main() -> None:
    """Print a row for each recording."""
    name_of_robot = sys.argv[1] if len(sys.argv) > 1 else PANDA
    robot = load_robot(name_of_robot)
    columns = "   v    a    j   flange a    j  off path    CPU"
    print(f"recording        taught   fast  shorter   runs  moves{columns}")
    for name in RECORDINGS:
        apps = segment_recording(recorded(name, name_of_robot)).apps
        taught = document_of_apps(apps, name, with_low_floor(safety_for(name_of_robot)))
        took = []
        for _ in range(5):
            began = time.thread_time()
            fast = optimal(taught, robot=robot)
            took.append(time.thread_time() - began)
        timing = fast.timing
        moves = [sum(p.apps[i].tn - p.apps[i].t0 for i in timing.retimed) for p in (taught, fast)]
        velocity, acceleration, jerk, *flange = worst_shares(fast, robot)
        shorter = 1.0 - timing.seconds / timing.taught_s
        runs = [seconds_of_run(program, name, robot) for program in (fast, taught)]
        print(
            f"{name:<15} {timing.taught_s:6.2f} s {timing.seconds:5.2f} s {shorter:6.1%}"
            f" {1.0 - runs[0] / runs[1]:6.1%}"
            f" {1.0 - moves[1] / moves[0]:6.1%} {velocity:4.2f} {acceleration:4.2f} {jerk:4.2f}"
            f" {flange[0]:10.2f} {flange[1]:4.2f}"
            f" {off_path_mm(taught, fast):6.2f} mm {1000.0 * min(took):4.0f} ms"
        )


if __name__ == "__main__":
    main()
