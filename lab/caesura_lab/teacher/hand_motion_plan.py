"""Computes the intended motion and force of the hand at every tick from a scenario and a person.

The plan is made before the first tick and draws all random events of the hand, so that a demonstration does
not depend on its division into chunks. The simulation computes the result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise, zip_longest
from math import exp

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from caesura_lab.teacher.habits import IDEAL
from caesura_lab.teacher.hand_force import ForceProfile, ForceSetpoint, force_goal, force_profile
from caesura_lab.teacher.level_surface_contact import Surface
from caesura_lab.teacher.motion_profiles import Array, Movement, Stroke, Vector, path, time_of_share
from caesura_lab.teacher.noise import band_noise, ornstein_uhlenbeck
from caesura_lab.teacher.person import Person
from caesura_lab.teacher.phase_truth import PhaseStart
from caesura_lab.teacher.scenarios import FINGERS_BELOW_FLANGE_M, Kind, Scenario, Step, tips
from caesura_lab.teacher.shaped_surface_contact import HorizontalCylinder
from caesura_lab.teacher.submovement_synthesis import Sweep, draw_bow, draw_submovements
from caesura_lab.teacher.tool_turns import Turns, turning_torque, turns_about

TICKS_PER_S = 1000.0
DT = 1.0 / TICKS_PER_S  # [s]
FINGER_TRAVEL_S = 0.56
WIDTH_OPEN_M, WIDTH_OBJECT_M = 0.08, 0.05
MOVING = ("move", "touch", "slide", "turn", "circle", "insert")  # steps whose time is that of a speed
PASSING_OVERLAP = 0.13  # of a stroke's duration, by which it and the next reach into each other
RELEASE_S = 0.3  # in which a force is let go when the hand leaves
PRESS_RISE_S = 0.5  # longest time in which a hand builds a force up
PRELOAD_LEAD_S = 0.16
CREEP_M_PER_S = 0.005  # intended speed at which the hand fully overcomes the arm's friction
FELT_MASS_KG, FELT_DAMPING_NS_PER_M = 8.0, 20.0  # what a person expects of the guided arm
FEED_FORWARD_LIMIT_N = 20.0
TREMOR_HZ, UNREST_HZ = (8.0, 12.0), (1.5, 6.0)
FULL_UNREST_M_PER_S = 0.1
WANDER_S = 0.8
TURN_WANDER_NM = 0.05
LATERAL_PRESS_SHARE = 0.07  # no person presses exactly along the normal
LONG_PAUSE_S, LONG_MOVE_M = 0.8, 0.08
BRIEF_PRESS_S = (0.25, 0.5)
DRIFT_S, DRIFT_M_PER_S = (0.3, 1.0), (0.002, 0.010)  # creep beside a rest: how long, how fast at most
SLOW_M_PER_S = 0.025  # mean speed of tracing
APPROACH_M, APPROACH_SHARE = (0.008, 0.03), (0.25, 0.5)  # last part of a touch: height, share of its duration
TEMPO_HZ = (0.3, 2.0)
TEMPO_LIMIT = 0.8  # speed never changes by more than this share
ANGLE_FACTORS = (0.7, 1.2)  # least and largest share of a scenario's angles that a person turns by
OVERTURN, OVERTURN_SHARE = 0.35, (0.02, 0.06)  # probability of turning too far, by which share
CIRCLE_POINTS = 8  # in a round, through which a circle is drawn
ROUND_SPREAD = 0.5  # of a circle's radius from point to point, times the person's irregularity
LONGEST_LEAD_S = 0.15  # by which a change of tempo may shift an event
FULL_SPEED_NOISE = 2.0  # times the noise at 0.1 m/s, reached in proportion to the speed


@dataclass(frozen=True)
class Plan:
    """Intended motion and force of a hand, tick by tick (n ticks of `DT`).

    position: (n, 3) [m] intended position of the flange; velocity: (n, 3) [m/s]; force: (n, 3) [N] and
    torque: (n, 3) [Nm] that the hand adds to those that hold the position; feed_forward: (n, 3) [N], the part
    of the force that moves the arm; press: (n,) [N] intended force on the surface; aims: intended force where
    the hand controls it; width: (n,) [m] between the fingers; load_kg: (n,) [kg] held by them; turns:
    intended orientation of the tool, None if it does not change; phases: intended beginning of each skill.
    All in the base frame.
    """

    scenario: Scenario
    person: Person
    position: Array
    velocity: Array
    force: Array
    torque: Array
    feed_forward: Array
    press: Array
    aims: ForceProfile
    width: Array
    load_kg: Array
    turns: Turns | None = None
    phases: tuple[PhaseStart, ...] = ()

    @property
    def ticks(self) -> int:
        """Length of the demonstration in ticks."""
        return len(self.position)


def make_plan(scenario: Scenario, person: Person, rng: np.random.Generator) -> Plan:
    """Draw one demonstration of a scenario by a person."""
    planner = _Planner(scenario, person, rng)
    for step, duration in zip(scenario.steps, _durations(scenario.steps, person, rng), strict=True):
        planner.add(step, duration)
    n = round(planner.now / DT)
    t = np.arange(n) / TICKS_PER_S
    even = _with_tempo(t, person, rng)
    moved = _smoothed(path(scenario.start, planner.strokes, even), person)
    turns = None
    if scenario.turn_axis is not None:
        angle = _smoothed(path((0.0, 0.0, 0.0), planner.turns, even), person)[:, 0]
        turns = turns_about(scenario.turn_axis, angle, DT)
        moved += turns.swing(FINGERS_BELOW_FLANGE_M)
    velocity: Array = np.gradient(moved, DT, axis=0)
    pushed = path((0.0, 0.0, 0.0), planner.pushes, t)
    if turns is not None:
        pushed = turns.along_tool(pushed)
    feed_forward = _feed_forward(velocity, person)
    force = pushed + feed_forward + _unsteadiness(velocity, person, rng)
    width, held = _gripper(
        t, planner.closed_s, planner.opened_s, any(s.kind == "grasp" for s in scenario.steps)
    )
    torque = TURN_WANDER_NM * ornstein_uhlenbeck(n, 3, WANDER_S, TICKS_PER_S, rng)
    if turns is not None:
        torque += turning_torque(turns, person, DT, rng)
    return Plan(
        scenario,
        person,
        position=moved + path((0.0, 0.0, 0.0), planner.shifts, t),
        velocity=velocity,
        force=force,
        torque=torque,
        feed_forward=feed_forward,
        press=path((0.0, 0.0, 0.0), planner.presses, t)[:, 2],
        aims=force_profile(planner.aims, t),
        width=width,
        load_kg=person.load_kg * held.astype(np.float64),
        turns=turns,
        phases=tuple(planner.phases),
    )


def _smoothed(path: Array, person: Person) -> Array:
    """Return a path (n, k) as a hand follows it, with rounded corners."""
    return np.asarray(gaussian_filter1d(path, person.habits.smoothing_s / DT, axis=0, mode="nearest"))


class _Planner:
    """Converts steps into strokes in order; tracks the place and time of the hand."""

    def __init__(self, scenario: Scenario, person: Person, rng: np.random.Generator) -> None:
        self.scenario, self.person, self.rng = scenario, person, rng
        self.now = 0.0  # [s]
        self.overlap = 0.0  # share of a step's duration by which it reaches into the next
        self.lead = 0.0  # [s] by which the next step begins early, because the last one does not stop
        self.place = np.array(scenario.start)  # [m] where the strokes so far lead
        self.push = np.zeros(3)  # [N] what the hand adds to holding its place
        self.press = 0.0  # [N] intended force on the surface
        self.strokes: list[Movement] = []
        self.angle = 0.0  # [rad] to which the turns so far lead
        self.turns: list[Movement] = []  # of the tool, [rad] in the first of three columns
        self.angle_factor = self._draw_angle_factor()
        self.phases: list[PhaseStart] = []
        self.inserted_m = 0.0  # how far below the surface the tip stands in a hole
        self.shifts: list[Stroke] = []  # of the place it holds, without meaning to move
        self.pushes: list[Stroke] = []
        self.presses: list[Stroke] = []
        self.aims: list[ForceSetpoint] = []
        self.aside = (0.0, 0.0)  # share of a press that goes sideways, as long as it lasts
        self.touch_s: float | None = None  # [s] since when it has been about to touch
        self.closed_s: list[float] = []
        self.opened_s: list[float] = []

    def add(self, step: Step, duration: float) -> None:
        """Append a step that takes a duration [s]."""
        self.now -= self.lead
        self.overlap = self._draw_overlap(step)
        if step.begins is not None:
            self.phases.append(PhaseStart(*step.begins, self.now))
        before = len(self.strokes)
        _STEPS[step.kind](self, step, duration + self.lead)
        if step.angle_deg is not None and step.kind != "turn":
            self._turn_along(self.strokes[before], self._angle(step.angle_deg))
        self.now += self.lead + duration
        self.lead = self.overlap * duration

    def _draw_overlap(self, step: Step) -> float:
        """Draw by which share of its duration a step that passes its goal reaches into the next."""
        rounding = self.person.habits.rounding
        rounder = self.rng.uniform(0.0, 2.0 * rounding) if rounding else 0.0
        return (PASSING_OVERLAP + rounder) * step.passing

    def _draw_angle_factor(self) -> float:
        """Draw by how much this person turns more or less than the scenario says."""
        if not (self.scenario.angle_spread and self.person.irregularity):
            return 1.0
        return float(np.clip(1.0 + self.scenario.angle_spread * self.rng.normal(), *ANGLE_FACTORS))

    def _angle(self, degrees: float) -> float:
        return self.angle_factor * float(np.radians(degrees))

    def _turn_along(self, stroke: Movement, angle: float) -> None:
        """Turn the tool to an angle [rad] with the same progress as a stroke."""
        by = np.array([angle - self.angle, 0.0, 0.0])
        if isinstance(stroke, Sweep):
            places = np.vstack([np.zeros(3), by])
            straight = replace(stroke, places=places, bow=np.zeros((2, 3)), deviation=np.zeros((0, 3)))
            self.turns.append(straight)
        elif isinstance(stroke, Stroke):
            self.turns.append(replace(stroke, displacement=by, deviation=np.zeros((0, 3))))
        self.angle = angle

    def _turn(self, step: Step, duration: float) -> None:
        """Turn the tool about its tip, which stays; by chance a little too far and back."""
        if step.angle_deg is None:
            raise ValueError(f"step turn of {self.scenario.name} has no angle_deg")
        angle, habits = self._angle(step.angle_deg), self.person.habits
        if self.press > 0.0:
            self._press_down(self._force(step), min(PRESS_RISE_S, duration), duration, yields=False)
        over = 0.0
        if habits != IDEAL and self.rng.random() < OVERTURN:
            over = self.rng.uniform(*OVERTURN_SHARE) * (angle - self.angle)
        lasts = duration * (0.8 if over else 1.0)
        submovements = draw_submovements(lasts, habits, self.rng)
        by = np.array([[0.0, 0.0, 0.0], [angle + over - self.angle, 0.0, 0.0]])
        self.turns.append(Sweep(self.now, lasts, by, submovements))
        if over:
            back = np.array([-over, 0.0, 0.0])
            self.turns.append(Stroke(self.now + 0.7 * duration, 0.3 * duration, back))
        self.angle = angle

    def _circle(self, step: Step, duration: float) -> None:
        """Go round a level circle that begins and ends here, its centre ahead along the base's x axis."""
        turned = 2.0 * np.pi * np.arange(1, CIRCLE_POINTS * step.rounds) / CIRCLE_POINTS
        spread = ROUND_SPREAD * self.person.irregularity
        radius = step.radius_m * (1.0 + (spread * self.rng.normal(size=turned.size) if spread else 0.0))
        center = self.place + np.array([step.radius_m, 0.0, 0.0])
        x, y = center[0] - radius * np.cos(turned), center[1] - radius * np.sin(turned)
        via = np.column_stack([x, y, np.full(turned.size, center[2])])
        goal = self.place.copy()
        self._stroke(goal, duration, via=tuple(tuple(point) for point in via.tolist()))

    def _insert(self, step: Step, duration: float) -> None:
        """Push down along the tool, to the place of the step, with a force."""
        goal = np.array([*self.place[:2], np.array(step.to)[2]])
        self.inserted_m = float(self.place[2] - goal[2])
        self._ideal_stroke(goal, duration, flat=True)
        self._press_down(self._force(step), min(PRESS_RISE_S, duration), duration, yields=False)

    def _move(self, step: Step, duration: float) -> None:
        goal = self._scattered(step)
        self.inserted_m = 0.0
        self._release_force(min(RELEASE_S, duration))
        long = not step.passing and not step.via and np.linalg.norm(goal - self.place) > LONG_MOVE_M
        if long and self.rng.random() < self.person.hesitation:
            self._hesitate(goal, duration)
        else:
            self._stroke(goal, duration * (1.0 + self.overlap), via=step.via)

    def _hesitate(self, goal: Array, duration: float) -> None:
        """Go part of the way, stop, go on; the demonstration gets longer by the stop."""
        share, stop = self.rng.uniform(0.35, 0.65), self.rng.uniform(0.13, 0.6)
        self._stroke(self.place + share * (goal - self.place), share * duration)
        self.now += stop
        self._stroke(goal, (1.0 - share) * duration, delay=share * duration)

    def _touch(self, step: Step, duration: float) -> None:
        """Arrive above the target when the surface stops the fall, which aims slightly below the surface."""
        goal = self._scattered(step)
        fall = self.place[2] - goal[2]
        share = time_of_share(self.person.profile, fall / (fall + self.person.impact_m))
        ideal = self.person.habits == IDEAL
        self._stroke(np.array([*goal[:2], self.place[2]]), duration, flat=not ideal)
        below = goal - (0.0, 0.0, self.person.impact_m)
        if ideal:
            self._stroke(below, duration / share)
        else:
            self._approach(below, duration)
        self.touch_s = self.now

    def _approach(self, below: Array, duration: float) -> None:
        """Go down to a little above a surface, then touch it slowly, at the end of a duration."""
        fall = self.place[2] - below[2]
        height, part = min(0.5 * fall, self.rng.uniform(*APPROACH_M)), self.rng.uniform(*APPROACH_SHARE)
        last = height + self.person.impact_m
        above = below + np.array([0.0, 0.0, last])
        share = time_of_share(self.person.profile, height / last)
        self._stroke(above, (1.0 - 0.5 * part) * duration)
        self._stroke(below, part * duration / share, delay=(1.0 - part) * duration)

    def _press(self, step: Step, duration: float) -> None:
        surface, force = self._surface_below(self.place), self._force(step)
        rise = min(PRESS_RISE_S, 0.7 * duration)
        height = surface.height_at(*self.place[:2]) - self.inserted_m
        place = np.array([*self.place[:2], height - tips(0.0) - surface.depth_for(force)])
        if surface.travel_m > 0.0 and self.person.force_rate_per_s is None:  # else x_d = x, thesis 3.2.2
            self._stroke(place, rise)
        else:
            self.shifts.append(Stroke(self.now, rise, place - self.place))
            self.place = place
        self._press_down(force, rise, duration)

    def _slide(self, step: Step, duration: float) -> None:
        goal = self._scattered(step)
        surface = self._surface_below(self.place)
        depth = surface.height_at(*self.place[:2]) - self.place[2]
        goal[2] = self.place[2]
        via: tuple[Vector, ...] = ()
        if isinstance(surface, HorizontalCylinder):
            via = surface.arc(self.place, goal, depth)
            goal[2] = surface.height_at(*goal[:2]) - depth
        self._stroke(goal, duration * (1.0 + self.overlap), flat=True, via=via)
        self._press_down(self._force(step), duration, duration, yields=False)

    def _grasp(self, step: Step, duration: float) -> None:
        self._press(step, duration)
        self.closed_s.append(self.now + duration)

    def _release(self, step: Step, duration: float) -> None:
        self._press(step, duration)
        self.opened_s.append(self.now + duration)

    def _dwell(self, step: Step, duration: float) -> None:
        if duration > LONG_PAUSE_S and self.press == 0.0 and self.rng.random() < self.person.correction:
            begin, length = self.rng.uniform(0.3, 0.5), self.rng.uniform(0.002, 0.008)
            direction = self.rng.normal(size=3)
            goal = self.place + length / np.linalg.norm(direction) * direction
            self._ideal_stroke(goal, self.rng.uniform(0.3, 0.5), delay=begin * duration)
        if self.person.habits.drift and self.press == 0.0:
            self._drift(duration, after=True)
            self._drift(duration, after=False)

    def _drift(self, duration: float, *, after: bool) -> None:
        """Creep by chance: on from the last stop, or at the end of a pause, before the next start."""
        if self.rng.random() > self.person.habits.drift:
            return
        length = min(self.rng.uniform(*DRIFT_S), 0.6 * duration)
        way = length * self.rng.uniform(*DRIFT_M_PER_S) / 2.0
        direction = self.rng.normal(size=3)
        goal = self.place + way / np.linalg.norm(direction) * direction
        early = 0.3 * length
        self._ideal_stroke(goal, length, delay=-early if after else duration - length + early)

    def _stroke(
        self,
        goal: Array,
        duration: float,
        *,
        delay: float = 0.0,
        flat: bool = False,
        via: tuple[Vector, ...] = (),
    ) -> None:
        """Append a movement of this person to a place, past others."""
        if self.person.habits == IDEAL and not via:
            self._ideal_stroke(goal, duration, delay=delay, flat=flat)
        else:
            self._sweep(goal, duration, delay=delay, flat=flat, via=via)

    def _ideal_stroke(self, goal: Array, duration: float, *, delay: float = 0.0, flat: bool = False) -> None:
        by = goal - self.place
        deviation = self._draw_deviation(by, flat=flat)
        self.strokes.append(Stroke(self.now + delay, duration, by, self.person.profile, deviation))
        self.place = goal

    def _sweep(
        self, goal: Array, duration: float, *, delay: float, flat: bool, via: tuple[Vector, ...]
    ) -> None:
        habits = self.person.habits
        places = np.vstack([self.place, np.array(via).reshape(-1, 3), goal]) - self.place
        deviation = self._draw_deviation(places[-1], flat=flat)
        bow = draw_bow(places, habits, self.rng, flat=flat)
        slow = bool(np.linalg.norm(places[-1]) < SLOW_M_PER_S * duration)
        submovements = draw_submovements(duration, habits, self.rng, slow=slow)
        self.strokes.append(
            Sweep(self.now + delay, duration, places, submovements, self.person.profile, bow, deviation)
        )
        self.place = goal

    def _draw_deviation(self, by: Array, *, flat: bool) -> Array:
        size = self.person.deviation * float(np.linalg.norm(by))
        deviation: Array = size * self.rng.normal(size=(4, 3)) / np.array([[1.0], [1.2], [1.6], [2.0]])
        deviation[:, 2] *= not flat
        return deviation

    def _push_with(self, push: Array, press: float, rise: float) -> None:
        self.pushes.append(Stroke(self.now, rise, push - self.push))
        self.presses.append(Stroke(self.now, rise, np.array([0.0, 0.0, press - self.press])))
        self.push, self.press = push, press

    def _press_down(self, force: float, rise: float, duration: float, *, yields: bool = True) -> None:
        aside = LATERAL_PRESS_SHARE * force * self.rng.normal(size=2)
        if self.person.force_rate_per_s is None:
            self._push_with(np.array([*aside, -force]), force, rise)
        else:
            self._aim(force, aside / force, duration, self.person.force_rate_per_s, yields=yields)

    def _aim(self, force: float, aside: Array, duration: float, rate_per_s: float, *, yields: bool) -> None:
        """Control the force from now on; after a touch since the surface is met, if that is before."""
        goal = force_goal(force, self.press, duration, rate_per_s)
        if self.press == 0.0:
            self.aside = (float(aside[0]), float(aside[1]))
        if self.touch_s is not None:
            self.aims.append(ForceSetpoint(self.touch_s, goal, self.aside, yields, waits=True))
        self.aims.append(ForceSetpoint(self.now, goal, self.aside, yields))
        self.press = goal + (self.press - goal) * exp(-rate_per_s * duration)
        self.touch_s = None

    def _release_force(self, duration: float) -> None:
        if self.person.force_rate_per_s is None:
            self._push_with(np.zeros(3), 0.0, duration)
        self.aims.append(ForceSetpoint(self.now))
        self.press, self.touch_s = 0.0, None

    def _scattered(self, step: Step) -> Array:
        goal = np.array(step.to)
        spread = self.person.scatter * min(0.25, float(np.linalg.norm(goal - self.place)))
        offset = np.clip(self.rng.normal(scale=spread, size=3), -0.006, 0.006)
        return goal + offset * (1.0, 1.0, step.kind == "move")

    def _force(self, step: Step) -> float:
        irregular = 1.0 + self.person.irregularity * self.rng.normal() / 2
        return step.force_n * self.person.force_factor * irregular

    def _surface_below(self, place: Array) -> Surface:
        below = [s for s in self.scenario.surfaces if s.covers(*place[:2])]
        return max(below, key=lambda s: s.touch_height_m)


