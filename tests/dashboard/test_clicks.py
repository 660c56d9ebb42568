"""A double click presses one button: it pressed the one, too, that stood at its place then."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Locator, Page, expect

from caesura_clients import Caesura
from caesura_protocol.messages import Snapshot
from dashboard.browser import DESK, PATIENCE_MS, Visitor, needs_chromium
from dashboard.stage import Stage
from harness.demonstrations import guided

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
BETWEEN_MS = 200  # the two clicks, as of a hand: the first one has mostly been answered by then


@pytest.fixture(scope="module")
def taught(stage: Stage) -> Iterator[Caesura]:
    stage.teach("cell-1", guided(), session="over", pace="fast")
    stage.wait("cell-1")
    with stage.reader() as caesura:
        yield caesura


@pytest.fixture
def page(stage: Stage, taught: Caesura, opened: Visitor) -> Iterator[Page]:
    opened.begin_again(DESK)
    opened.is_called("Ann", stage.dashboard.url)
    opened.page.goto(f"{stage.dashboard.url}/sessions/cell-1/over")
    expect(opened.page.locator(".app").first).to_be_visible()
    yield opened.page
    assert opened.errors == []


def now(caesura: Caesura) -> Snapshot:
    return caesura.snapshot("cell-1", "over")


def click_twice(page: Page, button: Locator) -> None:
    """At one place, whatever stands there by the second click."""
    button.scroll_into_view_if_needed()
    button.hover()
    box = button.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.click(x, y)
    page.wait_for_timeout(BETWEEN_MS)
    page.mouse.click(x, y)


def test_a_double_click_on_delete_deletes(page: Page, taught: Caesura):
    page.locator(".description summary").press("Enter")
    delete = page.locator(".description .delete")
    click_twice(page, delete)
    expect(page.locator(".saved")).to_contain_text("Deleted")
    expect(delete).to_have_text("Restore")
    delete.press("Enter")  # the keyboard is not held up
    expect(page.locator(".saved")).to_contain_text("Restored.")
    assert now(taught).status.description.deleted is False
    assert now(taught).status.described == 2


def test_what_only_looks_takes_every_click(page: Page):
    page.get_by_role("button", name="All", exact=True).click()
    before_s = page.wait_for_function(SPAN).json_value()
    click_twice(page, page.get_by_role("button", name="Zoom in"))
    page.wait_for_function(f"(before) => Math.abs(({SPAN})() - before / 4) < 1e-6", arg=before_s)


SPAN = """() => {
  const { from, to } = document.querySelector(".plots").dataset;
  return to - from;
}"""
