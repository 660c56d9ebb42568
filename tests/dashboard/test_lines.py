"""The line above a session: how it is, and which wrench source is in use."""

from __future__ import annotations

from dataclasses import replace

import pytest

pytest.importorskip("nicegui")

from caesura_clients.dashboard.pages.session import line_of, line_of_past
from caesura_clients.dashboard.session_list_rows import sessions
from caesura_clients.dashboard.station_summary import DashboardState, glance
from clients.examples import segment

WORLD = DashboardState()  # without a network


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        (True, "wrench: a sensor that the guiding hand does not touch"),
        (False, "wrench: a sensor that the guiding hand does not touch (assumed)"),
    ],
)
def test_a_line_names_the_wrench_source_and_whether_it_is_assumed(update, stated, words):
    known = update()
    wrench = known.status.wrench.model_copy(update={"stated": stated})
    shown = replace(known, status=known.status.model_copy(update={"wrench": wrench}))
    assert line_of_past(shown, WORLD).split(" · ")[-1] == words


def test_a_line_says_when_a_session_with_times_of_day_began(update):
    day = replace(update(), segments=(segment("motion", 1764172800.25),))
    shown = line_of_past(day, WORLD).split(" · ")
    assert shown[1] == "1.0 s"
    assert shown[-1] == "times [s] from 2025-11-26 16:00:00 UTC on, the start"


def test_a_station_and_the_history_state_the_same_length(update):
    known = update()
    closed = replace(known, status=known.status.model_copy(update={"state": "closed", "t": 12.68}))
    world = DashboardState(updates={(closed.station, closed.session): closed})
    live = line_of(glance(world, closed.station, None, now=1.0, began=0.0), closed)
    assert live.split(" · ")[1] == line_of_past(closed, world).split(" · ")[1] == "12.7 s"


def test_a_long_session_is_stated_in_minutes_too(update):
    known = update()
    hour = replace(known, status=known.status.model_copy(update={"state": "closed", "t": 3599.9}))
    assert line_of_past(hour, WORLD).split(" · ")[1] == "3599.9 s (60 min)"


def test_a_session_that_its_bridge_has_left_open_is_not_said_to_be_taught(update):
    """The page and the list had `being taught` and `going on` for as long as the service ran."""
    left, later = update(session="left", opened=100.0), update(session="later", opened=200.0)
    both = {(one.station, one.session): one for one in (left, later)}
    world = DashboardState(updates=both, alive=frozenset({"a"}), bridges=frozenset({left.station}))
    gone = replace(world, bridges=frozenset())
    assert line_of_past(later, world).startswith("being taught · ")
    assert line_of_past(later, gone).startswith(
        "not ended: its bridge is gone, and the station's next bridge"
    )
    assert [row["leftOpen"] for row in sessions(world)] == [False, True]
    assert [row["leftOpen"] for row in sessions(gone)] == [True, True]
    for not_known in (
        replace(gone, alive=frozenset()),
        replace(gone, troubles={"results": "the router is gone"}),
        replace(world, parallel={left.station: ("later", "left")}),
    ):
        assert line_of_past(left, not_known).startswith("being taught · ")