_STEPS: Mapping[Kind, Callable[[_Planner, Step, float], None]] = {
    "move": _Planner._move,
    "touch": _Planner._touch,
    "press": _Planner._press,
    "slide": _Planner._slide,
    "grasp": _Planner._grasp,
    "release": _Planner._release,
    "dwell": _Planner._dwell,
    "turn": _Planner._turn,
    "circle": _Planner._circle,
    "insert": _Planner._insert,
}


def _durations(steps: tuple[Step, ...], person: Person, rng: np.random.Generator) -> list[float]:
    """Draw the duration [s] of each step by this person."""
    nominal = np.diff([0.0, *(step.until_s for step in steps)])
    moves = np.array([step.kind in MOVING for step in steps])
    scaled = np.where(moves, nominal / person.speed_factor, nominal * person.pause_factor)
    scaled *= np.exp(person.irregularity * rng.normal(size=len(steps)))
    least = np.array([0.9 if step.kind == "grasp" else 0.1 for step in steps])
    return [float(d) for d in _brief(np.maximum(scaled, least), steps, person, rng)]


def _brief(durations: Array, steps: tuple[Step, ...], person: Person, rng: np.random.Generator) -> Array:
    """Make some presses that follow a touch brief, by the person's habits."""
    chance = person.habits.brief_press
    if chance:
        for i, (before, step) in enumerate(pairwise(steps), start=1):
            seconds, chosen = rng.uniform(*BRIEF_PRESS_S), rng.random() < chance
            if chosen and before.kind == "touch" and step.kind == "press":
                durations[i] = seconds
    return durations


