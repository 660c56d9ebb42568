"""Nothing moves under the operator's eyes while a demonstration is taught, corrected, stopped and named."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Page, ViewportSize, expect

from caesura_protocol.formats.read import load_recording
from dashboard.browser import (
    DESK,
    LOOK_MS,
    PATIENCE_MS,
    PHONE,
    SETTLED,
    UPRIGHT,
    Visitor,
    needs_chromium,
    settled,
)
from dashboard.operator import Operator
from dashboard.stage import Stage, StandbyBridge, patient
from dashboard.test_whole_day import shown_range
from harness.demonstrations import guided
from harness.processes import eventually, running

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
SIZES = {"desk": DESK, "upright": UPRIGHT, "phone": PHONE}
LONG_S = 40.0  # a station shows 30 s of a session that goes on
PICK_AND_PLACE = Path(__file__).parents[2] / "data" / "pick_and_place.npz"
# What the browser itself reports as moved in the part of the page that does not scroll by itself: in which
# step, and by how much [px]. What appears or goes outside of the window moves nothing that is seen. A long
# message lies upon what is below it (staying.js): on a busy machine the signals can be late, and it says so.
WATCH = """() => {
  window.shifts = [];
  const name = (node) => node && (node.className || node.nodeName);
  new PerformanceObserver((list) => {
    for (const { sources } of list.getEntries()) for (const { node, previousRect, currentRect } of sources) {
      const element = node && (node.closest ? node : node.parentElement);
      const by = currentRect.y - previousRect.y + currentRect.height - previousRect.height;
      const isMoved = element?.closest(".work") && !element.closest(".staying:not(.free)");
      if (isMoved && Math.abs(by) > 1) window.shifts.push([window.step, name(element), by]);
    }
  }).observe({ type: "layout-shift" });
}"""
LOADED_BEFORE = "() => { window.loadedBefore = document.querySelector('.plots').plots.state.data; }"
IS_OPEN = "() => !document.querySelector('.plots').plots.state.closed"
IS_DRAWN = f"""() => {{
  const plots = document.querySelector(".plots"), {{ state }} = plots.plots;
  return state.closed ? ({SETTLED})(plots) : state.data !== window.loadedBefore;
}}"""
# Where each part begins on the page [px].
PLACES = """() => Object.fromEntries([".desk", ".description", ".signals", ".plots", ".scrub"].map(
  (part) => [part, Math.round(document.querySelector(part).getBoundingClientRect().y + scrollY)]))"""


@pytest.fixture(scope="module")
def over(stage: Stage) -> None:
    """Demonstrations that are over: one where a bridge comes, and one that no test changes."""
    for station in ("cell-1", "cell-2"):
        stage.teach(station, guided(), session="over", pace="fast")
        stage.wait(station)


@pytest.fixture
def bridge(stage: Stage, over: None) -> Iterator[StandbyBridge]:
    with running(StandbyBridge(stage)) as bridge:
        yield bridge


class Day:
    """The steps of a session, and where the parts of the page are after each."""

    def __init__(self, page: Page) -> None:
        self.page, self.desk = page, page.locator(".desk")
        self.places: dict[str, dict[str, int]] = {}

    def step(self, name: str) -> None:
        """The next step begins."""
        self.page.evaluate("(name) => { window.step = name; }", name)

    def done(self, name: str) -> None:
        """It has ended: all that it changes is drawn.

        A page of a demonstration that goes on is never at rest on a busy machine: there the samples that are
        loaded after the step are drawn.
        """
        self.page.evaluate(LOADED_BEFORE)
        self.page.wait_for_function(IS_DRAWN, polling=LOOK_MS)
        self.page.evaluate("() => new Promise((drawn) => requestAnimationFrame(() => setTimeout(drawn)))")
        self.places[name] = self.page.evaluate(PLACES)

    def start(self, name: str) -> None:
        self.step(name)
        self.desk.locator(".task").press("Enter")
        expect(self.desk).to_contain_text("Teaching")
        self.page.wait_for_function(IS_OPEN, polling=LOOK_MS)  # the plots are of the one before, until then
        expect(self.page.locator(".app").first).to_be_visible()
        self.done(name)

    def correct(self) -> None:
        self.step("correct")
        self.page.locator(".plots").press("r")
        self.page.locator(".correct-menu .insert").click()
        expect(self.page.locator(".message").first).to_contain_text("Changepoint inserted")
        self.done("correct")

    def stop(self, name: str) -> None:
        self.step(name)
        self.desk.get_by_role("button", name="Stop").click()
        expect(self.desk).to_contain_text("Ready")
        expect(self.page.locator("#program-title")).to_contain_text("complete")
        expect(self.page.locator(".description")).to_contain_text("Last demonstration")
        self.done(name)

    def shows_last_app(self) -> bool:
        """Is the list of apps at its end, as while it grew?"""
        rest = "(one) => one.scrollHeight - one.clientHeight - one.scrollTop"
        return int(self.page.locator(".apps").evaluate(rest)) <= 1

    def name(self) -> None:
        self.step("name")
        self.page.locator(".name-task").fill("wipe the table")
        self.page.locator(".description .yes").click()
        expect(self.page.locator(".saved")).to_contain_text("Saved.")
        expect(self.page.locator(".description summary")).to_contain_text("succeeded")
        self.done("name")


def day_at(stage: Stage, visitor: Visitor, size: ViewportSize, name: str = "") -> Day:
    """The page of cell-1, whose bridge is ready, as an operator of this name has left it, or a new one."""
    visitor.begin_again(size)
    if name:
        visitor.is_called(name, stage.dashboard.url)
        visitor.page.evaluate("() => localStorage.setItem('caesura-description', 'yes')")  # the form is open
    visitor.page.goto(f"{stage.dashboard.url}/station/cell-1")
    expect(visitor.page.locator(".desk")).to_contain_text("Ready")
    return Day(visitor.page)


def page_at(stage: Stage, visitor: Visitor, path: str, size: ViewportSize) -> Page:
    """A page that shows a demonstration which is over, as Ann opens it."""
    visitor.begin_again(size)
    visitor.is_called("Ann", stage.dashboard.url)
    visitor.page.goto(f"{stage.dashboard.url}/{path}")
    expect(visitor.page.locator(".app").first).to_be_visible()
    settled(visitor.page)
    return visitor.page


def taught_page(stage: Stage, visitor: Visitor, session: str, size: ViewportSize) -> Page:
    """That of a demonstration which no other test has."""
    stage.teach("cell-4", guided(), session=session, pace="fast")
    stage.wait("cell-4")
    return page_at(stage, visitor, f"sessions/cell-4/{session}", size)


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
def test_no_step_of_a_session_moves_the_plots(
    stage: Stage, bridge: StandbyBridge, opened: Visitor, size: ViewportSize
):
    """The end of a demonstration moved them by 99 px at a desk, 144 on a tablet and 255 on a phone."""
    day = day_at(stage, opened, size, name="Ann")
    page = day.page
    day.start("start")
    page.evaluate(WATCH)
    day.correct()
    day.stop("stop")
    assert day.shows_last_app(), "findings below the list cover it"
    if size != PHONE:  # there the form is folded
        day.name()
    day.start("next")
    day.stop("last stop")
    assert page.evaluate("() => window.shifts") == []
    first = day.places["start"]
    assert {step: places for step, places in day.places.items() if places != first} == {}
    assert opened.errors == []


@pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
def test_a_start_on_a_page_of_an_ended_session_moves_no_plots(
    stage: Stage, bridge: StandbyBridge, opened: Visitor, size: ViewportSize
):
    """The description opened at Start, and the plots moved by 66 px at a desk."""
    day = day_at(stage, opened, size)
    page = day.page
    expect(page.locator(".app").first).to_be_visible()
    day.done("opened")
    if size == PHONE:
        has_everything_in_the_first_screen(page)
    day.start("start")
    if size == PHONE:
        has_everything_in_the_first_screen(page)
    day.stop("stop")
    assert day.places["start"] == day.places["opened"] == day.places["stop"]
    if size == DESK:  # they began at 484 px, half a window down
        assert page.evaluate("() => document.querySelector('.plots').getBoundingClientRect().top") <= 300
    expect(page.locator(".name-task")).to_be_hidden()
    page.locator(".description summary").click()
    expect(page.locator(".name-task"), "opened by hand, it stays so").to_be_visible()
    day.start("by hand")
    expect(page.locator(".name-task")).to_be_visible()
    day.stop("last")
    assert day.places["by hand"] == day.places["last"]
    day.name()
    assert day.places["name"] == day.places["last"]
    page.reload()
    expect(page.locator(".app").first).to_be_visible()
    expect(page.locator(".name-task"), "also on a desk's next page").to_be_visible(visible=size == DESK)
    assert opened.errors == []


# Where the plots begin, and how far the first one is above what stands at the lower edge [px].
FIRST_PLOT = """() => {
  const box = (name) => document.querySelector(name).getBoundingClientRect();
  return [box(".plots").top, box(".at-time-box").top - box(".panel .u-over").bottom];
}"""
HALF_PX = PHONE["height"] / 2


def has_everything_in_the_first_screen(page: Page) -> None:
    """Start and Stop, the description and the first plot, of a phone; the plots began at 569 px."""
    for part in (".desk-state", ".start", ".stop", ".description summary", ".band", ".panel .u-over"):
        expect(page.locator(part).first, part).to_be_in_viewport(ratio=1)
    begin, room = page.evaluate(FIRST_PLOT)
    assert begin < HALF_PX
    assert room >= 0, "what is selected covers the first plot"


def test_samples_that_stop_move_no_plot(stage: Stage, bridge: StandbyBridge, opened: Visitor):
    """The line on the session then has their age too, which on a busy machine comes and goes."""
    day = day_at(stage, opened, DESK)
    page = day.page
    day.start("start")
    for name, size in SIZES.items():
        page.set_viewport_size(size)
        day.done(name)
    bridge.freeze()
    try:
        expect(page.locator(".state-line")).to_contain_text("last sample")
        for name, size in SIZES.items():
            page.set_viewport_size(size)
            eventually(lambda name=name: page.evaluate(PLACES) == day.places[name])
    finally:
        bridge.thaw()
    day.stop("stop")
    assert opened.errors == []


@pytest.mark.parametrize(
    ("path", "state"), [("station/cell-2", ".desk-state"), ("sessions/cell-2/over", ".state-line")]
)
def test_a_phone_shows_the_state_and_the_first_plot_in_the_first_screen(
    stage: Stage, over: None, opened: Visitor, path: str, state: str
):
    """The plots of a station began below the window: a form of 312 px stood above them."""
    page = page_at(stage, opened, path, PHONE)
    for part in (state, ".band", ".panel .u-over"):
        expect(page.locator(part).first, part).to_be_in_viewport(ratio=1)
    assert opened.sideways_px() <= 0
    assert opened.errors == []


def test_a_station_shows_an_ended_session_as_a_whole(stage: Stage, opened: Visitor):
    """Its last 30 s were shown, in which the hand often rests."""
    stage.teach("cell-3", patient(rest_s=LONG_S), session="long", pace="fast")
    stage.wait("cell-3")
    page = page_at(stage, opened, "station/cell-3", DESK)
    expect(page.locator(".desk-state")).to_have_text("Ended")
    start, end = shown_range(page)
    assert start == 0.0
    assert end > LONG_S
    assert opened.errors == []


def test_without_a_service_no_bridge_is_denied_and_no_plot_moves(
    stage: Stage, bridge: StandbyBridge, opened: Visitor
):
    """The page stated that no bridge is connected, while the bridge ran, and its form went."""
    opened.begin_again(DESK)
    page, why = opened.page, opened.page.locator(".desk-why")
    page.goto(f"{stage.dashboard.url}/station/cell-1")
    expect(page.locator(".desk")).to_contain_text("Ready")
    day = Day(page)
    day.start("taught")
    stage.service.kill()
    expect(why).to_contain_text(
        "Whether a bridge is connected at cell-1 is not known: no service can be reached"
    )
    expect(page.locator(".desk-state")).to_have_text("Stale")
    assert page.evaluate(PLACES) == day.places["taught"]
    expect(page.locator("button.start")).to_be_disabled()
    expect(page.locator("button.stop")).to_be_disabled()
    stage.service.start()
    expect(page.locator("button.stop")).to_be_enabled()
    day.stop("stop")
    opened.errors.clear()  # of samples that were not there


def test_the_answer_to_a_correction_is_in_sight_wherever_in_the_plots_it_is_made(
    stage: Stage, opened: Visitor
):
    """It stood above the first plot: who corrected in the plot of forces did not see that it was refused."""
    page = taught_page(stage, opened, "seen", DESK)
    for size, t in ((DESK, 1.4), (PHONE, 0.5)):
        page.set_viewport_size(size)
        x, _ = Operator.at(page, opened).place(t)
        page.locator(".panel[data-signal=speed]").evaluate("(panel) => panel.scrollIntoView()")
        force = page.locator(".panel[data-signal=force]").bounding_box()
        assert force is not None
        page.mouse.click(x, force["y"] + force["height"] / 2)
        page.keyboard.press("Enter")
        expect(page.locator(".message")).to_contain_text(f"Changepoint inserted at {math.floor(t)}.")
        expect(page.locator("canvas.band")).not_to_be_in_viewport()
        expect(page.locator(".message")).to_be_in_viewport(ratio=1)
        expect(page.get_by_role("button", name="Undo", exact=True).first).to_be_in_viewport(ratio=1)
    assert opened.errors == []


# Whether a message covers the end of what is selected.
COVERED = """() => {
  const { x, bottom } = document.querySelector(".selection").getBoundingClientRect();
  return document.elementFromPoint(x + 30, bottom - 4).closest(".staying") !== null;
}"""


def test_a_long_answer_leaves_what_is_selected_when_something_else_is_pressed(stage: Stage, opened: Visitor):
    """On a phone it covered that until it was closed."""
    page = taught_page(stage, opened, "long", PHONE)
    operator = Operator.at(page, opened)
    operator.click(1.4)
    page.keyboard.press("Enter")
    expect(page.locator(".message")).to_contain_text("Changepoint inserted at 1.")
    page.get_by_role("button", name="Undo", exact=True).first.click()
    expect(page.locator(".message")).to_contain_text("Undone: Ann inserted a changepoint at 1.")
    close = page.get_by_role("button", name="Close the message")
    expect(close).to_be_visible()
    assert page.evaluate(COVERED)
    operator.click(1.4)
    expect(page.get_by_role("button", name="Show the whole message")).to_be_visible()
    assert not page.evaluate(COVERED)
    assert opened.errors == []


# Where the list of apps is [px], and how much room is kept between the exports and what is folded.
LIST = """() => {
  const box = (name) => document.querySelector(name).getBoundingClientRect(), { y, height } = box(".apps");
  return [Math.round(y), Math.round(height), box(".unfolded").y - box(".exports").bottom];
}"""
GAPS_PX = 16.0  # above and below it
# Whether nothing lies upon the message of the program.
IS_WHOLE = """() => {
  const said = document.querySelector(".program-said"), { x, y, height } = said.getBoundingClientRect();
  return [3, height / 2, height - 3].every((at) => said.contains(document.elementFromPoint(x + 20, y + at)));
}"""


def test_an_edit_moves_no_app_and_no_line_is_kept_for_what_is_said(stage: Stage, opened: Visitor):
    """Two empty lines stood above the list, and the first edit brought a line above and one below it."""
    page = taught_page(stage, opened, "edited", DESK)
    card = page.locator(".app").first
    card.get_by_text("Edit", exact=True).click()
    before = page.evaluate(LIST)
    card.locator(".app-name").fill("reach down slowly until the plate is touched")
    card.locator(".app-note").fill("gently")
    card.locator(".save").click()
    expect(page.locator(".program-said")).to_contain_text("name set, note set")
    expect(page.locator(".edits")).to_be_visible()
    expect(page.locator(".versions")).to_be_visible()
    assert page.evaluate(LIST) == before
    assert page.evaluate(IS_WHOLE), "nothing lies upon the message"
    assert before[2] <= GAPS_PX
    expect(page.locator("#program-title")).to_contain_text("edited by Ann")
    page.locator(".undo-edit").click()
    expect(page.locator(".program-said")).to_have_text(
        re.compile(
            r"^Undone: app \d+ \(reach down slowly until the plate is touched\): name set, note set "
            r"\(edit 1 by Ann\)\.$"
        )
    )
    expect(page.locator("#program-title"), "no correction was made").to_contain_text("changed by Ann")
    assert page.evaluate(LIST) == before
    assert opened.errors == []


def test_the_answer_to_an_edit_is_in_sight_on_a_phone(stage: Stage, opened: Visitor):
    """It stood above the cards: who saved a form that is scrolled did not see that it was refused."""
    page = taught_page(stage, opened, "phone", PHONE)
    card, said = page.locator(".app").nth(1), page.locator(".program-said")
    card.get_by_text("Edit", exact=True).click()
    card.locator(".app-name").fill("Press the pump")
    card.locator(".save").evaluate("(save) => save.scrollIntoView()")
    card.locator(".save").click()
    expect(said).to_contain_text("name set")
    expect(said).to_be_in_viewport(ratio=1)
    expect(page.locator(".exports")).not_to_be_in_viewport()
    assert opened.errors == []


# Their places in the part of the page that shows the path, and their heights [px].
PATH = """() => [".path-tools", ".program-path canvas"].map((name) => {
  const top = document.querySelector(".program-path").getBoundingClientRect().y;
  const { y, height } = document.querySelector(name).getBoundingClientRect();
  return [Math.round(y - top), Math.round(height)];
})"""


def path_places(page: Page) -> list[object]:
    """Where they are at each size of the window."""
    places = []
    for size in SIZES.values():
        page.set_viewport_size(size)
        settled(page)
        places.append(page.evaluate(PATH))
    return places


def test_a_simulation_moves_neither_its_buttons_nor_the_drawing(stage: Stage, opened: Visitor):
    """*Cancel* and the line of its result moved the drawing by two lines."""
    stage.teach("cell-6", load_recording(PICK_AND_PLACE), session="simulated", pace="fast")
    stage.wait("cell-6")
    page = page_at(stage, opened, "sessions/cell-6/simulated", DESK)
    simulate, cancel, said = (
        page.locator(f".{name}") for name in ("simulate", "cancel-simulation", "simulated")
    )
    page.locator(".program-path canvas").scroll_into_view_if_needed()
    expect(page.locator(".measured-said")).to_contain_text("samples")
    before = path_places(page)
    expect(cancel).to_be_hidden()
    simulate.click()
    expect(cancel).to_be_visible()
    assert path_places(page) == before, "while it is under way"
    expect(said).to_have_text(re.compile("^Ran to the end: cell as taught: 2 level surfaces, .* mm/s and "))
    follow, shown = page.locator(".follow-run"), page.locator(".program-path output")
    expect(follow).to_have_attribute("aria-pressed", "true")
    expect(shown).to_contain_text("simulated run")
    follow.click()
    expect(shown, "as taught").to_contain_text(" · 6 move · ")
    follow.click()
    assert path_places(page) == before, "with its result"
    for size, place in zip(SIZES.values(), before, strict=True):
        page.set_viewport_size(size)
        simulate.evaluate("(button) => button.scrollIntoView({ block: 'center' })")
        expect(said).to_be_in_viewport()
        assert opened.barriers(within=".program-path") == []
        for name in (".follow-run", ".show-measured", ".play-path", ".play-path"):
            page.locator(name).click()
            assert page.evaluate(PATH) == place, name
        assert opened.sideways_px() <= 0
    assert opened.errors == []


MOUSE = """() => {
  window.presses = [];
  addEventListener("mousedown", ({ target }) => presses.push(target.className), true);
}"""


def test_a_finger_that_is_lifted_after_a_long_press_presses_nothing_of_the_menu(
    stage: Stage, over: None, opened: Visitor
):
    """The browser clicked what the menu had put under the finger: a field, which brought up the keyboard."""
    page = page_at(stage, opened, "sessions/cell-2/over", PHONE)
    operator = Operator.at(page, opened)
    page.locator(".panel[data-signal=force]").scroll_into_view_if_needed()
    page.evaluate(MOUSE)
    operator.touch_for_long(1.4)
    expect(page.locator(".correct-menu .insert")).to_be_focused()
    page.evaluate("() => new Promise((seen) => requestAnimationFrame(() => setTimeout(seen)))")
    assert page.evaluate("() => presses") == []
    assert opened.errors == []


def test_the_menu_of_corrections_leaves_the_segment_in_sight(stage: Stage, over: None, opened: Visitor):
    """At a desk and on a tablet it covered half of the segment, and on a phone the band."""
    page = page_at(stage, opened, "sessions/cell-2/over", DESK)
    menu, band = page.locator(".correct-menu"), page.locator("canvas.band")
    for size in SIZES.values():
        page.set_viewport_size(size)
        operator = Operator.at(page, opened)
        for t0, tn, *_ in page.evaluate("() => document.querySelector('.plots').plots.state.segments"):
            left, x, right = (operator.place(t)[0] for t in (t0, (t0 + tn) / 2, tn))
            row = band.bounding_box()
            assert row is not None
            page.mouse.click(x, row["y"] + row["height"] - 4, button="right")
            menu.locator(".is-kind").nth(3).focus()
            expect(menu.locator(".effect")).to_contain_text("Preview")
            box, row = menu.bounding_box(), band.bounding_box()
            assert box is not None
            assert row is not None
            is_beside = box["x"] >= right or box["x"] + box["width"] <= left
            is_off_band = box["y"] >= row["y"] + row["height"] or box["y"] + box["height"] <= row["y"]
            assert is_beside or is_off_band, f"{t0} to {tn} s at {size}: {box}, {row}"
            assert box["y"] >= 0
            assert box["y"] + box["height"] <= size["height"]
            menu.press("Escape")
            expect(menu).to_have_count(0)
    assert opened.errors == []
