"""An arm without a source of its own comes in by its topics: a KUKA iiwa, by the mapping of the examples."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from caesura_protocol.formats.read import load_recording
from caesura_protocol.formats.ros_types import JOINT_STATE, WRENCH
from caesura_protocol.programs.safety import CellSettings
from caesura_service.offline_segmentation import segment_recording
from caesura_service.robot import load_robot
from harness import ros

MAPPING = Path(__file__).resolve().parents[3] / "examples" / "ros2_iiwa14.toml"
NAMES = tuple(f"lbr_A{i}" for i in (7, 2, 3, 4, 5, 6, 1))  # as broadcasters do, in no order
PERIOD_NS = 10_000_000
#: With a scatter: one that is the same for seconds would be frozen.
FORCES = np.random.default_rng(0).normal([1.0, 2.0, 3.0], 0.05, (400, 3))


def taught() -> np.ndarray:
    """(n, 7) joints [rad]: a rest, a movement, a rest."""
    start = np.array(load_robot("iiwa14").description.postures[0])
    share = np.clip((np.arange(400) - 100) / 200, 0.0, 1.0)
    return start + np.outer(share**3 * (10 - 15 * share + 6 * share**2), [0.5, 0.2, 0, 0.3, 0, 0, 0])


def messages(joints: np.ndarray):
    for row, q in enumerate(joints):
        stamp = ros.BEGAN_NS + row * PERIOD_NS
        by_name = {name: float(q[int(name[-1]) - 1]) for name in NAMES}
        yield "/lbr/joint_states", JOINT_STATE, stamp, ros.joints(stamp, by_name)
        wrench = ros.wrench(stamp, FORCES[row], frame="lbr_link_ee")
        yield "/lbr/force_torque_broadcaster/wrench", WRENCH, stamp, wrench


def test_joints_and_a_wrench_in_the_flange_are_a_session_of_an_iiwa(tmp_path):
    joints = taught()
    bag = ros.write_bag(tmp_path / "bag", messages(joints), "mcap")
    recording = load_recording(bag, mapping=MAPPING)
    np.testing.assert_array_equal(recording.signals["q"], joints)
    np.testing.assert_array_equal(recording.signals["force"], FORCES)
    assert (recording.wrench_source, recording.force_frame) == ("joint_torque_estimate", "flange")
    found = segment_recording(recording, setting=CellSettings(robot="iiwa14"))
    assert [one.kind for one in found.segments] == ["steady", "motion", "steady"]
    there = load_robot("iiwa14").flange_pose(joints[-1]).position_base
    np.testing.assert_allclose(found.segments[-1].position_end, there, atol=1e-3)
