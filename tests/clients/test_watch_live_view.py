"""What is kept in view: one session a station, its newest rows, and whether there is a service."""

import os
import signal
import subprocess
import sys
import threading
from contextlib import nullcontext
from dataclasses import replace
from functools import partial

import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner

from caesura_clients import Caesura, connect
from caesura_clients.cli import watch as watch_command
from caesura_clients.cli.commands import register
from caesura_clients.cli.options import CONNECT_TIMEOUT_S
from caesura_clients.cli.result_tables import segments_view
from caesura_clients.cli.watch_live_view import FinalLines, LiveView
from caesura_clients.session_follower import ServiceAvailability, SessionRemoved, events
from caesura_clients.session_state_reader import SessionReader
from caesura_protocol.errors import Unreachable
from caesura_protocol.messages import Hint
from caesura_protocol.session_time_display import SessionClock
from clients.answering import Answering
from clients.examples import snapshot
from clients.fake_service import eventually
from harness.processes import Router, running


def update(*kinds, **changes):
    reader = SessionReader()
    reader.restart(snapshot(0, *kinds, **changes))
    return reader.update


@pytest.fixture
def current():
    """What the service says of its stations."""
    return {}


@pytest.fixture
def view(current):
    return LiveView(lambda: dict(current), waiting="waiting for cell-1")


def drawn(view, height=40, width=120):
    console = Console(width=width, height=height, force_terminal=True, color_system=None)
    return [line.rstrip() for line in "".join(s.text for s in console.render(view)).splitlines()]


def sessions(view):
    return [(one.station, one.session) for one in view.shown()]


def test_two_sessions_at_a_station_do_not_take_turns(view, current):
    # Keyed by the station alone, the table once alternated between them at every message.
    current["cell-1"] = "new"
    for _ in range(2):
        view.receive(update("motion", session="abandoned"))
        view.receive(update("hold", session="new"))
        assert sessions(view) == [("cell-1", "new")]
    view.receive(update("motion", "contact", session="abandoned"))
    assert sessions(view) == [("cell-1", "new")]


def test_a_session_that_is_opened_later_takes_its_place(view, current):
    current["cell-1"] = "zzz"
    view.receive(update(session="zzz"))
    current["cell-1"] = "aaa"
    view.receive(update(session="aaa"))
    view.receive(update("motion", session="zzz"))
    assert sessions(view) == [("cell-1", "aaa")]


def test_where_the_service_does_not_say_the_last_that_was_met_is_shown(view):
    view.receive(update(session="one"))
    view.receive(update(session="two"))
    view.receive(update("motion", session="one"))
    assert sessions(view) == [("cell-1", "two")]


@pytest.mark.parametrize("height", [12, 40])
def test_two_bridges_that_teach_at_one_station_are_named_until_one_is_over(view, current, height):
    current["cell-1"] = "s2"
    view.receive(update("motion", station="cell-2"))
    for number in range(1, 4):
        for session in ("s1", "s2"):
            view.receive(update("motion", session=session, t=float(number)))
    words = "! two bridges teach at cell-1: s1 and s2: give one of them another --station"
    assert drawn(view, height=height)[-1] == words
    view.receive(update("motion", session="s1", t=9.0, state="closed"))
    assert words not in drawn(view, height=height)


@pytest.mark.parametrize("width", [60, 80])
def test_the_two_bridges_of_a_station_are_not_cut_off(view, width):
    for number in range(1, 4):
        for session in ("s20261125-001623-74e8", "s20261125-001623-de1b"):
            view.receive(update(*["motion"] * 20, session=session, t=float(number)))
    for number in range(2, 8):
        view.receive(update("motion", station=f"cell-{number}"))
    lines = drawn(view, height=16, width=width)
    assert len(lines) <= 16
    assert "give one of them another --station" in " ".join(lines[-3:])


def test_stations_stand_beneath_each_other(view):
    view.receive(update(station="cell-2"))
    view.receive(update(station="cell-1"))
    assert [station for station, _ in sessions(view)] == ["cell-1", "cell-2"]


def test_what_is_forgotten_leaves_the_view(view):
    view.receive(update(session="s1"))
    view.receive(SessionRemoved("cell-1", "s1"))
    assert drawn(view) == ["waiting for cell-1"]


def test_after_a_restart_that_lost_the_session_it_says_what_it_waits_for(view):
    view.receive(ServiceAvailability("there"))
    view.receive(update(session="s1"))
    for event in (ServiceAvailability("gone"), ServiceAvailability("there"), SessionRemoved("cell-1", "s1")):
        view.receive(event)
    assert drawn(view) == ["service back, waiting for cell-1"]
    view.receive(ServiceAvailability("gone"))
    assert drawn(view) == ["service gone, waiting for cell-1"]


