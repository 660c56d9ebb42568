"""A simulated person who teaches a simulated robot, live or as a whole.

    teaching = Teaching("pick_and_place", seed=3)
    for samples in teaching.chunks(0.02):     # (n, columns), time first
        ...
    truth = teaching.truth()

Seed 0 is the thesis' own demonstration; every other seed is another person on another robot. The same
arguments give the same bytes, however the demonstration is cut into chunks.

The robot is a Panda where none is named. Scenarios stand where a Panda reaches them; another robot's
description states by how much they are moved (`task_offset_m`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from caesura_lab.teacher.contact_and_motion_spans import TrueState
from caesura_lab.teacher.guided_arm import GuidedArmSimulation, SimulationTrace
from caesura_lab.teacher.habits import IDEAL
from caesura_lab.teacher.hand_motion_plan import DT, make_plan
from caesura_lab.teacher.motion_profiles import Array, Profile
from caesura_lab.teacher.person import THESIS, Person, draw_person, habits_stream, with_habits
from caesura_lab.teacher.phase_truth import phases_of
from caesura_lab.teacher.robot_sensors import Sensors
from caesura_lab.teacher.scenarios import SCENARIOS, Scenario, moved
from caesura_lab.teacher.screw_truth import screws_of
from caesura_lab.teacher.truth import annotate
from caesura_protocol.codec import signals_of
from caesura_protocol.columns import columns_of
from caesura_protocol.messages import WrenchSource
from caesura_protocol.programs.safety import CellSettings
from caesura_protocol.recording import Recording
from caesura_service.robot import Robot, load_robot

RATE_HZ = 1000.0
CHUNK_S = 0.1
PANDA = "panda"
Truth = dict[str, Any]


@dataclass(frozen=True)
class Demonstration:
    """A recording and its truth."""

    recording: Recording
    truth: Truth


class SimulatedTeaching:
    """One demonstration, simulated as it is read.

    A scenario is one of `SCENARIOS`, by name, or one of your own. natural: the person of the seed has habits
    (`with_habits`), where `person` names no other. columns: names of the sample columns, time
    first; signals: names of the signals that they make up; duration_s: how long it will take.
    robot: which arm is guided, or its name or the path of its description; None for a Panda.
    Raises ValueError for a scenario that does not exist, a rate that the simulation does not have, a robot
    that is not known, or one that does not reach the start.
    """

    def __init__(
        self,
        scenario: str | Scenario,
        *,
        seed: int = 0,
        person: Person | None = None,
        profile: Profile | None = None,
        wrench_source: WrenchSource = "flange_sensor",
        rate_hz: float = RATE_HZ,
        tared: bool = True,
        robot: Robot | str | None = None,
        natural: bool = False,
    ) -> None:
        if isinstance(scenario, str) and scenario not in SCENARIOS:
            raise ValueError(f"unknown scenario {scenario!r}, known: {', '.join(SCENARIOS)}")
        if not 1.0 <= rate_hz <= 1.0 / DT:
            raise ValueError(f"rate is {rate_hz} Hz, expected 1 to {1.0 / DT:g} Hz")
        rng = np.random.default_rng(seed)
        drawn = THESIS if seed == 0 else draw_person(rng, f"person-{seed}")
        person = person or (with_habits(drawn, habits_stream(seed)) if natural else drawn)
        self.person = replace(person, profile=profile) if profile else person
        self.seed, self.wrench_source = seed, wrench_source
        robot = load_robot(robot or PANDA) if robot is None or isinstance(robot, str) else robot
        self.robot = robot.description
        named = SCENARIOS[scenario] if isinstance(scenario, str) else scenario
        self.scenario = moved(named, self.robot.task_offset_m)
        plan = make_plan(self.scenario, self.person, rng)
        self.duration_s = DT * plan.ticks
        self._phases = plan.phases
        self._guiding = GuidedArmSimulation(robot, plan)
        self._sensors = Sensors(robot, plan, wrench_source, rng, tared=tared)
        self._stride = 1.0 / (DT * rate_hz)
        self._states: list[TrueState] = []
        self._contact: list[Array] = []
        self.signals = _signals(wrench_source)
        self.columns = columns_of(self.signals, robot.joints)
        self.setting = CellSettings(robot=robot.description.name)

    def chunks(self, seconds: float = CHUNK_S) -> Iterator[Array]:
        """Simulate on, `seconds` at a time: samples (n, columns), as many as the rate gives."""
        while not self._guiding.done:
            trace = self._guiding.run(max(1, round(seconds / DT)))
            self._states.append(self._state(trace))
            self._contact.append(trace.contact)
            read = self._sensors.read(trace)
            matrix = np.column_stack([trace.t, *(read[s] for s in self.signals)])
            chosen = matrix[self._reported(trace.t)]
            if chosen.size:
                yield chosen

    @property
    def contact(self) -> Array:
        """The force (n, 3) [N] of the surfaces on the robot at every tick that has been read."""
        return np.concatenate(self._contact) if self._contact else np.empty((0, 3))

    def truth(self) -> Truth:
        """Return the truth in the annotation format of real recordings, and more.

        Raises RuntimeError before all chunks are read.
        """
        if not self._guiding.done:
            raise RuntimeError("the truth is known when the demonstration is over: read all chunks first")
        names = [field.name for field in fields(TrueState)]
        parts = [[getattr(state, name) for state in self._states] for name in names]
        state = TrueState(*(np.concatenate(part) for part in parts))
        truth = annotate(state, guided=self._guided)
        screws = screws_of(self.scenario.surfaces, state, truth["segments"])
        phases = phases_of(self._phases, truth["changepoints"], truth["window"][1])
        return {
            "file": f"{self.scenario.name}.npz",
            "scenario": self.scenario.name,
            "seed": self.seed,
            "person": self.person.name,
            "profile": self.person.profile,
            "wrench_source": self.wrench_source,
            "hand_force_in_wrench": self.wrench_source
            in ("flange_sensor_with_hand", "joint_torque_estimate"),
            **({} if self.robot.name == PANDA else {"robot": self.robot.name}),
            **truth,
            **({"phases": phases} if phases else {}),
            **({"screws": screws} if screws else {}),
        }

    def _state(self, trace: SimulationTrace) -> TrueState:
        """True state of a trace: of the flange, or of the fingertips and their turns."""
        if not self.scenario.whole_pose:
            return TrueState(trace.t, trace.twist[:, :3], trace.contact[:, 2], trace.load_kg)
        return TrueState(trace.t, trace.tip_velocity, trace.normal, trace.load_kg, trace.twist[:, 3:])

    @property
    def _guided(self) -> bool:
        return self.scenario.traced or self.scenario.whole_pose or self.person.habits != IDEAL

    def _reported(self, t: Array) -> NDArray[np.bool_]:
        """Ticks on which a sample is due: the first at or after each multiple of the period."""
        tick = np.round(t / DT)
        due: NDArray[np.bool_] = np.floor(tick / self._stride) > np.floor((tick - 1.0) / self._stride)
        return due


def teach(
    scenario: str | Scenario,
    *,
    seed: int = 0,
    person: Person | None = None,
    profile: Profile | None = None,
    wrench_source: WrenchSource = "flange_sensor",
    rate_hz: float = RATE_HZ,
    tared: bool = True,
    robot: Robot | str | None = None,
    natural: bool = False,
) -> Demonstration:
    """Simulate a whole demonstration. Arguments and errors as for `SimulatedTeaching`."""
    teaching = SimulatedTeaching(
        scenario,
        seed=seed,
        person=person,
        profile=profile,
        wrench_source=wrench_source,
        rate_hz=rate_hz,
        tared=tared,
        robot=robot,
        natural=natural,
    )
    return finish(teaching, list(teaching.chunks(1.0)))


def finish(teaching: SimulatedTeaching, chunks: list[Array]) -> Demonstration:
    """Put all chunks of a teaching together."""
    samples = np.concatenate(chunks)
    signals = signals_of(teaching.columns, samples)
    name = teaching.scenario.name
    recording = Recording(
        samples[:, 0],
        signals,
        wrench_source=teaching.wrench_source,
        hand_on_robot="yes",
        name=name,
        setting=teaching.setting,
    )
    return Demonstration(recording, teaching.truth())


def _signals(source: WrenchSource) -> tuple[str, ...]:
    wrench = ("force", "torque") if source != "none" else ()
    torques = ("tau",) if source == "joint_torque_estimate" else ()
    return ("pos", "quat", "q", *wrench, *torques, "gripper")
