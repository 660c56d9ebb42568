"""The thesis' person in every scenario."""

from __future__ import annotations

import pytest

from caesura_lab.teacher.scenarios import SCENARIOS
from caesura_lab.teacher.simulated_teaching import Demonstration
from caesura_service.robot import Robot, load_panda
from lab.teacher.nominal import nominal_once


@pytest.fixture(scope="session")
def robot() -> Robot:
    return load_panda()


STORED = ("three_point", "parkour", "pick_and_place", "dispenser", "wiping", "button")  # in data/


@pytest.fixture(params=STORED)
def stored(request: pytest.FixtureRequest) -> Demonstration:
    """Each scenario that has a recording in the repository in turn, by the thesis' person."""
    return nominal_once(request.param)


@pytest.fixture(params=list(SCENARIOS))
def nominal(request: pytest.FixtureRequest) -> Demonstration:
    """Each scenario in turn, by the thesis' person."""
    return nominal_once(request.param)


@pytest.fixture(scope="session")
def demonstrations() -> list[Demonstration]:
    return [nominal_once(name) for name in STORED]


@pytest.fixture(scope="session")
def pick_and_place() -> Demonstration:
    return nominal_once("pick_and_place")


@pytest.fixture(scope="session")
def dispenser() -> Demonstration:
    return nominal_once("dispenser")
