"""The measured path in three dimensions: samples and nothing else, in the colours of their segments."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Page, expect

from caesura_clients.bridge import Bridge
from caesura_protocol.recording import Recording
from clients.bridging import QUICK
from clients.examples import LiveSource
from dashboard.browser import DESK, LOOK_MS, PATIENCE_MS, Visitor, looks_right, needs_chromium, settled
from dashboard.operator import T
from dashboard.stage import Bridges, Dashboard, Stage
from dashboard.test_whole_day import shown_range
from harness.demonstrations import guided
from harness.processes import ServiceProcess, running

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
SENT = guided()
GAP_S = (1.2, 1.8)  # in which nothing is measured
ROUNDED_S = 1e-3  # by which the page rounds the times of segments
PATH = ".program-path canvas"
RUNS = "() => document.querySelector('.program-path canvas').path.runs"
IMPORTED = """async ([points, segments, holes]) => {
  const { placesOf, runsOf } = await import("caesura-dashboard/measured_path.js");
  const flat = Object.fromEntries(Object.entries(points).map(([name, all]) => [name, all.flat()]));
  const places = placesOf(flat);
  return { places, runs: runsOf(places, segments, holes) };
}"""


@pytest.fixture
def visitor(opened: Visitor) -> Iterator[Visitor]:
    opened.begin_again(DESK)
    yield opened
    assert opened.errors == []


def runs_of(page: Page, count: int) -> list[dict[str, Any]]:
    """What is drawn in sight, once the page says that it has so many samples."""
    page.locator(PATH).scroll_into_view_if_needed()
    expect(page.locator(".measured-said")).to_contain_text(f"Measured: {count} samples")
    settled(page)
    return list(page.evaluate(RUNS))


def check_measured(runs: list[dict[str, Any]], sent: Recording) -> None:
    """Every place is a sample, at its own time, to the last bit."""
    samples = dict(zip(sent.t.tolist(), (1000 * sent.signals["pos"]).tolist(), strict=True))
    for run in runs:
        assert all(samples[t] == place for t, *place in run["places"])


def test_every_sample_is_drawn_in_the_colour_of_its_segment(tmp_path: Path, visitor: Visitor):
    sent, journal, page = guided(), tmp_path / "journal", visitor.page
    with running(ServiceProcess(journal)) as service, closing(Bridges(service, tmp_path)) as bridges:
        bridges.teach("cell-1", sent, session="over", pace="fast")
        bridges.wait("cell-1")
    with running(ServiceProcess(journal)) as service, running(Dashboard(service.endpoint)) as dashboard:
        with closing(Bridges(service, tmp_path)) as bridges, bridges.reader() as caesura:
            segments = caesura.snapshot("cell-1", "over").segments.segments
        exact: list[str] = []
        page.on("request", lambda request: exact.append(request.url) if "exact=1" in request.url else None)
        page.goto(f"{dashboard.url}/sessions/cell-1/over")
        settled(page)
        expect(page.locator(PATH)).not_to_be_in_viewport()
        page.wait_for_timeout(1000)
        assert exact == [], "nothing is asked for that is not in sight: a minute at 1 kHz is a megabyte"
        runs = runs_of(page, len(sent.t))
        check_measured(runs, sent)
        assert [run["kind"] for run in runs if run["kind"]] == [one.kind for one in segments]
        for run, one in zip([run for run in runs if run["kind"]], segments, strict=True):
            assert one.t0 - ROUNDED_S <= run["places"][1][0] <= run["places"][-1][0] <= one.tn + ROUNDED_S
        with closing(Bridges(service, tmp_path)) as bridges, bridges.reader() as caesura:
            caesura.relabel("cell-1", "over", t=T, kind="sliding", author="Ann")
        page.wait_for_function(f"() => ({RUNS})().some((run) => run.kind === 'sliding')", polling=LOOK_MS)
        page.locator(".program-path").scroll_into_view_if_needed()
        looks_right(visitor, "measured", within=".program-path")

        page.get_by_role("button", name="Zoom in").press("Enter")
        settled(page)
        start, end = shown_range(page)
        inside = sent.t[(sent.t >= start) & (sent.t <= end)]
        zoomed = runs_of(page, len(inside))
        check_measured(zoomed, sent)
        assert (zoomed[0]["places"][0][0], zoomed[-1]["places"][-1][0]) == (inside[0], inside[-1])

        measured = page.get_by_role("button", name="Measured", exact=True)
        expect(measured).to_have_attribute("aria-pressed", "true")
        measured.press("Enter")
        expect(measured).to_have_attribute("aria-pressed", "false")
        assert page.evaluate(RUNS) == []


class Hand(LiveSource):
    """A robot that sends what it is given."""

    columns = SENT.columns
    wrench_source = SENT.wrench_source
    force_frame = SENT.force_frame
    length_unit = SENT.length_unit


def test_while_a_demonstration_goes_on_the_page_says_that_the_path_comes_at_its_end(
    stage: Stage, visitor: Visitor
):
    with stage.reader() as caesura, Bridge(caesura.transport, "cell-live", Hand(), settings=QUICK) as bridge:
        bridge.wait_open(PATIENCE_MS / 1000)
        rows = SENT.matrix()
        for start in range(0, len(rows), 100):
            bridge.send(rows[start : start + 100])
        visitor.page.goto(f"{stage.dashboard.url}/station/cell-live")
        said = visitor.page.locator(".measured-said")
        visitor.page.locator(PATH).scroll_into_view_if_needed()
        expect(said).to_have_text("The measured path is drawn once the demonstration has ended.")
        bridge.finish()
        check_measured(runs_of(visitor.page, len(SENT.t)), SENT)


def test_no_line_leads_across_missing_samples(stage: Stage, visitor: Visitor):
    whole = guided()
    there = (whole.t <= GAP_S[0]) | (whole.t >= GAP_S[1])
    signals = {name: values[there] for name, values in whole.signals.items()}
    sent = replace(whole, t=whole.t[there], signals=signals)
    stage.teach("cell-gap", sent, session="over", pace="fast")
    stage.wait("cell-gap")
    visitor.page.goto(f"{stage.dashboard.url}/sessions/cell-gap/over")
    runs = runs_of(visitor.page, len(sent.t))
    check_measured(runs, sent)
    steps = [b[0] - a[0] for run in runs for a, b in pairwise(run["places"])]
    assert max(steps) < 0.1
    assert {place[0] for run in runs for place in run["places"]} == set(sent.t.tolist())
    leaves_out_what_not_all_columns_have(visitor.page)


def leaves_out_what_not_all_columns_have(page: Page) -> None:
    """Of made-up points, by the functions of the page."""
    points = {
        "px": [[0.0, 1.0], [1.0, 2.0], [3.0, 3.0]],
        "py": [[0.0, 1.0], [2.0, 2.0], [3.0, 3.0]],
        "pz": [[0.0, 1.0], [1.0, 2.0], [2.0, 2.0], [3.0, 3.0]],
    }
    segments = [[0.0, 1.5, "motion"], [1.5, 2.5, "steady"]]
    found = page.evaluate(IMPORTED, [points, segments, []])
    assert found["places"] == [[0.0, 1000.0, 1000.0, 1000.0], [3.0, 3000.0, 3000.0, 3000.0]]
    assert [run["kind"] for run in found["runs"]] == ["motion", None]
    apart = page.evaluate(IMPORTED, [points, segments, [[1.0, 2.0, "source"]]])
    assert [len(run["places"]) for run in apart["runs"]] == [1, 1]


def test_the_measured_path_comes_once_the_service_answers_again(stage: Stage, visitor: Visitor):
    """The page stated until it was loaded again that no service answers."""
    page, exact = visitor.page, "**/samples/**exact=1**"
    stage.teach("cell-again", SENT, session="over", pace="fast")
    stage.wait("cell-again")
    page.route(exact, lambda route: route.fulfill(status=503, body="no service answers"))
    page.goto(f"{stage.dashboard.url}/sessions/cell-again/over")
    said = page.locator(".measured-said")
    page.locator(PATH).scroll_into_view_if_needed()
    expect(said).to_have_text("The measured path cannot be shown: no service answers")
    page.unroute(exact)
    check_measured(runs_of(page, len(SENT.t)), SENT)
    visitor.errors.clear()  # what could not be loaded meanwhile


def test_a_session_longer_than_a_minute_asks_to_zoom_in(stage: Stage, visitor: Visitor):
    taught = guided()
    count = round(70 / 0.02)
    rest = {name: np.repeat(values[-1:], count, axis=0) for name, values in taught.signals.items()}
    t = np.concatenate([taught.t, taught.t[-1] + 0.02 * (1 + np.arange(count))])
    signals = {name: np.concatenate([values, rest[name]]) for name, values in taught.signals.items()}
    stage.teach("cell-long", replace(taught, t=t, signals=signals), session="over", pace="fast")
    stage.wait("cell-long")
    page = visitor.page
    page.goto(f"{stage.dashboard.url}/sessions/cell-long/over")
    said = page.locator(".measured-said")
    page.locator(PATH).scroll_into_view_if_needed()
    expect(said).to_have_text("The measured path is drawn where the plots show at most 64 s: zoom in.")
    page.get_by_role("button", name="Zoom in").press("Enter")
    expect(said).to_contain_text("Measured: ")
