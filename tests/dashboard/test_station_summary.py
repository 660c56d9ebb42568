"""What a station is said to do, and when what is shown is said to be old."""

from __future__ import annotations

from dataclasses import replace

import pytest

from caesura_clients.dashboard.demonstration_requests import controls
from caesura_clients.dashboard.station_summary import (
    STALE_S,
    DashboardState,
    NewestSamples,
    glance,
    glances,
    lasted,
    reached,
    summary,
    troubled,
    warning_of,
)
from caesura_protocol.messages import BridgeStatus, Gap, ServiceStatus
from clients.examples import example

NOW = 100.0


@pytest.fixture
def world(update):
    """One station in the middle of a demonstration, all well."""
    taught = update("motion", "contact", t=12.0)
    key = (taught.station, taught.session)
    return DashboardState(
        updates={key: taught},
        current={taught.station: taught.session},
        bridges=frozenset({taught.station}),
        alive=frozenset({"a"}),
    )


def station_of(world):
    ((station, _),) = world.updates
    return station


def seen(world, *, received_ago=0.1, received_t=12.0, received_first=0.0, began=0.0):
    station = station_of(world)
    session = world.updates[next(iter(world.updates))].session
    newest = NewestSamples(NOW - (received_ago or 0.0), received_t, session, received_first)
    received = None if received_ago is None else newest
    return glance(world, station, received, NOW, began)


def changed(world, **status):
    ((key, update),) = world.updates.items()
    return replace(world, updates={key: replace(update, status=update.status.model_copy(update=status))})


@pytest.mark.parametrize("first", [500.0, 1764172800.0], ids=["robot", "of day"])
def test_samples_of_any_clock_are_not_behind_before_the_first_result(world, update, first):
    """A robot's clock goes on while its bridge is started again: each session began as `Stale`."""
    ((key, _),) = world.updates.items()
    begun = replace(world, updates={key: update(t=0.0)})
    assert seen(begun, received_t=first + 0.5, received_first=first).why == ""
    late = "results are 4 s behind the samples"
    assert seen(begun, received_t=first + 4.0, received_first=first).why == late
    ended = replace(world, updates={key: update(t=first + 0.5)})
    assert seen(ended, received_t=first + 4.5, received_first=first).why == late


def test_a_station_that_is_taught_says_what_it_is_doing(world):
    one = seen(world)
    assert (one.state, one.why, one.kind, one.segments) == ("teaching", "", "contact", 2)


def test_a_demonstration_that_is_over_has_no_current_segment(world, update):
    ((key, taught),) = world.updates.items()
    status = taught.status.model_copy(update={"state": "closed"})
    one = seen(replace(world, updates={key: replace(taught, status=status)}))
    assert (one.state, one.kind, one.probability, one.segments) == ("done", "", None, 2)


def test_a_demonstration_that_the_service_cannot_store_is_stale_at_once(world):
    # The page said "teaching", and the list "none in trouble", until the bridge's ring was full.
    status, trouble = example(ServiceStatus), "journal j.sqlite cannot be written, there is no room left"
    journal = status.journal.model_copy(update={"trouble": trouble})
    ((_, update),) = world.updates.items()
    for instance, expected in ((update.status.instance, "stale"), ("another", "teaching")):
        one = status.model_copy(update={"instance": instance, "journal": journal})
        found = seen(replace(world, services=(one,)))
        assert found.state == expected
        assert (trouble in found.why) == (expected == "stale")
    broken = replace(
        world, services=(status.model_copy(update={"instance": update.status.instance, "journal": journal}),)
    )
    assert summary(broken, [seen(broken)]) == "1 station, 1 in trouble"


def test_a_session_with_the_time_of_day_is_as_long_as_it_lasted(update):
    plain, day_s = update("motion", "contact", t=12.0), 1.7e9
    later = tuple(
        one.model_copy(update={"t0": one.t0 + day_s, "tn": one.tn + day_s}) for one in plain.segments
    )
    shifted = replace(plain, segments=later)
    assert lasted(plain) == reached(plain)
    assert lasted(shifted) == pytest.approx(later[-1].tn - later[0].t0)