def test_a_service_that_is_gone_is_said_beneath_what_is_known(view):
    view.receive(ServiceAvailability("there"))
    assert drawn(view) == ["waiting for cell-1"]
    view.receive(update("motion"))
    assert "service" not in drawn(view)[-1]
    view.receive(ServiceAvailability("gone"))
    assert drawn(view)[-1] == "service gone, waiting"
    assert any(" motion " in line for line in drawn(view))
    view.receive(ServiceAvailability("there"))
    assert drawn(view)[-1] == "service back"
    view.receive(update("motion", "hold"))
    assert "service" not in drawn(view)[-1]


@pytest.mark.parametrize("height", [12, 16, 24])
@pytest.mark.parametrize("width", [60, 120])
@pytest.mark.parametrize("stations", [1, 2])
def test_a_short_terminal_shows_the_newest_rows_and_how_many_are_hidden(view, height, width, stations):
    # The rows that are found last, and the line on how the session is doing, were once cut off.
    if stations == 2 and height < 24:
        return
    for number in range(stations):
        view.receive(update(*["motion"] * 50, "hold", station=f"cell-{number}"))
    view.receive(ServiceAvailability("gone"))
    lines = drawn(view, height, width)
    assert len(lines) <= height
    assert lines[-1] == "service gone, waiting"
    assert sum(line.split()[:1] == ["51"] and "hold" in line for line in lines) == stations
    assert sum("earlier ones hidden · open" in line for line in lines) == stations
    assert (
        height - len(lines) < 3 * stations
    )  # a row more may take two lines, and one of each station's title


@pytest.mark.parametrize("stations", [3, 6, 17, 40])
def test_a_terminal_too_short_for_all_stations_shows_a_line_for_each(view, stations):
    """Of six stations two were shown in 24 lines, and that the service is gone was cut off."""
    for number in range(stations):
        view.receive(update(*["motion"] * 9, "hold", station=f"cell-{number:02}", t=12.3))
    view.receive(ServiceAvailability("gone"))
    lines = drawn(view, height=24, width=80)
    assert len(lines) <= 24
    assert lines[-1] == "service gone, waiting"
    shown = [row for line in lines if (row := line.split())[:1] and row[0].startswith("cell-")]
    assert len(shown) == min(stations, 18)
    assert all(len(row) >= 6 and row[2:5] == ["open", "12.3", "10"] for row in shown)
    assert any("more: --station shows one" in line for line in lines) == (stations > 18)
    assert not any("…" in line for line in lines)


def test_hints_stand_below_the_lines_of_stations(view):
    hint = Hint(
        kind="too_fast", since=1.0, text="Too fast.", advice="Move more slowly, and pause at corners."
    )
    for number in range(6):
        taught = update(*["motion"] * 9, station=f"cell-{number}")
        view.receive(replace(taught, hints=(hint,)) if number == 4 else taught)
    lines = drawn(view, height=24, width=80)
    assert lines[-1] == "! cell-4: Move more slowly, and pause at corners."
    assert sum("cell-" in line for line in lines) == 7


@pytest.mark.parametrize("stations", [1, 6])
def test_a_hint_names_times_as_the_table_shows_them(view, stations):
    """It asked to show the part from 1700000003.0 s again, below segments that begin at 0."""
    hint = Hint(
        kind="show_again",
        since=1.7e9,
        text="The boundary at 1700000004.0 s stayed unclear.",
        advice="Teach the part from 1700000003.0 to 1700000005.5 s again.",
    )
    for number in range(stations):
        taught = update(*["motion"] * 9, station=f"cell-{number}", t=1.7e9 + 9.0)
        first = taught.segments[0].model_copy(update={"t0": 1.7e9})
        view.receive(replace(taught, hints=(hint,), segments=(first, *taught.segments[1:])))
    shown = drawn(view, height=24, width=100)
    assert [line for line in shown if "Teach the part from 3.0 to 5.5 s again." in line]
    assert stations == 1 or [line for line in shown if line.split()[2:4] == ["open", "9.0"]]
    assert not [line for line in shown if "! " in line and "17000000" in line]


def test_a_terminal_that_is_tall_enough_hides_nothing(view):
    view.receive(update(*["motion"] * 10))
    assert not any("hidden" in line for line in drawn(view, height=40))
    assert sum("motion" in line for line in drawn(view, height=40)) == 10


def test_a_final_segment_is_one_line_once():
    whole = snapshot(0, "motion", "contact", "hold", station="cell-1", session="s1")
    first, second, third = whole.segments.segments
    growing = third.model_copy(update={"certainty": "provisional"})
    final = FinalLines()

    def lines(*segments):
        reader = SessionReader()
        listed = whole.segments.model_copy(update={"segments": segments})
        reader.restart(whole.model_copy(update={"segments": listed}))
        return final.lines(reader.update)

    assert [line.split()[:2] for line in lines(first, growing)] == [["cell-1/s1", "1"]]
    (line,) = lines(first, second, growing)
    assert line.startswith(f"cell-1/s1 2 {second.t0:.2f} {second.tn:.2f} contact ")
    assert lines(first, second, growing) == []


