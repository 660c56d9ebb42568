"""The check that the arm reaches a program: joints, inverse kinematics, speed, workspace and obstacles."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from caesura_lab.execution.cell_limits import Cell
from caesura_lab.execution.joint_speeds import JOINT_SHARE, fastest_joint
from caesura_lab.execution.trajectories import app_path, press_direction
from caesura_lab.teacher.guided_arm import lever_along
from caesura_lab.teacher.motion_profiles import Array
from caesura_protocol.app_contacts import ends_in_contact
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App, Vector
from caesura_protocol.programs.checks.findings import Finding
from caesura_protocol.programs.checks.workspace import EDGE_M, NEARLY_ALL, OF_AT_LEAST, outside_reason
from caesura_protocol.programs.contact_forces import touching_force
from caesura_protocol.programs.safety import PLANNED_SHARE
from caesura_protocol.reproduced_path import Curve
from caesura_protocol.rotations import matrix_of, quaternion_of
from caesura_service.robot import Robot

REACH_M, REACH_RAD = 1e-3, 1e-2
STEP_M = 0.02  # of a way that is looked at
JOINT_MARGIN_RAD = 0.05  # from a joint's end, so that no guard has to stop the robot there
BEGINS_M = 1e-6  # a way may begin there
ASTRAY_M = 0.03  # between a target and where its joints lead
ONE_IS_WRONG = ": one of them is wrong"
DEPTH_M = 0.003  # below the top of an obstacle
BESIDE_M = 0.03  # aside of where it touches, a movement may end in a contact or rise out of one
SLOWED = 1.01  # factor of time from which on a movement is named as slowed down
DEPTH_PARTS = 8  # pieces of a leg in which its depth is summed


@dataclass(frozen=True)
class _ArmState:
    """State of the arm before an app, None where unknown.

    Place (3,), rotation (3, 3), joints (n,), contact.
    """

    place: Array | None
    rotation: Array | None
    joints: Array | None
    touching: bool


class _Peak(NamedTuple):
    """The largest speed on a path, and its limit, of which a share is allowed.

    joint: whose speed it is, None for the flange's.
    """

    unit: str
    value: float
    limit: float
    share: float
    joint: int | None = None

    @property
    def allowed(self) -> float:
        """The largest speed that a path may reach, in `unit`."""
        return self.share * self.limit

    @property
    def slower(self) -> float:
        """The factor of time with which the path keeps the limit."""
        return self.value / self.allowed

    def reason(self, seconds: float) -> str:
        """Return why a movement of some seconds is slowed down, with its speed, limit and new duration."""
        reaches, lasts = f"reaches {self.value:.2f} {self.unit}", f"{self.slower * seconds:.2f} s"
        limit = f"{self.allowed:.2f} {self.unit} are allowed, {self.share:g} of the limit"
        allowed = f"in its {seconds:.2f} s, {limit}"
        if self.joint is None:
            return f"{reaches} {allowed}: it is slowed down to {lasts}"
        slows = f"the simulated robot slows it down to {lasts}, a script does not check joints"
        return f"{reaches} at joint {self.joint} {allowed}: {slows}"


def reach_findings(apps: Sequence[App], cell: Cell, robot: Robot) -> list[Finding]:
    """Return where the arm cannot follow, is too fast, leaves its limits, or collides."""
    checker = _ReachabilityChecker(cell, robot)
    state = _state_before(apps, cell)
    found: list[Finding] = []
    for index, app in enumerate(apps):
        following = apps[index + 1] if index + 1 < len(apps) else None
        some, state = checker.check_app(index, app, following, state)
        found += some
    wrong = checker.joint_reasons(apps)
    if (of_program := checker.other_arm(apps, wrong)) is None:
        return found
    return [of_program, *(one for one in found if one.index is None or one.reason != wrong.get(one.index))]


class _ReachabilityChecker:
    def __init__(self, cell: Cell, robot: Robot) -> None:
        self._cell, self._safety, self._robot = cell, cell.safety, robot
        self._low = robot.lower_limits + JOINT_MARGIN_RAD
        self._high = robot.upper_limits - JOINT_MARGIN_RAD
        self._low_place = np.array(cell.safety.workspace_low) + EDGE_M - BEGINS_M
        self._high_place = np.array(cell.safety.workspace_high) - EDGE_M + BEGINS_M

    def check_app(
        self, index: int, app: App, following: App | None, state: _ArmState
    ) -> tuple[list[Finding], _ArmState]:
        """Check one app; return its findings and the state of the arm after it."""
        ends = ends_in_contact(app, following)
        after = _state_after(app, state, touching=ends)
        if state.touching and (APP_KINDS[app.kind].in_contact or not self._has_left(after)):
            after = replace(after, touching=True)
        reasons = list(self._check_joints(app))
        outside = outside_reason(app.target, self._safety) is not None  # which `workspace` finds
        joints = after.joints
        if app.target is not None and not reasons and not outside:
            joints, reason = self._joints_at_target(app, app.target, state)
            reasons += [reason] if reason else []
        path = None
        if reasons or outside:
            after = replace(after, place=None)  # where it would be is not known
        elif app.target is not None and state.place is not None and APP_KINDS[app.kind].needs:
            path = _planned_path(app, state)
        if APP_KINDS[app.kind].presses:
            reasons += self._check_press(app, state, path)
        elif path is not None:
            reasons += self._check_path(path, state, joints, ends=ends)
        found = [Finding("error", index, app.kind, reason) for reason in reasons]
        found += [] if path is None else self._slowdown(index, app, path, state.joints, joints)
        return found, replace(after, joints=joints)

    def joint_reasons(self, apps: Sequence[App]) -> dict[int, str]:
        """Return why joints do not match an app's target, by the number of the app."""
        reasons = ((index, next(self._check_joints(app), None)) for index, app in enumerate(apps))
        return {index: reason for index, reason in reasons if reason is not None}

    def other_arm(self, apps: Sequence[App], wrong: Mapping[int, str]) -> Finding | None:
        """Return a finding if the joints of nearly all apps do not belong to this arm's targets.

        wrong: from `joint_reasons`.
        """
        stated = sum(app.joints is not None for app in apps)
        if len(wrong) < OF_AT_LEAST or len(wrong) < NEARLY_ALL * stated:
            return None
        first, name = min(wrong), self._robot.description.name
        return Finding(
            "error",
            None,
            None,
            f"the joints of {len(wrong)} of {stated} apps are not those of the arm {name}, such as app "
            f"{first + 1}: {wrong[first].removesuffix(ONE_IS_WRONG)}. Was it taught on another arm? State it "
            "with --robot. If not, its poses are not those of the flange in the base frame",
        )

    def _check_joints(self, app: App) -> Iterator[str]:
        if app.joints is None:
            return
        q = np.array(app.joints)
        if len(q) != self._robot.joints:
            name = self._robot.description.name
            yield f"has {len(q)} joints, and its robot {name} has {self._robot.joints}"
            return
        low, high = self._robot.lower_limits, self._robot.upper_limits
        for i in np.flatnonzero((q < low) | (q > high)):
            yield f"joint {i + 1} at {q[i]:.3f} rad, limits {low[i]:.3f} to {high[i]:.3f} rad"
            return
        if app.target is not None:
            astray = float(np.linalg.norm(self._robot.flange_pose(q).position_base - app.target))
            if astray > ASTRAY_M:
                yield (
                    f"its joints put the flange {1000 * astray:.0f} mm from its target, "
                    f"expected at most {1000 * ASTRAY_M:.0f} mm{ONE_IS_WRONG}"
                )

    def _joints_at_target(
        self, app: App, target: Vector, state: _ArmState
    ) -> tuple[Array | None, str | None]:
        """Solve for joints (n,) at the target; return them, or why there are none."""
        own = app.joints is not None and len(app.joints) == self._robot.joints
        seeds = [np.array(app.joints)] if own else []
        seeds += [] if state.joints is None else [state.joints]
        seeds += self._robot.postures
        best = (np.inf, np.inf)
        for seed in seeds:
            q, left, turn = self._robot.nearest_joints(target, _quaternion(app, state), seed)
            if left < REACH_M and turn < REACH_RAD and self._within_joint_limits(q):
                return q, None
            best = min(best, (left, turn))
        if best[0] < REACH_M and best[1] < REACH_RAD:
            return None, f"target {_mm(target)} is reached only with a joint at its limit"
        return None, (
            f"target {_mm(target)} is out of reach: the arm comes within {1000 * best[0]:.0f} mm and "
            f"{best[1]:.2f} rad, expected {1000 * REACH_M:g} mm and {REACH_RAD:g} rad"
        )

    def _slowdown(
        self, index: int, app: App, path: Curve, begins: Array | None, ends: Array | None
    ) -> Iterator[Finding]:
        """Warn of a movement that was taught faster than the limits and is slowed down.

        begins, ends: joints (n,) [rad] before and after it, where they are known.
        """
        speed, turn = path.peaks()
        peaks = [
            _Peak("m/s", speed, self._safety.speed_m_per_s, PLANNED_SHARE),
            _Peak("rad/s", turn, self._safety.turn_rad_per_s, PLANNED_SHARE),
        ]
        if (q := self._joints_at_start(path, begins, ends)) is not None:
            joint = fastest_joint(self._robot, path, q)
            peaks.append(_Peak("rad/s", joint.rad_per_s, joint.limit_rad_per_s, JOINT_SHARE, joint.number))
        peak = max(peaks, key=lambda one: one.slower)
        if peak.slower >= SLOWED:
            reason = peak.reason(float(path.t[-1]))
            yield Finding("warning", index, app.kind, reason, peak.value, peak.allowed)

    def _joints_at_start(self, path: Curve, begins: Array | None, ends: Array | None) -> Array | None:
        """Return joints (n,) [rad] where a path begins, None where none are found."""
        seed = ends if begins is None else begins
        if seed is None or path.values.shape[1] == 3:
            return begins
        q, left, turn = self._robot.nearest_joints(path.values[0, :3], path.values[0, 3:], seed)
        return q if left < REACH_M and turn < REACH_RAD else None

    def _check_path(
        self, path: Curve, state: _ArmState, joints: Array | None, *, ends: bool
    ) -> Iterator[str]:
        """Check that the path to the target is within reach and free of obstacles."""
        longest = float(np.linalg.norm(np.diff(path.values[:, :3], axis=0), axis=1).max())
        points = path.sampled(max(1, int(np.ceil(longest / STEP_M))))
        start, end, q = points[0, :3], points[-1, :3] if ends else None, joints
        for pose in points[::-1]:
            point = pose[:3]
            turned = pose[3:] if len(pose) == 7 else _quaternion(None, state)
            if reason := self._collision(point, turned, state, start, end):
                yield reason
                return
            if (point < self._low_place).any() or (point > self._high_place).any():
                yield f"its path leads through {_mm(point)}, which is outside of the workspace"
                return
            if q is not None:
                q, left, turn = self._robot.nearest_joints(point, turned, q)
                if left > REACH_M or turn > REACH_RAD or not self._within_joint_limits(q):
                    yield f"its path leads through {_mm(point)}, which is out of reach or at a joint's limit"
                    return

    def _collision(
        self, point: Array, turned: Array, state: _ArmState, start: Array, end: Array | None
    ) -> str | None:
        """Return why a pose of the flange collides: its fingertips are inside an obstacle.

        start: of the way (3,) [m]; end: where it ends in a contact, None where it ends free. There the arm
        stops at the touch, which may be as far from where it was taught as the arm searches for it.
        """
        depth, yields = self._depth(point, matrix_of(turned))
        allowed = DEPTH_M
        if end is not None and _is_beside(point, end):
            allowed += max(yields, self._safety.search_m)
        leaves = state.touching and _is_beside(point, start) and point[2] >= start[2] - DEPTH_M
        if depth <= allowed or leaves:
            return None
        return f"its path leads through {_mm(point)}, {1000 * depth:.0f} mm inside an obstacle"

    def _depth(self, point: Array, rotation: Array) -> tuple[float, float]:
        """Return how deep [m] the fingertips of a pose are inside an obstacle, and by how much it yields."""
        x, y, z = (point + lever_along(rotation[:, 2])).tolist()
        top = self._cell.surface_height(x, y)
        return (-math.inf, 0.0) if top is None else (top - z, self._cell.compliance_depth(x, y))

    def _has_left(self, state: _ArmState) -> bool:
        """Return whether the fingertips have left the object that they pressed in, which may follow them."""
        if state.place is None or state.rotation is None:
            return True
        return self._depth(state.place, state.rotation)[0] <= DEPTH_M

    def _check_press(self, app: App, state: _ArmState, path: Curve | None) -> Iterator[str]:
        force = np.array(app.force)
        rotation = state.rotation if app.orientation is None else matrix_of(app.orientation)
        if path is None:
            return
        deep = _press_depth(path, force, rotation, touching_force(app) is None)
        if deep > self._safety.search_m:
            most = 1000 * self._safety.search_m
            yield f"presses {1000 * deep:.0f} mm deep, at most {most:.0f} mm are allowed"

    def _within_joint_limits(self, q: Array) -> bool:
        return bool(((q >= self._low) & (q <= self._high)).all())


