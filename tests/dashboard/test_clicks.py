"""A double click presses one button: it pressed the one, too, that stood at its place then."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Locator, Page, expect

from caesura_clients import Caesura
from caesura_protocol.messages import Snapshot
from dashboard.browser import CLICK, DESK, PATIENCE_MS, Visitor, needs_chromium
from dashboard.stage import Stage
from harness.demonstrations import guided

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
BETWEEN_MS = 200  # the two clicks, as of a hand: the first one has mostly been answered by then
LAG_MS = 300  # of a page that is busy
DOUBLE_MS = 500  # as AGAIN_MS of clicks.js
TRIES = 20  # of a double click, which a busy machine may do too slowly
HELD = 12  # how often a key that is held down repeats itself
WHEN_PRESSED = """() => {
  const note = ({ timeStamp }) => window.pressed.push(timeStamp);
  if (!window.pressed) addEventListener("pointerdown", note, true);
  window.pressed = [];
}"""


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


def click_twice(page: Page, button: Locator) -> bool:
    """At one place, whatever stands there by the second click; whether that came in time for a double one."""
    button.scroll_into_view_if_needed()
    button.hover()
    box = button.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.evaluate(WHEN_PRESSED)
    page.mouse.click(x, y)
    page.wait_for_timeout(BETWEEN_MS)
    page.mouse.click(x, y)
    first, second = page.evaluate("() => window.pressed")
    return bool(second - first < DOUBLE_MS)


def test_a_double_click_on_delete_deletes(page: Page, taught: Caesura):
    page.locator(".description summary").press("Enter")
    delete = page.locator(".description .delete")
    clicks = 0
    while not click_twice(page, delete):  # too slowly: both have counted, and it is restored
        clicks += 2
        assert clicks <= 2 * TRIES
        expect(page.locator(".saved")).to_contain_text("Restored.")
        expect(delete).to_have_text("Delete")
    expect(page.locator(".saved")).to_contain_text("Deleted")
    expect(delete).to_have_text("Restore")
    delete.press("Enter")  # the keyboard is not held up
    expect(page.locator(".saved")).to_contain_text("Restored.")
    assert now(taught).status.description.deleted is False
    assert now(taught).status.described == clicks + 2


def test_a_double_click_on_delete_deletes_also_where_the_page_lags(page: Page, taught: Caesura):
    """The first click was handled 300 ms late, and did not count as one that changes something."""
    page.locator(".description summary").press("Enter")
    delete, saved = page.locator(".description .delete"), page.locator(".saved")
    first = delete.evaluate(CLICK, page.evaluate("() => performance.now()") - LAG_MS)
    expect(saved).to_contain_text("Deleted")
    expect(delete).to_have_text("Restore")
    described = now(taught).status.described
    delete.evaluate(CLICK, first + BETWEEN_MS)
    delete.press("Enter")  # after the click
    expect(saved).to_contain_text("Restored.")
    assert now(taught).status.described == described + 1


def open_first(page: Page) -> Locator:
    card = page.locator(".app").first
    card.locator(".app-edit summary").press("Enter")
    expect(card.locator(".duplicate")).to_be_enabled()
    return card


def undo_the_edit(page: Page) -> None:
    page.locator(".undo-edit").press("Enter")
    expect(page.locator(".program-said")).to_contain_text("Undone: app")


def apps(caesura: Caesura) -> list[str]:
    return [app.kind for app in now(caesura).program.apps]


def test_a_double_click_on_copy_makes_one_copy(page: Page, taught: Caesura):
    copy = open_first(page).locator(".duplicate")
    copy.press("Enter")  # from the first edit on nothing on the page moves at the next ones
    expect(page.locator(".program-said")).to_contain_text("duplicated")
    before = apps(taught)
    for _ in range(TRIES):
        was_in_time = click_twice(page, copy)
        expect(page.locator(".program-said")).to_contain_text("duplicated")
        expect(copy).to_be_enabled()
        undo_the_edit(page)
        if was_in_time:
            break
        while apps(taught) != before:
            undo_the_edit(page)
    assert apps(taught) == before, "one undo takes it back"


def test_a_double_click_on_yes_states_success_and_a_held_key_takes_it_back_once(page: Page, taught: Caesura):
    page.locator(".description summary").press("Enter")
    yes = page.locator(".description .yes")
    for _ in range(TRIES):
        was_in_time = click_twice(page, yes)
        expect(page.locator(".saved")).to_contain_text("Saved.")
        if was_in_time:
            break
        page.reload()
        page.locator(".description summary").press("Enter")
        if now(taught).status.description.success:
            yes.press("Enter")
            expect(yes).to_have_attribute("aria-pressed", "false")
            expect(page.locator(".saved")).to_contain_text("Saved.")
    expect(yes).to_have_attribute("aria-pressed", "true")
    assert now(taught).status.description.success is True
    yes.focus()
    for _ in range(HELD):  # pressed so often it would state success again
        page.keyboard.down("Enter")
    page.keyboard.up("Enter")
    expect(yes, "a key that is held down presses once").to_have_attribute("aria-pressed", "false")
    expect(page.locator(".saved")).to_contain_text("Saved.")
    assert now(taught).status.description.success is None


def test_what_only_looks_takes_every_click(page: Page):
    page.get_by_role("button", name="All", exact=True).click()
    before_s = page.wait_for_function(SPAN).json_value()
    click_twice(page, page.get_by_role("button", name="Zoom in"))
    page.wait_for_function(f"(before) => Math.abs(({SPAN})() - before / 4) < 1e-6", arg=before_s)


SPAN = """() => {
  const { from, to } = document.querySelector(".plots").dataset;
  return to - from;
}"""
