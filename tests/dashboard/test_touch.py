"""A phone and a finger: what an operator does at a robot without a desk."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Browser, Locator, expect

from dashboard.browser import LOOK_MS, PATIENCE_MS, PHONE, SETTLED, Visitor, needs_chromium
from dashboard.stage import Stage
from harness.demonstrations import guided

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
FINGER_PX = 24  # WCAG 2.5.8
# What is written below the last plot of each side.
TIMES = """() => [...document.querySelectorAll(".plots")].map(
  ({ plots }) => [...plots.plots.values()].at(-1).plot.axes[0]._values)"""
STATION, SESSIONS = "cell-1", ("one", "two")
# Of two compared sessions: from the first one's plots to the end of the second one's.
BOTH_PX = """() => {
  const [one, other] = [...document.querySelectorAll(".plots")].map((plots) => plots.getBoundingClientRect());
  return other.bottom - one.top;
}"""


@pytest.fixture
def phone(stage: Stage, browser: Browser) -> Iterator[Visitor]:
    for number, session in enumerate(SESSIONS):
        stage.teach(STATION, guided(number), session=session, pace="fast")
        stage.wait(STATION)
    visitor = Visitor(browser, viewport=PHONE, has_touch=True, is_mobile=True, device_scale_factor=2)
    visitor.is_called("Ann", stage.dashboard.url)
    yield visitor
    assert visitor.errors == []
    visitor.close()


def top_px(element: Locator) -> float:
    """Of the page, however it is scrolled."""
    return float(element.evaluate("(element) => element.getBoundingClientRect().y + scrollY"))


def test_a_finger_compares_exports_and_teaches_a_part_again(stage: Stage, phone: Visitor, tmp_path: Path):
    page = phone.page
    page.set_viewport_size({"width": PHONE["width"], "height": 520})  # as a long list
    page.goto(f"{stage.dashboard.url}/sessions")
    boxes, first = page.locator(".choose"), page.locator("table.sessions tbody tr").first
    expect(boxes).to_have_count(len(SESSIONS))
    for tapped in (*boxes.all(), *page.locator(".is-task a").all()):
        size = tapped.bounding_box()
        assert size is not None
        assert min(size["width"], size["height"]) >= FINGER_PX, size
    boxes.first.tap()
    before = top_px(first)
    boxes.last.tap()
    together = page.get_by_role("link", name="Compare these two")
    expect(together).to_be_visible()
    assert top_px(first) == before, "the list moved below the finger"
    first.evaluate("(row) => scrollTo(0, scrollY + row.getBoundingClientRect().bottom)")
    expect(together, "it was above what is in sight").to_be_in_viewport(ratio=1)
    phone.picture("touch-chosen")
    together.tap()

    page.set_viewport_size(PHONE)
    expect(page.locator(".tables, table.facts").first).to_contain_text("alike")
    expect(page.locator(".legend").first, "one for both").to_be_hidden()
    expect(page.locator(".legend").last).to_be_visible()
    assert phone.sideways_px() <= 0
    page.wait_for_function(
        f"() => [...document.querySelectorAll('.plots')].every({SETTLED})", polling=LOOK_MS
    )
    assert [len([*filter(None, times)]) > 3 for times in page.evaluate(TIMES)] == [True, True]
    phone.picture("touch-compare")
    expect(page.get_by_role("button", name="Zoom in"), "one for both").to_have_count(1)
    assert page.evaluate(BOTH_PX) <= PHONE["height"], "one was out of sight while the other was seen"
    page.get_by_role("group", name="Signals").last.get_by_role("button", name="force").tap()
    expect(page.locator(".panel[data-signal=force]"), "of both").to_have_count(2)
    expect(page.locator(".panels .panel")).to_have_count(2)
    page.get_by_role("button", name="Move together").tap()
    expect(page.get_by_role("button", name="Zoom in"), "one each").to_have_count(2)

    page.goto(f"{stage.dashboard.url}/sessions/{STATION}/{SESSIONS[1]}")
    with page.expect_download() as download:
        page.locator(".exports").get_by_role("link", name="JSON").tap()
    download.value.save_as(tmp_path / "program.json")
    taught = json.loads((tmp_path / "program.json").read_text())["apps"]

    last = page.locator(f"summary[aria-label='Edit app {len(taught)}']")
    last.tap()
    page.locator(".part-session").select_option(SESSIONS[0])
    page.locator(".replace-part").tap()
    expect(page.locator(".program-said")).to_contain_text(f"replaced by session '{SESSIONS[0]}'")
    expect(last, "the new part comes into sight").to_be_focused()
    expect(last).to_be_in_viewport()
    phone.picture("touch-again")
