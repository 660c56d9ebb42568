"""A browser that applies the differences has what the session has."""

from __future__ import annotations

from dataclasses import replace

import pytest

from caesura_clients.dashboard.drawing_updates import (
    SentState,
    beginning,
    delta,
    phase_row,
    run_lengths,
    segment_row,
)
from caesura_protocol.messages import Phase, Posterior
from clients.examples import changepoint, example, segment


class SessionViewScript:
    """What `session_view.js` does with a payload."""

    def __init__(self) -> None:
        self.segments: list = []
        self.phases: list = []
        self.changepoints: list = []
        self.session = ""

    def apply(self, payload: dict) -> None:
        if payload.get("reset"):
            self.__init__()
        self.session = payload.get("session", self.session)
        for name in ("segments", "phases", "changepoints"):
            if name in payload:
                part = payload[name]
                setattr(self, name, getattr(self, name)[: part["first"]] + part["rows"])


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


def test_a_browser_gets_the_start_once_and_rows_keep_the_clock_of_the_samples(update):
    day = replace(update("motion"), segments=(segment("motion", 1764172800.25),))
    sent, payload = delta(SentState(), day)
    assert payload["start"] == payload["segments"]["rows"][0][0] == 1764172800.25
    _, payload = delta(sent, replace(day, changepoints=(changepoint(1764172800.75),)))
    assert payload["changepoints"]["rows"][0][0] == 1764172800.75
    assert "start" not in payload


def test_a_browser_that_takes_every_difference_has_everything(updates):
    browser, sent = SessionViewScript(), SentState()
    for one in updates:
        sent, payload = delta(sent, one)
        browser.apply(payload)
        assert browser.session == one.session
        assert browser.segments == [segment_row(part) for part in one.segments]
        assert browser.phases == [phase_row(part) for part in one.phases]
        assert [row[0] for row in browser.changepoints] == [point.t for point in one.changepoints]


def test_a_page_begins_with_what_its_samples_need_and_gets_the_rest_after(updates):
    browser, two = SessionViewScript(), updates[1]
    sent, payload = beginning(two)
    browser.apply(payload)
    assert browser.segments == [segment_row(two.segments[0])]
    assert not browser.phases
    assert not browser.changepoints
    _, rest = delta(sent, two)
    browser.apply(rest)
    assert browser.segments == [segment_row(one) for one in two.segments]
    assert len(browser.phases) == 2
    assert rest["segments"]["first"] == 1
    assert rest["t"] == payload["t"]
    assert "reset" not in rest


def test_a_page_of_an_unknown_session_begins_empty():
    assert beginning(None) == (SentState(), {})


def test_a_browser_that_missed_some_catches_up_at_once(updates):
    browser = SessionViewScript()
    sent, payload = delta(SentState(), updates[0])
    browser.apply(payload)
    _, payload = delta(sent, updates[3])
    browser.apply(payload)
    assert browser.segments == [segment_row(part) for part in updates[3].segments]


def test_a_phase_has_the_name_that_it_was_given():
    named = example(Phase).model_copy(update={"name": "reach"})
    assert (phase_row(named)[6], phase_row(example(Phase))[6]) == ("reach", example(Phase).name)


def test_nothing_new_is_nothing_to_send(updates):
    sent, _ = delta(SentState(), updates[1])
    assert delta(sent, updates[1]) == (sent, {})


def test_only_what_changed_is_sent(updates):
    sent, _ = delta(SentState(), updates[0])
    _, payload = delta(sent, updates[1])
    assert payload["segments"]["first"] == 1
    assert len(payload["segments"]["rows"]) == 1


def test_a_session_that_is_gone_leaves_nothing_behind(updates):
    sent, _ = delta(SentState(), updates[0])
    assert delta(sent, None) == (SentState(), {"reset": True})
    assert delta(SentState(), None) == (SentState(), {})


def test_run_lengths_are_times_back_from_their_observation():
    one = example(Posterior).model_copy(
        update={"t": 2.0, "starts": (0.5, 1.5), "probabilities": (0.9999, 0.0001)}
    )
    assert run_lengths([one]) == [[2.0, [[1.5, 1.0]]]]


def test_a_segment_has_its_start_and_its_load_and_no_end_to_draw_a_line_to(updates):
    row = segment_row(updates[0].segments[0])
    assert row[7:] == [[0.5, -0.25, 0.125], 0.5, 0.0625]


@pytest.mark.parametrize(("frame", "tare"), [("base", (0.5, -1.0, 2.0)), ("flange", None)])
def test_a_bias_is_taken_off_where_it_and_the_samples_are_in_one_frame(updates, frame, tare):
    wrench = updates[0].status.wrench.model_copy(update={"frame": frame, "tare": (0.5, -1.0, 2.0)})
    one = replace(updates[0], status=updates[0].status.model_copy(update={"wrench": wrench}))
    _, payload = delta(SentState(), one)
    assert (payload["frame"], payload["tare"]) == (frame, tare)


def test_a_force_whose_tare_is_withdrawn_is_drawn_as_measured(updates):
    """Its panel had the title "force without its bias", and nothing was taken off."""
    status = updates[0].status
    tares = [(3.0, 0.0, 16.0), (0.0, 0.0, 0.0)]
    reports = [status.wrench.model_copy(update={"frame": "base", "tare": tare}) for tare in tares]
    pressed, withdrawn = (
        replace(updates[0], status=status.model_copy(update={"wrench": report})) for report in reports
    )
    sent, first = delta(SentState(), pressed)
    _, second = delta(sent, withdrawn)
    assert (first["tare"], second["tare"]) == (tares[0], None)
