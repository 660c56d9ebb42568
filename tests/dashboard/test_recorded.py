"""An hour that was taught before everything was started again: the page draws the samples of its journal."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

import httpx
from playwright.sync_api import Browser, Page, expect

from caesura_protocol.messages import Changepoint
from dashboard.browser import PATIENCE_MS, THEMES, SlowSocket, Visitor, needs_chromium, settled
from dashboard.stage import Stage, staged
from harness.journals import COLUMNS, ended, taught, written
from harness.processes import DEADLINE_S, eventually

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)

HOUR_S = 3600.0
HOLE = (1000.0, 1300.0)  # [s] about: samples that no bridge ever sent
KINDS = ("motion", "contact", "transport", "steady")
DESKTOP, PHONE = {"width": 1440, "height": 900}, {"width": 390, "height": 844}
# Of a panel the times and values that it draws, by column.
DRAWN = """(name) => {
  const [times, ...values] = document.querySelector(".plots").plots.plots.get(name).plot.data;
  return values.map((column) => [...times].map((t, i) => [t, column[i]]).filter(([, v]) => v !== undefined));
}"""
REQUESTS = """() => performance.getEntriesByType("resource").filter((one) => one.name.includes("/samples/"))
  .length"""


@pytest.fixture(scope="module")
def hour() -> np.ndarray:
    whole = taught(HOUR_S)
    return np.vstack([whole[: round(HOLE[0] * 100)], whole[round(HOLE[1] * 100) :]])


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory, hour: np.ndarray) -> Iterator[Stage]:
    folder = tmp_path_factory.mktemp("stage")
    written(folder / "journal", hour, closed=_outcome())
    with staged(folder) as stage:
        yield stage


def _outcome():
    """A segment a minute."""
    last = ended("motion", t=HOUR_S)
    (one,) = last.segments.segments
    minutes = [
        one.model_copy(update={"t0": 60.0 * i, "tn": 60.0 * i + 60.0, "kind": KINDS[i % 4]})
        for i in range(60)
    ]
    points = [Changepoint(t=60.0 * i, probability=0.9, certainty="final") for i in range(1, 60)]
    segments = last.segments.model_copy(update={"segments": tuple(minutes)})
    changepoints = last.changepoints.model_copy(update={"changepoints": tuple(points)})
    return last.model_copy(update={"segments": segments, "changepoints": changepoints})


@pytest.fixture(scope="module")
def opened(stage: Stage, regular: Visitor) -> Iterator[Visitor]:
    regular.begin_again(DESKTOP)
    regular.watch_hosts()
    regular.page.goto(f"{stage.dashboard.url}/sessions/cell-1/s1")
    yield regular
    regular.leave()


@pytest.fixture
def visitor(opened: Visitor) -> Iterator[Visitor]:
    """The page, with the whole hour in sight."""
    settled(opened.page)
    opened.page.locator(".plots").press("0")
    opened.page.evaluate("scrollTo(0, 0)")
    settled(opened.page)
    yield opened
    assert opened.hosts == {"127.0.0.1"}, "something is fetched from outside"
    assert opened.errors == []


def view(page: Page) -> tuple[float, float]:
    found = [page.locator(".plots").get_attribute(f"data-{name}") for name in ("from", "to")]
    return float(found[0] or "nan"), float(found[1] or "nan")


def check(page: Page, hour: np.ndarray, name: str, first: int, off: np.ndarray) -> None:
    """Every point that a panel draws is a sample, less what its title says; extremes are among them."""
    start, end = view(page)
    inside = hour[(hour[:, 0] >= start) & (hour[:, 0] <= end)]
    for k, column in enumerate(page.evaluate(DRAWN, name)):
        samples = dict(zip(hour[:, 0], hour[:, first + k] - off[k], strict=True))
        points = [(t, value) for t, value in column if value is not None]
        assert len(points) > 500
        assert all(samples.get(t) == value for t, value in points)
        if len(inside):
            values = inside[:, first + k] - off[k]
            assert {values.min(), values.max()} <= {value for _, value in points}


def test_samples_are_asked_for_once_and_come_with_the_segments_before_the_program(
    opened: Visitor, browser: Browser
):
    """Samples were fetched and drawn twice: the second time by their names, up to the last one.

    The cards of a long program were made before the page was sent: a fifth of a second of it.
    """
    fresh = Visitor(browser)
    slow = SlowSocket(fresh.page)
    slow.hold("runMethod")
    fresh.page.goto(opened.page.url)
    settled(fresh.page)
    eventually(lambda: slow.has_received("changepoints"))
    assert not slow.has_received("pathBefore"), "the browser has not drawn the segments yet"
    slow.release()
    expect(fresh.page.locator(".app").first).to_be_visible()
    settled(fresh.page)
    assert fresh.page.evaluate(REQUESTS) == 1
    fresh.close()


def test_every_point_that_is_drawn_is_a_sample_of_the_journal(stage: Stage, visitor: Visitor, hour):
    page = visitor.page
    assert view(page) == (0.0, pytest.approx(HOUR_S, abs=0.1))
    tare, origin = np.array([0.5, -1.25, 2.0]), np.array([0.5, -0.25, 0.125])  # of the outcome
    check(page, hour, "force", COLUMNS.index("fx"), tare)
    check(page, hour, "position", COLUMNS.index("px"), origin)
    for visitor.theme in THEMES:
        page.emulate_media(color_scheme=visitor.theme)
        visitor.picture("recorded")
    for _ in range(6):
        page.get_by_role("button", name="Zoom in").click()
    settled(page)
    start, end = view(page)
    assert end - start == pytest.approx(HOUR_S / 64, rel=0.01)
    check(page, hour, "force", COLUMNS.index("fx"), tare)


def test_no_line_leads_across_a_hole(visitor: Visitor):
    for name in ("force", "position", "speed"):
        for column in visitor.page.evaluate(DRAWN, name):
            inside = [value for t, value in column if HOLE[0] <= t < HOLE[1] - 1.0]
            assert inside == [None], "a break, and nothing else"


def test_a_zoom_asks_for_its_range_once(visitor: Visitor):
    """How long the first picture and a zoom take, `tests/bench/samples_cost.py` measures."""
    page = visitor.page
    before = page.evaluate(REQUESTS)
    for _ in range(5):
        page.get_by_role("button", name="Zoom in").click()
        settled(page)
    assert 1 <= page.evaluate(REQUESTS) - before <= 5


def test_wheel_drag_buttons_and_keys_move_what_is_in_sight(visitor: Visitor):
    page, box = visitor.page, visitor.page.locator(".plots").bounding_box()
    assert box is not None
    x, y = box["x"] + 700, box["y"] + 150
    page.mouse.move(x, y)
    page.mouse.wheel(0, -300)
    eventually(lambda: view(page)[1] - view(page)[0] < 0.5 * HOUR_S)
    start, end = view(page)
    at = (700 - 64) / (box["width"] - 2 - 76)
    assert start + at * (end - start) == pytest.approx(at * HOUR_S, abs=0.01 * HOUR_S)

    page.get_by_role("button", name="All").click()
    eventually(lambda: view(page)[1] - view(page)[0] > 0.99 * HOUR_S)
    box = page.locator(".plots").bounding_box()  # the page has scrolled to the button
    assert box is not None
    y = box["y"] + box["height"] - 100
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 50, y)
    page.mouse.move(x + 100, y)
    expect(page.locator(".marked")).to_be_visible()
    page.mouse.up()
    eventually(lambda: view(page)[1] - view(page)[0] < 0.2 * HOUR_S)
    marked = view(page)
    page.locator(".plots").focus()
    for key, moved in ((".", 1), (",", -1)):
        before = view(page)
        page.keyboard.press(key)
        eventually(lambda before=before, moved=moved: moved * (view(page)[0] - before[0]) > 100.0)
    assert view(page) == pytest.approx(marked)
    page.keyboard.press("-")
    eventually(lambda: view(page)[1] - view(page)[0] == pytest.approx(2 * (marked[1] - marked[0])))
    page.keyboard.press("0")
    eventually(lambda: view(page)[1] - view(page)[0] > 0.99 * HOUR_S)


def test_places_are_read_in_the_unit_of_the_program(visitor: Visitor, hour):
    """The program has mm; the plots had m."""
    page = visitor.page
    panel = page.locator("[data-signal=position]")
    expect(panel.locator("strong")).to_have_text("position from the start [mm]")
    box = panel.locator(".u-over").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] * 1830 / HOUR_S, box["y"] + 60)
    value = panel.locator("output").first
    expect(value).to_have_text(re.compile(r"^-?\d+\.\d$"))
    x = hour[:, COLUMNS.index("px")]
    origin = page.evaluate("() => document.querySelector('.plots').plots.state.origin[0]")
    near = 1000.0 * (x[np.abs(hour[:, 0] - 1830.0) < 12.0] - origin)
    assert np.abs(near - float(value.inner_text())).min() < 0.06


def test_signals_are_switched_and_values_read(visitor: Visitor, hour):
    page = visitor.page
    expect(page.locator(".panel[data-signal]")).to_have_count(3)
    page.get_by_role("button", name="changepoints").click()
    page.get_by_role("button", name="load").click()
    page.get_by_role("button", name="position").click()
    expect(page.locator(".panel[data-signal]")).to_have_count(4)
    expect(page.locator("[data-signal=position]")).to_have_count(0)
    box = page.locator("[data-signal=force] .u-over").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] * 1830 / HOUR_S, box["y"] + 60)
    value = page.locator("[data-signal=force] output").nth(2)
    expect(value).to_have_text(re.compile(r"^-?\d+\.\d\d$"))
    near = hour[np.abs(hour[:, 0] - 1830.0) < 12.0, COLUMNS.index("fz")] - 2.0
    assert np.abs(near - float(value.inner_text())).min() < 0.006
    expect(page.locator("[data-signal=load] output")).to_contain_text("0.500 ± 0.063")
    page.mouse.move(box["x"] + box["width"] * 1150 / HOUR_S, box["y"] + 60)
    expect(value).to_have_text("missing")
    visitor.picture("switched")
    page.reload()
    expect(page.locator("[data-signal=changepoints]")).to_be_visible()


def test_values_are_read_at_the_time_that_keys_choose(visitor: Visitor, hour):
    """Only a pointer read them: keys left them empty, or at the time where the pointer had left."""
    page, plots = visitor.page, visitor.page.locator(".plots")
    page.mouse.move(0, 0)
    for key in ("Home", *"+++++++++", *["Shift+ArrowRight"] * 3):
        plots.press(key)
    settled(page)

    def shown_of(t: float) -> str:
        return f"{hour[round(100 * t), COLUMNS.index('fx')] - 0.5:.2f}"  # less its tare

    value = page.locator("[data-signal=force] output").first
    expect(value).to_have_text(shown_of(3.0))
    box = page.locator("[data-signal=force] .u-over").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 4, box["y"] + 60)
    expect(value).not_to_have_text(shown_of(3.0))
    page.mouse.move(0, 0)
    expect(value).to_have_text(shown_of(3.0))
    plots.press("Shift+ArrowRight")
    expect(value).to_have_text(shown_of(4.0))
    for _ in range(4):
        plots.press(".")
    settled(page)
    expect(value, "out of view it is not missing").to_have_text("")
    plots.press("Home")


@pytest.mark.parametrize(
    ("asked", "status", "named"),
    [
        ("cell-1/s1?from=3&to=1&bins=5", 400, "the range ends before it begins"),
        ("cell-1/s1?from=0&to=1&bins=many", 400, "bins is not a count"),
        ("cell-1/s9?from=0&to=1&bins=5", 404, "no samples of session cell-1/s9"),
        ("cell-1/../s1?from=0&to=1&bins=5", 404, ""),
    ],
)
def test_what_cannot_be_shown_is_refused_by_name(stage: Stage, asked, status, named):
    answer = httpx.get(f"{stage.dashboard.url}/samples/{asked}", timeout=DEADLINE_S)
    assert (answer.status_code, named in answer.text) == (status, True)


def test_samples_come_compressed_if_they_are_many(stage: Stage):
    """The page of a demonstration at 1 kHz had 1.2 MB of them."""

    def answer(bins: int, accepted: str) -> httpx.Response:
        asked = f"{stage.dashboard.url}/samples/cell-1/s1?from=0&to=10&bins={bins}"
        return httpx.get(asked, timeout=DEADLINE_S, headers={"accept-encoding": accepted})

    whole, packed, few = answer(4096, "identity"), answer(4096, "gzip"), answer(5, "gzip")
    assert [one.headers.get("content-encoding") for one in (whole, packed, few)] == [None, "gzip", None]
    assert whole.content == packed.content
    assert int(packed.headers["content-length"]) < 0.7 * len(whole.content)


def test_a_phone_shows_it_without_scrolling_sideways(visitor: Visitor):
    page = visitor.page
    page.set_viewport_size(PHONE)
    page.wait_for_function("() => document.querySelector('.panel .uplot').clientWidth < 390")
    settled(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    for visitor.theme, rules in THEMES.items():
        page.emulate_media(color_scheme=visitor.theme)
        visitor.picture("recorded-phone")
        assert visitor.barriers(*rules) == []
