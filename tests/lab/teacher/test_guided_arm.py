"""The guided arm: what it does when it is held, pushed, and left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from caesura_lab.teacher.guided_arm import (
    DAMPING,
    JOINT_DAMPING,
    STICK_RAD_PER_S,
    GuidedArmSimulation,
    SimulationTrace,
    start_posture,
)
from caesura_lab.teacher.hand_motion_plan import DT, Plan, make_plan
from caesura_lab.teacher.person import THESIS
from caesura_lab.teacher.scenarios import SCENARIOS, Scenario, Step
from caesura_service.robot import Robot

STILL = Scenario("still", "stay where you are", (0.4, 0.1, 0.3), (Step("dwell", 1.2),))
LOOSE = replace(THESIS, stiffness_n_per_m=0.0, damping_ns_per_m=0.0, tremor_n=0.0, wander_n=0.0)


def pushed(force_n: float, seconds: float) -> Plan:
    """A hand that pushes sideways for a while, then lets the arm alone."""
    plan = make_plan(STILL, LOOSE, np.random.default_rng(0))
    force = np.zeros_like(plan.force)
    force[: round(seconds / DT), 1] = force_n
    return replace(plan, force=force, torque=np.zeros_like(plan.torque))


def kinetic_energy(robot: Robot, trace: SimulationTrace) -> list[float]:
    return [0.5 * v @ robot.mass_matrix(q) @ v for q, v in zip(trace.q, trace.v, strict=True)]


def test_an_arm_left_alone_stays(robot: Robot) -> None:
    trace = GuidedArmSimulation(robot, pushed(0.0, 0.0)).run(1000)
    assert np.abs(trace.q - trace.q[0]).max() < 1e-9


def test_a_push_below_friction_moves_nothing_visible(robot: Robot) -> None:
    trace = GuidedArmSimulation(robot, pushed(0.5, 1.0)).run(1000)
    assert np.abs(robot.flange_poses(trace.q)[0][-1] - STILL.start).max() < 2e-4


def test_without_joint_friction_the_least_push_moves_the_arm(robot: Robot) -> None:
    plan = pushed(0.5, 1.0)
    plan = replace(plan, person=replace(plan.person, joint_friction=0.0))
    trace = GuidedArmSimulation(robot, plan).run(1000)
    assert np.abs(robot.flange_poses(trace.q)[0][-1] - STILL.start).max() > 5e-3


def test_an_arm_let_go_loses_its_energy_and_comes_to_rest(robot: Robot) -> None:
    trace = GuidedArmSimulation(robot, pushed(15.0, 0.3)).run(1200)
    energy = kinetic_energy(robot, trace)[310:]
    assert energy[0] > 0.05
    assert np.all(np.diff(energy) < 1e-9)
    assert energy[-1] < 1e-5 * energy[0]


def test_each_step_obeys_the_robots_forward_dynamics(robot: Robot) -> None:
    trace = GuidedArmSimulation(
        robot, make_plan(SCENARIOS["dispenser"], THESIS, np.random.default_rng(0))
    ).run(3200)
    for k in range(0, 3100, 97):
        q, v, ahead = trace.q[k], trace.v[k], trace.v[k + 1]
        wrench = trace.hand[k] + trace.environment[k] - DAMPING * trace.twist[k]
        resist = (robot.friction_nm / (np.abs(v) + STICK_RAD_PER_S) + JOINT_DAMPING) * ahead
        torques = robot.nonlinear_torques(q, v) + robot.joint_torques_of_wrench(q, wrench) - resist
        assert_allclose((ahead - v) / DT, robot.forward_dynamics(q, v, torques), atol=1e-6)


def test_contact_in_a_demonstration_never_pulls_and_stays_in_its_friction_cone(robot: Robot) -> None:
    trace = GuidedArmSimulation(robot, make_plan(SCENARIOS["wiping"], THESIS, np.random.default_rng(1))).run(
        6000
    )
    normal, sideways = trace.contact[:, 2], np.hypot(trace.contact[:, 0], trace.contact[:, 1])
    assert normal.min() >= 0.0
    assert np.any(normal > 5.0)
    assert np.all(sideways <= 0.25 * normal + 1e-9)


@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=lambda s: s.name)
def test_the_panda_reaches_every_place_of_every_scenario(robot: Robot, scenario: Scenario) -> None:
    places = [scenario.start, *(step.to for step in scenario.steps if step.to is not None)]
    for place in places:
        q, rotation = start_posture(robot, place)
        assert_allclose(robot.flange_pose(q).position_base, place, atol=1e-5)
        assert_allclose(rotation[:, 2], [0.0, 0.0, -1.0], atol=1e-5)
        assert np.linalg.svd(robot.flange_jacobian(q))[1][-1] > 0.1


def test_the_hand_loads_up_before_the_arm_moves(robot: Robot) -> None:
    calm = replace(THESIS, tremor_n=0.0, wander_n=0.0, deviation=0.0)
    scenario = replace(
        SCENARIOS["three_point"], steps=(Step("dwell", 0.6), Step("move", 2.0, (0.035, -0.335, 0.03)))
    )
    trace = GuidedArmSimulation(robot, make_plan(scenario, calm, np.random.default_rng(0))).run(2000)
    force = np.linalg.norm(trace.hand[:, :3], axis=1)
    moves = int(np.argmax(np.linalg.norm(trace.twist[:, :3], axis=1) > 0.005))
    assert 1.0 < force[moves - 20] < 4.0
    assert force[moves - 300] < 0.3
