"""A session that the service no longer holds: its page reads, exports and replays it, and offers no edit."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Locator, Page, expect

from dashboard.browser import DESK, PATIENCE_MS, Visitor, looks_right, needs_chromium
from dashboard.stage import Stage, staged
from harness.demonstrations import guided
from harness.journals import ended, taught, written

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
NAMES = [f"s{i:02d}" for i in range(18)]  # the service holds the last 16 of a station
WHY = "it can be read, exported and replayed, and cannot be changed."


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    folder: Path = tmp_path_factory.mktemp("stage")
    for name in NAMES:
        written(folder / "journal", taught(2.0), session=name, closed=ended("motion", t=2.0, session=name))
    with staged(folder) as stage:
        yield stage


def tools(page: Page) -> Locator:
    return page.locator(".description .fields, .app-edit, .program-name, .correct, .take-back, .who")


def is_shown(page: Page) -> None:
    expect(page.locator(".state-line")).to_contain_text("closed")
    page.locator(".plots").focus()
    page.keyboard.press("ArrowRight")
    expect(page.locator(".selection")).to_contain_text("Time")


def test_a_session_that_is_only_read_has_no_tools_and_says_why(stage: Stage, opened: Visitor):
    opened.begin_again(DESK)
    page = opened.page
    page.goto(f"{stage.dashboard.url}/sessions/cell-1/{NAMES[0]}")
    expect(page.locator(".only-read")).to_contain_text(WHY)
    is_shown(page)
    expect(tools(page)).to_have_count(0)
    page.locator(".plots").press("r")
    expect(page.locator(".correct-menu")).to_have_count(0)
    expect(page.get_by_role("button", name="Play", exact=True).first).to_be_visible()
    looks_right(opened, "only-read")
    assert opened.errors == []


def test_the_tools_go_once_newer_sessions_take_the_place_of_the_one_that_is_shown(
    stage: Stage, opened: Visitor
):
    opened.begin_again(DESK)
    page = opened.page
    page.goto(f"{stage.dashboard.url}/sessions/cell-1/{NAMES[2]}")
    is_shown(page)
    expect(page.locator(".only-read")).to_have_count(0)
    expect(tools(page).first).to_be_attached()
    for name in ("s98", "s99"):  # the second opening makes room
        stage.teach("cell-1", guided(), session=name, pace="fast")
        stage.wait("cell-1")
    expect(page.locator(".only-read")).to_contain_text(WHY)
    expect(tools(page)).to_have_count(0)
    expect(page.locator(".state-line")).to_contain_text("closed")
    assert opened.errors == []


def test_a_session_of_the_journal_is_shown_once_the_service_is_back(stage: Stage, opened: Visitor):
    """A page that was opened while the service was away asked the journal once, and not again."""
    opened.begin_again(DESK)
    page = opened.page
    stage.service.kill()
    try:
        page.goto(f"{stage.dashboard.url}/sessions/cell-1/{NAMES[1]}")
        expect(page.locator(".banner")).to_be_visible()
        expect(page.locator(".state-line"), "it is not known whether it was deleted").to_have_text("")
        expect(page.locator(".selection"), "no demonstration begins here").to_have_text("")
        assert opened.barriers() == []
    finally:
        stage.service.start()
    expect(page.locator(".state-line")).to_contain_text("closed")
    expect(page.locator(".only-read")).to_contain_text(WHY)
    assert opened.errors == []
