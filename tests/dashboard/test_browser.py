"""The dashboard as an operator has it: real processes, a real browser, a demonstration that goes on."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Browser, Page, expect

from dashboard.browser import CHROMIUM, PATIENCE_MS, Visitor, chromium
from dashboard.stage import KINDS, Stage, patient, staged
from harness.demonstrations import guided

pytestmark = pytest.mark.skipif(
    not CHROMIUM.exists(), reason=f"no {CHROMIUM}: apt-get install chromium, or set CAESURA_CHROMIUM"
)
expect.set_options(timeout=PATIENCE_MS)
PAGES = {
    "stations": ("/", "cell-1"),
    "station": ("/station/cell-1", "move to contact"),
    "sessions": ("/sessions", "done-1"),
    "replay": ("/sessions/cell-2/done-1", "move to contact"),
    "system": ("/system", "caesura-1"),
}
T = 1.4  # [s] in the middle of the first movement: nobody would put a changepoint there
SHOWN_S = 5.0  # what the plot shows while somebody clicks into it


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """Station cell-1 is being taught; at cell-2 a demonstration is over."""
    with staged(tmp_path_factory.mktemp("stage")) as stage:
        stage.teach("cell-2", guided(), session="done-1", pace="4")
        stage.teach("cell-1", patient())
        stage.wait("cell-2")
        yield stage


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


@pytest.fixture
def visitor(browser: Browser, request: pytest.FixtureRequest) -> Iterator[Visitor]:
    visitor = Visitor(browser, getattr(request, "param", "light"))
    yield visitor
    visitor.close()


def goto(stage: Stage, visitor: Visitor, path: str) -> Page:
    visitor.page.goto(stage.dashboard.url + path)
    return visitor.page


@pytest.mark.parametrize("visitor", ["light", "dark"], indirect=True)
@pytest.mark.parametrize("name", PAGES)
def test_every_page_shows_what_it_is_for_and_keeps_nobody_out(stage: Stage, visitor: Visitor, name: str):
    path, words = PAGES[name]
    page = goto(stage, visitor, path)
    expect(page.get_by_text(words).first).to_be_visible()
    visitor.picture(name)
    assert visitor.barriers() == []
    assert visitor.hosts == {"127.0.0.1"}, "something is fetched from outside"
    assert visitor.errors == []


def test_stations_are_told_at_a_glance(stage: Stage, visitor: Visitor):
    page = goto(stage, visitor, "/")
    taught, over = (page.locator("li.card", has_text=name) for name in ("cell-1", "cell-2"))
    expect(taught.locator(".badge")).to_have_text("teaching")
    expect(taught).to_contain_text("just now")
    expect(over.locator(".badge")).to_have_text("demonstration over")


def test_segments_appear_while_they_are_taught(stage: Stage, visitor: Visitor):
    page = goto(stage, visitor, "/station/cell-1")
    page.get_by_text("Segments as a table").click()
    rows = page.locator("details.table tbody tr")
    for kind in KINDS:
        expect(rows.filter(has_text=re.compile(rf"{kind}.*final")).first).to_be_visible()
    expect(page.locator(".app").first).to_contain_text("move to contact")


def test_run_lengths_are_shown_when_they_are_asked_for(stage: Stage, visitor: Visitor):
    page = goto(stage, visitor, "/station/cell-1")
    button = page.get_by_role("button", name="Run lengths")
    button.click()
    expect(button).to_have_attribute("aria-pressed", "true")
    expect(page.locator("canvas.tall")).to_be_visible()
    visitor.picture("run-lengths")
    assert visitor.errors == []


def test_a_session_that_is_over_can_be_gone_through(stage: Stage, visitor: Visitor):
    page = goto(stage, visitor, "/sessions")
    page.get_by_role("link", name="done-1").click()
    expect(page.locator("h1")).to_have_text("cell-2 · done-1")
    slider = page.get_by_role("slider", name="Show until")
    expect(slider).to_have_attribute("max", re.compile(r"^5\."))
    slider.fill("1.5")
    expect(page.locator(".selection")).to_contain_text("motion")
    slider.fill("2.6")
    expect(page.locator(".selection")).to_contain_text("contact")
    visitor.picture("scrubbed")


def test_what_was_chosen_of_light_and_dark_is_kept(stage: Stage, visitor: Visitor):
    page = goto(stage, visitor, "/system")
    page.get_by_role("button", name="Light or dark").click()
    expect(page.locator("html")).to_have_attribute("data-theme", "dark")
    goto(stage, visitor, "/")
    expect(page.locator("html")).to_have_attribute("data-theme", "dark")
