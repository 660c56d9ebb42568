"""A station's page gets what is new in a session, however old it is, and draws the same as all of it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Browser, Page

from caesura_clients.dashboard.station_summary import reached
from dashboard.browser import LOOK_MS, Visitor, needs_chromium
from dashboard.stage import Stage
from dashboard.subscriber import Subscriber
from harness.demonstrations import taught

pytestmark = needs_chromium

AGE_S, REST_S = 45.0, 240.0  # the view of 30 s is full; for so long it goes on
ANSWERS = 12  # of samples that the page asks for
NEW_APPS = 3
SHARE = 0.25  # of what the page got first: a later part is shorter
SIZES = """() => performance.getEntriesByType("resource")
  .filter((one) => one.name.includes("/samples/")).map((one) => one.decodedBodySize)"""
COUNT = f"() => ({SIZES})().length"
COVERED_MS = 60_000  # a dashboard that missed the beginning answers by itself once the view has passed it
IS_COVERED = """() => {
  const { data } = document.querySelector(".plots").plots.state;
  return data !== null && data.instance === "dashboard";
}"""
# The rows of segments and of phases that end after the next one begins.
OVERLAPPING = """() => {
  const { segments, phases } = document.querySelector(".plots").plots.state;
  return [segments, phases].flatMap((rows) => rows.slice(1).filter(([t0], i) => rows[i][1] > t0));
}"""
# Of each column the points of complete bins: those drawn, and those of one answer for the whole range.
DRAWN_AND_WHOLE = """async () => {
  const state = document.querySelector(".plots").plots.state, held = state.data;
  const { load } = await import("caesura-dashboard/signals.js");
  const columns = held.columns, bins = 1000;
  const found = await load(state.station, state.session, { from: held.from, to: held.to, bins, columns });
  const until = Math.min(held.last, held.to) - 2 * held.bin_s, from = held.from + held.bin_s;
  const rows = ({ points }, name) => {
    const flat = [...points[name]], rows = [];
    for (let i = 0; i < flat.length; i += 2) rows.push([flat[i], flat[i + 1]]);
    return rows.filter(([t]) => t > from && t < until);
  };
  return columns.map((name) => [name, rows(held, name), rows(found, name)]);
}"""


@pytest.fixture
def page(stage: Stage, browser: Browser) -> Iterator[Page]:
    """The page of a station at which a session of this age goes on."""
    with (
        stage.reader() as reader,
        Subscriber(reader, "cell-1").listening() as received,
        stage.aged("cell-1", taught(7, AGE_S + REST_S), AGE_S),
    ):
        received.until(lambda: received.update is not None and reached(received.now) >= AGE_S)
        visitor = Visitor(browser)
        yield visitor.page
        visitor.close()


def test_a_page_gets_what_is_new_and_draws_as_if_it_had_got_everything(stage: Stage, page: Page):
    frames: list[str] = []
    page.on("websocket", lambda socket: socket.on("framereceived", lambda frame: frames.append(str(frame))))
    page.goto(f"{stage.dashboard.url}/station/cell-1")
    page.locator(".app").first.wait_for()
    page.wait_for_function(IS_COVERED, timeout=COVERED_MS, polling=LOOK_MS)
    answers = page.evaluate(COUNT) + ANSWERS
    page.wait_for_function(f"() => ({COUNT})() >= {answers}", polling=LOOK_MS)

    assert page.evaluate(OVERLAPPING) == [], "only the last segment and the last phase go on"

    first, *_, newest = sorted_apps(page)
    page.wait_for_function(
        "(newest) => Number(document.querySelector('.app:last-child h3').innerText.split(' ')[0]) > newest",
        arg=newest + NEW_APPS,
        polling=LOOK_MS,
    )
    assert sorted_apps(page)[0] == first, "apps that stayed are still there"

    sizes = page.evaluate(SIZES)
    assert sorted(sizes[-ANSWERS // 2 :])[ANSWERS // 4] < SHARE * max(sizes), (
        "of samples the page got all again"
    )
    programs = [len(frame) for frame in frames if "drawing" in frame]  # a field of each app
    assert len(programs) > 2
    assert max(programs[1:]) < SHARE * programs[0], "of the program the page got all again"

    for name, drawn, whole in page.evaluate(DRAWN_AND_WHOLE):
        assert len(drawn) > 100, name
        assert drawn == whole, name

    page.evaluate("(t) => document.querySelector('.plots').plots.state.show(t - 6, t - 4)", AGE_S)
    has_older = f"() => document.querySelector('.plots').plots.state.data.to < {AGE_S}"
    page.wait_for_function(has_older, polling=LOOK_MS)


def sorted_apps(page: Page) -> list[int]:
    """The numbers of the apps that are shown, as they stand there."""
    return [int(words.split(" ")[0]) for words in page.locator(".app h3").all_inner_texts()]