def _with_tempo(t: Array, person: Person, rng: np.random.Generator) -> Array:
    """Times (n,) [s] at which a person is on an even path: ahead or behind where the tempo changes."""
    if not person.habits.tempo:
        return t
    change = person.habits.tempo * band_noise(t.size, 1, TEMPO_HZ, TICKS_PER_S, rng)[:, 0]
    lead = DT * np.cumsum(np.clip(change, -TEMPO_LIMIT, TEMPO_LIMIT))
    return t + LONGEST_LEAD_S * np.tanh(lead / LONGEST_LEAD_S)


def _feed_forward(velocity: Array, person: Person) -> Array:
    """Force [N] that a practised hand adds to compensate the arm: its mass, its damping, its friction.

    The friction part leads by `PRELOAD_LEAD_S`: the hand loads before anything moves.
    """
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    push = person.preload_n * velocity / (speed + CREEP_M_PER_S)
    lead = round(PRELOAD_LEAD_S / DT)
    early = uniform_filter1d(push, lead, axis=0, origin=-(lead // 2), mode="nearest")
    sizes = [np.linalg.norm(p, axis=1, keepdims=True) for p in (early, push)]
    push = np.where(sizes[0] > sizes[1], early, push)
    inertia = FELT_MASS_KG * np.gradient(velocity, DT, axis=0)
    return np.clip(
        inertia + person.guiding_damping * FELT_DAMPING_NS_PER_M * velocity + push,
        -FEED_FORWARD_LIMIT_N,
        FEED_FORWARD_LIMIT_N,
    )


def _unsteadiness(velocity: Array, person: Person, rng: np.random.Generator) -> Array:
    """Force of the hand that it does not mean [N], (n, 3): tremor, slow wander, and unrest while it moves."""
    n = len(velocity)
    most = FULL_SPEED_NOISE if person.habits.speed_noise else 1.0
    moving = np.minimum(most, np.linalg.norm(velocity, axis=1, keepdims=True) / FULL_UNREST_M_PER_S)
    force = person.tremor_n * band_noise(n, 3, TREMOR_HZ, TICKS_PER_S, rng)
    force += person.wander_n * ornstein_uhlenbeck(n, 3, WANDER_S, TICKS_PER_S, rng)
    force += person.unrest_n * moving * band_noise(n, 3, UNREST_HZ, TICKS_PER_S, rng)
    return force


def _gripper(
    t: Array, closed_s: list[float], opened_s: list[float], used: bool
) -> tuple[Array, NDArray[np.bool_]]:
    """Width between the fingers (n,) [m], and whether they hold the object (n,)."""
    width = np.full(t.size, WIDTH_OPEN_M if used else 0.0)
    held = np.zeros(t.size, dtype=bool)
    stroke = Stroke(0.0, FINGER_TRAVEL_S, np.array([WIDTH_OPEN_M - WIDTH_OBJECT_M, 0.0, 0.0]))
    for closed, opened in zip_longest(closed_s, opened_s, fillvalue=np.inf):
        closing = replace(stroke, start_s=closed - FINGER_TRAVEL_S).positions(t)
        width += replace(stroke, start_s=opened).positions(t)[:, 0] - closing[:, 0]
        held |= (t >= closed) & (t < opened)
    return width, held
