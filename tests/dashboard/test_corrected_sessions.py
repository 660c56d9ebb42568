"""Corrections of sessions that are over: of segments, phases and the program, listed and taken back."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Browser, Locator, Page, expect

from caesura_protocol.messages import Remove
from clients.answering import Answering
from clients.conftest import RouterNetwork
from clients.examples import snapshot
from dashboard.browser import (
    DESK,
    PATIENCE_MS,
    PHONE,
    TABLET,
    THEMES,
    SlowSocket,
    Visitor,
    looks_right,
    needs_chromium,
    settled,
)
from dashboard.operator import NEAR_S, Operator, T
from dashboard.stage import Dashboard, Stage
from harness.demonstrations import guided
from harness.processes import running

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)


DAY_S = 1764172800.25  # when a recording with times of day begins
READ = r"""() => {
  document.querySelectorAll("details").forEach((one) => { one.open = true; });
  const named = [...document.querySelectorAll("[aria-label], [aria-valuetext], [title]")];
  const words = (one) => ["aria-label", "aria-valuetext", "title"].map((name) => one.getAttribute(name));
  return [document.body.innerText, ...named.flatMap(words)].join("\n");
}"""
# As the dashboard's server would send it: what a subscriber got before the answer to an edit, sent after it.
LATE = """(payload) => runMethod(+document.querySelector(".plots").closest("[id^=c]").id.slice(1), "take",
  [0, payload])"""
OUTDATED = "Not done. The session has been corrected since: look at the current state."
TICKS = "() => [...document.querySelector('.plots').plots.plots.values()].at(-1).plot.axes[0]._values"
FONTS = "() => [...document.querySelector('.plots').plots.plots.values()].map(({ plot }) => plot.ctx.font)"
# A second press of Enter, which comes as soon as another Undo has the focus.
PRESSED_AGAIN = """() => addEventListener(
  "focusin", ({ target }) => { if (target.matches(".take-back")) target.click(); }, { once: true })"""
PASSES_MS = 500  # the focus is passed on, and a preview is asked for


@pytest.fixture
def visitor(opened: Visitor) -> Iterator[Visitor]:
    opened.begin_again(DESK)
    yield opened
    assert opened.errors == []


def teach(stage: Stage, station: str, begins_s: float = 0.0) -> None:
    """The session `over` of a station."""
    recording = guided()
    stage.teach(station, replace(recording, t=recording.t + begins_s), session="over", pace="fast")
    stage.wait(station)


def test_a_session_that_is_over_can_still_be_corrected(stage: Stage, visitor: Visitor):
    stage.teach("cell-over", guided(), session="over", pace="4")
    stage.wait("cell-over")
    page = visitor.page
    page.set_viewport_size(TABLET)
    page.goto(f"{stage.dashboard.url}/sessions/cell-over/over")
    expect(page.locator(".app").first).to_be_visible()
    for button in (".undo", ".redo"):  # hidden alone, they were enabled
        expect(page.locator(button)).to_be_hidden()
        expect(page.locator(button)).to_be_disabled()
    page.locator(".plots").focus()
    page.keyboard.press("r")
    page.get_by_label("Time [s]").fill(str(T))
    page.locator(".correct-menu .insert").click()
    page.get_by_label("Your name").fill("Ann")
    page.get_by_role("button", name="Correct", exact=True).click()
    expect(page.locator(".message")).to_contain_text(re.compile(r"inserted at 1\.[34]5 s"))
    expect(page.locator("#program-title")).to_contain_text("complete, corrected by Ann")
    with stage.reader() as caesura:
        assert any(one.corrected for one in caesura.snapshot("cell-over", "over").changepoints.changepoints)
    page.get_by_role("button", name="Undo", exact=True).click()
    expect(page.locator(".message")).to_have_text(
        re.compile(r"^Undone: Ann inserted a changepoint at 1\.[34]5 s\.$")
    )


def test_a_time_beyond_the_session_is_refused_and_nothing_is_corrected(stage: Stage, visitor: Visitor):
    """It was replaced by the end of the session in silence, and a click corrected there."""
    teach(stage, "cell-beyond")
    visitor.is_called("Ann", stage.dashboard.url)
    page, menu = visitor.page, visitor.page.locator(".correct-menu")
    page.goto(f"{stage.dashboard.url}/sessions/cell-beyond/over")
    expect(page.locator(".app").first).to_be_visible()
    page.locator(".plots").press("r")
    time, refused = page.get_by_label("Time [s]"), menu.get_by_role("alert")
    time.fill("99")
    menu.locator(".insert").click()
    expect(refused).to_have_text(
        re.compile(r"^Time 99 s is outside the session \(0 to 5\.\d+ s\): type a time in it\.$")
    )
    expect(time).to_have_value("99")
    expect(time).to_be_focused()
    assert visitor.barriers(within=".correct-menu") == []
    visitor.picture("outside")
    with stage.reader() as caesura:
        assert caesura.snapshot("cell-beyond", "over").status.revision == 0
    time.fill(str(T))
    time.press("Tab")
    expect(refused).to_have_count(0)
    menu.locator(".insert").press("Enter")
    expect(page.locator(".message")).to_contain_text("Changepoint inserted at 1.")


def test_a_message_of_two_lines_covers_no_field_and_no_notes(stage: Stage, visitor: Visitor):
    teach(stage, "cell-words")
    visitor.is_called("Ann", stage.dashboard.url)
    page = visitor.page
    page.goto(f"{stage.dashboard.url}/sessions/cell-words/over")
    page.locator(".description summary").click()
    page.locator(".description .delete").click()
    saved, note = page.locator(".description .saved"), page.locator(".description .name-note")
    expect(saved).to_contain_text("Deleted: lists leave it out")
    page.reload()
    expect(page.locator(".app").first).to_be_visible()
    page.locator(".description summary").click()
    expect(saved).to_contain_text("its samples stay until")
    visitor.picture("covered-description")
    assert bottom(saved) <= top(note)
    card = page.locator(".app").first
    card.locator(".app-edit summary").press("Enter")
    card.locator(".app-name").fill("down to the seal of the cover of the pump")
    card.locator(".app-note").fill("slowly")
    card.locator(".save").press("Enter")
    said, notes = page.locator(".program-said"), page.locator(".program-notes")
    expect(said).to_contain_text("of the pump): name set, note set.")
    visitor.picture("covered-program")
    assert said.evaluate("(one) => one.offsetHeight > 1.5 * parseFloat(getComputedStyle(one).lineHeight)")
    assert bottom(said) <= top(notes)


def top(one: Locator) -> float:
    box = one.bounding_box()
    assert box is not None
    return box["y"]


def bottom(one: Locator) -> float:
    return top(one) + one.evaluate("(one) => one.offsetHeight")


def test_a_list_that_shows_itself_folds_with_the_next_session(stage: Stage, visitor: Visitor):
    """It stayed open and stated that nothing had been corrected. The last answer stayed, too."""
    teach(stage, "cell-fold")
    visitor.is_called("Ann", stage.dashboard.url)
    page = visitor.page
    page.goto(f"{stage.dashboard.url}/station/cell-fold")
    expect(page.locator(".app").first).to_be_visible()
    for key in ("Home", "Shift+ArrowRight", "Enter"):
        page.locator(".plots").press(key)
    corrections = page.locator(".corrections")
    expect(corrections.locator("summary")).to_have_text("Corrections: 1")
    expect(corrections.locator("li")).to_be_visible()
    expect(page.locator(".message")).to_contain_text("Changepoint inserted")
    stage.teach("cell-fold", guided(1), session="second", pace="fast")
    stage.wait("cell-fold")
    expect(corrections.locator("summary")).to_have_text("Corrections: 0")
    expect(corrections.locator("p")).to_be_hidden()
    expect(page.locator(".message"), "it is of the session before").to_have_text("")


def times_of_day(page: Page) -> list[str]:
    """Lines that a page shows or names with a time of day in seconds."""
    page.evaluate(READ)  # what is folded is made by then
    return [line for line in page.evaluate(READ).splitlines() if re.search(r"\b1[67]\d{8}\b", line)]


def test_a_session_with_times_of_day_is_read_and_corrected_from_its_start(stage: Stage, visitor: Visitor):
    teach(stage, "cell-day", begins_s=DAY_S)
    visitor.is_called("Dee", stage.dashboard.url)
    page = visitor.page
    with stage.reader() as caesura:
        start_s = caesura.snapshot("cell-day", "over").segments.segments[0].t0

        def corrected() -> list[float]:
            points = caesura.snapshot("cell-day", "over").changepoints.changepoints
            return [one.t - start_s for one in points if one.corrected]

        page.goto(f"{stage.dashboard.url}/sessions/cell-day/over")
        expect(page.locator(".state-line")).to_contain_text("from 2025-11-26 16:00:00 UTC on, the start")
        expect(page.locator(".app").first).to_be_visible()
        settled(page)
        assert times_of_day(page) == []
        assert page.evaluate(TICKS)[:3] == ["0 s", "0.5", "1"]

        page.locator(".plots").press("r")
        field = page.get_by_label("Time [s]")
        field.fill(str(T))
        field.press("Enter")
        expect(page.locator(".selection")).to_contain_text(f"Time {T:.2f} s: motion")
        page.locator(".correct-menu .insert").hover()
        expect(page.locator(".correct-menu .effect")).to_contain_text(
            re.compile(r"becomes motion 0\.\d\d to 1\.")
        )
        assert times_of_day(page) == []
        page.locator(".correct-menu .insert").click()
        expect(page.locator(".message").first).to_contain_text(re.compile(r"inserted at 1\.[34]\d s"))
        rows = page.locator(".corrections li")
        (inserted,) = corrected()
        expect(rows.first).to_contain_text(f"Dee inserted a changepoint at {inserted:.2f} s")
        assert inserted == pytest.approx(T, abs=NEAR_S)
        expect(page.locator(".message").first).to_contain_text(f"inserted at {inserted:.2f} s")

        visitor.picture("time-of-day")
        operator = Operator.at(page, visitor)
        operator.drag(start_s + inserted, start_s + inserted + 0.2)
        expect(page.locator(".message").first).to_contain_text("Changepoint moved from")
        expect(rows).to_have_count(2)
        assert corrected() == [pytest.approx(inserted + 0.2, abs=NEAR_S)]
        assert times_of_day(page) == []
        operator.press("Undo")
        expect(page.locator(".message").first).to_contain_text("Undone")
        assert corrected() == [pytest.approx(inserted)]
    for path in ("/station/cell-day", "/"):
        page.goto(f"{stage.dashboard.url}{path}")
        expect(page.locator("body")).to_contain_text("ended", ignore_case=True)
        assert times_of_day(page) == []


def test_all_corrections_are_listed_and_any_of_them_is_undone(stage: Stage, visitor: Visitor):
    teach(stage, "cell-list")
    visitor.is_called("Cem", stage.dashboard.url)
    page = visitor.page
    with stage.reader() as caesura:
        page.goto(f"{stage.dashboard.url}/sessions/cell-list/over")
        listed = page.locator(".corrections")
        expect(listed.locator("summary")).to_have_text("Corrections: 0")
        expect(listed.locator(".empty"), "collapsed to a count").to_be_hidden()
        caesura.insert("cell-list", "over", 1.2, author="Ann")
        caesura.insert("cell-list", "over", 0.4, author="Bo")
        caesura.move("cell-list", "over", 1.2, 1.6, author="Ann")
        rows = listed.locator("li")
        expect(rows).to_have_count(3)
        moved = re.compile(r"Ann moved the changepoint at 1\.[12]5 s to 1\.[56]5 s")
        expect(rows.first).to_contain_text(moved)
        expect(rows.first.locator("time")).to_be_visible()
        expect(rows.last).to_contain_text(re.compile(r"Ann inserted a changepoint at 1\.[12]5 s"))

        since = listed.get_by_label("What has changed since")
        since.select_option(value="1")
        effect = listed.locator(".effect")
        expect(effect).to_contain_text(re.compile(r"^\s*Changed.* become .*and 2 more"))
        looks_right(visitor, "since", within=".corrections")
        page.locator(".plots").focus()

        rows.last.get_by_role("button", name="Undo").click()
        refusal = "correction 3 by Ann moved that changepoint on: take correction 3 back first"
        expect(listed.locator(".message")).to_contain_text(refusal)
        caesura.undo("cell-list", "over", number=3, author="Ann")
        expect(listed.locator(".message"), "its reason is gone").to_have_text(OUTDATED)
        caesura.redo("cell-list", "over", author="Ann")
        expect(rows.first, "the page follows").not_to_contain_text("undone")
        called = re.compile(r"^Undo correction 2: Bo inserted a changepoint at 0\.[34]5 s$")
        undo = rows.nth(1).get_by_role("button", name=called)
        undo.focus()
        page.evaluate(PRESSED_AGAIN)
        page.keyboard.press("Enter")
        expect(listed.locator(".message")).to_contain_text("Correction 2 is taken back")
        expect(rows.nth(1)).to_contain_text("undone")
        expect(rows.nth(2).get_by_role("button", name="Undo"), "its button is gone").to_be_focused()
        kept = [
            one.t for one in caesura.snapshot("cell-list", "over").changepoints.changepoints if one.corrected
        ]
        assert kept == [pytest.approx(1.6, abs=NEAR_S)]
        looks_right(visitor, "corrections", within=".corrections")
        expect(listed.locator(".message"), "Enter counted once").to_contain_text("Correction 2 is taken back")

        def states() -> list[str]:
            return [one.state for one in caesura.snapshot("cell-list", "over").program.corrections]

        expect(page.get_by_role("button", name="Redo", exact=True)).to_have_count(0)
        page.locator(".plots").press("Control+z")
        expect(page.locator(".message").first, "the taking back is undone").to_have_text(
            re.compile(r"^Correction 2 counts again: Bo inserted a changepoint at 0\.\d5 s\.$")
        )
        expect(rows.nth(1).get_by_role("button", name="Undo")).to_be_visible()
        assert states() == ["applied"] * 3
        page.locator(".plots").press("Control+y")
        expect(rows.nth(1)).to_contain_text("undone")
        assert states() == ["applied", "undone", "applied"]
        page.get_by_role("button", name="Undo", exact=True).click()
        expect(rows.nth(1).get_by_role("button", name="Undo")).to_be_visible()
        page.locator(".plots").press("Control+z")
        expect(rows.first, "then the newest correction").to_contain_text("undone")
        expect(page.locator(".message").first, "it is answered").not_to_have_text("Correcting …")
        assert states() == ["applied", "applied", "undone"]
        caesura.redo("cell-list", "over", author="Bo")
        expect(rows.first.get_by_role("button", name="Undo")).to_be_visible()
        page.locator(".plots").press("Control+z")
        expect(rows.first, "another editor was first: the newest one").to_contain_text("undone")


def test_a_correction_whose_place_is_gone_is_listed_with_the_reason(stage: Stage, visitor: Visitor):
    teach(stage, "cell-gone")
    page = visitor.page
    page.set_viewport_size(TABLET)
    with stage.reader() as caesura:
        (pressing,) = [one for one in caesura.snapshot("cell-gone", "over").program.apps if one.force]
        middle = 0.5 * (pressing.t0 + pressing.tn)
        caesura.limit_force("cell-gone", "over", middle, 4.0, author="Ann")
        page.goto(f"{stage.dashboard.url}/sessions/cell-gone/over")
        row = page.locator(".corrections li").last
        expect(row).to_contain_text("Ann limited the force")
        expect(row).not_to_contain_text("Not applied")
        caesura.relabel("cell-gone", "over", middle, "motion", author="Bo")
        expect(row).to_contain_text(f"Not applied: no app exerts a force at {middle:.2f} s any more")
        looks_right(visitor, "correction-gone", within=".corrections")
        page.locator(".corrections li").first.get_by_role("button", name="Undo").click()
        expect(page.locator(".who")).to_be_visible()
        page.locator(".who .author").fill("Cem")
        page.locator(".who .save-name").click()
        expect(row, "its app is back").not_to_contain_text("Not applied")


def test_a_phase_is_named(stage: Stage, visitor: Visitor):
    teach(stage, "cell-phase")
    visitor.is_called("Ann", stage.dashboard.url)
    page = visitor.page
    with stage.reader() as caesura:
        page.goto(f"{stage.dashboard.url}/sessions/cell-phase/over")
        expect(page.locator(".app").first).to_be_visible()
        operator = Operator.at(page, visitor)
        contact = next(
            one for one in caesura.snapshot("cell-phase", "over").segments.phases if one.kind == "contact"
        )
        # where a phase begins, the menu means the phase that begins
        page.mouse.click(*operator.place(contact.t0), button="right")
        menu = page.locator(".correct-menu")
        expect(menu.get_by_role("button", name="contact")).to_have_attribute("aria-pressed", "true")
        menu.get_by_label("Name the phase contact").fill("press the pump")
        menu.get_by_role("button", name="Name", exact=True).hover()
        expect(menu.locator(".effect")).to_contain_text("becomes phase press the pump (contact)")
        menu.get_by_label("Name the phase contact").focus()
        looks_right(visitor, "name-phase", within=".correct-menu")
        page.keyboard.press("Enter")
        expect(page.locator(".message").first).to_contain_text("is called press the pump")
        expect(page.locator(".selection")).to_contain_text("in phase press the pump (contact)")
        expect(page.locator(".corrections li")).to_contain_text("Ann named the phase at")
        names = [
            one.name
            for one in caesura.snapshot("cell-phase", "over").segments.phases
            if one.kind == "contact"
        ]
        assert names == ["press the pump"]
        page.set_viewport_size(DESK)
        visitor.picture("phase-named-desktop")
        page.get_by_role("button", name="Undo", exact=True).click()
        expect(page.locator(".selection")).not_to_contain_text("press the pump")


def test_what_a_correction_would_change_is_shown_before_it_is_made(stage: Stage, visitor: Visitor):
    teach(stage, "cell-preview")
    visitor.is_called("Ann", stage.dashboard.url)
    page, effect = visitor.page, visitor.page.locator(".effect")
    with stage.reader() as caesura:
        before = caesura.snapshot("cell-preview", "over")
        first, second = before.segments.segments[1:3]
        page.goto(f"{stage.dashboard.url}/sessions/cell-preview/over")
        expect(page.locator(".app").first).to_be_visible()
        operator = Operator.at(page, visitor)
        expect(operator.plot, "the last samples push nothing out").to_have_attribute("data-from", "0")

        page.mouse.click(*operator.place(first.tn), button="right")
        menu = page.locator(".correct-menu")
        expect(menu.locator(".remove")).to_be_focused()
        merged = caesura.preview("cell-preview", "over", Remove(t=first.tn)).segments_after
        words = [f"{one.kind} {one.t0:.2f} to {one.tn:.2f} s" for one in merged]
        expect(menu.locator(".effect"), "of the key that has the focus").to_contain_text(words[0])
        expect(menu.locator(".effect")).to_contain_text("App")
        visitor.picture("preview-remove-desktop")
        assert visitor.barriers(within=".correct-menu") == []
        menu.get_by_role("button", name="steady").hover()
        expect(menu.locator(".effect"), "of what the pointer is on").to_contain_text("steady")
        visitor.picture("preview-relabel-desktop")
        page.keyboard.press("Escape")
        expect(effect.filter(has_text="become")).to_have_count(0)

        page.mouse.move(*operator.place(first.tn))
        page.mouse.down()
        to = first.tn + 0.3
        page.mouse.move(*operator.place(to - 0.1))
        page.mouse.move(*operator.place(to))
        tip = page.locator(".effect-tip")
        expect(tip, "what is known at once").to_contain_text(f"{first.kind} {first.t0:.2f} to")
        expect(tip, "what the service answers").to_contain_text("App")
        visitor.picture("preview-drag-desktop")
        shown = tip.inner_text()
        for part in ("changepoints", "segments", "program"):
            assert getattr(caesura.snapshot("cell-preview", "over"), part) == getattr(before, part), part
        page.mouse.up()
        expect(page.locator(".message").first).to_contain_text("Changepoint moved")
        after = caesura.snapshot("cell-preview", "over").segments.segments
        ends = [f"{one.kind} {one.t0:.2f} to {one.tn:.2f} s" for one in after[1:3]]
        assert all(words in shown for words in ends), "the edit does what was shown"
        assert second.tn == after[2].tn

        row = page.locator(".corrections li").first
        row.get_by_role("button", name="Undo").hover()
        expect(page.locator(".corrections .effect")).to_contain_text(f"{first.tn:.2f} s")
        visitor.picture("preview-undo-desktop")
        assert caesura.snapshot("cell-preview", "over").status.revision == 1


def test_a_finger_sees_the_effect_at_the_first_tap_and_corrects_at_the_second(stage: Stage, browser: Browser):
    teach(stage, "cell-touch")
    visitor = Visitor(browser, viewport=PHONE, has_touch=True, device_scale_factor=2)
    page = visitor.page
    page.add_init_script("localStorage.setItem('caesura-author', 'Ann')")
    with stage.reader() as caesura:
        page.goto(f"{stage.dashboard.url}/sessions/cell-touch/over")
        expect(page.locator(".app").first).to_be_visible()
        operator = Operator.at(page, visitor)
        expect(page.locator(".selection")).to_have_text(
            "Tap a time in the plot, or hold your finger there to correct it."
        )
        operator.touch_for_long(T)
        expect(page.locator(".correct")).to_have_attribute("title", re.compile("a long press"))
        menu = page.locator(".correct-menu")
        menu.locator(".insert").tap()
        expect(menu.locator(".effect")).to_contain_text("become")
        expect(menu.locator(".effect")).to_contain_text("Tap again to correct.")
        expect(menu.locator(".more"), "it was below what is in sight").to_be_in_viewport(ratio=1)
        assert menu.locator(".more").evaluate(IS_ON_TOP)
        assert caesura.snapshot("cell-touch", "over").status.revision == 0
        for visitor.theme, rules in THEMES.items():
            page.evaluate("(theme) => document.documentElement.dataset.theme = theme", visitor.theme)
            visitor.picture("preview-phone")
            assert visitor.barriers(*rules, within=".correct-menu") == []
        assert page.evaluate("() => document.documentElement.scrollWidth - innerWidth") <= 0
        menu.locator(".insert").tap()
        expect(page.locator(".message").first).to_contain_text("Changepoint inserted at 1.")
        assert caesura.snapshot("cell-touch", "over").status.revision == 1
        assert len(set(page.evaluate(FONTS))) == 1, "times were written half as large as values"
        undo = page.get_by_role("button", name="Undo", exact=True).first
        undo.tap()
        expect(page.locator(".message").first).to_contain_text("Undone")
        expect(undo).to_be_hidden()
        page.wait_for_timeout(PASSES_MS)
        expect(page.locator(".effect-tip"), "a finger points at no other button").to_have_count(0)
    assert visitor.errors == []
    visitor.close()


def test_what_comes_late_to_a_page_makes_no_undo_of_two(stage: Stage, visitor: Visitor):
    """The page took the revision of what came late, and its next undo passed for the last one, sent again."""
    teach(stage, "cell-late")
    visitor.is_called("Ann", stage.dashboard.url)
    page = visitor.page
    with stage.reader() as caesura:
        for t in (0.4, 1.2, 1.6):
            caesura.insert("cell-late", "over", t, author="Ann")
        page.goto(f"{stage.dashboard.url}/sessions/cell-late/over")
        undo, undone = (
            page.get_by_role("button", name="Undo", exact=True),
            page.locator(".corrections .state"),
        )
        expect(undo).to_be_enabled()
        for count in (1, 2):
            undo.click()
            expect(undone).to_have_count(count)
        page.evaluate(LATE, {"revision": 4})
        undo.click()
        expect(undone).to_have_count(3)
        assert caesura.snapshot("cell-late", "over").status.revision == 6


def test_a_program_is_edited_at_its_apps_exported_and_taken_back(stage: Stage, visitor: Visitor):
    teach(stage, "cell-program")
    visitor.is_called("Ann", stage.dashboard.url)
    page, apps = visitor.page, visitor.page.locator(".app")
    page.goto(f"{stage.dashboard.url}/sessions/cell-program/over")
    expect(apps.first).to_be_visible()
    said, count = page.locator(".program-said"), apps.count()
    with stage.reader() as caesura:
        taught = caesura.snapshot("cell-program", "over").program.apps
        pressing = next(index for index, one in enumerate(taught) if one.kind == "apply_force")

        card = apps.nth(pressing)
        card.get_by_text("Edit", exact=True).click()
        card.locator(".app-name").fill("Press the pump")
        card.locator(".app-force_n").fill("4")
        card.locator(".app-target_name").fill("pump head")
        card.locator(".save").click()
        expect(said).to_contain_text("name set, position name set, force set")
        expect(card.locator("dl")).to_contain_text("pump head")
        expect(card.locator("h3")).to_contain_text("Press the pump")
        expect(card.locator(".marks")).to_contain_text("force by Ann (taught")
        edited = caesura.snapshot("cell-program", "over").program
        assert edited.apps[pressing].name == "Press the pump"
        assert edited.apps[pressing].target_name == "pump head"
        assert max(map(abs, edited.apps[pressing].force or ())) <= 4.01

        apps.first.get_by_text("Edit", exact=True).focus()
        page.keyboard.press("Enter")
        apps.first.get_by_role("button", name="Delete app 1").focus()
        page.keyboard.press("Enter")
        expect(said).to_contain_text("deleted")
        expect(apps).to_have_count(count - 1)
        expect(page.locator(".app .findings .error").first).to_contain_text("presses without a contact")
        for theme, rules in THEMES.items():
            page.evaluate("(theme) => document.documentElement.dataset.theme = theme", theme)
            visitor.theme = theme
            visitor.picture("program-edited-desktop")
            assert visitor.barriers(*rules, within=".program-column") == []
        page.set_viewport_size(PHONE)
        visitor.picture("program-edited-phone")
        assert page.evaluate("() => document.documentElement.scrollWidth - innerWidth") <= 0

        page.get_by_role("button", name="Undo edit").click()
        expect(apps).to_have_count(count)
        page.get_by_role("button", name="Undo edit").click()
        expect(page.locator(".edits summary")).to_contain_text("Edits: 2")
        expect(page.locator(".marks")).to_have_count(0)
        assert caesura.snapshot("cell-program", "over").program.apps == taught
    for words, part in (
        ("JSON", '"caesura.program"'),
        ("franky script", "APPS ="),
        ("behaviour tree", "<root"),
    ):
        with page.expect_download() as download:
            page.get_by_role("link", name=words).click()
        assert part in Path(download.value.path()).read_text("utf-8")
    # A browser keeps the text of a refused download to itself; a refused page is shown.
    assert page.locator(".exports a[download]").count() == 0


def test_an_operator_who_edits_again_before_the_program_is_there_makes_two_edits(
    stage: Stage, browser: Browser
):
    """The second one named the revision of the first, as where an answer is lost: it was not made."""
    teach(stage, "cell-quick")
    visitor = Visitor(browser, viewport=DESK)
    visitor.is_called("Ann", stage.dashboard.url)
    page, said = visitor.page, visitor.page.locator(".program-said")
    slow = SlowSocket(page)
    page.goto(f"{stage.dashboard.url}/sessions/cell-quick/over")
    copy = page.get_by_role("button", name="Duplicate app 1")
    page.locator(".app").first.get_by_text("Edit", exact=True).click()
    slow.hold("editRevision")
    for _ in range(2):
        copy.press("Enter")  # two clicks would be a double click
        expect(said).to_contain_text("duplicated")
        expect(copy).to_be_enabled()
    with stage.reader() as caesura:
        assert caesura.snapshot("cell-quick", "over").program.edit_revision == 2
    slow.release()
    expect(page.locator(".edits summary")).to_contain_text("Edits: 2")
    assert visitor.errors == []
    visitor.close()


# Is the middle of an element in sight, under nothing else and not scrolled out of what it is in?
IS_ON_TOP = """(one) => {
  const { left, top, width, height } = one.getBoundingClientRect();
  return document.elementFromPoint(left + width / 2, top + height / 2) === one;
}"""
DISCONNECT = "() => { window.socket.emit = () => {}; }"  # as a connection that is lost, and never comes back


OFFER = "Simulate runs the program on the simulated arm, in a cell that is built from the program."


def test_what_is_lost_with_the_connection_is_stated_when_the_page_is_loaded_again(
    stage: Stage, visitor: Visitor
):
    """The page showed the session as if nothing had been corrected, edited or typed."""
    teach(stage, "cell-lost")
    visitor.is_called("Ann", stage.dashboard.url)
    page = visitor.page
    page.goto(f"{stage.dashboard.url}/sessions/cell-lost/over")
    expect(page.locator(".app").first).to_be_visible()
    settled(page)
    said, edited = page.locator(".at-time .message"), page.locator(".program-said")
    run = page.locator(".program-path .simulated")
    note, tags, saved = (page.locator(one) for one in (".name-note", ".name-tags", ".description .conflict"))
    page.locator(".description summary").click()
    page.evaluate(DISCONNECT)
    note.fill("calm hand")
    note.press("Tab")
    page.locator(".program-name").fill("Press the pump")
    page.locator(".program-name").press("Tab")
    page.locator(".plots").press("r")
    page.locator(".correct-menu .insert").click()
    expect(said).to_contain_text("Correcting …")
    page.get_by_role("button", name="Simulate", exact=True).click()
    tags.fill("left")  # and the cursor stays there
    page.once("dialog", lambda dialog: dialog.accept())  # the browser asks before it leaves what is not saved
    page.reload()
    expect(said).to_contain_text("A correction was asked for before this page was loaded again")
    expect(edited).to_contain_text("An edit was asked for before this page was loaded again")
    expect(run).to_contain_text("A simulated run ended with the connection")
    expect(saved).to_contain_text("Not saved: this page was left or loaded again")
    expect(note).to_have_value("calm hand")
    expect(tags).to_have_value("left")
    looks_right(visitor, "lost", within=".description")
    page.get_by_role("button", name="Try again").click()
    expect(page.locator(".description .saved")).to_contain_text("Saved.")
    with stage.reader() as caesura:
        stored = caesura.snapshot("cell-lost", "over").status.description
        assert (stored.note, stored.tags) == ("calm hand", ("left",))
    page.reload()
    expect(page.locator(".app").first).to_be_visible()
    settled(page)
    for one in (said, edited, page.locator(".description .saved")):
        expect(one, "it is stated once").to_have_text("")
    expect(run, "it is stated once").to_have_text(OFFER)


def test_the_first_edit_of_a_program_asks_for_a_name(stage: Stage, visitor: Visitor):
    teach(stage, "cell-unsigned")
    page = visitor.page
    page.set_viewport_size(TABLET)
    page.goto(f"{stage.dashboard.url}/sessions/cell-unsigned/over")
    page.get_by_label("Program name").fill("Press the pump")
    page.get_by_label("Program name").press("Enter")
    expect(page.get_by_label("Your name")).to_be_focused()
    assert visitor.barriers(within=".who-edits") == []
    page.keyboard.press("Escape")
    expect(page.get_by_label("Program name"), "it has asked for the name").to_be_focused()
    page.keyboard.press("End")
    page.keyboard.type("!")
    page.keyboard.press("Enter")
    expect(page.get_by_label("Your name")).to_be_focused()
    page.keyboard.insert_text("A" * 65)
    page.keyboard.press("Enter")
    refusal = "Not done: your name has 65 characters, expected at most 64 characters."
    expect(page.locator(".program-said"), "it was cut in silence").to_have_text(refusal)
    expect(page.get_by_label("Your name"), "and every edit would be refused").to_be_focused()
    page.keyboard.press("ControlOrMeta+a")
    page.keyboard.type("Ann")
    page.keyboard.press("Enter")
    expect(page.locator(".edits summary")).to_contain_text("Edits: 1")
    page.locator(".edits summary").click()
    expect(page.locator(".edits li")).to_contain_text("– Ann, applied")


def test_a_part_is_taught_again_and_replaced_at_its_app(stage: Stage, visitor: Visitor):
    stage.teach("cell-again", guided(), session="first", pace="fast")
    stage.wait("cell-again")
    stage.teach("cell-again", guided(1), session="second", pace="fast")
    stage.wait("cell-again")
    page, apps = visitor.page, visitor.page.locator(".app")
    visitor.is_called("Ann", stage.dashboard.url)
    page.goto(f"{stage.dashboard.url}/sessions/cell-again/first")
    expect(apps.first).to_be_visible()
    said = page.locator(".program-said")
    with stage.reader() as caesura:
        taught = caesura.snapshot("cell-again", "first").program.apps
        second = caesura.snapshot("cell-again", "second").program.apps
        expect(apps).to_have_count(len(taught))

        card = apps.nth(1)
        card.get_by_text("Edit", exact=True).click()
        card.locator(".part-last").select_option("2")
        offered = card.locator(".part-session option").all_inner_texts()
        assert offered == ["choose", f"second, {len(second)} apps"]
        card.locator(".part-session").select_option("second")
        for theme, rules in THEMES.items():
            page.evaluate("(theme) => document.documentElement.dataset.theme = theme", theme)
            visitor.theme = theme
            visitor.picture("part-taught-again-desktop")
            assert visitor.barriers(*rules, within=".app-edit[open]") == []
        card.locator(".replace-part").click()
        expect(said).to_contain_text("replaced by session 'second'")
        expect(apps).to_have_count(len(taught) - 1 + len(second))
        expect(card.locator(".marks")).to_contain_text("taught again by Ann")
        expect(card.locator(".findings")).to_contain_text("from the end of the app before it")
        visitor.picture("part-replaced-desktop")
        page.locator(".edits summary").click()
        expect(page.locator(".edits li")).to_contain_text("– Ann, applied")
        shown = caesura.snapshot("cell-again", "first").program.apps
        assert [one for one in shown if one.added is None] == [taught[0], *taught[2:]]

        page.get_by_role("button", name="Undo edit").click()
        expect(apps).to_have_count(len(taught))
        assert caesura.snapshot("cell-again", "first").program.apps == taught


def test_a_session_whose_corrections_are_not_listed_is_not_called_uncorrected(browser: Browser):
    """As one that an older version of the service closed."""
    with RouterNetwork() as router, Answering(router.transport()) as service, ExitStack() as stack:
        whole = snapshot(0, "motion", station="cell-1", session="s1", state="closed")
        status = whole.status.model_copy(update={"revision": 2})
        program = whole.program.model_copy(update={"corrections": ()})
        service.snapshots = [whole.model_copy(update={"status": status, "program": program})]
        dashboard = stack.enter_context(running(Dashboard(router.endpoint)))
        visitor = stack.enter_context(closing(Visitor(browser)))
        visitor.page.goto(f"{dashboard.url}/sessions/cell-1/s1")
        listed = visitor.page.locator(".corrections")
        expect(listed.locator("summary")).to_have_text("Corrections: not listed")
        listed.locator("summary").click()
        expect(listed.locator(".empty")).to_contain_text("made under an older version of the service")
