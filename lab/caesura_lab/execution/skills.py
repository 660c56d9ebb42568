"""The robot's skill for each kind of app. A skill moves the setpoint tick by tick until its app is done.

Movements that end in a contact reach their target at the search speed, and continue until a contact force is
measured. In contact the force is controlled along the direction of the press, and the position across it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import TypeGuard

import numpy as np

from caesura_lab.execution.force_controller import ForceController, force_gain_per_s
from caesura_lab.execution.safety_monitor import RobotStopped, SafetyMonitor
from caesura_lab.execution.simulated_arm import ArmMeasurement, Setpoint, SimulatedArm
from caesura_lab.execution.trajectories import app_path, approach_direction, arrival_speed
from caesura_lab.teacher.hand_motion_plan import DT
from caesura_lab.teacher.motion_profiles import Array
from caesura_protocol.app_force_limit import LEAST_PRESS_N
from caesura_protocol.app_kinds import APP_KINDS, AppKind
from caesura_protocol.messages import App, ScrewMotion, ViaPoint
from caesura_protocol.programs.app_time_shifts import goes_on, rest_newtons, rests_of
from caesura_protocol.programs.safety import Safety
from caesura_protocol.programs.ways_between_apps import ASTRAY_M
from caesura_protocol.reproduced_path import TOLERANCE_M, Curve
from caesura_protocol.rotations import cross, matrix_of, quaternion_of, turning_of
from caesura_protocol.screw_torque_and_text import stop_torque_nm
from caesura_service.constants import GRAVITY

RISE_S, RELEASE_S = 0.15, 0.15  # longest time in which a force is built up; in which it is let go
LEAVES_S = 0.15  # at the start of a movement between two contacts, in which it may still touch the first
SLIDE_M = 0.015  # a target of Apply Force this far aside is slid to
SQUEEZE_M = 0.01  # by which fingers aim to close further than what they grip is wide
SETTLE_S = 0.4  # the arm rests so long at most before the fingers move, and so long after it
STILL_S, STILL_M_PER_S = 0.05, 0.003  # between two checks of whether it is at rest; its speed there
FINGER_POLL_S = 0.1  # between two polls of the fingers
WEIGHED = (0.4, 0.6)  # shares of a path with a load between which its force is the zero of a contact
LOAD_ERROR_LIMIT_N = 3.5  # by which a load may be heavier or lighter than it was taught to be
MEET_S, MEET_N = 0.15, 4.0  # in which a contact comes to rest before it is pressed, and what holds it
NOTHING_TO_PRESS = "there is nothing to press on: no contact was made before"
CREEP_M_PER_S = 0.005  # mean speed up to which what is moved in a rest is no movement
MOST_CREEP_M_PER_S = 0.01  # of a hand in a rest


class SkillController:
    """Executes apps on a simulated arm: holds the setpoint and the direction of the contact, if any."""

    def __init__(self, arm: SimulatedArm, safety: Safety) -> None:
        self.arm, self.safety = arm, safety
        self._monitor = SafetyMonitor(arm, safety)
        self.setpoint = Setpoint(arm.measured.position, arm.measured.rotation)
        self.contact_direction: Array | None = None  # direction in which it stands on something
        self._pressed_n, self._correction_n = 0.0, 0.0
        self._settled_s = 0.0  # in which the contact that the last app made came to rest
        self._free_force = np.zeros(3)  # [N] that was felt on the way to it: by what its load was set wrong

    @property
    def measured(self) -> ArmMeasurement:
        """Return the measurement after the last tick."""
        return self.arm.measured

    @property
    def felt(self) -> Array:
        """The force (3,) [N] of the contact, relative to the force before it, as programs state forces."""
        return self.measured.force - self._free_force

    def run(self, app: App, following: App | None) -> None:
        """Execute an app. Raises RobotStopped."""
        self._settled_s = 0.0
        _SKILLS[app.kind](self, app, following)

    def hold_position(self, seconds: float, force_n: float | None = None) -> None:
        """Hold the position for `seconds`; in contact, with a force [N], by default the current one."""
        if self.contact_direction is not None:
            force_n = self._pressed_n if force_n is None else force_n
            self.press(min(force_n, self.safety.most_force_n), seconds)
            return
        still = self.setpoint.still
        for _ in range(round(seconds / DT)):
            self.tick(still)

    def pause(self, seconds: float, following: App | None) -> None:
        """Hold between two apps; the times in which a contact comes to rest and is released are part of it.

        If the hand crept to the start of the next path in a rest, so does the setpoint. In a contact that the
        next app leaves, it slides there with a light force, as a hand does that lets go. On a new contact the
        force of the next press rises before that press.
        """
        begins = None if following is None or following.path is None else following.path.start
        way_m = 0.0 if begins is None else math.dist(begins.position, self.setpoint.position)
        in_air = self.contact_direction is None and seconds > 0.0
        if in_air and begins is not None and way_m <= min(ASTRAY_M, MOST_CREEP_M_PER_S * seconds):
            creep = self._way_to(begins, seconds)
            for k in range(1, round(seconds / DT) + 1):
                self.tick(self._setpoint_at(creep, k * DT))
            return
        leaves = self.contact_direction is not None and _leaves_contact(following)
        rises = following is not None and following.force is not None and self._settled_s > 0.0
        force_n = rest_newtons(following)[0] if following is not None and rises else None
        left_s = max(seconds - self._settled_s - RELEASE_S * leaves, 0.0)
        if leaves and TOLERANCE_M < way_m <= self.safety.contact_speed_m_per_s * left_s:
            self.rest_until(begins, min(self._pressed_n, MEET_N), left_s)
            return
        self.hold_position(left_s, force_n)

    def send_fingers(self, width_m: float, app: App) -> None:
        """Come to rest, move the fingers to a width [m] or onto an object, and wait until the arm settles.

        app: has the place and the force; in contact the tool slides there first, and presses.
        """
        world, safety, place = self.arm.world, self.safety, _place_of(app)
        carried_kg, newton = self.arm.load_kg, self._standing_force(app)
        if place is None or self.contact_direction is None:
            self._come_to_rest(newton)
        else:
            way_s = math.dist(place.position, self.setpoint.position) / safety.contact_speed_m_per_s
            self.rest_until(place, newton, max(way_s, SETTLE_S))
        world.send_fingers(width_m, safety.gripper_m_per_s)
        for _ in range(round(safety.gripper_width_m / safety.gripper_m_per_s / FINGER_POLL_S)):
            self.hold_position(FINGER_POLL_S, newton)
            if not world.held_kg:
                self.arm.load_kg, self._free_force = 0.0, np.zeros(3)
                newton = self._standing_force(app, carried_kg)
            if world.fingers_still:
                break
        self.hold_position(SETTLE_S, newton)

    def _come_to_rest(self, force_n: float) -> None:
        """Hold the position until the arm is at rest, for `SETTLE_S` at most; force_n: of a contact."""
        for _ in range(round(SETTLE_S / STILL_S)):
            self.hold_position(STILL_S, force_n)
            if float(np.linalg.norm(self.measured.twist[:3])) <= STILL_M_PER_S:
                break

    def _standing_force(self, app: App, released_kg: float = 0.0) -> float:
        """Return the force [N] of a contact while fingers move: the taught one, or else the present one.

        The taught one includes the weight that was carried; released_kg: how much of it no longer is.
        """
        newton = self._pressed_n
        if app.force_taught is not None and self.contact_direction is not None:
            pressed = np.add(app.force_taught, (0.0, 0.0, GRAVITY * released_kg))
            newton = max(float(self.contact_direction @ pressed), LEAST_PRESS_N)
        return min(newton, self.safety.most_force_n)

    def tick(self, setpoint: Setpoint) -> ArmMeasurement:
        """Simulate one tick and check its measurement. Raises RobotStopped where a limit is reached."""
        self.setpoint = setpoint
        measured = self.arm.tick(setpoint)
        self._monitor.check_measurement(measured)
        return measured

    def brake(self, seconds: float) -> None:
        """Stop at the current place, with no force beyond the stiffness; limits are not checked."""
        still = Setpoint(self.measured.position, self.measured.rotation)
        for _ in range(round(seconds / DT)):
            still.position = still.position + 0.1 * (self.measured.position - still.position)
            self.arm.tick(still)

    def follow_path(self, app: App, *, approach: Array | None = None, passes_on: bool = False) -> None:
        """Follow an app's path.

        With `approach` (3,) until a contact in that direction, past the target if needed. passes_on: whether
        the next app continues from its target without a rest. Raises RobotStopped without such a contact, for
        one far from the taught one, and if the carried object is lighter or heavier than the app's load.
        """
        leaves_s = 0.0 if self.contact_direction is None else LEAVES_S
        self.release_contact()
        self._free_force = np.zeros(3)
        search, arriving = 0.0, None
        if approach is not None:
            search = arrival_speed(app, approach, self.setpoint.position, self.safety)
            arriving = search * approach
        moving = np.concatenate([self.setpoint.velocity, self.setpoint.turning])
        path = self.path_within_limits(app, _seconds(app), arriving, moving, passes_on=passes_on)
        seconds = float(path.t[-1])
        torque_stop = TorqueStop(app.screw)
        search_s = 0.0 if approach is None else self.safety.search_m / search
        weighs_from, weighed = (round(s * seconds / DT) if self.arm.load_kg else 0 for s in WEIGHED)
        blind = max(weighed, round(leaves_s / DT))
        for k in range(1, round((seconds + search_s) / DT) + 1):
            measured = self.tick(self._setpoint_at(path, k * DT))
            if torque_stop.reached(measured):
                self.setpoint = self.setpoint.still
                break
            if k == round(0.5 * (weighs_from + weighed)):
                self._check_load(measured)
            if approach is not None and k > blind and -float(approach.dot(self.felt)) > self.safety.contact_n:
                self._check_contact(app, measured)
                self._enter_contact(approach)
                self._settle_on_contact(approach)
                return
            if weighs_from < k <= weighed:
                self._free_force = self._free_force + self._weighed(measured) / (weighed - weighs_from)
        if approach is not None:
            raise RobotStopped(f"no contact within {1000 * self.safety.search_m:.0f} mm past its target")

    def press(
        self,
        force_n: float,
        seconds: float,
        aside: Array | None = None,
        path: Curve | None = None,
        screw: ScrewMotion | None = None,
        depth_m: float | None = 0.0,
    ) -> None:
        """Press along the direction of the contact for some seconds; aside: (3,) [N] across it.

        path: followed meanwhile across that direction; along it the force is controlled. The direction turns
        with the tool. screw: the screw motion meanwhile, until it is tight. depth_m: depth by which the
        object yields; it is pushed in by the force alone, and slower towards the bottom. Half of the time
        remains for holding it there, so pushing in may take half as long again. None for a stroke, which may
        lead up or down. Raises RobotStopped without a contact, or beyond the depth.
        """
        if self.contact_direction is None:
            raise RobotStopped(NOTHING_TO_PRESS)
        aside = np.zeros(3) if aside is None else aside
        rise = min(RISE_S, 0.4 * seconds)
        along, in_tool = self.contact_direction, self.setpoint.rotation.T @ self.contact_direction
        gain_per_s = force_gain_per_s(force_n, self.arm.mass_along(along))
        controller = ForceController(gain_per_s, self._correction_n, depth_m)
        began_n, still, torque_stop = self._pressed_n, self.setpoint.still, TorqueStop(screw)
        ticks, k, waited = round(seconds / DT), 0, 0
        while k - waited < ticks:
            k += 1
            waited += 2 * k > ticks > 2 * waited and controller.sinks
            share = min(k * DT / rise, 1.0)
            want_n = began_n + share * (force_n - began_n)
            setpoint = still if path is None else self._setpoint_at(path, k * DT)
            along = setpoint.rotation.dot(in_tool)
            speed, resists_n = (float(along.dot(v)) for v in (self.measured.twist[:3], -self.felt))
            push = along * controller.push_n(want_n, speed, resists_n) + share * aside
            measured = self.tick(replace(setpoint, push=push, along=along))
            if torque_stop.reached(measured):
                break
            controller.correct(want_n, speed, resists_n, DT)
            self._pressed_n, self._correction_n = want_n, controller.correction_n
            controller.sunk_m += DT * float(along.dot(measured.twist[:3]))
            self._check_depth(controller, along)
        deep = along * (along @ (self.measured.position - self.setpoint.position))
        self.contact_direction, self.setpoint.position = along, self.setpoint.position + deep

    def _check_depth(self, controller: ForceController, along: Array) -> None:
        """Check that there still is something to press on. Raises RobotStopped."""
        if controller.depth_m is None:
            beyond_m = float(along.dot(self.measured.position - self.setpoint.position))
        else:
            beyond_m = controller.sunk_m - max(controller.depth_m, 0.0)
        if beyond_m > self.safety.search_m:
            raise RobotStopped(f"nothing to press on within {1000 * self.safety.search_m:.0f} mm")

    def release_contact(self) -> None:
        """Reduce the contact force to zero, and hold the reached position."""
        if self.contact_direction is None:
            return
        along, began_n, correction = self.contact_direction, self._pressed_n, self._correction_n
        ticks = round(RELEASE_S / DT)
        for k in range(ticks):
            left = 1.0 - (k + 1) / ticks
            push = left * (began_n + correction) * along
            self.tick(Setpoint(self.measured.position, self.setpoint.rotation, push=push, along=along))
        self.contact_direction, self._pressed_n, self._correction_n = None, 0.0, 0.0
        self.setpoint = Setpoint(self.measured.position, self.setpoint.rotation)

    def path_within_limits(
        self,
        app: App,
        seconds: float,
        arriving: Array | None = None,
        moving: Array | None = None,
        *,
        passes_on: bool = False,
    ) -> Curve:
        """Plan the path of an app from the current pose, in its duration, or slower by the limits.

        Arguments as `app_path`.
        """
        here = self.setpoint
        lasting = partial(
            app_path, app, here.position, here.rotation, arriving=arriving, moving=moving, passes_on=passes_on
        )
        path = lasting(seconds)
        slower = max(self.safety.slower(*path.peaks()), self.arm.fastest_joint(path).slower)
        return path if slower == 1.0 else lasting(slower * seconds)

    def rest_until(self, begins: ViaPoint | None, force_n: float, seconds: float) -> None:
        """Press for `seconds`, and creep to the start of the next path, as the hand did in the rest."""
        here = self.setpoint
        if begins is None or math.dist(begins.position, here.position) > 2.0 * ASTRAY_M or seconds < RISE_S:
            self.hold_position(seconds, force_n)
            return
        self.press(force_n, seconds, path=self._way_to(begins, seconds), depth_m=None)

    def _way_to(self, place: ViaPoint, seconds: float) -> Curve:
        """Return the straight path from the setpoint to a position, in `seconds`."""
        poses = [[*self.setpoint.position], [*place.position]]
        if place.orientation is not None:
            poses = [[*poses[0], *quaternion_of(self.setpoint.rotation)], [*poses[1], *place.orientation]]
        return Curve.through([0.0, seconds], poses)

    def _setpoint_at(self, path: Curve, t: float) -> Setpoint:
        """Return the setpoint of a path at a time [s]; a path without orientation keeps the present one."""
        value, velocity, acceleration = path.at(t)
        setpoint = Setpoint(value[:3], self.setpoint.rotation, velocity[:3], acceleration[:3])
        if len(value) == 7:
            x, y, z, w = value[3:].tolist()
            setpoint.rotation = matrix_of((x, y, z, w))
            turning = turning_of(value[3:], velocity[3:], acceleration[3:])
            setpoint.turning, setpoint.angular_acceleration = turning
        return setpoint

    def _weighed(self, measured: ArmMeasurement) -> Array:
        """Return the measured force (3,) [N] without the inertia of the stated load: that is no weight."""
        return np.asarray(measured.force + self.arm.load_kg * self.setpoint.acceleration)

    def _check_load(self, measured: ArmMeasurement) -> None:
        """Check the carried weight against the load of the program.

        Raises RobotStopped for a difference, because it would appear as a contact.
        """
        wrong = float(self._weighed(measured)[2])
        if abs(wrong) > LOAD_ERROR_LIMIT_N:
            how = "lighter" if wrong > 0.0 else "heavier"
            load = f"{self.arm.load_kg:.2f} kg of its load"
            raise RobotStopped(f"the carried object is {abs(wrong):.1f} N {how} than the {load}")

    def _check_contact(self, app: App, measured: ArmMeasurement) -> None:
        """Check that a contact is near the taught one. Raises RobotStopped for another obstacle."""
        off, most = math.dist(measured.position, app.target or measured.position), self.safety.search_m
        if off > most:
            where = f"contact {1000 * off:.0f} mm from where it was taught"
            raise RobotStopped(f"{where}, at most {1000 * most:.0f} mm")

    def _settle_on_contact(self, along: Array) -> None:
        """Come to rest on a new contact, so that it and the next app are separate events."""
        still = replace(self.setpoint, push=MEET_N * along)
        for _ in range(round(MEET_S / DT)):
            self.tick(still)
        self._settled_s = MEET_S
        self._enter_contact(along)

    def _enter_contact(self, along: Array) -> None:
        self.contact_direction = along
        self._pressed_n, self._correction_n = max(-float(along @ self.felt), 0.0), 0.0
        self.setpoint = Setpoint(self.measured.position, self.setpoint.rotation)


class TorqueStop:
    """Ends a turn at a torque limit about its axis, which follows from the taught torque."""

    def __init__(self, screw: ScrewMotion | None) -> None:
        """screw: with the torque that the robot exerts; without one the limit is never reached."""
        self._most_nm = stop_torque_nm(screw)
        if screw is not None:
            self._axis, self._point = np.array(screw.axis), np.array(screw.point)

    def reached(self, measured: ArmMeasurement) -> bool:
        """Return whether the torque about the axis exceeds the limit.

        The moment r × F of the flange's lever is subtracted.
        """
        if self._most_nm is None:
            return False
        about_point = measured.torque + cross(measured.position - self._point, measured.force)
        return -float(self._axis @ about_point) > self._most_nm


def target_pose(controller: SkillController, app: App) -> tuple[Array, Array]:
    """Return place (3,) and rotation (3, 3) of an app's target; the present ones where it states none."""
    position = controller.setpoint.position if app.target is None else np.array(app.target)
    rotation = controller.setpoint.rotation if app.orientation is None else matrix_of(app.orientation)
    return position, rotation


