"""The system page says who owns what, how fast it goes, and what is wrong."""

from __future__ import annotations

import pytest

from caesura_clients.dashboard.session_list_rows import sessions
from caesura_clients.dashboard.station_summary import DashboardState
from caesura_clients.dashboard.system import rates, system
from caesura_protocol.messages import JournalReport, ServiceStatus
from clients.examples import example


def status(instance="a", **changes):
    return example(ServiceStatus).model_copy(update={"instance": instance, "epoch": 1, **changes})


def test_a_rate_is_what_came_between_two_looks():
    assert rates([status(messages=100)], [status(messages=150)], 2.0) == {"a": 25.0}


@pytest.mark.parametrize(
    ("before", "after", "seconds"),
    [([], [status()], 1.0), ([status()], [status(epoch=2)], 1.0), ([status()], [status()], 0.0)],
)
def test_an_instance_that_is_new_has_no_rate(before, after, seconds):
    assert rates(before, after, seconds) == {}


def test_a_station_has_its_owner(update):
    one = update("motion", station="cell-3", instance="west", epoch=4500)
    found = system(DashboardState(updates={("cell-3", one.session): one}))
    (row,) = found.stations
    assert (row["station"], row["owner"], row["since"], row["bridge"]) == ("cell-3", "west", 4.5, "gone")


def test_a_list_of_sessions_states_who_edited_one_and_the_time_of_day_for_the_browser_to_write(update):
    """It had hours and minutes of the machine of the dashboard, without a day."""
    one = update("motion", station="cell-3")
    world = DashboardState(updates={("cell-3", one.session): one})
    (row,) = sessions(world)
    assert (row["author"], row["edited"]) == (one.program.author or "", one.program.edited)


@pytest.mark.parametrize(("state", "words"), [("open", "gone"), ("closed", "not connected")])
def test_a_bridge_that_left_after_a_normal_end_is_not_missing(update, state, words):
    one = update("motion", station="cell-3", state=state)
    (row,) = system(DashboardState(updates={("cell-3", one.session): one})).stations
    assert row["bridge"] == words


def test_what_is_wrong_is_said():
    trouble = example(JournalReport).model_copy(update={"trouble": "disk full"})
    world = DashboardState(
        services=(status("a", overloaded=True), status("b", journal=trouble)),
        alive=frozenset({"a", "b", "c"}),
        troubles={"results": "no router"},
    )
    assert system(world).warnings == (
        "no router",
        "instance a is overloaded",
        "instance c is alive and does not answer",
        "instance b cannot write its journal: disk full",
    )


def test_an_instance_that_went_is_distinguished_from_one_that_lives():
    world = DashboardState(
        services=(status("a", overloaded=False), status("b", overloaded=False)), alive=frozenset({"a"})
    )
    assert [row["state"] for row in system(world).instances] == ["alive", "gone"]


def test_the_newest_session_stands_first_and_leads_to_its_replay(update):
    old, new = update("motion", session="s1"), update("motion", session="s2")
    world = DashboardState(updates={(one.station, one.session): one for one in (old, new)})
    rows = sessions(world)
    assert [row["session"] for row in rows] == ["s2", "s1"]
    assert rows[0]["href"] == f"/sessions/{new.station}/s2"