def _is_beside(point: Array, other: Array) -> bool:
    return float(np.linalg.norm(point[:2] - other[:2])) < BESIDE_M


def _state_before(apps: Sequence[App], cell: Cell) -> _ArmState:
    """Return the state of the arm before a program: where the cell states it, else where its path begins."""
    place, rotation = cell.start, None
    if place is None and apps and (path := apps[0].path) is not None:
        place = path.start.position
        rotation = None if path.start.orientation is None else matrix_of(path.start.orientation)
    return _ArmState(None if place is None else np.array(place), rotation, None, touching=False)


def _state_after(app: App, state: _ArmState, *, touching: bool) -> _ArmState:
    return _ArmState(
        state.place if app.target is None else np.array(app.target),
        state.rotation if app.orientation is None else matrix_of(app.orientation),
        state.joints,
        touching,
    )


def _planned_path(app: App, state: _ArmState) -> Curve:
    """Plan the reproduced path from the current pose; without a known rotation, from the taught one."""
    assert state.place is not None, "is asked for where the place is known"
    rotation = state.rotation
    if rotation is None:
        taught = app.path.start.orientation if app.path is not None else None
        rotation = matrix_of(taught or app.orientation or (1.0, 0.0, 0.0, 0.0))
    return app_path(app, state.place, rotation, app.tn - app.t0)


