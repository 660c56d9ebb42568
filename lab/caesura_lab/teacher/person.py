"""The person of the simulated teacher: all properties in which persons differ, drawn from a seed.

The ranges are those of real hand-guided recordings (data/PROVENANCE.md). `THESIS` is the person with the
times, forces and loads of the thesis.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from caesura_lab.teacher.habits import IDEAL, Habits, draw_habits
from caesura_lab.teacher.motion_profiles import PROFILES, Profile


@dataclass(frozen=True)
class Person:
    """One teacher and the sensors of the robot that is taught.

    Factors multiply the scenario's nominal values. Noise levels are standard deviations an axis.
    """

    name: str
    profile: Profile = "minimum_jerk"
    speed_factor: float = 1.0
    pause_factor: float = 1.0
    force_factor: float = 1.0
    load_kg: float = 0.25
    # The arm
    stiffness_n_per_m: float = 600.0
    damping_ns_per_m: float = 90.0
    tremor_n: float = 0.12  # 8 to 12 Hz
    wander_n: float = 0.4  # slow change of the hand's force
    unrest_n: float = 0.7  # quick changes of the hand's force while it moves
    deviation: float = 0.015  # by which a path leaves its profile, as a share of its length
    scatter: float = 0.005  # of a movement's end, as a share of its length
    irregularity: float = 0.0  # of times and forces from one step to the next, relative
    hesitation: float = 0.0  # probability of a stop within a movement
    correction: float = 0.3  # probability of a small movement within a long pause
    preload_n: float = 2.0  # hand force before a movement starts
    force_rate_per_s: float | None = None  # controls its force in contact (`hand_force`), else its place
    # The robot
    joint_friction: float = 1.0  # share of the arm's joint friction that its controller leaves
    position_noise_m: float = 5e-6
    force_noise_n: float = 0.06
    motion_noise_n: float = 0.2
    bias_n: float = 2.0
    bias_wander_n: float = 0.3  # over a recording, with the pose and slowly by itself
    hand_kg: float = 0.76  # gripper below the sensor, which feels its inertia
    impact_m: float = 0.012  # how far below a surface a movement towards it aims
    habits: Habits = IDEAL
    guiding_damping: float = 1.0  # share of the damping that the robot's guiding controller adds
    joint_noise: float = 1.0  # factor of the errors of estimated joint torques
    stiction: float = 1.0  # joint friction at standstill over that in motion
    bias_period_m: float = 0.0  # way over which the bias repeats as the pose changes; 0 is a linear change


THESIS = Person(name="thesis", correction=0.0)


def draw_person(rng: np.random.Generator, name: str) -> Person:
    """Draw a person: speed, habits, unsteadiness, and the sensors of a robot."""
    return Person(
        name=name,
        profile=PROFILES[rng.choice(3, p=(0.6, 0.15, 0.25))],
        speed_factor=rng.uniform(0.7, 1.2),
        pause_factor=rng.lognormal(0.2, 0.35),
        force_factor=rng.uniform(0.85, 1.15),
        load_kg=rng.uniform(0.15, 0.6),
        stiffness_n_per_m=rng.uniform(450.0, 800.0),
        damping_ns_per_m=rng.uniform(70.0, 120.0),
        tremor_n=rng.uniform(0.08, 0.3),
        wander_n=rng.uniform(0.3, 0.9),
        unrest_n=rng.uniform(0.5, 2.0),
        deviation=rng.uniform(0.01, 0.04),
        scatter=rng.uniform(0.005, 0.02),
        irregularity=rng.uniform(0.03, 0.12),
        hesitation=rng.uniform(0.0, 0.15),
        correction=rng.uniform(0.1, 0.6),
        preload_n=rng.uniform(1.2, 2.2),
        position_noise_m=rng.uniform(2e-6, 15e-6),
        force_noise_n=np.exp(rng.uniform(np.log(0.02), np.log(0.2))),
        motion_noise_n=rng.uniform(0.1, 0.6),
        bias_n=rng.uniform(1.0, 5.0),
        bias_wander_n=rng.lognormal(np.log(0.9), 0.5),
        impact_m=rng.uniform(0.008, 0.03),
    )


def with_habits(person: Person, rng: np.random.Generator) -> Person:
    """Give a person habits and a calmer hand; its robot gets stiction and a bias that wanders with the pose.

    Noise is lower than of ideal people, whose noise also stands for the submovements of the habits.
    """
    friction = rng.uniform(0.05, 0.6)
    return replace(
        person,
        joint_friction=friction,
        preload_n=np.sqrt(friction) * person.preload_n,
        guiding_damping=rng.uniform(0.05, 0.6),
        habits=draw_habits(rng),
        stiction=rng.uniform(1.0, 1.6),
        tremor_n=0.4 * person.tremor_n,
        unrest_n=0.25 * person.unrest_n,
        motion_noise_n=0.3 * person.motion_noise_n,
        joint_noise=rng.uniform(0.1, 0.4),
        bias_wander_n=float(np.clip(rng.lognormal(np.log(1.5), 0.4), 0.6, 3.2)),
        bias_period_m=rng.uniform(0.4, 1.0),
    )


def habits_stream(seed: int) -> np.random.Generator:
    """Make the generator of the habits of a seed, apart from the one of the person."""
    return np.random.default_rng((seed, 1))