def _seconds(app: App) -> float:
    """Return the duration [s] of an app's path; without a path, that of the app."""
    return app.tn - app.t0 if app.path is None else app.path.tn - app.path.start.t


def _leaves_contact(following: App | None) -> TypeGuard[App]:
    """Return whether there is a next app and it leaves the contact."""
    return following is not None and APP_KINDS[following.kind].has_target


def _move(controller: SkillController, app: App, following: App | None) -> None:
    _, rotation = target_pose(controller, app)
    approach = approach_direction(app, following, rotation)
    controller.follow_path(app, approach=approach, passes_on=goes_on(app, following))


def _transport(controller: SkillController, app: App, following: App | None) -> None:
    controller.arm.load_kg = app.load_kg or 0.0
    _move(controller, app, following)


def _apply_force(controller: SkillController, app: App, following: App | None) -> None:
    force = np.array(app.force)
    if controller.contact_direction is None:
        raise RobotStopped(NOTHING_TO_PRESS)
    along = controller.contact_direction
    target, _ = target_pose(controller, app)
    across = (target - controller.setpoint.position) - along * (
        along @ (target - controller.setpoint.position)
    )
    slides = float(np.linalg.norm(across)) > SLIDE_M
    size, aside = float(np.linalg.norm(force)), force - along * (along @ force)
    straight = size if slides else float(np.sqrt(max(size**2 - aside @ aside, 0.0)))
    depth = float(along @ (target - controller.setpoint.position))
    (before_s, after_s), (before_n, after_n) = rests_of(app), rest_newtons(app)
    seconds = _seconds(app)
    lets_go_s = max(RELEASE_S - (following.t0 - app.tn), 0.0) if _leaves_contact(following) else 0.0
    if app.path is None:
        seconds = max(seconds - lets_go_s, 0.5 * seconds)
    else:
        controller.rest_until(app.path.start, straight if app.rest_before is None else before_n, before_s)
    path = None
    if app.target is not None:
        path = controller.path_within_limits(app, seconds)
        seconds = float(path.t[-1])
    controller.press(straight, seconds, None if slides else aside, path, app.screw, None if slides else depth)
    onward = None if following is None or following.path is None else following.path.start
    rest_n = straight if app.rest_after is None else after_n
    controller.rest_until(onward, rest_n, max(after_s - lets_go_s, 0.0))


def _grasp(controller: SkillController, app: App, following: App | None) -> None:
    world = controller.arm.world
    controller.send_fingers(max((app.gripper_width or 0.0) - SQUEEZE_M, 0.0), app)
    if not world.held_kg:
        raise RobotStopped(f"nothing between the fingers, which stand at {1000 * world.width_m:.0f} mm")


def _move_fingers(controller: SkillController, app: App, following: App | None) -> None:
    width = controller.safety.gripper_width_m if app.gripper_width is None else app.gripper_width
    controller.send_fingers(width, app)


def _place_of(app: App) -> ViaPoint | None:
    """Return the taught pose at which the fingers move; None without a target."""
    return (
        None if app.target is None else ViaPoint(t=app.t0, position=app.target, orientation=app.orientation)
    )


_SKILLS: Mapping[AppKind, Callable[[SkillController, App, App | None], None]] = {
    "cartesian_motion": _move,
    "move_to_contact": _move,
    "apply_force": _apply_force,
    "grasp": _grasp,
    "gripper_move": _move_fingers,
    "transport": _transport,
    "hold": _transport,
}
