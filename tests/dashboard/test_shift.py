"""A shift at the desk: a page is left, a login ends, names are long, and the clocks are set back."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Browser, Locator, Page, expect

from caesura_clients.program_editing import edit_program, reference
from caesura_protocol.messages import ChangeApp, NameProgram
from dashboard.browser import DESK, PATIENCE_MS, PHONE, UPRIGHT, Visitor, needs_chromium
from dashboard.stage import Dashboard, Stage
from harness.demonstrations import guided
from harness.processes import eventually, running

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
SHEET = {"width": 794, "height": 1123}  # A4 at 96 dpi


@pytest.fixture
def page(stage: Stage, opened: Visitor) -> Iterator[Page]:
    opened.begin_again(DESK)
    opened.is_called("Ann", stage.dashboard.url)
    yield opened.page
    assert opened.errors == []


def taught(stage: Stage, page: Page, station: str) -> None:
    """A session that is over, and its page."""
    stage.teach(station, guided(), session="over", pace="fast")
    stage.wait(station)
    page.goto(f"{stage.dashboard.url}/sessions/{station}/over")
    expect(page.locator(".app").first).to_be_visible()


def _answered_by_the_test(_dialog: object) -> None:
    """Keep Playwright from answering."""


def stays_after_it_was_asked(page: Page) -> None:
    """The page is loaded again, and the operator chooses to stay."""
    with page.expect_event("dialog") as asked:
        page.evaluate("() => void setTimeout(() => location.reload())")
    assert asked.value.type == "beforeunload"
    asked.value.dismiss()


def form_of(page: Page) -> Locator:
    form = page.locator(".description")
    form.locator("summary").press("Enter")
    expect(form.locator(".name-note")).to_be_visible()
    return form


def test_a_page_with_something_typed_in_it_is_not_left_unasked(stage: Stage, page: Page):
    taught(stage, page, "cell-1")
    page.on("dialog", _answered_by_the_test)
    note = form_of(page).locator(".name-note")
    note.click()
    page.keyboard.type("mind the cable")
    stays_after_it_was_asked(page)
    expect(note, "what was typed is kept").to_have_value("mind the cable")
    note.press("Enter")
    expect(page.locator(".saved")).to_contain_text("Saved.")
    card = page.locator(".app").first
    card.locator(".app-edit summary").press("Enter")
    card.locator(".app-name").fill("Reach")
    stays_after_it_was_asked(page)
    card.locator(".save").press("Enter")
    expect(card.locator("h3")).to_contain_text("Reach")
    expect(card.locator(".save"), "nothing is left to be saved").to_be_disabled()
    page.reload()
    expect(page.locator(".description summary")).to_contain_text("mind the cable")
    page.remove_listener(
        "dialog", _answered_by_the_test
    )  # the page is shared: later ones would wait for an answer


def test_a_page_shows_no_program_of_a_session_that_is_gone(stage: Stage, page: Page, opened: Visitor):
    taught(stage, page, "cell-2")
    page.goto(f"{stage.dashboard.url}/station/cell-2")
    expect(page.locator(".app").first).to_be_visible()
    stage.service.kill()
    shutil.rmtree(stage.service.journal)
    stage.service.start()
    expect(page.locator(".desk-why")).to_contain_text("it has no session")
    expect(page.locator(".app, .app-edit, .program-tools")).to_have_count(0)
    opened.errors.clear()  # its samples are not there any more


def test_long_names_leave_the_page_its_width_and_the_apps_their_place(
    stage: Stage, page: Page, opened: Visitor
):
    station = "c" * 64
    taught(stage, page, station)
    with stage.reader() as caesura:
        caesura.describe(station, "over", author="Ann", task="t" * 120, operator="o" * 64, tags=("g" * 64,))
        app = reference(caesura.snapshot(station, "over").program.apps[0])
        for action in (ChangeApp(app=app, name="n" * 64, note="m" * 200), NameProgram(name="p" * 120)):
            edit_program(caesura.transport, station, "over", action, author="a" * 64)
    page.locator(".edits summary").press("Enter")
    expect(page.locator(".edits li")).to_have_count(2)
    for size in (DESK, UPRIGHT, PHONE):
        page.set_viewport_size(size)
        eventually(lambda: opened.sideways_px() <= 0)
    page.set_viewport_size(DESK)
    eventually(lambda: (page.locator(".apps").bounding_box() or {"height": 0})["height"] > 150)
    page.emulate_media(media="print")
    page.set_viewport_size(SHEET)
    eventually(lambda: page.locator(".apps").evaluate("(apps) => apps.scrollWidth <= apps.clientWidth"))
    page.emulate_media(media="screen")
    page.goto(f"{stage.dashboard.url}/sessions")
    expect(page.locator("td.is-station", has_text=station).first).to_be_visible()
    for size in (DESK, PHONE):
        page.set_viewport_size(size)
        eventually(lambda: opened.sideways_px() <= 0)
    page.set_viewport_size(DESK)
    table = page.locator("div.scroll")
    eventually(lambda: table.evaluate("(one) => one.scrollWidth <= one.clientWidth"))


def test_a_login_that_ended_before_the_page_was_connected_is_stated(
    stage: Stage, browser: Browser, tmp_path: Path
):
    file = tmp_path / "password"
    file.write_text("correct horse\n")
    visitor = Visitor(browser, viewport=DESK)
    page = visitor.page
    try:
        with running(Dashboard(stage.service.endpoint, "--password-file", str(file))) as dashboard:
            page.goto(f"{dashboard.url}/system")
            page.get_by_label("Password").fill("correct horse")
            page.route("**/_nicegui_ws/**", lambda route: route.abort())
            page.route_web_socket("**/_nicegui_ws/**", lambda socket: socket.close())
            page.keyboard.press("Enter")
            expect(page.get_by_role("heading", name="System")).to_be_visible()
            dashboard.kill()
            dashboard.start()
            expect(page.locator("#popup")).to_contain_text("The login of this browser has ended.")
            expect(page.locator("#popup")).to_be_visible()
    finally:
        visitor.close()


def test_a_login_that_ended_is_stated_and_leads_back_to_the_page(
    stage: Stage, opened: Visitor, tmp_path: Path
):
    file = tmp_path / "password"
    file.write_text("correct horse\n")
    opened.begin_again(DESK)
    page = opened.page
    with running(Dashboard(stage.service.endpoint, "--password-file", str(file))) as dashboard:
        page.goto(f"{dashboard.url}/system")
        page.get_by_label("Password").fill("correct horse")
        page.keyboard.press("Enter")
        expect(page.get_by_role("heading", name="System")).to_be_visible()
        page.wait_for_function("() => window.socket?.connected")
        dashboard.kill()
        dashboard.start()  # it knows no login from before
        expect(page.locator("#popup")).to_contain_text("The login of this browser has ended.")
        with page.expect_popup() as tab:
            page.locator("#popup").get_by_role("link", name="log in").click()
        tab.value.get_by_label("Password").fill("correct horse")
        tab.value.keyboard.press("Enter")
        expect(tab.value.get_by_role("heading", name="Stations")).to_be_visible()
        tab.value.close()
        expect(page.locator("#popup"), "it is connected again").to_be_hidden()
        expect(page.get_by_role("heading", name="System")).to_be_visible()
        opened.leave()
    opened.errors.clear()  # what could not be loaded meanwhile


CLOCKS = """async ([asset, times]) => {
  const { dayAndTime } = await import(asset);
  return times.map((at) => dayAndTime(at));
}"""


def test_an_hour_that_the_clocks_have_twice_is_shown_with_its_zone(stage: Stage, browser: Browser):
    hours = [1_792_886_400 + 3600 * hour for hour in range(-1, 3)]  # around 2026-10-25 00:00 UTC
    visitor = Visitor(browser, timezone_id="Europe/Berlin", locale="en-GB")
    try:
        visitor.page.goto(f"{stage.dashboard.url}/assets/theme.js")
        before, summer, winter, after = visitor.page.evaluate(CLOCKS, ["/assets/numbers.js", hours])
    finally:
        visitor.close()
    assert (before, after) == ("25 Oct 2026, 01:00", "25 Oct 2026, 03:00")
    assert summer != winter
    assert summer.startswith("25 Oct 2026, 02:00:00")
    assert winter.startswith("25 Oct 2026, 02:00:00")
