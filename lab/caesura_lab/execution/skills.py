"""What the robot does for each kind of app. An act moves the setpoint tick by tick until its app is done.

Movements that a contact ends arrive at their target with the speed of a search, and go on until
something is felt. In contact the force is controlled along the direction of the press, the place across it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from caesura_lab.execution.safety_monitor import SafetyMonitor, Stopped
from caesura_lab.execution.simulated_arm import ArmMeasurement, Setpoint, SimulatedArm
from caesura_lab.execution.trajectories import ASTRAY_M, arrival_speed, course, press_direction
from caesura_lab.teacher.motion_profiles import Array
from caesura_lab.teacher.plan import DT
from caesura_protocol.messages import App, AppKind, ScrewMotion
from caesura_protocol.paths import Curve
from caesura_protocol.programs.app_kinds import APP_KINDS
from caesura_protocol.programs.safety import Safety
from caesura_protocol.rotations import cross, matrix_of, turning_of
from caesura_protocol.screw_motion import tight_nm

RISE_S, LET_GO_S = 0.15, 0.15  # longest time in which a force is built up; in which it is let go
FORCE_GAIN_PER_S, FORCE_CORRECTION_N = 40.0, 8.0
YIELDING_M_PER_S = 0.003  # what gives way faster says nothing yet of the force at rest
STANDING_N = 10.0  # with which it stands while the fingers move
SLIDE_M = 0.015  # a target of Apply Force this far aside is slid to
SQUEEZE_M = 0.01  # by which fingers aim to close further than what they grip is wide
SETTLE_S, LOOK_S = 0.4, 0.1  # before and after the fingers move; between two looks at them
MISWEIGHED_N = 3.5  # by which a load may be heavier or lighter than it was taught to be
MEET_S, MEET_N = 0.15, 4.0  # in which a contact comes to rest before it is pressed, and what holds it
NOTHING_TO_PRESS = "there is nothing to press on: no contact was made before"
YIELD_M = 0.012  # from which depth on a target in a contact is one that gives way
SINK_S = 0.3  # least time for pushing it in
SINKING_M_PER_S = 0.09  # on its way there, on average
SINK_M_PER_S, BEYOND_M = 0.02, 0.008  # with which it meets the bottom, and how far it looks for it
CREEP_M_PER_S = 0.005  # mean speed up to which what is moved in a rest is no movement
JOINT_SHARE = 0.85  # of a joint's speed limit that a path may ask for


class SkillController:
    """A robot under way through a program: where its setpoint is, and whether it stands on something."""

    def __init__(self, arm: SimulatedArm, safety: Safety) -> None:
        self.arm, self.safety = arm, safety
        self._guard = SafetyMonitor(arm, safety)
        self.setpoint = Setpoint(arm.felt.position, arm.felt.rotation)
        self.along: Array | None = None  # direction in which it stands on something
        self._pressed_n, self._correction_n = 0.0, 0.0

    @property
    def felt(self) -> ArmMeasurement:
        """The arm after the last tick."""
        return self.arm.felt

    def run(self, app: App, following: App | None) -> None:
        """Do an app. Raises Stopped."""
        _ACTS[app.kind](self, app, following)

    def stay(self, seconds: float, force_n: float | None = None) -> None:
        """Hold the place for some seconds, or stand on a contact with a force [N], by default as it does."""
        if self.along is not None:
            force_n = self._pressed_n if force_n is None else force_n
            self.press(min(force_n, self.safety.most_force_n), seconds)
            return
        for _ in range(round(seconds / DT)):
            self.tick(self.setpoint.still)

    def pause(self, seconds: float, following: App | None) -> None:
        """Stay between two apps; the time in which a contact is let go is part of it.

        Where a hand crept in a rest to the start of the next path, the setpoint does.
        """
        path = None if following is None else following.path
        if self.along is None and path is not None and seconds > 0.0:
            start, here = np.array(path.start.position), self.setpoint.position
            way = float(np.linalg.norm(start - here))
            if way <= ASTRAY_M and way <= CREEP_M_PER_S * seconds:
                creep = Curve.through([0.0, seconds], [here, start])
                for k in range(1, round(seconds / DT) + 1):
                    self.tick(self._on(creep, k * DT))
                return
        leaves = self.along is not None and following is not None and APP_KINDS[following.kind].has_target
        self.stay(max(seconds - LET_GO_S, 0.0) if leaves else seconds)

    def send_fingers(self, width_m: float) -> None:
        """Stand firmly, move the fingers to a width [m] or to what is between them, and let it settle."""
        world, safety = self.arm.world, self.safety
        self.stay(SETTLE_S, STANDING_N)
        world.send_fingers(width_m, safety.gripper_m_per_s)
        for _ in range(round(safety.gripper_width_m / safety.gripper_m_per_s / LOOK_S)):
            self.stay(LOOK_S, STANDING_N)
            if world.fingers_still:
                break
        self.stay(SETTLE_S, STANDING_N)

    def tick(self, setpoint: Setpoint) -> ArmMeasurement:
        """One tick. Raises Stopped where a limit is reached."""
        self.setpoint = setpoint
        felt = self.arm.tick(setpoint)
        self._guard.look(felt)
        return felt

    def brake(self, seconds: float) -> None:
        """Stop where it is: no force but that of its stiffness about the place; without a guard."""
        still = Setpoint(self.felt.position, self.felt.rotation)
        for _ in range(round(seconds / DT)):
            still.position = still.position + 0.1 * (self.felt.position - still.position)
            self.arm.tick(still)

    def go(self, app: App, *, until: Array | None = None) -> None:
        """Follow an app's path; or until something is felt in a direction (3,), past its target if need."""
        self.let_go()
        search = self._search_speed(app, until)
        path = self.course(app, _seconds(app), None if until is None else search * until)
        seconds = float(path.t[-1])
        tight = Tight(app.screw)
        search_s = 0.0 if until is None else self.safety.search_m / search
        weighed = round(0.5 * seconds / DT) if self.arm.load_kg else 0
        for k in range(1, round((seconds + search_s) / DT) + 1):
            felt = self.tick(self._on(path, k * DT))
            if tight.reached(felt):
                break
            if k == weighed:
                self._weigh(felt)
            if until is not None and k > weighed and -float(until @ felt.force) > self.safety.contact_n:
                self._stand_on(until)
                self._meet(until)
                return
        if until is not None:
            raise Stopped(f"no contact within {1000 * self.safety.search_m:.0f} mm past its target")

    def press(
        self,
        force_n: float,
        seconds: float,
        aside: Array | None = None,
        path: Curve | None = None,
        screw: ScrewMotion | None = None,
    ) -> None:
        """Press along the direction of the contact for some seconds; aside: (3,) [N] across it.

        path: to follow across that direction meanwhile; along it the force decides. The direction turns with
        the tool. screw: what is turned meanwhile, until it is tight.
        """
        if self.along is None:
            raise Stopped(NOTHING_TO_PRESS)
        aside = np.zeros(3) if aside is None else aside
        rise = min(RISE_S, 0.4 * seconds)
        along, in_tool = self.along, self.setpoint.rotation.T @ self.along
        began_n, sunk = self._pressed_n, 0.0
        still = self.setpoint.still
        tight = Tight(screw)
        for k in range(1, round(seconds / DT) + 1):
            share = min(k * DT / rise, 1.0)
            want = began_n + share * (force_n - began_n)
            setpoint = still if path is None else self._on(path, k * DT)
            along = setpoint.rotation @ in_tool
            push = along * (want + self._correction_n) + share * aside
            felt = self.tick(replace(setpoint, push=push, along=along))
            if tight.reached(felt):
                break
            self._pressed_n = want
            wrong = want + float(along @ felt.force)
            self._correction_n = float(
                np.clip(
                    self._correction_n + FORCE_GAIN_PER_S * DT * wrong,
                    -FORCE_CORRECTION_N,
                    FORCE_CORRECTION_N,
                )
            )
            sunk += DT * float(along @ felt.twist[:3])
            if sunk > self.safety.search_m:
                raise Stopped(f"nothing to press on within {1000 * self.safety.search_m:.0f} mm")
        deep = along * (along @ (self.felt.position - self.setpoint.position))
        self.along, self.setpoint.position = along, self.setpoint.position + deep

    def sink(self, depth_m: float, force_n: float, seconds: float) -> None:
        """Push in what gives way, by a depth [m] along the contact, or until it pushes back with a force."""
        along = self.along
        if along is None:
            raise Stopped(NOTHING_TO_PRESS)
        start = self.setpoint.position
        leaving = along * max(float(along @ self.felt.twist[:3]), 0.0)
        arriving = SINK_M_PER_S * along
        ends = [start, start + depth_m * along]
        path = Curve.through([0.0, seconds], ends, leaving=leaving, arriving=arriving)
        for k in range(1, round((seconds + BEYOND_M / SINK_M_PER_S) / DT) + 1):
            felt = self.tick(self._on(path, k * DT))
            if -float(along @ felt.force) >= force_n:
                break
        self._stand_on(along)

    def let_go(self) -> None:
        """Take the force back, and hold the place that was reached."""
        if self.along is None:
            return
        along, began_n, correction = self.along, self._pressed_n, self._correction_n
        ticks = round(LET_GO_S / DT)
        for k in range(ticks):
            left = 1.0 - (k + 1) / ticks
            push = left * (began_n + correction) * along
            self.tick(Setpoint(self.felt.position, self.setpoint.rotation, push=push, along=along))
        self.along, self._pressed_n, self._correction_n = None, 0.0, 0.0
        self.setpoint = Setpoint(self.felt.position, self.setpoint.rotation)

    def course(self, app: App, seconds: float, arriving: Array | None = None) -> Curve:
        """The path of an app from where the robot is, in its seconds, or slower where a limit asks for it."""
        here = self.setpoint
        path = course(app, here.position, here.rotation, seconds, arriving)
        slower = max(self.safety.slower(*path.peaks()), self.arm.joint_hurry(path) / JOINT_SHARE)
        if slower == 1.0:
            return path
        return course(app, here.position, here.rotation, slower * seconds, arriving)

    def _on(self, path: Curve, t: float) -> Setpoint:
        """Where a path is at a time [s]; without orientation it keeps the one that it has."""
        value, velocity, acceleration = path.at(t)
        setpoint = Setpoint(value[:3], self.setpoint.rotation, velocity[:3], acceleration[:3])
        if len(value) == 7:
            x, y, z, w = value[3:].tolist()
            setpoint.rotation = matrix_of((x, y, z, w))
            turning = turning_of(value[3:], velocity[3:], acceleration[3:])
            setpoint.turning, setpoint.angular_acceleration = turning
        return setpoint

    def _search_speed(self, app: App, until: Array | None) -> float:
        """Speed [m/s] with which a contact is met in a direction (3,); that of no way without one."""
        way = target_of(self, app)[0] - self.setpoint.position
        return arrival_speed(0.0 if until is None else float(until @ way), _seconds(app), self.safety)

    def _weigh(self, felt: ArmMeasurement) -> None:
        """Compare what hangs on the arm with what the program says; what is off would pass for a contact."""
        wrong = float(felt.force[2])
        if abs(wrong) > MISWEIGHED_N:
            how = "lighter" if wrong > 0.0 else "heavier"
            load = f"{self.arm.load_kg:.2f} kg of its load"
            raise Stopped(f"what is carried is {abs(wrong):.1f} N {how} than the {load}")

    def _meet(self, along: Array) -> None:
        """Come to rest on what was met, so that it is one event and what follows another."""
        still = replace(self.setpoint, push=MEET_N * along)
        for _ in range(round(MEET_S / DT)):
            self.tick(still)
        self._stand_on(along)

    def _stand_on(self, along: Array) -> None:
        self.along = along
        self.arm.load_kg = 0.0  # what is held rests on what is stood on
        self._pressed_n, self._correction_n = max(-float(along @ self.felt.force), 0.0), 0.0
        self.setpoint = Setpoint(self.felt.position, self.setpoint.rotation)


