"""What an operator does beside teaching, in a real browser: name, list, delete, drop, compare."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Locator, Page, expect

from caesura_clients import Caesura
from caesura_protocol.app_kinds import app_title
from caesura_protocol.messages import Description, NameProgram, Program
from dashboard.browser import DESK, LOOK_MS, PATIENCE_MS, PHONE, SETTLED, Visitor, looks_right, needs_chromium
from dashboard.stage import Stage, StandbyBridge, patient
from harness.demonstrations import guided
from harness.processes import eventually, running

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)


@pytest.fixture
def bridge(stage: Stage) -> Iterator[StandbyBridge]:
    with running(StandbyBridge(stage)) as bridge:
        yield bridge


@pytest.fixture
def visitor(opened: Visitor) -> Visitor:
    opened.begin_again(DESK)
    return opened


def described(caesura: Caesura, session: str, station: str) -> Description:
    return caesura.snapshot(station, session).status.description


CHANGE_TWO_FIELDS = """(form) => {
  for (const [field, text] of [["name-task", "polish"], ["name-operator", "Bo"]]) {
    const input = form.querySelector("." + field);
    input.value = text;
    input.dispatchEvent(new Event("input"));
    input.dispatchEvent(new Event("change"));
  }
}"""


def test_two_changes_at_once_are_both_stored_and_the_last_can_be_undone(stage: Stage, visitor: Visitor):
    with stage.reader() as caesura:
        stage.teach("cell-4", guided(), session="twice", pace="fast")
        stage.wait("cell-4")
        visitor.page.goto(f"{stage.dashboard.url}/sessions/cell-4/twice")
        form = visitor.page.locator(".description")
        form.locator("summary").click()
        form.locator(".fields").wait_for()
        form.evaluate(CHANGE_TWO_FIELDS)
        expect(form.locator(".saved")).to_contain_text("Saved.")
        both = Description(task="polish", operator="Bo")
        eventually(lambda: described(caesura, "twice", "cell-4") == both)
        form.locator(".take-back").click()
        eventually(lambda: described(caesura, "twice", "cell-4") == Description(task="polish"))
        assert visitor.errors == []


def test_the_reason_stands_beside_a_start_that_is_not_possible(stage: Stage, visitor: Visitor):
    page, why = visitor.page, visitor.page.locator(".desk-why")
    stage.teach("cell-2", patient())
    page.goto(f"{stage.dashboard.url}/station/cell-2")
    expect(why).to_contain_text("The bridge of cell-2 is not in standby")
    expect(page.locator(".desk .start")).to_have_count(0)
    stage.kill("cell-2")
    expect(why).to_contain_text("No bridge is connected at cell-2.")


HEIGHTS = """() => {
  const heights = window.heights = new Set(), desk = document.querySelector(".desk");
  const look = () => { heights.add(desk.clientHeight); requestAnimationFrame(look); };
  look();
}"""


def test_no_state_and_no_reason_changes_the_height_of_start_and_stop(
    stage: Stage, bridge: StandbyBridge, visitor: Visitor
):
    """The plots jumped at the tenth second of each demonstration."""
    page, state = visitor.page, visitor.page.locator(".desk-state")
    page.goto(f"{stage.dashboard.url}/station/cell-1")
    expect(page.locator("button.start")).to_be_enabled()
    page.evaluate(HEIGHTS)
    page.locator("button.start").click()
    expect(state).to_have_text(re.compile(r"Teaching \d\d s"))
    expect(page.locator(".desk label.wide"), "the field of this one is below").to_contain_text("Next task")
    visitor.picture("desk-teaching")
    page.locator("button.stop").click()
    expect(page.locator("button.start")).to_be_enabled()
    assert len(page.evaluate("() => [...window.heights]")) == 1


SCROLL_BAR = 15  # [px]; the browser of the tests has none
LINES = """(fields) => new Set([...fields.children].filter((one) => one.checkVisibility())
  .map((one) => Math.round(one.getBoundingClientRect().bottom))).size"""


def test_sessions_are_searched_filtered_sorted_and_deleted_with_undo(stage: Stage, visitor: Visitor):
    with stage.reader() as caesura:
        stage.teach("cell-3", guided(), session="unnamed", pace="fast")
        stage.wait("cell-3")
        for number, success in (("a", True), ("b", False), ("c", None)):
            stage.teach("cell-3", guided(), session=f"list-{number}", pace="fast")
            stage.wait("cell-3")
            changes = {"task": f"press {number}", "success": success}
            caesura.describe("cell-3", f"list-{number}", author="Ann", **changes)
        page = visitor.page
        page.goto(f"{stage.dashboard.url}/sessions")
        names = page.locator("td.is-task")
        page.locator(".by-station").select_option("cell-3")
        expect(names).to_have_text(["press c", "press b", "press a", "unnamed"])
        page.get_by_role("button", name="name", exact=True).click()
        expect(names, "as the column has them").to_have_text(["press a", "press b", "press c", "unnamed"])
        caesura.edit_program("cell-3", "list-a", NameProgram(name="press"), author="Ann")
        changed = page.locator("tr", has_text="press a").locator("td[data-title=changed]")
        expect(changed, "an edit of the program is no correction").to_contain_text("Ann")
        looks_right(visitor, "sessions-listed", within="table.sessions")
        page.locator(".by-success").select_option("false")
        expect(names).to_have_text(["press b"])
        names.get_by_role("link").click()
        form = page.locator(".description")
        form.locator("summary").click()
        form.locator(".delete").click()
        expect(form.locator(".saved")).to_contain_text("Deleted: lists leave it out.")
        page.go_back()
        expect(page.locator(".by-success"), "the list is as it was left").to_have_value("false")
        expect(page.get_by_text("No session is like that.")).to_be_visible()
        page.locator(".by-success").select_option("")
        page.get_by_role("button", name="taught").click()
        expect(names).to_have_text(["press c", "press a", "unnamed"])
        page.locator(".with-deleted").check()
        expect(names).to_have_text(["press c", "press b", "press a", "unnamed"])
        names.nth(1).get_by_role("link").click()
        form.locator("summary").click()
        page.set_viewport_size({**DESK, "width": DESK["width"] - SCROLL_BAR})
        assert form.locator(".fields").evaluate(LINES) == 1
        form.locator(".delete").click()
        expect(form.locator(".saved")).to_contain_text("Restored.")
        assert caesura.snapshot("cell-3", "list-b").status.description.deleted is False
        assert visitor.errors == []


def test_a_session_is_deleted_in_the_list_and_the_line_above_it_takes_that_back(
    stage: Stage, visitor: Visitor
):
    with stage.reader() as caesura:
        for number in ("a", "b"):
            stage.teach("cell-5", guided(), session=f"row-{number}", pace="fast")
            stage.wait("cell-5")
            caesura.describe("cell-5", f"row-{number}", author="Ann", task=f"wipe {number}", tags=["left"])
        page = visitor.page
        page.goto(f"{stage.dashboard.url}/sessions")
        page.locator(".by-station").select_option("cell-5")
        names, said = page.locator("td.is-task"), page.locator(".list-said .saved")
        expect(names).to_have_text(["wipe b", "wipe a"])
        page.get_by_role("button", name="Delete wipe b").click()
        expect(said).to_contain_text("wipe b is deleted.")
        expect(names).to_have_text(["wipe a"])
        assert described(caesura, "row-b", "cell-5").deleted is True
        looks_right(visitor, "session-deleted", within=".list-said")
        undo = said.get_by_role("button", name="Undo")
        expect(undo, "the button that had the focus is gone").to_be_focused()
        undo.press("Enter")
        expect(said).to_contain_text("wipe b is restored.")
        expect(names).to_have_text(["wipe b", "wipe a"])
        assert described(caesura, "row-b", "cell-5") == Description(task="wipe b", tags=("left",))
        page.get_by_role("button", name="Delete wipe a").press("Enter")
        expect(names).to_have_text(["wipe b"])
        page.locator(".with-deleted").check()
        page.get_by_role("button", name="Restore wipe a").press("Enter")
        expect(said).to_contain_text("wipe a is restored.")
        eventually(lambda: described(caesura, "row-a", "cell-5").deleted is False)
        caesura.describe("cell-5", "row-a", author="Ann", task="wipe b")
        both = page.get_by_role("button", name=re.compile(r"^Delete wipe b, \w+ \d+, \d{4}"))
        expect(both, "two buttons of one name, to a screen reader").to_have_count(2)
        assert visitor.errors == []


def odd_csv(path: Path) -> Path:
    """A demonstration as other software writes it: ms, mm, and names of its own."""
    rows = guided().matrix() * np.array([1e3, 1e3, 1e3, 1e3, 1.0, 1.0, 1.0])
    lines = (";".join(f"{value:.6f}" for value in row) for row in rows)
    path.write_text("\n".join(["Zeit [ms];X;Y;Z;K1;K2;K3", *lines]).replace(".", ","), encoding="utf-8")
    return path


DROP = """async (zone, content) => {
  const file = new File([content], "odd.csv"), held = new DataTransfer();
  held.items.add(file);
  zone.dispatchEvent(new DragEvent("drop", { dataTransfer: held, bubbles: true, cancelable: true }));
}"""


def test_a_recording_is_dropped_and_played_as_a_session(
    stage: Stage, bridge: StandbyBridge, visitor: Visitor, tmp_path: Path
):
    page = visitor.page
    page.goto(f"{stage.dashboard.url}/recordings")
    page.locator(".drop").evaluate(DROP, odd_csv(tmp_path / "odd.csv").read_text(encoding="utf-8"))
    form = page.locator(".questions")
    expect(form.locator(".column-px")).to_have_value("X")
    expect(form.locator(".unit-pos")).to_have_value("mm")
    expect(page.locator(".drop-state"), "the form is announced").to_have_text(
        "Answer the questions about the recording, then press Play."
    )
    expect(form.locator(".not-read"), "they were left out in silence").to_contain_text("K1, K2, K3")
    expect(form.locator(".column-t"), "nothing is played without a time").to_have_attribute("required", "")
    for column, name in (("fx", "K1"), ("fy", "K2"), ("fz", "K3")):
        form.locator(f".column-{column}").select_option(name)
    expect(form.locator(".not-read")).to_have_count(0)
    form.locator(".wrench-source").select_option("flange_sensor")
    form.locator(".station").fill("cell-1")
    form.locator(".session").fill("from-a-file")
    form.locator(".task").fill("press")
    looks_right(visitor, "recording-questions", within=".questions")
    form.locator(".play-recording").click()
    expect(page.locator(".drop-state")).to_contain_text("The robot of station cell-1 is connected")
    form.locator(".station").fill("cell-7")
    form.locator(".unit-pos").select_option("m")
    form.locator(".play-recording").press("Enter")
    expect(page.locator(".drop-state")).to_contain_text("positions are 524 m away from the base")
    expect(form.locator(".play-recording"), "the form was taken away meanwhile").to_be_focused()
    form.locator(".unit-pos").select_option("mm")
    form.locator(".play-recording").click()
    expect(page.locator(".play-state").first).to_have_text("done")
    with stage.reader() as caesura:
        played = caesura.snapshot("cell-7", "from-a-file")
        assert (played.status.state, played.status.samples) == ("closed", len(guided().t))
        assert (played.status.description.task, played.status.wrench.source) == ("press", "flange_sensor")
        assert len(played.segments.segments) > 2
    page.goto(f"{stage.dashboard.url}/sessions/cell-7/from-a-file")
    check_path_in_3d(page, played.program)
    looks_right(visitor, "path", within=".program-path")
    assert visitor.errors == []


def check_path_in_3d(page: Page, program: Program) -> None:
    """The path is drawn, turned by keys, and run through to its end."""
    path = page.locator(".program-path")
    picture, said = path.locator("canvas"), path.locator("output")
    last = program.apps[-1]
    place = ", ".join(f"{1000 * value + 0.0:.0f}" for value in last.target)
    expect(said).to_contain_text(f" s · {len(program.apps)} {app_title(last.kind)} · ({place}) mm")
    at_the_end = said.text_content() or ""
    drawn = picture.evaluate(PICTURE)
    picture.press("ArrowLeft")
    page.wait_for_function(
        f"(before) => ({PICTURE})(document.querySelector('.program-path canvas')) !== before",
        arg=drawn,
        polling=LOOK_MS,
    )
    path.get_by_role("button", name="top").click()
    expect(path.get_by_role("button", name="top")).to_have_attribute("aria-pressed", "true")
    slider = path.get_by_role("slider")
    slider.press("Home")
    expect(said).to_contain_text(f"1 {app_title(program.apps[0].kind)}")
    slider.fill(str(round(last.tn - 0.3, 1)))
    path.get_by_role("button", name="Play").click()
    expect(said).to_have_text(at_the_end)
    expect(path.get_by_role("button", name="Play")).to_be_visible()
    check_cancel(path)


def check_cancel(path: Locator) -> None:
    """A simulation is cancelled by the keyboard; another page waits no longer than it lasts."""
    simulate, words = path.get_by_role("button", name="Simulate", exact=True), path.locator(".simulated")
    beside = path.page.context.new_page()
    beside.goto(path.page.url)
    second = beside.locator(".program-path")
    expect(second.get_by_role("button", name="Simulate", exact=True)).to_be_enabled()
    simulate.press("Enter")
    expect(path.get_by_role("button", name="Cancel simulation")).to_be_focused()
    expect(second.locator(".simulated")).to_have_text("Another simulation is under way on this dashboard.")
    expect(second.get_by_role("button", name="Simulate", exact=True)).to_be_disabled()
    path.page.keyboard.press("Enter")
    expect(words).to_have_text("Not simulated: cancelled.")
    expect(simulate).to_be_focused()
    expect(second.locator(".simulated")).to_contain_text("Simulate runs the program")
    expect(second.get_by_role("button", name="Simulate", exact=True)).to_be_enabled()
    beside.close()


PICTURE = "(canvas) => canvas.toDataURL()"


def test_two_sessions_stand_side_by_side_with_one_axis_of_time(stage: Stage, visitor: Visitor):
    page, taught = visitor.page, guided()
    slower = replace(taught, t=1.5 * taught.t)
    for station, recording in (("cell-8", taught), ("cell-9", slower)):
        stage.teach(station, recording, session="one", pace="fast")
    for station in ("cell-8", "cell-9"):
        stage.wait(station)
    with stage.reader() as caesura:  # a name that is one long word made the page three times as wide
        caesura.describe("cell-9", "one", author="Ann", task="W" * 120)
    page.goto(f"{stage.dashboard.url}/compare")
    expect(page, "without two sessions, they are chosen first").to_have_url(f"{stage.dashboard.url}/sessions")
    for station in ("cell-8", "cell-9"):
        page.locator("tr", has_text=station).locator(".choose").check()
    page.get_by_role("link", name="Compare these two").click()
    plots = page.locator(".plots")
    expect(plots).to_have_count(2)
    named = page.locator("section", has_text="W" * 120).locator(".state-line")
    expect(named, "two may have the same task").to_contain_text("session one · closed")
    programs = page.locator("section", has=page.get_by_role("heading", name="Programs"))
    expect(programs.locator("tbody tr")).not_to_have_count(0)
    count = programs.locator("tbody tr").count()
    expect(programs, "the same demonstration, slower").to_contain_text(
        f"The first has {count} apps, the second {count}. {count} correspond, of which"
    )
    expect(page.get_by_text("duration")).not_to_have_count(0)
    page.wait_for_function(BOTH_LOADED, polling=LOOK_MS)
    assert page.evaluate(RANGES) == [[0, pytest.approx(float(slower.t[-1]), abs=0.3)]] * 2, "one axis of time"
    looks_right(visitor, "compared")
    page.get_by_role("button", name="Zoom in").first.click()
    page.wait_for_function(BOTH_LOADED, polling=LOOK_MS)
    first, second = page.evaluate(RANGES)
    assert first == second
    assert first[1] - first[0] < 6.0
    page.get_by_role("button", name="Move together").click()
    page.get_by_role("button", name="Earlier").last.click()
    page.wait_for_function(BOTH_LOADED, polling=LOOK_MS)
    assert page.evaluate(RANGES)[0] == first
    moved = page.evaluate(RANGES)[1]
    assert moved[0] < second[0]
    page.get_by_role("button", name="Move together").click()
    page.get_by_role("button", name="Later").last.click()
    page.wait_for_function(BOTH_LOADED, polling=LOOK_MS)
    found = page.evaluate(RANGES)
    apart = [one[0] - other[0] for one, other in zip(found, (first, moved), strict=True)]
    assert apart[0] == pytest.approx(apart[1], abs=0.01), "they keep their distance"
    assert visitor.errors == []
    page.goto(f"{stage.dashboard.url}/sessions/cell-9/one")
    page.set_viewport_size(PHONE)
    expect(page.locator("summary", has_text="This demonstration")).to_contain_text("W" * 120)
    eventually(lambda: visitor.sideways_px() <= 0)


BOTH_LOADED = f"""() => [...document.querySelectorAll(".plots")].every(
  (one) => ({SETTLED})(one) && one.plots.state.partnerLength > 0)"""
RANGES = """() => [...document.querySelectorAll(".plots")].map((one) => one.plots.state.view())"""