@pytest.mark.parametrize(
    ("station", "said"),
    [
        ("ur-9", "there is no station ur-9 yet; stations: ur-1, ur-2, waiting for ur-9\n"),
        ("ur-1", ""),
        (None, ""),
    ],
)
def test_watch_says_once_that_there_is_no_such_station_and_goes_on_waiting(
    router, monkeypatch, capsys, station, said
):
    # A typing error waited in silence.
    began = []
    monkeypatch.setattr(watch_command, "events", lambda _, pattern: began.append(pattern) or [])
    with Answering(router.transport()) as service, Caesura(router.transport()) as caesura:
        service.snapshots = [snapshot(0, "motion", station=one, session="s1") for one in ("ur-1", "ur-2")]
        watch_command._write_lines(caesura, station)
    assert capsys.readouterr().err == said
    assert began == [station or "*"]


def test_watch_in_a_pipe_writes_a_line_at_once_and_ends_at_sigterm(router):
    # The file of `caesura watch > file` stayed empty.
    with Answering(router.transport()) as service:
        service.snapshots = [snapshot(0, "motion", station="cell-1", session="s1")]
        child = subprocess.Popen(
            [sys.executable, "-m", "caesura_clients", "watch"],
            env={**os.environ, "CAESURA_CONNECT": router.endpoint},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        deadline = threading.Timer(60.0, child.kill)
        deadline.start()
        try:
            assert child.stdout.readline().startswith("cell-1/s1 1 ")
            child.send_signal(signal.SIGTERM)
            _, said = child.communicate(timeout=30.0)
        finally:
            deadline.cancel()
            child.kill()
    assert (child.returncode, said) == (0, "")


def test_watch_in_a_pipe_names_a_router_that_hangs_and_a_service_that_is_back(monkeypatch, capsys):
    """It wrote nothing, as where nothing is taught."""
    said: list[str] = []

    def printed(words: str) -> bool:
        said.append(capsys.readouterr().err)
        return words in "".join(said)

    with (
        running(Router()) as router,
        connect(router.endpoint) as answering,
        connect(router.endpoint) as caesura,
        Answering(answering.transport) as service,
    ):
        service.snapshots = [snapshot(0, "motion", station="cell-1", session="s1")]
        over = threading.Event()
        monkeypatch.setattr(watch_command, "events", partial(events, refresh_s=0.2, over=over))
        monkeypatch.setattr(watch_command, "ended_by_sigterm", nullcontext)
        watching = threading.Thread(target=watch_command._write_lines, args=(caesura, "cell-1"))
        watching.start()
        try:
            eventually(lambda: "cell-1/s1" in capsys.readouterr().out)
            router.freeze()
            eventually(lambda: printed("router not reachable, waiting"))
            router.thaw()
            eventually(lambda: printed("service back"))
        finally:
            router.thaw()
            over.set()
            watching.join()


@pytest.mark.parametrize("verb", ["watch", "hints"])
def test_what_runs_all_the_time_waits_for_a_router(monkeypatch, verb):
    """A lamp whose machine starts before that of the service stayed dark."""
    waited: list[float | None] = []

    def refuse(_endpoint, *, timeout_s, **_: object) -> Caesura:
        waited.append(timeout_s)
        if timeout_s is None:
            raise KeyboardInterrupt
        raise Unreachable("no router at tcp/127.0.0.1:7447")

    monkeypatch.setattr("caesura_clients.cli.options.connect", refuse)
    app = typer.Typer()
    register(app)
    ended = CliRunner().invoke(app, [verb])
    assert ended.stderr.startswith("waiting: no router at tcp/127.0.0.1:7447\n")
    assert waited == [CONNECT_TIMEOUT_S, None]


def test_a_table_shows_times_on_the_clock_that_its_caller_has():
    found = snapshot(0, "motion", station="cell-1", session="s1")
    console = Console(width=120, color_system=None)
    with console.capture() as drawn:
        console.print(segments_view(found.status, found.segments.segments, SessionClock(-100.0)))
    t0 = found.segments.segments[0].t0
    assert f"{t0 + 100.0:.2f}" in drawn.get()


@pytest.mark.parametrize(("source", "measured"), [("none", False), ("flange_sensor", True)])
def test_a_segment_has_a_force_only_where_there_is_a_wrench(source, measured):
    found = snapshot(0, "motion", station="cell-1", session="s1")
    wrench = found.status.wrench.model_copy(update={"source": source})
    segment = found.segments.segments[0].model_copy(update={"load_kg": None, "load_sd_kg": None})
    console = Console(width=120, color_system=None)
    with console.capture() as drawn:
        console.print(segments_view(found.status.model_copy(update={"wrench": wrench}), [segment]))
    (row,) = [line for line in drawn.get().splitlines() if " motion " in line]
    assert (" N " in row) == measured
    assert (" – " in row) != measured
