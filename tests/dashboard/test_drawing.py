"""A browser that applies the differences has what the session has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from caesura_clients.dashboard.drawing import SentState, delta, phase_row, run_lengths, segment_row
from caesura_clients.dashboard.signals import Rows, SignalRing
from caesura_protocol.messages import Phase, Posterior
from clients.examples import changepoint, example, segment

NOTHING = Rows("", "m/s", 0, ())
COLUMNS = ("t", "px", "py", "pz")


class Browser:
    """What `session_view.js` does with a payload."""

    def __init__(self) -> None:
        self.segments: list = []
        self.phases: list = []
        self.changepoints: list = []
        self.signals: list = []
        self.session = ""

    def apply(self, payload: dict) -> None:
        if payload.get("reset"):
            self.__init__()
        self.session = payload.get("session", self.session)
        for name in ("segments", "phases", "changepoints"):
            if name in payload:
                part = payload[name]
                setattr(self, name, getattr(self, name)[: part["first"]] + part["rows"])
        self.signals += payload.get("signals", [])


@pytest.fixture
def updates(update):
    """A session as it grows, is revised, and gives way to the next one."""
    one = update("motion")
    two = replace(
        one, segments=(segment("motion"), segment("contact", 1.0)), changepoints=(changepoint(1.0),)
    )
    press = example(Phase).model_copy(update={"first_segment": 1, "last_segment": 1})
    two = replace(two, phases=(example(Phase), press))
    revised = replace(two, segments=(segment("steady"), segment("contact", 1.0)))
    revised = replace(revised, phases=(press,))
    shorter = replace(revised, segments=(segment("motion"),), changepoints=())
    return [one, two, revised, shorter, update("transport", session="another")]


def test_a_browser_that_takes_every_difference_has_everything(updates):
    browser, sent = Browser(), SentState()
    for one in updates:
        sent, payload = delta(sent, one, NOTHING)
        browser.apply(payload)
        assert browser.session == one.session
        assert browser.segments == [segment_row(part) for part in one.segments]
        assert browser.phases == [phase_row(part) for part in one.phases]
        assert [row[0] for row in browser.changepoints] == [point.t for point in one.changepoints]


def test_a_browser_that_missed_some_catches_up_at_once(updates):
    browser = Browser()
    sent, payload = delta(SentState(), updates[0], NOTHING)
    browser.apply(payload)
    _, payload = delta(sent, updates[3], NOTHING)
    browser.apply(payload)
    assert browser.segments == [segment_row(part) for part in updates[3].segments]


def test_nothing_new_is_nothing_to_send(updates):
    sent, _ = delta(SentState(), updates[1], NOTHING)
    assert delta(sent, updates[1], NOTHING) == (sent, {})


def test_only_what_changed_is_sent(updates):
    sent, _ = delta(SentState(), updates[0], NOTHING)
    _, payload = delta(sent, updates[1], NOTHING)
    assert payload["segments"]["first"] == 1
    assert len(payload["segments"]["rows"]) == 1


def test_signals_are_sent_once_and_only_those_of_the_session(updates):
    ring, session = SignalRing(), updates[0].session
    t = np.arange(1000) / 1000.0
    ring.receive(session, COLUMNS, np.column_stack([t, t, t, t]))
    sent, payload = delta(SentState(), updates[0], ring.after(0))
    assert len(payload["signals"]) == 24
    assert delta(sent, updates[0], ring.after(sent.rows))[1] == {}
    other = ring.after(0)._replace(session="another")
    assert "signals" not in delta(SentState(), updates[0], other)[1]


def test_a_session_that_is_gone_leaves_nothing_behind(updates):
    sent, _ = delta(SentState(), updates[0], NOTHING)
    assert delta(sent, None, NOTHING) == (SentState(), {"reset": True})
    assert delta(SentState(), None, NOTHING) == (SentState(), {})


def test_run_lengths_are_times_back_from_their_observation():
    one = example(Posterior).model_copy(
        update={"t": 2.0, "starts": (0.5, 1.5), "probabilities": (0.9999, 0.0001)}
    )
    assert run_lengths([one]) == [[2.0, [[1.5, 1.0]]]]


def test_signals_are_in_metres_whatever_the_bridge_sends(updates):
    status = updates[0].status.model_copy(update={"length_unit": "mm"})
    one = replace(updates[0], status=status)
    ring = SignalRing()
    t = np.arange(1000) / 1000.0
    ring.receive(one.session, COLUMNS, np.column_stack([t, t + 250.0, t, t]))
    _, payload = delta(SentState(), one, ring.after(0))
    assert payload["signals"][0][1] == pytest.approx(0.25, abs=0.001)


@pytest.mark.parametrize(("frame", "tare"), [("base", (0.5, -1.0, 2.0)), ("flange", None)])
def test_a_bias_is_taken_off_where_it_and_the_samples_are_in_one_frame(updates, frame, tare):
    wrench = updates[0].status.wrench.model_copy(update={"frame": frame, "tare": (0.5, -1.0, 2.0)})
    one = replace(updates[0], status=updates[0].status.model_copy(update={"wrench": wrench}))
    _, payload = delta(SentState(), one, NOTHING)
    assert (payload["frame"], payload["tare"]) == (frame, tare)
