"""Simulates the surroundings of a scenario: obstacles, the graspable object, and the fingers."""

from __future__ import annotations

import math
from dataclasses import dataclass

from caesura_lab.execution.cell_limits import Cell
from caesura_lab.teacher.hand_motion_plan import WIDTH_OBJECT_M, WIDTH_OPEN_M
from caesura_lab.teacher.level_surface_contact import Surface
from caesura_lab.teacher.motion_profiles import Array, Vector
from caesura_lab.teacher.scenarios import Scenario
from caesura_protocol.programs.program_gripper import GRIP_REACH_M
from caesura_protocol.programs.safety import DEFAULT, Safety

SETTLED_M = 1e-4


@dataclass(frozen=True)
class GraspableObject:
    """An object on a surface: its grasp position of the flange (3,) [m], its width and its weight."""

    place: Vector
    width_m: float
    kg: float


class CellSimulation:
    """Obstacles, the graspable object and the fingers. A released object stays where it is."""

    def __init__(self, scenario: Scenario, load_kg: float, width_m: float | None = None) -> None:
        """load_kg, width_m: of the grasped object; None for the usual width."""
        self.surfaces: tuple[Surface, ...] = scenario.surfaces
        self.start: Vector = scenario.start
        self._object = _object_of(scenario, load_kg, WIDTH_OBJECT_M if width_m is None else width_m)
        self.width_m = WIDTH_OPEN_M if self._object else 0.0
        self.held_kg = 0.0
        self._goal_m, self._speed = self.width_m, 0.0

    @property
    def fingers_still(self) -> bool:
        """Return whether the fingers have reached their goal or hold an object."""
        return abs(self.width_m - self._goal_m) < SETTLED_M

    def send_fingers(self, width_m: float, speed_m_per_s: float) -> None:
        """Move the fingers towards a width [m].

        An object between them stops them, and opening releases it.
        """
        self._goal_m, self._speed = width_m, speed_m_per_s

    def tick(self, flange: Array, dt: float) -> None:
        """Simulate the fingers for one tick of dt [s]. flange: (3,) [m]."""
        step = self._speed * dt
        self.width_m += min(max(self._goal_m - self.width_m, -step), step)
        graspable = self._object
        if graspable is None:
            return
        if self.held_kg and self.width_m > graspable.width_m + SETTLED_M:
            x, y, z = flange.tolist()
            self._object, self.held_kg = GraspableObject((x, y, z), graspable.width_m, graspable.kg), 0.0
        near = self.held_kg > 0.0 or math.dist(flange.tolist(), graspable.place) <= GRIP_REACH_M
        if near and self._goal_m < graspable.width_m and self.width_m <= graspable.width_m:
            self.width_m = self._goal_m = graspable.width_m
            self.held_kg = graspable.kg

    def cell(self, safety: Safety = DEFAULT) -> Cell:
        """Return the cell for a check."""
        return Cell(safety, self.surfaces, self.start)


def _object_of(scenario: Scenario, load_kg: float, width_m: float) -> GraspableObject | None:
    """Return the object that the scenario grasps, at its place; None without a grasp."""
    place: Vector = scenario.start
    for step in scenario.steps:
        place = step.to or place
        if step.kind == "grasp":
            return GraspableObject(place, width_m, load_kg)
    return None
