"""The real franky against a robot that is simulated behind libfranka's protocol; needs neither in `make`.

pip install franky-control franky-sim mujoco && pytest tests/clients/test_franky_sim.py
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from caesura_clients.bridge.sources.registry import SourceOptions, open_source
from caesura_protocol.errors import SourceError
from caesura_service.robot import load_panda

pytest.importorskip("franky", reason="franky-control is not installed")
pytest.importorskip("franky_sim", reason="franky-sim is not installed")
pytest.importorskip("mujoco", reason="mujoco is not installed")

SAMPLES = 400


@pytest.fixture
def robot() -> Iterator[tuple[subprocess.Popen, str]]:
    """A simulated robot with a hand, and its address."""
    command = "from franky_sim.run_server import main; main()"
    with subprocess.Popen(
        [sys.executable, "-u", "-c", command, "-s", "mujoco"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        try:
            lines = iter(process.stdout.readline, "")
            (address,) = next(line for line in lines if "robot IP" in line).split("'")[1:2]
            yield process, address
        finally:
            process.kill()


def test_pose_joints_and_gripper_are_the_simulators_until_it_is_killed(robot):
    process, address = robot
    source = open_source("franky", SourceOptions(host=address))
    chunks, rows = [], 0
    with pytest.raises(SourceError, match=f"franky at {address}: .*lost after"):  # noqa: PT012 - it is a loop
        for chunk in source.chunks():
            chunks.append(chunk)
            rows += len(chunk)
            if rows >= SAMPLES:
                process.kill()
    column = dict(zip(source.columns, np.concatenate(chunks).T, strict=True))
    assert (np.diff(column["t"]) > 0.0).all()
    flange = load_panda().flange_pose([column[f"q{i}"][-1] for i in range(1, 8)])
    found = [column[name][-1] for name in ("px", "py", "pz")]
    np.testing.assert_allclose(found, flange.position_base, atol=2e-3)  # another model of the same arm
    turned = [column[name][-1] for name in ("qx", "qy", "qz", "qw")]
    assert abs(np.dot(turned, flange.orientation_base)) == pytest.approx(1.0, abs=1e-4)
    assert column["gripper"][-1] == pytest.approx(0.04, abs=1e-3)


def test_a_robot_that_is_not_there_is_named():
    with pytest.raises(SourceError, match=r"franky at 127\.0\.0\.1: cannot connect: libfranka: "):
        open_source("franky", SourceOptions(host="127.0.0.1"))
