"""Physical constants and rates that several packages use; each is defined only here."""

from __future__ import annotations

GRAVITY = 9.81  # [m/s²], as the thesis has it
LOAD_KG = 3.0  # of the heaviest load, and tool: what a Panda carries
JOINTS = 7  # of a Panda
JOINTS_MOST = 8  # of any arm
# [N] scale of what free space reads after a tare: in real recordings the bias wanders so far with the pose
TARED_BIAS_N = 2.3
# A hand turns a tool about its palm: what it does with a point of the tool at a hand's breadth, it does with
# the orientation. So 10 mm/s of movement are 0.1 rad/s of turning.
HANDS_BREADTH_M = 0.1
# A hand that stops creeps on for a while: motion starts and stops where its speed passes 5 to 10 mm/s.
CREEP_M_PER_S, REST_M_PER_S = 0.005, 0.010
# Faster than a person presses or inserts, also where the tip is turned about the flange.
FREE_M_PER_S = 0.1
UP = (0.0, 0.0, 1.0)  # away from gravity in the base frame, where nothing else is stated
TURN_SHARE = 0.1  # of a hand's squared path in a turn, by which the centre moves: nine tenths are rotation
GRID_HZ = 100  # [1/s] of the grid to which samples are brought before they are filtered
