"""How often the inverse kinematics finds a reachable pose: 1,000 drawn postures of each arm that ships.

python tests/bench/ik_rate.py [ROBOT…]
"""

from __future__ import annotations

import sys
import time

import numpy as np

from caesura_protocol.robots import robot_names
from caesura_service.robot import ReachError, load_robot

POSES, SEED, WITHIN_M = 1000, 11, 1e-4


def main() -> None:
    for name in sys.argv[1:] or robot_names():
        robot, found = load_robot(name), 0
        rng = np.random.default_rng(SEED)
        began = time.perf_counter()
        for q in rng.uniform(robot.lower_limits, robot.upper_limits, size=(POSES, robot.joints)):
            goal = robot.flange_pose(q)
            try:
                joints = robot.find_joints(goal.position_base, goal.orientation_base)
            except ReachError:
                continue
            left = np.linalg.norm(robot.flange_pose(joints).position_base - goal.position_base)
            found += bool(left < WITHIN_M)
        each_ms = 1000.0 * (time.perf_counter() - began) / POSES
        print(f"{name:8} {found} of {POSES} poses within {1000 * WITHIN_M:g} mm, {each_ms:.1f} ms each")


if __name__ == "__main__":
    main()