def _press_depth(path: Curve, force: Array, rotation: Array | None, tilts: bool) -> float:
    """Return how deep [m] a path presses along the direction of the press, which turns with the tool.

    tilts: so far that the force is not that of its beginning; the tool's axis is.
    """
    if rotation is None:
        along = force / np.linalg.norm(force)
        return float(np.max((path.values[:, :3] - path.values[0, :3]) @ along))
    points = path.sampled(DEPTH_PARTS)
    if points.shape[1] == 7 and tilts:
        rotation = matrix_of(points[0, 3:])
    along = press_direction(rotation, None if tilts else force)
    if points.shape[1] == 3:
        return float(np.max((points - points[0]) @ along))
    first = matrix_of(points[0, 3:]).T @ along
    turned = np.array([matrix_of(pose[3:]) @ first for pose in points])
    return float(np.max(np.cumsum(np.vecdot(np.diff(points[:, :3], axis=0), turned[1:]))))


def _quaternion(app: App | None, state: _ArmState) -> Array:
    if app is not None and app.orientation is not None:
        given = np.array(app.orientation)
        return np.asarray(given / np.linalg.norm(given), dtype=np.float64)
    return np.array((1.0, 0.0, 0.0, 0.0)) if state.rotation is None else quaternion_of(state.rotation)


def _mm(point: object) -> str:
    return f"({', '.join(f'{1000 * x:.0f}' for x in np.asarray(point))}) mm"
