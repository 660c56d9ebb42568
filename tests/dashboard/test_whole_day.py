"""The operator's day in one go, in a real browser: from the start of a demonstration to the day after."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Locator, Page, expect

from caesura_clients import Caesura
from caesura_protocol.messages import Description, Insert, Snapshot
from caesura_protocol.recording import Recording
from dashboard.browser import (
    DESK,
    LOOK_MS,
    PATIENCE_MS,
    PHONE,
    SIZES,
    TABLET,
    UPRIGHT,
    Visitor,
    looks_right,
    needs_chromium,
    settled,
)
from dashboard.operator import Operator
from dashboard.stage import Stage, StandbyBridge, patient
from dashboard.test_start_stop import described
from harness.processes import eventually, running

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
TAUGHT_S = 6.5  # [s] the hand has gone back and rests
SHORT_S = 1.5
LEAST_SHOWN = 35  # of 50 samples a second, in half of that
# [s] the middle of the longest segment: in a long session any other time is near to a changepoint.
MIDDLE = """() => {
  const segments = document.querySelector(".plots").plots.state.segments;
  const [t0, tn] = segments.reduce((one, two) => (two[1] - two[0] > one[1] - one[0] ? two : one));
  return (t0 + tn) / 2;
}"""
AXES = ("x", "y", "z")
NAMED = Description(task="wipe the table", operator="Ann", note="calm hand", success=True)
STARTED = "put the cube into the box"  # the task, as it is typed before the start
# Of a field: how much wider it is than the text in it.
ROOM_PX = """(field) => {
  const { font, paddingLeft, paddingRight } = getComputedStyle(field);
  const context = Object.assign(document.createElement("canvas").getContext("2d"), { font });
  const used = parseFloat(paddingLeft) + parseFloat(paddingRight) + context.measureText(field.value).width;
  return field.clientWidth - used;
}"""
# Of a line that ends with an ellipsis: how much of its date is behind its end.
DATE_CUT_PX = r"""(line) => {
  const texts = document.createTreeWalker(line, NodeFilter.SHOW_TEXT), range = document.createRange();
  for (let text = texts.nextNode(); text; text = texts.nextNode()) {
    const [date] = text.data.match(/\w+ \d+, \d{4}, [\d:]+.[AP]M/) ?? [];
    if (!date) continue;
    range.setStart(text, text.data.indexOf(date));
    range.setEnd(text, text.data.indexOf(date) + date.length);
    return range.getBoundingClientRect().right - line.getBoundingClientRect().right;
  }
  return Infinity;
}"""
# Of a panel, by column: the samples in a range of time, and what its title says is taken off them.
DRAWN = """([name, from, to]) => {
  const { state, plots } = document.querySelector(".plots").plots;
  const panel = state.panels.find((one) => one.name === name), off = state.off(panel);
  const [times, ...columns] = plots.get(name).plot.data;
  const points = columns.map((values) => [...times].map((t, i) => [t, values[i]])
    .filter(([t, value]) => value !== undefined && value !== null && t >= from && t <= to));
  return { off: columns.map((_, k) => off[k] ?? 0), points };
}"""


@pytest.fixture
def bridge(stage: Stage) -> Iterator[StandbyBridge]:
    with running(StandbyBridge(stage)) as bridge:
        yield bridge


@pytest.fixture
def visitor(opened: Visitor) -> Visitor:
    opened.begin_again(DESK)
    return opened


def teach(stage: Stage, visitor: Visitor) -> str:
    """Start, teach, stop and name a demonstration; return its session.

    The keyboard starts and stops; `trial` sees that a mouse could, as nothing covers the buttons.
    """
    page, desk = visitor.page, visitor.page.locator(".desk")
    start, stop = (desk.get_by_role("button", name=name) for name in ("Start", "Stop"))
    expect(desk).to_contain_text("Ready")
    expect(stop).to_be_disabled()
    expect(page.locator(".selection")).to_have_text(
        "Signals and segments are drawn here once a demonstration begins."
    )
    expect(page.locator(".plots")).to_be_hidden()
    expect(page.locator(".state-line"), "the state stands beside Start").to_have_text("")
    for tools in (".scrub", ".signals", ".table"):  # there is nothing to zoom, to choose or to list yet
        expect(page.locator(tools)).to_have_count(0)
    looks_right(visitor, "day-ready")

    start.click(trial=True)
    desk.locator(".operator").fill("Ann")
    desk.locator(".task").fill(STARTED)
    for size in SIZES.values():
        page.set_viewport_size(size)
        assert desk.locator(".task").evaluate(ROOM_PX) >= 0, f"cut at {size}"
    page.set_viewport_size(DESK)
    desk.locator(".task").press("Enter")
    expect(desk).to_contain_text("Teaching")
    expect(start).to_be_disabled()
    expect(desk.get_by_role("status").first, "its seconds are not announced").to_have_text("Teaching")
    expect(desk).to_contain_text("Stop ends this demonstration; then the next one can start.")
    expect(page.get_by_text("move to contact").first).to_be_visible()
    looks_right(visitor, "day-teaching")
    shown = page.locator(".scrub output")
    expect(shown, "it changes every second").to_have_attribute("aria-live", "off")
    is_taught = f"(shown) => parseFloat(shown.innerText) > {TAUGHT_S}"
    page.wait_for_function(is_taught, arg=shown.element_handle(), polling=LOOK_MS)
    stop.click(trial=True)
    stop.focus()
    page.keyboard.press("Enter")
    expect(desk).to_contain_text("Ready")
    expect(stop, "the keys went nowhere").to_be_focused()
    session = session_of(page)
    describe(stage, visitor, session)
    return session


def session_of(page: Page) -> str:
    """The session that the page names as the current one."""
    words = page.locator(".state-line").inner_text()
    return words.split("session ")[1].split(" ·")[0]


def describe(stage: Stage, visitor: Visitor, session: str) -> None:
    """State what was taught, and take the last statement back."""
    tagged = NAMED.model_copy(update={"tags": ("left", "slow")})
    form = visitor.page.locator(".description")
    form.locator("summary").click()
    assert form.locator(".name-task").evaluate(ROOM_PX) >= 0, "the task is cut"
    for size in (DESK, TABLET, UPRIGHT, PHONE):
        visitor.page.set_viewport_size(size)
        assert form.locator("summary").evaluate(DATE_CUT_PX) <= 0, f"the date is cut at {size}"
    visitor.page.set_viewport_size(DESK)
    form.locator(".name-task").select_text()
    visitor.page.keyboard.insert_text("x" * 121)  # as it is pasted
    visitor.page.keyboard.press("Tab")
    expect(form.get_by_role("alert")).to_have_text(
        "Not done: task has 121 characters, expected at most 120 characters."
    )
    form.get_by_role("button", name="Give up").click()
    form.locator(".name-note").fill("calm hand")
    form.locator(".yes").click()
    expect(form.locator(".saved")).to_contain_text("Saved.")
    form.locator(".name-task").fill(NAMED.task)
    form.locator(".name-tags").fill("left, slow")
    form.locator(".name-tags").press("Tab")
    looks_right(visitor, "day-named", within=".description")
    with stage.reader() as caesura:
        eventually(lambda: described(caesura, session, "cell-1") == tagged)
        form.locator(".take-back").click()
        eventually(lambda: described(caesura, session, "cell-1") == NAMED)
    expect(form.locator(".name-tags")).to_have_value("")


def correct(visitor: Visitor) -> None:
    """Insert a changepoint by the menu of its time, in the name of the operator who started."""
    page = visitor.page
    page.locator(".plots").press("0")
    page.locator("canvas.band").scroll_into_view_if_needed()
    settled(page)
    insert, t = page.locator(".correct-menu .insert"), page.evaluate(MIDDLE)

    def opens_menu() -> bool:  # again where the page has moved between the look and the click
        x, _ = Operator.at(page, visitor).place(t)
        band = page.locator("canvas.band").bounding_box()
        assert band is not None
        page.mouse.click(x, band["y"] + band["height"] - 4, button="right")
        return insert.is_visible()

    eventually(opens_menu)
    insert.click()
    expect(page.locator(".message").first).to_contain_text("Changepoint inserted at ")
    expect(page.locator(".corrections li")).to_have_count(1)
    looks_right(visitor, "day-corrected", within=".corrections")


def edit(visitor: Visitor, number: int) -> None:
    """Name an app of the program, and let it press less."""
    card = visitor.page.locator(".app").nth(number)
    card.get_by_text("Edit", exact=True).click()
    card.locator(".app-name").fill("Press the pump")
    card.locator(".app-force_n").fill("4")
    card.locator(".save").click()
    expect(visitor.page.locator(".program-said")).to_contain_text("name set, force set")
    expect(card.locator(".marks")).to_contain_text("force by Ann (taught")
    expect(card).to_contain_text("limited to 4.0 N of")
    visitor.page.set_viewport_size(PHONE)
    assert visible(visitor.page.locator(".app")) == [number], "nothing stands beside the form"
    looks_right(visitor, "day-edited", within=".app")


def visible(cards: Locator) -> list[int]:
    """The numbers of the cards that are shown, from 0."""
    return [i for i, one in enumerate(cards.all()) if one.is_visible()]


def simulate(visitor: Visitor) -> None:
    """Run the program on the simulated arm as taught, and faster; the run is drawn, and played."""
    path = visitor.page.locator(".program-path")
    as_taught_s = simulated_s(path, "taught")
    assert simulated_s(path, "optimal") < as_taught_s
    path.get_by_role("slider").press("Home")
    path.get_by_role("button", name="Play").click()
    expect(path.locator("output"), "the slider has its words").to_have_attribute("aria-live", "off")
    path.get_by_role("button", name="Pause").click()
    visitor.picture("day-simulated-desktop")


def simulated_s(path: Locator, speed: str) -> float:
    """Simulate the program, and return how long the run takes [s]."""
    path.locator(".simulated-speed").select_option(speed)
    path.get_by_role("button", name="Simulate", exact=True).click()
    expect(path.locator(".simulated")).to_contain_text("cell as taught: 1 level surface, nothing else")
    run = path.get_by_role("button", name="Simulated run")
    expect(run).to_have_attribute("aria-pressed", "true")
    return float(path.get_by_role("slider").get_attribute("max") or 0.0)


def export(visitor: Visitor) -> dict[str, object]:
    """Return the program as the page exports it, without the number that each start of a service has."""
    with visitor.page.expect_download() as download:
        visitor.page.get_by_role("link", name="JSON").click()
    exported = json.loads(Path(download.value.path()).read_text("utf-8"))
    assert isinstance(exported, dict)
    assert exported.pop("epoch") > 0
    return exported


def pressing_of(taught: Snapshot) -> int:
    return next(i for i, one in enumerate(taught.program.apps) if one.kind == "apply_force")


def check_signals(page: Page, sent: Recording, count: int) -> None:
    """Within a second every sample that the bridge sent is drawn, and nothing else; likewise at the whole."""
    page.locator(".plots").press("0")
    settled(page)
    drawn_as_sent(page, sent, 0.0, float(sent.t[count - 1]), every=False)
    start, end = shown_range(page)
    for _ in range(math.ceil(math.log2((end - start) / SHORT_S))):  # each halves what is shown
        page.get_by_role("button", name="Zoom in").click()
    settled(page)
    start, end = shown_range(page)
    assert end - start < SHORT_S
    drawn_as_sent(page, sent, start, end, every=True)


def shown_range(page: Page) -> tuple[float, float]:
    """From and to where the plots show signals [s]."""
    start, end = (page.locator(".plots").get_attribute(f"data-{one}") for one in ("from", "to"))
    return float(start or "nan"), float(end or "nan")


def drawn_as_sent(page: Page, sent: Recording, start: float, end: float, *, every: bool) -> None:
    """Compare what is drawn from `start` to `end` [s] with the samples of the recording, bit by bit."""
    inside = sent.t[(sent.t >= start) & (sent.t <= end)]
    for panel, signal in (("position", "pos"), ("force", "force")):
        found = page.evaluate(DRAWN, [panel, start, end])
        for k, (off, points) in enumerate(zip(found["off"], found["points"], strict=True)):
            samples = dict(zip(sent.t.tolist(), (sent.signals[signal][:, k] - off).tolist(), strict=True))
            assert len(points) >= LEAST_SHOWN
            assert all(samples[t] == value for t, value in points), f"{panel} {AXES[k]}"
            if every:
                assert [t for t, _ in points] == inside.tolist(), f"{panel} {AXES[k]}"


def restart(stage: Stage, bridge: StandbyBridge, page: Page) -> None:
    """Everything dies at once, and is started again."""
    page.goto("about:blank")  # a page that loses its dashboard reports that as an error
    for process in (stage.dashboard, bridge, stage.service):
        process.kill()
    stage.service.start()
    stage.dashboard.start()
    bridge.start()


def find(stage: Stage, page: Page) -> None:
    """The day after: search the list, which is not cut off, for words of its description, and open it."""
    page.goto(f"{stage.dashboard.url}/sessions")
    page.locator("table.sessions tbody tr").first.wait_for()
    for size in (DESK, TABLET, UPRIGHT):
        page.set_viewport_size(size)
        assert page.locator(".scroll").evaluate("(list) => list.scrollWidth - list.clientWidth") == 0
    page.set_viewport_size(DESK)
    page.locator(".words").fill("table ann")
    rows = page.locator("tbody tr")
    expect(rows).to_have_count(1)
    expect(rows).to_contain_text("yes")
    rows.get_by_role("link", name=NAMED.task).click()
    expect(page.locator(".app").first).to_be_visible()


def check_results(caesura: Caesura, session: str, before: Snapshot) -> None:
    """What was taught, named, corrected and edited is there as it was."""
    after = caesura.snapshot("cell-1", session)
    assert after.status.description == NAMED
    assert after.status.samples == before.status.samples > 0
    assert after.segments.segments == before.segments.segments
    assert after.program.apps == before.program.apps
    assert [(one.author, type(one.action)) for one in after.program.corrections] == [("Ann", Insert)]
    assert [(one.author, one.state) for one in after.program.edits] == [("Ann", "applied")]


@pytest.mark.timeout(300)  # a day has 27 s of steps, each of which waits for the one before
def test_a_demonstration_from_its_start_to_the_day_after(
    stage: Stage, bridge: StandbyBridge, visitor: Visitor
):
    page = visitor.page
    visitor.watch_hosts()
    page.goto(f"{stage.dashboard.url}/station/cell-1")
    session = teach(stage, visitor)
    correct(visitor)
    with stage.reader() as caesura:
        number = pressing_of(caesura.snapshot("cell-1", session))
        edit(visitor, number)
        simulate(visitor)
        exported = export(visitor)
        before = caesura.snapshot("cell-1", session)
    assert visitor.errors == []

    restart(stage, bridge, page)
    find(stage, page)
    with stage.reader() as caesura:
        check_results(caesura, session, before)
    expect(page.locator(".corrections li")).to_contain_text("inserted a changepoint at ")
    expect(page.locator(".app").nth(number).locator("h3")).to_contain_text("Press the pump")
    check_signals(page, patient(), before.status.samples)
    looks_right(visitor, "day-next-day")
    assert export(visitor) == exported
    assert visitor.hosts == {"127.0.0.1"}
    assert visitor.errors == []
