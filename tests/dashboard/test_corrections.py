"""Corrections as an operator makes them, by mouse and by keyboard, and what of them goes over the wire."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Browser, ViewportSize, expect

from caesura_clients import Caesura
from dashboard.browser import DESK, PATIENCE_MS, SIZES, THEMES, SlowSocket, Visitor, needs_chromium
from dashboard.operator import NEAR_S, Operator, T
from dashboard.stage import Stage, patient
from dashboard.subscriber import Subscriber
from harness.processes import eventually

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
AGE_S = 12.0  # of the demonstration when the page is opened: its first three segments are final


@pytest.fixture(scope="module")
def visitor(browser: Browser) -> Iterator[Visitor]:
    visitor = Visitor(browser)
    yield visitor
    visitor.close()


@pytest.fixture(scope="module")
def slow(visitor: Visitor) -> SlowSocket:
    """What the dashboard sends to the page, from its only load on."""
    return SlowSocket(visitor.page)


@pytest.fixture(scope="module")
def taught(stage: Stage, visitor: Visitor, slow: SlowSocket) -> Iterator[tuple[Operator, Caesura]]:
    """A station that is taught while the tests of this module last."""
    with (
        stage.aged("cell-1", patient(), AGE_S),
        stage.reader() as caesura,
        Subscriber(caesura, "cell-1").listening() as wire,
    ):
        operator = Operator(stage, visitor, wire, "cell-1")
        operator.wait_for_three_segments()
        yield operator, caesura


@pytest.fixture
def operator(taught: tuple[Operator, Caesura], slow: SlowSocket) -> Iterator[Operator]:
    """The operator of that station, where nothing is corrected."""
    operator, caesura = taught
    operator.look_at_the_beginning()
    yield operator
    slow.release()  # what a test that failed still held
    operator.undo_everything(caesura)
    assert operator.visitor.errors == []


def test_a_changepoint_is_inserted_with_the_mouse_and_undone(operator: Operator):
    before, version = operator.wire.taught(), operator.version()

    operator.click(T)
    expect(operator.page.locator(".selection")).to_contain_text("motion")
    operator.press("Correct …")
    operator.page.locator(".correct-menu .insert").click()
    operator.is_shown("Changepoint inserted at 1.")
    message = operator.page.locator(".message")
    eventually(lambda: operator.version() > version)
    operator.wire.until(lambda: operator.wire.now.program.version > version)
    operator.wire.until(lambda: operator.wire.corrected() == [pytest.approx(T, abs=NEAR_S)])
    _, second, third, *_ = operator.wire.now.segments
    assert second.tn == third.t0 == pytest.approx(T, abs=NEAR_S), "a new segment on the wire"
    place = f"changepoint at {third.t0:.2f} s"
    expect(message, "where it is, not where the click was").to_have_text(
        f"Changepoint inserted at {third.t0:.2f} s."
    )
    operator.wire.until(lambda: operator.wire.now.program.author == "Ann")
    expect(operator.page.locator("#program-title")).to_contain_text("corrected by Ann")
    operator.visitor.picture("inserted")

    operator.press("Undo")
    expect(message, "what was undone").to_have_text(f"Undone: Ann inserted a {place}.")
    operator.wire.until(lambda: operator.wire.corrected() == [])
    operator.wire.until(lambda: operator.wire.taught() == before)
    assert operator.wire.now.program.version > version + 1


def test_a_changepoint_is_dragged(operator: Operator):
    end = operator.wire.now.segments[0].tn
    operator.page.mouse.move(*operator.place(end))
    expect(operator.plot, "the cursor shows it").to_have_css("cursor", "ew-resize")
    operator.drag(end, end + 0.3)
    operator.is_shown("Changepoint moved")
    operator.wire.until(lambda: operator.wire.corrected() == [pytest.approx(end + 0.3, abs=NEAR_S)])
    assert operator.wire.now.segments[0].tn == pytest.approx(end + 0.3, abs=NEAR_S)


def test_a_changepoint_is_removed_and_the_correction_made_again(operator: Operator):
    before = operator.wire.taught()
    end = operator.wire.now.segments[0].tn
    operator.click(end)
    expect(operator.page.locator(".selection")).to_contain_text("changepoint at")
    operator.press("Correct …")
    operator.page.locator(".correct-menu .remove").click()
    operator.is_shown("removed")
    operator.wire.until(lambda: all(abs(one.t - end) > NEAR_S for one in operator.wire.now.changepoints))
    operator.press("Undo")
    operator.is_shown(f"Undone: Ann removed the changepoint at {end:.2f} s.")
    operator.wire.until(lambda: operator.wire.taught() == before)
    operator.press("Redo")
    operator.is_shown(f"Done again: Ann removed the changepoint at {end:.2f} s.")
    operator.wire.until(lambda: all(abs(one.t - end) > NEAR_S for one in operator.wire.now.changepoints))


def test_a_segment_gets_another_kind_and_an_app_a_limit(operator: Operator):
    page, menu = operator.page, operator.page.locator(".correct-menu")
    page.mouse.click(*operator.place(T), button="right")
    expect(menu.get_by_role("button", name="motion")).to_have_attribute("aria-pressed", "true")
    for theme, rules in THEMES.items():
        page.emulate_media(color_scheme=theme)
        operator.visitor.theme = theme
        operator.visitor.picture("correct-menu")
        assert operator.visitor.barriers(*rules, within=".correct-menu") == []
    menu.get_by_role("button", name="sliding").click()
    operator.is_shown("is sliding")
    operator.wire.until(lambda: operator.wire.now.segments[1].kind == "sliding")
    assert operator.wire.now.segments[1].corrected

    operator.touch_for_long(T)
    menu.get_by_role("button", name="transport").click()
    operator.is_shown(" s is transport. Its load is ")
    operator.is_shown(" kg: is something carried there? Undo takes it back.")

    page.mouse.click(*operator.place(2.6), button="right")
    menu.get_by_label("Force at most").fill("4")
    menu.get_by_role("button", name="Limit", exact=True).click()
    operator.is_shown("limited to 4 N")

    def limited() -> bool:
        forces = [app.force for app in operator.wire.now.program.apps if app.t0 < 2.6 < app.tn]
        return any(force is not None and max(map(abs, force)) <= 4.01 for force in forces)

    operator.wire.until(limited)


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
def test_the_menu_of_corrections_with_its_preview_is_within_the_window(
    operator: Operator, size: ViewportSize
):
    page, menu = operator.page, operator.page.locator(".correct-menu")
    page.set_viewport_size(size)
    try:
        left, top = operator.place(T)
        page.mouse.click(left, min(top, size["height"] - 40), button="right")
        menu.locator(".insert").hover()
        expect(menu.locator(".effect")).to_contain_text("App")
        box = menu.bounding_box()
        assert box is not None
        assert box["y"] >= 0
        assert box["y"] + box["height"] <= size["height"]
        menu.locator(".effect").evaluate("(words) => words.append('More that changes. '.repeat(200))")
        longer = menu.bounding_box()
        assert longer is not None
        assert longer["y"] + longer["height"] <= size["height"]
        scrolled = menu if size is DESK else menu.locator(".effect")  # of a phone
        assert scrolled.evaluate("(one) => one.scrollHeight > one.clientHeight"), "more than fits is scrolled"
        shown = scrolled.bounding_box()
        assert shown is not None
        assert shown["y"] + shown["height"] <= size["height"]
        page.keyboard.press("Escape")
    finally:
        page.set_viewport_size(DESK)


def test_a_time_that_is_being_typed_stays_while_the_menu_is_drawn_anew(operator: Operator):
    page, time = operator.page, operator.page.get_by_label("Time [s]")
    operator.plot.focus()
    page.keyboard.press("r")
    time.select_text()
    page.keyboard.type(str(T))
    page.locator(".correct-menu .insert").hover()
    expect(page.locator(".correct-menu")).to_contain_text("Preview")
    expect(time).to_have_value(str(T))
    page.keyboard.press("Tab")
    expect(page.get_by_role("dialog", name=f"Correct at {T:.2f} s")).to_be_visible()
    expect(time).to_have_value(f"{T:.2f}")
    page.keyboard.press("Escape")


def test_everything_goes_without_a_mouse(operator: Operator):
    before = operator.wire.taught()
    keyboard = operator.page.keyboard
    operator.plot.focus()
    keyboard.press("r")
    expect(operator.page.locator(".correct-menu .insert")).to_be_focused()
    operator.page.get_by_label("Time [s]").fill(str(T))
    keyboard.press("Escape")
    expect(operator.plot).to_be_focused()
    correct = operator.page.get_by_role("button", name="Correct …")
    correct.press("Enter")
    keyboard.press("Escape")
    expect(correct, "it has opened the menu").to_be_focused()
    keyboard.press("Enter")
    expect(operator.page.locator(".correct-menu .insert")).to_be_focused()
    keyboard.press("Shift+Tab")
    keyboard.press("Shift+Tab")
    expect(operator.page.locator(".correct-menu"), "it stayed upon what had the focus").to_have_count(0)
    expect(operator.plot).to_be_focused()
    keyboard.press("Enter")
    operator.wire.until(lambda: operator.wire.corrected() == [pytest.approx(T, abs=NEAR_S)])

    def is_second() -> bool:
        """Whether the keys find the new changepoint second; the page learns of it after the wire."""
        for key in ("Escape", "Home", "PageDown", "PageDown"):
            keyboard.press(key)
        return bool(re.search(r"changepoint at 1\.[34]5 s", operator.page.locator(".selection").inner_text()))

    eventually(is_second)
    selection = operator.page.locator(".selection")
    keyboard.press("Home")
    expect(selection, "it is in view").to_contain_text(re.compile(r"changepoint at 1\.[34]5 s"))
    eventually(is_second)
    for key in (*"++++++", "Home"):
        keyboard.press(key)
    expect(selection, "Delete would remove what is out of view").to_contain_text("no changepoint selected")
    keyboard.press("0")
    keyboard.press("Shift+ArrowRight")
    keyboard.press("ArrowLeft")
    keyboard.press("Escape")
    for key in ("Delete", "m", "M"):  # the help has capital letters
        keyboard.press(key)
        operator.is_shown("No changepoint is selected: Page ↑ and Page ↓ select one.")
    keyboard.press("Control+z")
    operator.wire.until(lambda: operator.wire.taught() == before)
    operator.is_shown("Undone")
    for key, what, outcome in (("z", "undo", ""), ("y", "redo", "Done again: Ann ")):
        if outcome:
            keyboard.press(f"Control+{key}")
            operator.is_shown(outcome)
        button = operator.page.get_by_role("button", name=what.capitalize(), exact=True)
        expect(button, "the page knows that there is none").to_have_count(0)
        keyboard.press(f"Control+{key}")
        operator.is_shown(f"There is nothing to {what}.")


def test_what_takes_long_says_that_it_is_under_way(operator: Operator, slow: SlowSocket):
    """An hour that is over is rebuilt for a minute: the menu stayed empty, and so did the page."""
    page, menu = operator.page, operator.page.locator(".correct-menu")
    slow.hold("previewed")
    page.mouse.click(*operator.place(T), button="right")
    menu.locator(".insert").hover()
    expect(menu.locator(".effect")).to_contain_text("The service computes it …")
    slow.release()
    expect(menu.locator(".effect")).to_contain_text("become")
    expect(menu.locator(".effect")).not_to_contain_text("computes")
    slow.hold("answered")
    menu.locator(".insert").click()
    operator.is_shown("Correcting …")
    slow.release()
    operator.is_shown("inserted at 1.")


def test_a_name_is_asked_for_at_the_first_correction_which_then_is_made(operator: Operator):
    operator.is_called("")
    operator.click(T)
    operator.plot.focus()
    operator.page.keyboard.press("Enter")
    name = operator.page.get_by_label("Your name")
    expect(name).to_be_focused()
    operator.page.keyboard.press("Escape")
    expect(operator.plot, "the keys went nowhere").to_be_focused()
    operator.page.keyboard.press("Enter")
    expect(name).to_be_focused()
    assert operator.wire.corrected() == []
    name.fill("Bea\u202e")
    name.press("Enter")
    operator.is_shown("leave out U+202E (right-to-left override)")
    expect(name, "each correction would be refused").to_be_focused()
    expect(name).to_have_value("Bea\u202e")
    name.fill("Bea")
    name.press("Enter")
    operator.is_shown("inserted at 1.")
    operator.wire.until(lambda: operator.wire.corrected() == [pytest.approx(T, abs=NEAR_S)])
    operator.wire.until(lambda: operator.wire.now.program.author == "Bea")


def test_who_comes_second_is_refused_and_sees_what_is_there(
    operator: Operator, slow: SlowSocket, stage: Stage
):
    """Both have seen the same; what the dashboard says reaches this browser late."""
    revision = operator.wire.now.status.revision
    operator.click(T)
    slow.hold()
    with stage.reader() as other:
        other.insert(operator.wire.now.station, operator.wire.now.session, 1.2, author="Bob")
    operator.wire.until(lambda: operator.wire.corrected() == [pytest.approx(1.2, abs=NEAR_S)])
    operator.insert(T)
    eventually(lambda: slow.has_received(f"revision {revision + 1}"))
    slow.release()
    seen = f"(it is at revision {revision + 1}, you saw {revision})"
    operator.is_shown(f"another operator changed this meanwhile {seen}")
    expect(operator.page.locator("#program-title")).to_contain_text("corrected by Bob")
    assert operator.wire.corrected() == [pytest.approx(1.2, abs=NEAR_S)]

    # The revision comes to the page with what can be undone, after the program's title.
    expect(operator.page.get_by_role("button", name="Undo", exact=True)).to_be_enabled()
    operator.page.mouse.click(*operator.place(T), button="right")
    operator.page.locator(".correct-menu .insert").press("Enter")  # not the second of a double click
    operator.is_shown("inserted at 1.")
    operator.wire.until(lambda: len(operator.wire.corrected()) == 2)
