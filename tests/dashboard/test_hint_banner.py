"""The banner of hints on the page of a station: raised, readable from two metres, and cleared."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import expect

from caesura_clients.dashboard.hint_banner import banner_of
from caesura_protocol.messages import Hint, HintKind, Hints, Result
from clients.answering import Answering
from clients.conftest import RouterNetwork
from clients.examples import example, segment, snapshot
from dashboard.browser import LOOK_MS, PATIENCE_MS, THEMES, Visitor, needs_chromium
from dashboard.stage import Dashboard
from harness.processes import running

expect.set_options(timeout=PATIENCE_MS)
TWO_METRES_PX = 44  # capitals of 31 px, 8 mm at 96 dpi: 1/250 of the distance
SIZES = {"desktop": {"width": 1440, "height": 900}, "phone": {"width": 390, "height": 844}}
ON_TOP = """(one) => {
  const { x, y, width } = one.getBoundingClientRect();
  return one.contains(document.elementFromPoint(x + width / 2, y + 16));
}"""
PLOTS_TOP = "() => document.querySelector('.plots').getBoundingClientRect().top + scrollY"
# Of hints that are over: they stay for a short time, in which a busy machine may not look.
WATCH_OVER = """() => {
  window.over = [];
  const look = () => document.querySelectorAll(".hint.over .hint-advice")
    .forEach((one) => window.over.push(one.textContent));
  const whole = { subtree: true, childList: true, attributes: true, characterData: true };
  new MutationObserver(look).observe(document.querySelector(".hints"), whole);
}"""
HAND = "The sensor measures the hand: 8 N along the movement."


def hint(kind: HintKind, since: float, text: str, advice: str, until: float | None = None) -> Hint:
    return Hint(kind=kind, since=since, until=until, text=text, advice=advice)


def message(seq: int, *hints: Hint) -> Result:
    changes = {"station": "cell-1", "session": "s1", "seq": seq, "hints": hints}
    return example(Hints).model_copy(update=changes)


def test_the_newest_active_hint_comes_first_and_none_of_a_session_that_is_over(update):
    old = hint("joint_limit", 1.0, "Joint 4 is 2° from its limit.", "Move joint 4 back.")
    new = hint("too_fast", 2.0, "Too fast.", "Move more slowly where the path turns.")
    over = hint("singularity", 1.5, "Near a singularity.", "Bend the elbow.", until=1.8)
    active = update("motion")
    shown = banner_of(replace(active, hints=(old, over, new)))
    assert [one["kind"] for one in shown["hints"]] == ["too_fast", "joint_limit"]
    closed = update("motion", state="closed")
    assert banner_of(replace(closed, hints=(old,))) == banner_of(None) == {"hints": []}


def test_a_part_to_show_again_links_to_the_program_in_which_it_is_replaced(update):
    part = hint("show_again", 5.2, "Nothing was recorded.", "Teach the part again.")
    (shown,) = banner_of(replace(update("motion"), hints=(part.model_copy(update={"t0": 5.0, "tn": 5.2}),)))[
        "hints"
    ]
    session = update("motion")
    assert shown["href"] == f"/sessions/{session.station}/{session.session}"
    assert shown["link"] == "Replace the apps of 5.0 to 5.2 s: Edit, Teach again"


def test_a_hint_has_times_of_day_as_people_read_them(update):
    begins = 1764172800.25
    day = replace(update("motion"), segments=(segment("motion", begins),))
    pause = hint("show_again", begins + 5.2, f"Nothing at {begins + 5:.2f} s.", "Teach the part again.")
    pause = pause.model_copy(update={"t0": begins + 5.0, "tn": begins + 5.2})
    (shown,) = banner_of(replace(day, hints=(pause,)))["hints"]
    assert shown["text"] == "Nothing at 5.00 s."
    assert shown["link"] == "Replace the apps of 5.0 to 5.2 s: Edit, Teach again"


def test_a_boundary_links_to_the_program_once_its_part_is_to_be_shown_again(update):
    pause = hint("uncertain_boundary", 5.2, "It is not clear.", "Pause here.")
    pause = pause.model_copy(update={"t0": 4.6, "tn": 4.6})
    again = pause.model_copy(update={"t0": 2.0, "tn": 8.6})
    shown = [banner_of(replace(update("motion"), hints=(one,)))["hints"][0] for one in (pause, again)]
    assert ["link" in one for one in shown] == [False, True]


def test_two_hints_of_a_kind_are_distinguished(update):
    pauses = tuple(
        hint("uncertain_boundary", since, "It is not clear.", "Pause here.") for since in (3.0, 5.2)
    )
    shown = banner_of(replace(update("motion"), hints=pauses))["hints"]
    assert len({one["key"] for one in shown}) == 2


@needs_chromium
def test_a_hint_is_read_from_two_metres_and_goes_when_it_is_cleared(opened: Visitor):
    hand = hint("hand_in_wrench", 3.0, HAND, "Hold the robot behind the sensor.")
    limit = hint("joint_limit", 2.0, "Joint 4 is 2° from its limit.", "Move joint 4 back.")
    with RouterNetwork() as router, Answering(router.transport()) as service, ExitStack() as stack:
        service.snapshots = [snapshot(0, "motion", station="cell-1", session="s1")]
        dashboard = stack.enter_context(running(Dashboard(router.endpoint)))
        visitor, page, banner = opened, opened.page, opened.page.locator(".hint")
        visitor.begin_again(SIZES["desktop"])
        page.goto(f"{dashboard.url}/station/cell-1")
        expect(page.locator(".state-line")).to_contain_text("s1")
        expect(banner).to_have_count(0)
        expect(page.locator(".desk-state")).to_have_text("Stale")
        expect(page.locator(".plots")).to_be_visible()
        top = page.evaluate(PLOTS_TOP)
        service.snapshots = [service.snapshots[0].model_copy(update={"hints": message(1, hand, limit)})]
        service.put(message(1, hand, limit), "hints")
        expect(banner).to_have_count(2)
        expect(banner.first).to_contain_text("Hold the robot behind the sensor.")
        expect(banner.first).to_contain_text(HAND)
        expect(banner.first, "it comes into sight").to_be_in_viewport(ratio=1)
        assert page.evaluate(PLOTS_TOP) == top
        large = banner.first.locator(".hint-advice").evaluate(
            "(one) => parseFloat(getComputedStyle(one).fontSize)"
        )
        assert large >= TWO_METRES_PX
        for theme, rules in THEMES.items():
            page.evaluate("(theme) => document.documentElement.dataset.theme = theme", theme)
            visitor.theme = theme
            for name, size in SIZES.items():
                page.set_viewport_size(size)
                visitor.picture(f"hints-{name}")
                assert page.evaluate("() => document.documentElement.scrollWidth - innerWidth") <= 0
                assert banner.first.evaluate(ON_TOP), "no message of the page lies upon it"
            assert visitor.barriers(*rules) == []
        page.evaluate(WATCH_OVER)
        over = hand.model_copy(update={"until": 4.0})
        service.snapshots = [service.snapshots[0].model_copy(update={"hints": message(2, over)})]
        service.put(message(2, over), "hints")
        stays = "() => window.over.includes('Over: Hold the robot behind the sensor.')"
        page.wait_for_function(stays, polling=LOOK_MS)  # it can be read to its end
        expect(banner).to_have_count(0)
        assert len(set(page.evaluate("() => window.over"))) == 1, "the newest alone stays"
