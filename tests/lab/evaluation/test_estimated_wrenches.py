"""`--suite estimates`: the friction of the joints in an estimated wrench"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from caesura_lab.evaluation.cases.estimated_wrenches import FRICTIONS, as_estimate
from caesura_lab.evaluation.cases.suites import SuiteOptions, suite
from caesura_lab.teacher.simulated_teaching import teach
from caesura_service.robot import load_robot

ONE = SuiteOptions(seeds=1, first_seed=3)


def test_every_person_is_judged_with_every_friction():
    cases = suite("estimates", ONE)
    assert [case.group for case in cases] == [
        friction for friction in FRICTIONS for _ in suite("teacher", ONE)
    ]
    recording, truth = cases[0].load()
    assert (recording.wrench_source, recording.hand_on_robot) == ("joint_torque_estimate", "no")
    assert truth.hand_in_wrench is False


def test_without_friction_the_wrench_is_that_of_the_sensor():
    taught = teach("button", seed=3).recording
    estimate = as_estimate(taught, "estimate without friction", np.random.default_rng(1))
    for name, values in taught.signals.items():
        np.testing.assert_array_equal(estimate.signals[name], values)


def test_friction_depends_on_the_direction_of_each_joint_and_stays_where_it_stops():
    taught = teach("button", seed=3).recording
    estimate = as_estimate(taught, "joint friction 0.5 Nm", np.random.default_rng(1))
    robot = load_robot("panda")
    wrench = np.column_stack([estimate.signals[name] - taught.signals[name] for name in ("force", "torque")])
    q = taught.signals["q"]
    torques = np.array([robot.joint_torques_of_wrench(*row) for row in zip(q, wrench, strict=True)])
    speed = np.gradient(gaussian_filter1d(q, 0.05 * 100.0, axis=0), taught.t, axis=0)
    still = np.flatnonzero(np.abs(speed).max(axis=1) < 1e-3)[1:]
    assert len(still) > 500
    assert np.abs(torques[still] - torques[still - 1]).max() < 0.002
    work = np.einsum("ij,ij->i", torques, speed)
    assert np.mean(work[np.abs(speed).max(axis=1) > 0.05] > 0.0) > 0.98