@pytest.mark.parametrize(
    ("changes", "arguments", "words"),
    [
        ({}, {"received_ago": STALE_S + 1.0}, "no sample for 3 s"),
        ({}, {"received_ago": None}, "no sample for 100 s"),
        ({"bridges": frozenset()}, {}, "its bridge is gone"),
        ({"alive": frozenset()}, {}, "no service answers"),
        ({"troubles": {"results": "tcp/x: gone"}}, {}, "tcp/x: gone"),
        ({}, {"received_t": 16.0}, "results are 4 s behind the samples"),
    ],
)
def test_what_looks_alive_and_is_not_is_stale_and_says_why(world, changes, arguments, words):
    one = seen(replace(world, **changes), **arguments)
    assert (one.state, one.why) == ("stale", words)


def test_a_station_that_two_bridges_teach_is_in_trouble_and_not_stale(world):
    one = seen(replace(world, parallel={station_of(world): ("s1", "s2")}))
    words = f"two bridges teach at {station_of(world)}: s1 and s2: give one of them another --station"
    assert (one.state, one.why, troubled([one])) == ("teaching", words, 1)
    assert warning_of(one, world) == words
    stale = seen(world, received_ago=STALE_S + 1.0)
    assert warning_of(stale, world) == "Stale: no sample for 3 s. What is shown is old."
    without = warning_of(replace(stale, why="no router. This page connects by itself."), world)
    assert without == "Stale: no router. This page connects by itself. What is shown is old."


def test_a_bridge_in_standby_that_warns_while_it_teaches_is_shown(world):
    name, warning = station_of(world), "the service ignores that up is 0,0,-1"
    status = BridgeStatus(station=name, bridge="b", state="teaching", source="ur", problem=warning)
    one = seen(replace(world, standby={name: status}))
    assert (one.state, one.why, troubled([one])) == ("teaching", warning, 1)
    assert warning_of(one, world) == warning


def test_a_robot_that_is_not_ready_beside_an_ended_session_makes_nothing_old(world):
    """A bridge that was started again showed `Stale` while it connected to its robot."""
    ended, name = changed(world, state="closed"), station_of(world)
    status = BridgeStatus(station=name, bridge="b", state="failed", source="ur", problem="it is locked")
    one = seen(replace(ended, standby={name: status}))
    assert (one.state, one.why) == ("failed", "it is locked")
    assert warning_of(one, ended) == ""


def test_nothing_can_have_come_before_the_dashboard_began(world):
    assert seen(world, received_ago=None, began=NOW - 1.0).state == "teaching"


def test_a_demonstration_that_has_just_begun_is_not_as_silent_as_the_one_before(world):
    """Each Start showed `Stale` in red, until the first sample came."""
    ((station, session),) = world.updates
    before = NewestSamples(NOW - 60.0, 12.0, "before")
    begun = replace(world, first_seen={(station, session): NOW - 0.5})
    one = glance(begun, station, before, NOW, 0.0)
    assert (one.state, one.why, one.age_s) == ("teaching", "", 0.5)
    begun = replace(world, first_seen={(station, session): NOW - STALE_S - 1.0})
    assert glance(begun, station, before, NOW, 0.0).why == "no sample for 3 s"


def test_a_closed_session_is_over_whatever_comes(world):
    one = seen(changed(replace(world, bridges=frozenset()), state="closed"), received_ago=60.0)
    assert (one.state, one.age_s) == ("done", None)


def test_a_bridge_without_a_session_is_ready():
    found = glances(DashboardState(bridges=frozenset({"cell-9"})), {}, NOW, 0.0)
    assert [(one.station, one.state) for one in found] == [("cell-9", "ready")]