class Tight:
    """Whether what is turned resists more than it was taught to: then its app is done."""

    def __init__(self, screw: ScrewMotion | None) -> None:
        """screw: with the torque that the robot exerts; without one nothing is ever tight."""
        self._most_nm = tight_nm(screw)
        if screw is not None:
            self._axis, self._point = np.array(screw.axis), np.array(screw.point)

    def reached(self, felt: ArmMeasurement) -> bool:
        """Whether the torque about the axis, r × F of the flange's lever taken out, says so."""
        if self._most_nm is None:
            return False
        about_point = felt.torque + cross(felt.position - self._point, felt.force)
        return -float(self._axis @ about_point) > self._most_nm


def target_of(acting: SkillController, app: App) -> tuple[Array, Array]:
    """Place (3,) and rotation (3, 3) where an app leads; where it is, for what it does not say."""
    position = acting.setpoint.position if app.target is None else np.array(app.target)
    rotation = acting.setpoint.rotation if app.orientation is None else matrix_of(app.orientation)
    return position, rotation


def _seconds(app: App) -> float:
    return app.tn - app.t0


def _move(acting: SkillController, app: App, following: App | None) -> None:
    acting.go(app)


def _touch(acting: SkillController, app: App, following: App | None) -> None:
    _, rotation = target_of(acting, app)
    force = following.force if following is not None and following.kind == "apply_force" else None
    until = press_direction(rotation, None if force is None else np.array(force))
    acting.go(app, until=until)


