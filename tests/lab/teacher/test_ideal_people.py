"""Ideal people move as they did before habits were added, bit by bit."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from caesura_lab.evaluation.thesis.simulated_demonstrations import TIMED, person
from caesura_lab.teacher.simulated_teaching import Demonstration
from caesura_protocol.messages import WrenchSource
from caesura_service.robot import Robot
from lab.teacher.nominal import nominal_once

# SHA-256 of samples and truth without phases, recorded before habits existed; "probe" is of the arithmetic
# beneath.
HASHES = json.loads((Path(__file__).parent / "ideal_people.json").read_text(encoding="utf-8"))


def probe(robot: Robot) -> str:
    """Digest the arithmetic beneath the teacher, which differs between machines."""
    rng = np.random.default_rng(0)
    x = rng.normal(size=(500, 7))
    filtered = sosfilt(butter(2, 15.0, fs=1000.0, output="sos"), x, axis=0)
    found = hashlib.sha256(np.concatenate([np.sin(x), np.exp(x), filtered]).tobytes())
    for q in x[:20]:
        arm = robot.hand_dynamics(q)
        found.update(np.linalg.solve(arm.mass_matrix, arm.jacobian.T @ x[0, :6]).tobytes())
    return found.hexdigest()


@pytest.fixture(scope="module", autouse=True)
def _same_arithmetic(robot: Robot) -> None:
    if probe(robot) != HASHES["probe"]:
        pytest.skip("this machine rounds differently from the one that recorded the hashes")


def digest(demonstration: Demonstration) -> str:
    found = hashlib.sha256(demonstration.recording.matrix().tobytes())
    truth = {name: value for name, value in demonstration.truth.items() if name != "phases"}
    found.update(json.dumps(truth, sort_keys=True).encode())
    return found.hexdigest()


@pytest.mark.parametrize("seed", [0, 7])
@pytest.mark.parametrize("scenario", ["parkour", "dispenser", "pick_and_place", "wiping"])
def test_ideal_people_are_unchanged(scenario: str, seed: int) -> None:
    demonstration = nominal_once(scenario, seed=seed) if seed else nominal_once(scenario)
    assert digest(demonstration) == HASHES[f"{scenario}/{seed}"]


def test_an_estimated_wrench_of_ideal_people_is_unchanged() -> None:
    source: WrenchSource = "joint_torque_estimate"
    found = digest(nominal_once("button", seed=2, wrench_source=source))
    assert found == HASHES["button/est"]


@pytest.mark.parametrize("scenario", list(TIMED))
def test_the_demonstrations_of_the_thesis_suite_are_unchanged(scenario: str) -> None:
    taught = nominal_once(TIMED[scenario], seed=3, person=person(3, "overdamped"))
    assert digest(taught) == HASHES[f"thesis/{scenario}/overdamped"]
