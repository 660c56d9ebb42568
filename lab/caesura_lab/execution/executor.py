"""Runs a program on the simulated robot, and records the samples that a bridge would record.

Apps follow each other as they were taught, with their times and the pauses between them. If an app cannot be
executed the robot stops, and the result states the app and the reason.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np

from caesura_lab.execution.cell_simulation import CellSimulation
from caesura_lab.execution.checks import DemonstrationQuality, check
from caesura_lab.execution.safety_monitor import RobotStopped
from caesura_lab.execution.simulated_arm import SimulatedArm
from caesura_lab.execution.skills import SkillController
from caesura_lab.teacher.guided_arm import SimulationTrace
from caesura_lab.teacher.hand_force import force_profile
from caesura_lab.teacher.hand_motion_plan import Plan
from caesura_lab.teacher.person import Person
from caesura_lab.teacher.robot_sensors import Sensors
from caesura_lab.teacher.scenarios import Scenario
from caesura_protocol.messages import App, Vector, WrenchSource
from caesura_protocol.programs.app_time_shifts import run_times
from caesura_protocol.programs.checks.findings import CheckReport, RefusedError
from caesura_protocol.programs.checks.value_ranges import beyond_stop
from caesura_protocol.programs.program_gripper import within_gripper
from caesura_protocol.programs.safety import DEFAULT, Safety
from caesura_protocol.recording import Recording
from caesura_protocol.robots import GripperDescription
from caesura_service.robot import Robot, load_panda

BEGIN_S, END_S, BRAKE_S = 0.6, 0.8, 0.3
START_M = 0.02  # from home, up to which a program is begun where it was taught to begin


@dataclass(frozen=True)
class SimulatedCell:
    """A simulated cell: its scenario, and the person whose object and sensors it has.

    load_kg, width_m: of the grasped object; None for the person's own, and the usual width.
    """

    scenario: Scenario
    person: Person
    seed: int = 0
    wrench_source: WrenchSource = "flange_sensor"
    load_kg: float | None = None
    width_m: float | None = None

    def simulation(self) -> CellSimulation:
        """The cell before the first app."""
        kg = self.person.load_kg if self.load_kg is None else self.load_kg
        return CellSimulation(self.scenario, kg, self.width_m)


@dataclass(frozen=True)
class RunResult:
    """Trace, recording and outcome of a run.

    stopped: why it was stopped, None where it was not; at: the app during which, counted from 0; spans: when
    each app that was begun began and ended [s].
    """

    trace: SimulationTrace
    recording: Recording
    stopped: str | None
    at: int | None
    spans: tuple[tuple[float, float], ...] = ()


def execute(
    apps: Sequence[App],
    cell: SimulatedCell,
    safety: Safety = DEFAULT,
    *,
    quality: DemonstrationQuality | None = None,
    robot: Robot | None = None,
    gripper: GripperDescription | None = None,
) -> RunResult:
    """Check a program against its cell, and run it. Raises RefusedError if the check fails.

    gripper: the gripper to use; None: fingers within the limits of the cell.
    """
    robot = robot or load_panda()
    report = check(apps, cell.simulation().cell(safety), quality, robot, gripper)
    if not report.passed:
        raise RefusedError(report)
    if stopped := tuple(replace(one, severity="error") for one in beyond_stop(apps, safety)):
        raise RefusedError(CheckReport(stopped))
    return run(apps, cell, within_gripper(safety, gripper), robot)


def run(
    apps: Sequence[App], cell: SimulatedCell, safety: Safety = DEFAULT, robot: Robot | None = None
) -> RunResult:
    """Run checked apps; the same arguments give the same bytes."""
    robot = robot or load_panda()
    world = cell.simulation()
    world.start = _start_position(apps, world.start)
    controller = SkillController(SimulatedArm(robot, world, friction=cell.person.joint_friction), safety)
    stopped, at = None, None
    spans: list[tuple[float, float]] = []
    try:
        controller.hold_position(BEGIN_S)
        for index, (app, following) in enumerate(zip_longest(apps, apps[1:])):
            at, began = index, controller.arm.t
            controller.run(app, following)
            spans.append((began, controller.arm.t))
            controller.pause(_pause(app, following, safety), following)
        at = None
        controller.release_contact()
        controller.hold_position(END_S)
    except RobotStopped as reason:
        stopped = str(reason)
        controller.brake(BRAKE_S)
    trace = controller.arm.trace()
    return RunResult(trace, _recording_of(trace, cell, robot), stopped, at, tuple(spans))


def _start_position(apps: Sequence[App], home: Vector) -> Vector:
    """Return the start of the first path [m] where it is near home, else home."""
    path = apps[0].path if apps else None
    near = path is not None and math.dist(path.start.position, home) <= START_M
    return path.start.position if path is not None and near else home


def _pause(app: App, following: App | None, safety: Safety) -> float:
    """Return the rest [s] from the end of an app's path to the begin of the next, `safety.pause_s` at most.

    0 without a next app.
    """
    if following is None:
        return 0.0
    return min(max(run_times(following)[0] - run_times(app)[1], 0.0), safety.pause_s)


def _recording_of(trace: SimulationTrace, cell: SimulatedCell, robot: Robot) -> Recording:
    """Return the recording that the sensors of the cell's robot make of a trace."""
    plan = _plan_of(trace, cell)
    sensors = Sensors(robot, plan, cell.wrench_source, np.random.default_rng([cell.seed, 1]))
    signals = sensors.read(trace)
    return Recording(trace.t, signals, wrench_source=cell.wrench_source, name=f"{cell.scenario.name}-run")


def _plan_of(trace: SimulationTrace, cell: SimulatedCell) -> Plan:
    """Return a motionless plan of a run's length, from which the sensors draw their noise."""
    n = trace.t.size
    still = np.zeros((n, 3))
    return Plan(
        cell.scenario,
        cell.person,
        position=still,
        velocity=still,
        force=still,
        torque=still,
        feed_forward=still,
        press=np.zeros(n),
        aims=force_profile((), trace.t),
        width=trace.width,
        load_kg=trace.load_kg,
    )