def _carry(acting: SkillController, app: App, following: App | None) -> None:
    acting.arm.load_kg = app.load_kg or 0.0
    if following is not None and APP_KINDS[following.kind].in_contact:
        _touch(acting, app, following)
    else:
        _move(acting, app, following)


def _apply(acting: SkillController, app: App, following: App | None) -> None:
    force = np.array(app.force)
    if acting.along is None:
        raise Stopped(NOTHING_TO_PRESS)
    along = acting.along
    target, _ = target_of(acting, app)
    across = (target - acting.setpoint.position) - along * (along @ (target - acting.setpoint.position))
    slides = float(np.linalg.norm(across)) > SLIDE_M
    size, aside = float(np.linalg.norm(force)), force - along * (along @ force)
    straight = size if slides else float(np.sqrt(max(size**2 - aside @ aside, 0.0)))
    seconds, depth = _seconds(app), float(along @ (target - acting.setpoint.position))
    if depth > YIELD_M and not slides:
        sinking = min(max(SINK_S, depth / SINKING_M_PER_S), 0.5 * seconds)
        acting.sink(depth, straight, sinking)
        seconds -= sinking
    path = None
    if app.target is not None:
        path = acting.course(app, seconds)
        seconds = float(path.t[-1])
    acting.press(straight, seconds, None if slides else aside, path, app.screw)


def _grasp(acting: SkillController, app: App, following: App | None) -> None:
    world = acting.arm.world
    acting.send_fingers(max((app.gripper_width or 0.0) - SQUEEZE_M, 0.0))
    if not world.held_kg:
        raise Stopped(f"nothing between the fingers, which stand at {1000 * world.width_m:.0f} mm")


def _move_fingers(acting: SkillController, app: App, following: App | None) -> None:
    width = acting.safety.gripper_width_m if app.gripper_width is None else app.gripper_width
    acting.send_fingers(width)
    if not acting.arm.world.held_kg:
        acting.arm.load_kg = 0.0


_ACTS: Mapping[AppKind, Callable[[SkillController, App, App | None], None]] = {
    "cartesian_motion": _move,
    "move_to_contact": _touch,
    "apply_force": _apply,
    "grasp": _grasp,
    "gripper_move": _move_fingers,
    "transport": _carry,
    "hold": _carry,
}
