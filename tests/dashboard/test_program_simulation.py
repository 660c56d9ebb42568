"""A program that a page runs on the simulated robot."""

from __future__ import annotations

import threading

import pytest

pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from caesura_clients.dashboard import program_simulation
from caesura_clients.dashboard.correction_requests import EditRefused
from caesura_clients.dashboard.program_simulation import Simulation, Simulator
from caesura_protocol.messages import Program
from clients.examples import example
from harness.processes import eventually
from harness.programs import press


def program(*apps):
    return example(Program).model_copy(update={"apps": apps, "robot": None, "edits": ()})


def test_a_speed_that_is_none_is_refused():
    with (
        Simulator() as simulator,
        pytest.raises(EditRefused, match=r"speed 'warp', expected taught or optimal"),
    ):
        simulator.run(program(*press()), "warp")


def test_a_program_that_would_take_too_long_is_refused_with_the_limit():
    with Simulator() as simulator, pytest.raises(EditRefused, match="has 201 apps, at most 200"):
        simulator.run(program(*press() * 67), "taught")


def test_one_is_simulated_at_a_time_and_ended_with_the_dashboard(monkeypatch):
    begun = threading.Event()
    command = Simulator._command

    def hanging(self, words, made):
        begun.set()
        return command(self, ["watch", "--connect", "tcp/127.0.0.1:1"], made)  # until it is killed

    monkeypatch.setattr(Simulator, "_command", hanging)
    refused = []

    def simulate():
        with pytest.raises(EditRefused) as error:
            simulator.run(program(*press()), "taught")
        refused.append(str(error.value))

    with Simulator() as simulator:
        first = threading.Thread(target=simulate)
        first.start()
        assert begun.wait(30.0)
        with pytest.raises(EditRefused, match="another simulation is under way"):
            simulator.run(program(*press()), "taught")
    first.join(30.0)
    assert not first.is_alive()
    assert refused
    assert refused[0].startswith("Not simulated")


def test_a_simulation_that_hangs_is_ended(monkeypatch):
    monkeypatch.setattr(program_simulation, "LONGEST_S", 0.1)
    with Simulator() as simulator, pytest.raises(EditRefused, match=r"no result after 0\.1 s"):
        simulator.run(program(*press()), "taught")


@pytest.mark.slow
def test_a_simulation_that_is_cancelled_ends_its_process_and_frees_the_simulator(monkeypatch):
    command = Simulator._command
    hangs = ["watch", "--connect", "tcp/127.0.0.1:1"]  # until it is killed
    monkeypatch.setattr(Simulator, "_command", lambda self, _words, made: command(self, hangs, made))
    simulation, refused = Simulation(), []

    def simulate():
        with pytest.raises(EditRefused) as error:
            simulator.run(program(*press()), "taught", simulation)
        refused.append(str(error.value))

    with Simulator() as simulator:
        first = threading.Thread(target=simulate)
        first.start()
        eventually(lambda: simulation._child is not None)
        assert simulator.is_busy
        simulation.end()
        first.join(30.0)
        assert refused == ["Not simulated: cancelled."]
        assert simulation._child is not None
        assert simulation._child.poll() is not None, "its process is gone"
        assert not simulator.is_busy
        monkeypatch.setattr(Simulator, "_command", command)
        with pytest.raises(EditRefused, match=r"(?s)Not simulated: cell-1/.*has no apps.*\(robot not stated"):
            simulator.run(program(), "taught")


def test_a_simulation_that_is_cancelled_between_two_processes_starts_no_other():
    simulation = Simulation()
    simulation.end()
    with Simulator() as simulator, pytest.raises(EditRefused, match="cancelled"):
        simulator.run(program(*press()), "taught", simulation)
    assert simulation._child is None
