"""A short part of `make faults`: fewer stations, shorter demonstrations, the same bars."""

from __future__ import annotations

import sys
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

from caesura_protocol.messages import Edit, Insert, Snapshot
from faults.suite import (
    disk_calls,
    disks,
    io_errors,
    killed,
    lateness,
    lines,
    losses,
    neighbours,
    old_session,
    reference,
    rings,
)
from faults.suite.outcome import Disturbance, Played, Scale
from faults.suite.relay import Line
from faults.suite.stations import LiveRobot, TaughtStation, Watched, demonstration
from harness.attacker import Attacker
from harness.processes import Process

pytestmark = pytest.mark.slow

SMALL = Scale(stations=2, seconds=8.0, pace=4.0)
SLOW = Scale(stations=2, seconds=16.0, pace=2.0)  # lasts until the service is gone, also on a busy machine
DISK_FAILS = (disk_calls.OUT_OF_FILES, disk_calls.RUNNING[8])
EVERYTHING = Line(lost=0.1, doubled=0.1, late=0.1)


@pytest.mark.parametrize(
    "fault",
    [
        partial(killed.router_killed, scale=SMALL),
        partial(lines.bad_messages, EVERYTHING, scale=SMALL, least=5),
        partial(disks.disk_unwritable, scale=SMALL),
        partial(rings.ring_too_small, scale=SLOW, away_s=2.0),
        partial(io_errors.io_errors, stride=61),
        partial(disk_calls.disk_calls, while_running=DISK_FAILS, while_starting=()),
        partial(reference.reference, scale=Scale(stations=1, seconds=8.0)),
    ],
    ids=[
        "router killed",
        "messages lost, doubled and late",
        "disk unwritable",
        "ring too small",
        "disk errors",
        "calls to the disk",
        "no fault",
    ],
)
def test_a_fault_meets_its_bar(fault, tmp_path):
    row = fault(tmp_path)
    assert row.met, row.note


class Dead(Attacker):
    """Ends as soon as it is ready."""

    def __init__(self, how: str, endpoint: str) -> None:
        Process.__init__(self, [sys.executable, "-c", "print('ready', flush=True)"])


class IdleAttacker(Attacker):
    """Lives, and does nothing."""

    def __init__(self, how: str, endpoint: str) -> None:
        waits = "print('ready', flush=True); import signal; signal.pause()"
        Process.__init__(self, [sys.executable, "-c", waits])


@pytest.mark.parametrize("attacker", [Dead, IdleAttacker])
def test_an_attacker_that_does_nothing_proves_nothing(attacker, tmp_path, monkeypatch):
    monkeypatch.setattr(neighbours, "Attacker", attacker)
    row = neighbours.hostile_station("dense", tmp_path, Scale(stations=1, seconds=4.0, pace=2.0))
    assert (row.lost, row.equal, row.met) == (0, "yes", False)
    assert "expected {'put': 4000" in row.note


@pytest.mark.parametrize("is_other", [False, True])
def test_an_old_session_is_edited_beside_others_and_another_result_is_not_met(
    is_other, tmp_path, monkeypatch
):
    undisturbed = old_session.undisturbed

    def other(directory: Path, edit: Edit) -> tuple[Snapshot, float]:
        return undisturbed(directory, edit.model_copy(update={"action": Insert(t=5.5)}))

    monkeypatch.setattr(old_session, "undisturbed", other if is_other else undisturbed)
    row = old_session.old_session_edited(tmp_path, Scale(stations=1, seconds=4.0, pace=2.0), seconds=20.0)
    assert (row.sent, row.lost, row.equal) == (800, 0, "yes")
    assert f"the edit's result is {'not ' if is_other else ''}equal" in row.note
    assert not (is_other and row.met)


@pytest.mark.parametrize("fault", [losses.power_loss, io_errors.io_errors, disk_calls.disk_calls])
def test_what_cannot_be_run_is_not_met_and_the_row_names_what_is_missing(fault, tmp_path, monkeypatch):
    for module in (losses, io_errors, disk_calls):
        monkeypatch.setattr(module, "COMPILER", None)
    row = fault(tmp_path)
    assert not row.met
    assert "scripts/debian.sh gcc" in row.note


@pytest.mark.parametrize("late_s", [0.0, 0.25])
def test_a_delay_of_all_results_is_lateness(late_s):
    seconds, number = 6.0, 0
    robot = LiveRobot(demonstration(number, seconds), pace=1000.0)
    for _ in robot.chunks():
        pass
    bridge = SimpleNamespace(settings=SimpleNamespace(batch_samples=10))
    station = TaughtStation(number, seconds, bridge, Future(), robot)
    given_s, known_t = lateness.given(station), lateness.known(station)
    came = [(at + late_s, t) for at, t in zip(given_s, known_t, strict=True) if t >= 0.0]
    watched = Watched({station.name: [*came, (given_s[-1] + 9.0, 1e9)]})
    found = SimpleNamespace(station=station)
    late_ms = lateness.lateness_ms(Played([found], watched, Disturbance()))
    assert len(late_ms) == len(came), "what the close brings does not count"
    assert min(late_ms) == pytest.approx(1e3 * late_s, abs=1e-3)