def test_a_late_status_of_a_bridge_that_is_gone_makes_no_station_ready():
    late = BridgeStatus(station="cell-9", bridge="b", state="ready", source="franky")
    there = DashboardState(bridges=frozenset({"cell-9"}), standby={"cell-9": late})
    gone = replace(there, bridges=frozenset())
    assert [glance(world, "cell-9", None, NOW, 0.0).state for world in (there, gone)] == ["standby", "gone"]


def test_a_late_status_of_a_bridge_that_is_gone_enables_no_button():
    """A status on its way while the token went: Stop stayed enabled, and the page did not name the bridge."""
    late = BridgeStatus(station="cell-9", bridge="b", state="teaching", source="franky", session="s1")
    there = DashboardState(bridges=frozenset({"cell-9"}), standby={"cell-9": late}, alive=True)
    gone = replace(there, bridges=frozenset())
    first, then = (controls(world, "cell-9", may_operate=True) for world in (there, gone))
    assert (first["state"], first["canStop"]) == ("teaching", True)
    assert (then["state"], then["canStop"], then["canStart"]) == ("", False, False)
    assert "No bridge is connected at cell-9" in then["why"]


def test_a_press_that_began_nothing_is_explained_where_start_is():
    why = "the button was pressed, and nothing began: no service is there"
    status = BridgeStatus(station="cell-9", bridge="b", state="ready", source="franky", problem=why)
    there = DashboardState(bridges=frozenset({"cell-9"}), standby={"cell-9": status}, alive=True)
    shown = controls(there, "cell-9", may_operate=True)
    assert (shown["canStart"], shown["outcome"]) == (
        True,
        "The button was pressed, and nothing began: no service is there.",
    )


@pytest.mark.parametrize(
    ("outcome", "shown"), [("is stored", ""), ("is stored; 3 of 9 batches are lost", "s1 {}.")]
)
def test_lost_batches_of_the_last_demonstration_are_stated_where_stop_is(outcome: str, shown: str):
    status = BridgeStatus(
        station="cell-9", bridge="b", state="ready", source="franky", last_session="s1", outcome=outcome
    )
    there = DashboardState(bridges=frozenset({"cell-9"}), standby={"cell-9": status}, alive=True)
    assert controls(there, "cell-9", may_operate=True)["outcome"] == shown.format(outcome)


def test_overload_and_gaps_are_reported_and_counted(world):
    gap = Gap(t0=1.0, tn=2.0, reason="evicted")
    one = seen(changed(world, overloaded=True, gaps=(gap,), gaps_before=3))
    assert (one.overloaded, one.gaps, troubled([one])) == (True, 4, 1)


def test_the_session_that_is_shown_is_that_of_the_program(world, update):
    other = update("steady", session="zzz")
    both = replace(world, updates={**world.updates, (other.station, "zzz"): other})
    assert both.update(other.station) is world.update(other.station)
    assert both.update(other.station, "zzz") is other
    assert both.update(other.station, "none") is None


def test_an_age_is_shown_once_it_can_be_read(world):
    assert seen(world, received_ago=0.3).drawn()["age_s"] == ""
    assert seen(world, received_ago=1.5).drawn()["age_s"] == "1.5 s"


def test_while_no_service_answers_nothing_is_said_of_trouble(world):
    ready = replace(changed(world, state="closed"), standby={})
    found = glances(ready, {}, NOW, 0.0)
    assert summary(ready, found) == "1 station, none in trouble"
    assert summary(replace(ready, alive=frozenset()), found) == "1 station, no service answers"


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"alive": frozenset()}, "is not known: no service answers"),
        ({"troubles": {"results": "the router is gone"}}, "is not known: the router is gone"),
        ({}, "and it has no session"),
    ],
)
def test_of_an_unknown_station_no_session_is_denied_while_the_service_does_not_answer(world, changes, why):
    assert why in controls(replace(world, **changes), "cell-9", may_operate=True)["why"]
