"""Two sessions side by side: the sentence on their programs, and one range of values for each signal."""

from __future__ import annotations

import doctest
from dataclasses import replace

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Page, expect

from caesura_clients.dashboard.pages import compare
from caesura_clients.dashboard.pages.compare import _tables
from caesura_protocol.messages import App, Program
from clients.examples import example
from dashboard.browser import DESK, LOOK_MS, PATIENCE_MS, Visitor, needs_chromium
from dashboard.stage import Stage
from harness.demonstrations import guided

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
# The ranges of the values in each view, by signal.
RANGES = """() => [...document.querySelectorAll(".plots")].map(({ plots }) => Object.fromEntries(
  [...plots.plots].map(([name, { plot: { scales: { y } } }]) => [name, [y.min, y.max]])))"""
LOADED = """() => [...document.querySelectorAll(".plots")].every(({ plots }) => plots && plots.state.data
  && !plots.state.lacksData() && !plots.state.loading && plots.painters.every(({ frame }) => !frame))"""
# The extents of the forces that each view has.
FORCES = """() => [...document.querySelectorAll(".plots")].map(({ plots: { state } }) => {
  const values = ["fx", "fy", "fz"].flatMap((name, k) => [...state.data.points[name]]
    .filter((_, i) => i % 2).map((value) => value - ((state.tare ?? [])[k] ?? 0)));
  return [Math.min(...values), Math.max(...values)];
})"""


def test_examples_in_docstrings_hold():
    found = doctest.testmod(compare)
    assert found.attempted > 0
    assert found.failed == 0


def program(*kinds: str) -> Program:
    app = example(App)
    apps = [
        app.model_copy(update={"kind": kind, "t0": 2.0 * i, "tn": 2.0 * i + 1})
        for i, kind in enumerate(kinds)
    ]
    return example(Program).model_copy(update={"apps": tuple(apps)})


def test_apps_are_counted_by_program_and_not_by_pair():
    """Programs of 40 and 39 apps were said to differ in 49 of 49 apps."""
    first = program(*["apply_force", "cartesian_motion"] * 15, *["grasp"] * 10)
    second = program(*["apply_force", "cartesian_motion"] * 15, *["hold"] * 9)
    ((table,)) = _tables(first, second)["tables"]
    assert table["words"] == (
        "The first has 40 apps, the second 39. 30 correspond, of which none differ. "
        "10 are only in the first. 9 are only in the second."
    )


def test_an_app_has_its_name_as_at_its_card():
    """A named app was listed by its kind alone."""
    taught = program("grasp")
    unnamed, named = (
        taught.model_copy(update={"apps": (taught.apps[0].model_copy(update={"name": name}),)})
        for name in (None, "Pick the cube")
    )
    ((table,)) = _tables(unnamed, named)["tables"]
    assert [(row["first"], row["second"]) for row in table["rows"]] == [("1 · grasp", "1 · Pick the cube")]


def loaded(page: Page) -> None:
    page.wait_for_function(LOADED, polling=LOOK_MS)


# What a screen reader calls the tools of each side, and the groups of them.
NAMES = """(sides) => sides.map((side) => [...side.querySelectorAll("button, input, summary, [aria-label]")]
  .map((one) => one.ariaLabel ?? one.textContent.trim()))"""
TOPS = "() => [...document.querySelectorAll('.plots')].map((one) => one.getBoundingClientRect().y)"


def test_the_plots_of_both_sides_begin_alike(stage: Stage, opened: Visitor):
    """A long name moved those of its side down, and a time was not beside itself."""
    for station in ("cell-7", "cell-8"):
        stage.teach(station, guided(), session="one", pace="fast")
        stage.wait(station)
    with stage.reader() as caesura:
        caesura.describe("cell-7", "one", author="Ann", task="wipe the table " * 8)
    opened.begin_again(DESK)
    page = opened.page
    page.goto(f"{stage.dashboard.url}/compare?first=cell-7/one&second=cell-8/one")
    expect(page.locator(".pair h2").first).to_contain_text("wipe the table wipe")
    loaded(page)
    first, second = page.evaluate(TOPS)
    assert first == second
    names = page.locator(".session-view").evaluate_all(NAMES)
    assert len(names[0]) > 10
    assert not set(names[0]) & set(names[1]), "a tool states which side it moves"
    assert {name.rpartition(": ")[2] for name in names[0]} == {"cell-7/one"}
    assert opened.barriers() == []
    assert opened.errors == []


def test_both_sides_share_the_range_of_each_signal(stage: Stage, opened: Visitor):
    """A press of 8 N and one of 32 N were drawn equally high."""
    weak = guided()
    strong = replace(weak, signals={**weak.signals, "force": 4.0 * weak.signals["force"]})
    for station, recording in (("cell-5", weak), ("cell-6", strong)):
        stage.teach(station, recording, session="one", pace="fast")
    for station in ("cell-5", "cell-6"):
        stage.wait(station)
    opened.begin_again(DESK)
    page = opened.page
    page.goto(f"{stage.dashboard.url}/compare?first=cell-5/one&second=cell-6/one")
    expect(page.locator(".panel[data-signal=force]")).to_have_count(2)
    loaded(page)
    page.wait_for_function(
        f"() => {{ const [a, b] = ({RANGES})(); return JSON.stringify(a) === JSON.stringify(b); }}",
        polling=LOOK_MS,
    )
    (low, high), (lower, higher) = page.evaluate(FORCES)
    assert higher - lower > 2.0 * (high - low)
    first, _ = page.evaluate(RANGES)
    assert first["force"][0] <= lower < higher <= first["force"][1]
    both = page.locator(".signals")
    both.first.get_by_role("button", name="force").click()
    expect(page.locator(".panel[data-signal=force]")).to_have_count(1)
    both.last.get_by_role("button", name="force").click()
    both.first.get_by_role("button", name="force").click()
    expect(page.locator(".panel[data-signal=force]")).to_have_count(1)
    loaded(page)
    alone = "() => document.querySelector('.plots').plots.plots.get('force').plot.scales.y.max"
    assert page.evaluate(alone) < first["force"][1] / 2, "a range that is not drawn beside it does not count"
    assert opened.errors == []
