"""The dashboard as an operator has it: real processes, a real browser, a demonstration that goes on."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Browser, Page, expect

from caesura_protocol.formats.read import load_recording
from dashboard.browser import (
    DESK,
    LOOK_MS,
    PATIENCE_MS,
    PHONE,
    TABLET,
    THEMES,
    UPRIGHT,
    Visitor,
    needs_chromium,
    settled,
)
from dashboard.stage import KINDS, Dashboard, Stage, patient, staged
from harness.demonstrations import guided
from harness.processes import eventually, running

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
PAGES = {
    "stations": ("/", "cell-1"),
    "station": ("/station/cell-1", "move to contact"),
    "sessions": ("/sessions", "done-1"),
    "replay": ("/sessions/cell-2/done-1", "move to contact"),
    "system": ("/system", "caesura-1"),
    "recordings": ("/recordings", "Drop a recording here"),
    "compare": ("/compare?first=cell-2/done-1&second=cell-3/done-2", "correspond, of which"),
    "absent": ("/sessions/cell-2/nosuch", "There is no session nosuch at station cell-2."),
    "unknown": ("/station/cell-99", "it has no session. Stations: cell-1"),
}
PICK_AND_PLACE = Path(__file__).parents[2] / "data" / "pick_and_place.npz"
SMALL_TABLET = {"width": 768, "height": 1024}
TYPE = {"15px", "21px"}  # of text, and of titles
MEGABYTE = 1_000_000
# What a pointer can press or type into, and is shown; each gets a number.
NUMBERED = """() => {
  const all = [...document.querySelectorAll("a[href], button, input, select, textarea, summary, [tabindex]")];
  const shown = all.filter((one) => one.checkVisibility({ visibilityProperty: true })
    && !one.disabled && one.tabIndex >= 0);
  shown.forEach((one, number) => { one.dataset.number = number; });
  return shown.map((one) => one.outerHTML.slice(0, 100));
}"""
# The number of what has the focus, and whether a person sees that it has.
FOCUSED = """() => {
  const one = document.activeElement, look = getComputedStyle(one);
  return [one.dataset.number ?? null, look.outlineStyle !== "none" && parseFloat(look.outlineWidth) > 0];
}"""


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """Station cell-1 is being taught; at cell-2 and cell-3 a demonstration is over."""
    with staged(tmp_path_factory.mktemp("stage")) as stage:
        stage.teach("cell-2", guided(), session="done-1", pace="4")
        stage.teach("cell-3", guided(1), session="done-2", pace="fast")
        stage.teach("cell-1", patient())
        stage.wait("cell-2")
        stage.wait("cell-3")
        yield stage


@pytest.fixture
def visitor(opened: Visitor) -> Visitor:
    opened.begin_again(TABLET)
    return opened


@pytest.fixture
def newcomer(browser: Browser) -> Iterator[Visitor]:
    """With an empty cache, and a page that may be closed."""
    visitor = Visitor(browser)
    yield visitor
    visitor.close()


def goto(stage: Stage, visitor: Visitor, path: str) -> Page:
    visitor.page.goto(stage.dashboard.url + path)
    return visitor.page


@pytest.mark.parametrize("name", PAGES)
def test_every_page_has_a_purpose_and_is_accessible(stage: Stage, visitor: Visitor, name: str):
    path, words = PAGES[name]
    visitor.watch_hosts()
    page = goto(stage, visitor, path)
    expect(page.get_by_text(words).first).to_be_visible()
    for visitor.theme, rules in THEMES.items():
        page.emulate_media(color_scheme=visitor.theme)
        visitor.picture(name)
        assert visitor.barriers(*rules) == []
    assert visitor.hosts == {"127.0.0.1"}, "something is fetched from outside"
    assert visitor.received_bytes() < MEGABYTE
    visitor.theme = "light"
    page.emulate_media(color_scheme=visitor.theme)
    tab_reaches_everything_and_shows_where_it_is(page)
    sizes = visitor.type_sizes()
    assert set(sizes) <= TYPE, sizes
    for size, where in ((SMALL_TABLET, "upright"), (PHONE, "phone")):
        page.set_viewport_size(size)
        expect(page.get_by_text(words).first).to_be_visible()
        eventually(lambda: visitor.sideways_px() == 0)
        visitor.picture(f"{name}-{where}")
    assert visitor.errors == []


def test_a_barrier_is_found_in_the_part_that_is_looked_at(visitor: Visitor):
    pale = "<p style='color: #ccc; background: #fff'>pale</p>"
    unlike = "<button aria-label='Duplicate app 1'>Copy</button>"
    visitor.page.set_content(
        f"<main><div class='new'><button></button>{pale}{unlike}</div><div class='old'>A</div></main>"
    )
    found = visitor.barriers(within=".new")
    assert {one.partition(":")[0] for one in found} == {
        "button-name",
        "color-contrast",
        "label-content-name-mismatch",
    }
    assert [one.partition(":")[0] for one in visitor.barriers("color-contrast", within=".new")] == [
        "color-contrast"
    ]
    assert visitor.barriers(within=".old") == []
    with pytest.raises(AssertionError, match=r"nothing is \.none"):
        visitor.barriers(within=".none")


def tab_reaches_everything_and_shows_where_it_is(page: Page) -> None:
    everything = page.evaluate(NUMBERED)
    assert everything
    reached, unseen = set[int](), set[str]()
    for _ in range(2 * len(everything)):  # a card that came meanwhile has no number
        page.keyboard.press("Tab")
        number, is_seen = page.evaluate(FOCUSED)
        if number is not None:
            reached.add(int(number))
            unseen |= set() if is_seen else {everything[int(number)]}
        if len(reached) == len(everything):
            break
    assert [one for number, one in enumerate(everything) if number not in reached] == []
    assert unseen == set()


def test_stations_are_reported_at_a_glance(stage: Stage, visitor: Visitor):
    page = goto(stage, visitor, "/")
    taught, over = (page.locator("li.card", has_text=name) for name in ("cell-1", "cell-2"))
    expect(taught.locator(".badge")).to_have_text("teaching")
    expect(taught).to_contain_text("just now")
    expect(over.locator(".badge")).to_have_text("ended")


def test_segments_appear_while_they_are_taught_and_run_lengths_when_they_are_asked_for(
    stage: Stage, visitor: Visitor
):
    page = goto(stage, visitor, "/station/cell-1")
    page.get_by_text("Segments as a table").click()
    rows = page.locator("details.table tbody tr")
    for kind in KINDS:
        expect(rows.filter(has_text=re.compile(rf"{kind}.*final")).first).to_be_visible()
    expect(page.locator(".app").first).to_contain_text("move to contact")
    button = page.get_by_role("button", name="run lengths")
    button.click()
    expect(button).to_have_attribute("aria-pressed", "true")
    expect(page.locator("canvas.lengths")).to_be_visible()
    visitor.picture("run-lengths")
    assert visitor.errors == []


def test_what_is_live_is_drawn_sample_by_sample_on_an_axis_that_stands_still(stage: Stage, visitor: Visitor):
    taught = patient(seed=3)
    stage.teach("cell-7", taught)
    page = goto(stage, visitor, "/station/cell-7")
    shown, plots = page.locator(".scrub output"), page.locator(".plots")
    for least_s in (1.5, 3.0, 4.5):
        page.wait_for_function(
            f"(shown) => parseFloat(shown.innerText) > {least_s}",
            arg=shown.element_handle(),
            polling=LOOK_MS,
        )
        assert [plots.get_attribute(f"data-{name}") for name in ("from", "to")] == ["0", "30"]
    points = page.evaluate(
        """() => {
          const { state, plots } = document.querySelector(".plots").plots;
          const [times, ...columns] = plots.get("position").plot.data;
          const points = columns.map((values) => [...times].map((t, i) => [t, values[i]]));
          return [state.origin, points.map((column) => column.filter(([, value]) => value !== undefined))];
        }"""
    )
    for k, (origin, column) in enumerate(zip(*points, strict=True)):
        samples = dict(zip(taught.t, taught.signals["pos"][:, k] - origin, strict=True))
        assert len(column) > 100
        assert all(samples.get(t) == value for t, value in column)
    stage.kill("cell-7")


def test_who_comes_back_to_the_list_finds_what_was_searched(stage: Stage, visitor: Visitor):
    """The search was empty again after each session that was looked at."""
    page = goto(stage, visitor, "/sessions")
    page.locator(".words").fill("done-1")
    page.get_by_role("button", name="length").click()
    page.get_by_role("link", name="done-1").click()
    expect(page.locator("h1")).to_have_text("cell-2 · done-1")
    page.go_back()
    expect(page.locator(".words")).to_have_value("done-1")
    expect(page.locator("tbody tr")).to_have_count(1)
    expect(page.locator("th.is-length")).to_have_attribute("aria-sort", "ascending")
    page.get_by_role("link", name="Sessions", exact=True).click()
    expect(page.locator(".words"), "a new look has no filter").to_have_value("")


def test_a_session_that_is_over_can_be_gone_through(stage: Stage, visitor: Visitor):
    page = goto(stage, visitor, "/sessions")
    page.get_by_role("link", name="done-1").click()
    expect(page.locator("h1")).to_have_text("cell-2 · done-1")
    expect(page.locator(".state-line")).to_contain_text(
        "wrench: a sensor that the guiding hand does not touch"
    )
    slider = page.get_by_role("slider", name="Show until")
    expect(slider).to_have_attribute("max", re.compile(r"^5\."))
    slider.fill("1.5")
    expect(page.locator(".selection")).to_contain_text("motion")
    expect(page.locator(".selection")).to_contain_text("in phase free")
    slider.fill("2.6")
    expect(page.locator(".selection")).to_contain_text("contact")
    expect(page.locator(".selection")).to_contain_text("in phase contact")
    slider.fill(slider.get_attribute("max"))
    visitor.picture("phases")
    visitor.picture("scrubbed")
    slider.fill(slider.get_attribute("max"))  # the samples, loaded by now, may end after the results
    page.get_by_role("button", name="Play", exact=True).first.click()
    expect(page.locator(".selection")).to_contain_text("motion")
    page.get_by_role("button", name="Pause").click()


def test_a_name_is_the_title_of_a_session_and_its_id_stands_beside_it(stage: Stage, visitor: Visitor):
    page = goto(stage, visitor, "/sessions/cell-3/done-2")
    title, task = page.locator("h1"), page.locator(".name-task")
    page.locator(".description summary").click()
    for name, shown in (
        ("</title> & wipe", "cell-3 · </title> & wipe · done-2"),
        ("", "cell-3 · done-2"),
    ):
        task.fill(name)
        task.blur()
        expect(title).to_have_text(shown)
        expect(title.locator("small")).to_have_text(" · done-2" if name else "")
        expect(page).to_have_title(f"{shown} · Caesura")
        visitor.picture("named")
        expect(page.locator(".saved")).to_contain_text("Saved.")
        page.reload()
        expect(title).to_have_text(shown)
        expect(page).to_have_title(f"{shown} · Caesura")
        page.locator(".description summary").click()
    assert visitor.errors == []


PLOTS_TOP = "() => document.querySelector('.plots').getBoundingClientRect().top + scrollY"


REFUSED = "Not done: the changepoint at 3.42 s was set by Bob, and correction 14 refers to it. " * 3


@pytest.mark.parametrize("size", [DESK, UPRIGHT, PHONE], ids=["desk", "tablet", "phone"])
def test_no_message_moves_the_plots(stage: Stage, visitor: Visitor, size):
    visitor.page.set_viewport_size(size)
    page = goto(stage, visitor, "/sessions/cell-3/done-2")
    settled(page)
    plots, message = page.locator(".plots"), page.locator(".at-time .message")
    top = page.evaluate(PLOTS_TOP)
    expect(page.locator(".app").first, "its segments were sent before its program").to_be_visible()
    for key in ("Home", "PageDown"):
        plots.press(key)
    expect(page.locator(".selection")).to_contain_text("; changepoint at")
    assert page.evaluate(PLOTS_TOP) == top
    plots.press("Control+y")
    expect(message).to_have_text("There is nothing to redo.")
    assert page.evaluate(PLOTS_TOP) == top
    page.evaluate("(words) => document.querySelector('.plots').plots.state.answered(words, true)", REFUSED)
    close = page.get_by_role("button", name="Close the message")
    expect(close, "several lines lie upon the plots").to_be_visible()
    visitor.picture(f"message-{size['width']}")
    assert visitor.barriers("color-contrast", "target-size", within=".at-time") == []
    assert page.evaluate(PLOTS_TOP) == top
    close.press("Enter")
    expect(page.get_by_role("button", name="Show the whole message")).to_be_focused()
    assert page.evaluate(PLOTS_TOP) == top
    page.locator(".description summary").click()
    top = page.evaluate(PLOTS_TOP)
    page.locator(".description .yes").click()
    expect(page.locator(".saved")).to_contain_text("Saved.")
    assert page.evaluate(PLOTS_TOP) == top
    page.locator(".saved .take-back").click()
    expect(page.locator(".description .yes")).to_have_attribute("aria-pressed", "false")


def test_at_a_desk_plots_are_high_and_the_program_stands_beside_them(stage: Stage, visitor: Visitor):
    """Buttons of the path were a quarter higher than others."""
    visitor.page.set_viewport_size(DESK)
    page = goto(stage, visitor, "/sessions/cell-2/done-1")
    expect(page.locator(".app").first).to_be_visible()
    drawn = page.locator(".panels .u-over")
    expect(drawn.nth(1)).to_be_attached()
    assert min(drawn.evaluate_all("(all) => all.map((one) => one.clientHeight)")) >= 160
    plots, program = (page.locator(name).first.bounding_box() for name in (".panels", ".program-column"))
    assert plots
    assert program
    assert program["x"] >= plots["x"] + plots["width"]
    assert program["y"] < plots["y"] + 160
    page.locator(".path-tools").wait_for()
    buttons = page.locator(".path-tools button, .scrub button")
    assert len(set(buttons.evaluate_all("(all) => all.map((one) => one.offsetHeight)"))) == 1


def test_a_session_is_exported_as_a_dataset_from_its_page_and_from_the_list(stage: Stage, visitor: Visitor):
    for path in ("/sessions/cell-2/done-1", "/sessions"):
        page = goto(stage, visitor, path)
        if path == "/sessions":
            page.locator(".by-station").select_option("cell-2")
        link = page.locator("a.dataset")
        expect(link).to_contain_text(re.compile("LeRobot dataset$|of this session"))
        answer = visitor.page.request.get(f"{stage.dashboard.url}{link.get_attribute('href')}")
        assert (answer.status, answer.body()[:2]) == (200, b"PK"), answer.text()
        assert 'filename="cell-2.done-1-lerobot.zip"' in answer.headers["content-disposition"]
    refused = visitor.page.request.get(f"{stage.dashboard.url}/datasets?session=cell-2/none")
    assert (refused.status, refused.text()) == (
        409,
        "no dataset was written: no session cell-2/none is known",
    )


def test_the_gripper_of_a_station_is_stated_once(stage: Stage, visitor: Visitor):
    """A page that was loaded again exported for no gripper."""
    taught = load_recording(PICK_AND_PLACE)
    signals = {name: values for name, values in taught.signals.items() if name not in {"q", "tau"}}
    carried = replace(taught, signals=signals)
    stage.teach("cell-8", carried, "--robot", "ur5e", session="carried", pace="fast")
    stage.wait("cell-8")
    page = goto(stage, visitor, "/sessions/cell-8/carried")
    page.locator("select.gripper").select_option("robotiq_2f_85")
    page.reload()
    expect(page.locator("select.gripper")).to_have_value("robotiq_2f_85")
    expect(page.locator(".exports a").first).to_have_attribute("href", re.compile(r"gripper=robotiq_2f_85$"))


def test_no_table_of_the_system_is_cut_off_on_an_upright_tablet(stage: Stage, visitor: Visitor):
    """Its last columns were reached by scrolling sideways only."""
    page = goto(stage, visitor, "/system")
    page.set_viewport_size(UPRIGHT)
    page.locator(".scroll").first.wait_for()
    hidden_px = "(all) => all.map(({ scrollWidth, clientWidth }) => scrollWidth - clientWidth)"
    eventually(lambda: set(page.locator(".scroll").evaluate_all(hidden_px)) == {0})


def test_what_was_chosen_of_light_and_dark_is_kept(stage: Stage, visitor: Visitor):
    page = goto(stage, visitor, "/system")
    page.get_by_role("button", name="Light or dark").click()
    expect(page.locator("html")).to_have_attribute("data-theme", "dark")
    goto(stage, visitor, "/")
    expect(page.locator("html")).to_have_attribute("data-theme", "dark")


def test_a_station_that_hangs_is_stale_and_says_why(stage: Stage, visitor: Visitor):
    stage.teach("cell-9", patient())
    page = goto(stage, visitor, "/")
    card = page.locator("li.card", has_text="cell-9")
    expect(card.locator(".badge")).to_have_text("teaching")
    stage.freeze("cell-9")
    expect(card.locator(".badge")).to_have_text("stale")
    expect(card).to_contain_text(re.compile("no sample for|its bridge is gone"))
    visitor.picture("stale")
    goto(stage, visitor, "/station/cell-9")
    expect(page.get_by_role("alert")).to_contain_text("Stale")
    stage.kill("cell-9")
    expect(page.get_by_role("alert")).to_contain_text("its bridge is gone")
    assert visitor.barriers() == []


def test_an_unknown_page_is_not_found(stage: Stage, visitor: Visitor):
    page = visitor.page
    answer = page.goto(f"{stage.dashboard.url}/station/NOT..A..NAME")
    assert answer is not None
    assert answer.status == 404
    expect(page.locator("h1")).to_have_text("Page not found")
    assert visitor.barriers() == []
    page.goto(f"{stage.dashboard.url}/stations")
    expect(page.get_by_text("There is no page /stations.")).to_be_visible()
    page.goto(f"{stage.dashboard.url}/station/Cell 1")
    expect(page.get_by_text("station is not a valid name: 'Cell 1'; expected 1 to 64")).to_be_visible()
    page.get_by_role("link", name="Go to the stations").click()
    expect(page.locator("h1")).to_have_text("Stations")
    assert page.request.get(f"{stage.dashboard.url}/assets/none.js").json() == {"detail": "Not Found"}


def test_a_session_that_does_not_exist_is_stated_and_appears_once_it_is_taught(
    stage: Stage, visitor: Visitor
):
    """The page had a legend, help on keys and an empty program."""
    page, absent = visitor.page, visitor.page.locator(".absent-session")
    page.goto(f"{stage.dashboard.url}/sessions/cell-2/soon")
    expect(absent).to_contain_text("There is no session soon at station cell-2.")
    for part in (".legend", ".help", ".program", ".state-line", ".at-time"):
        expect(page.locator(part).locator("visible=true"), part).to_have_count(0)
    absent.get_by_role("link", name="done-1").click()
    expect(page.locator(".app").first).to_be_visible()
    expect(absent).to_be_hidden()
    page.go_back()
    absent.get_by_role("link", name="Go to the list of sessions").click()
    expect(page.locator("h1")).to_have_text("Sessions")
    page.goto(f"{stage.dashboard.url}/sessions/cell-2/soon")
    expect(absent).to_be_visible()
    stage.teach("cell-2", guided(), session="soon", pace="fast")
    expect(page.locator(".app").first).to_be_visible()
    expect(absent).to_be_hidden()
    settled(page)
    stage.wait("cell-2")


def test_an_export_that_is_refused_leads_back(stage: Stage, visitor: Visitor):
    page = visitor.page
    answer = page.goto(f"{stage.dashboard.url}/programs/cell-2/done-1/pascal")
    assert answer is not None
    assert answer.status == 404
    expect(page.locator("h1")).to_have_text("Not exported")
    expect(page.get_by_text("no program cell-2/done-1 in format 'pascal'; formats: ")).to_be_visible()
    assert visitor.barriers() == []
    page.get_by_role("link", name="Go back").click()
    expect(page.locator(".app").first).to_be_visible()


def test_a_page_of_another_name_is_refused(stage: Stage, visitor: Visitor):
    """As DNS that is bent would have it: the browser asks this machine by a stranger's name."""
    page = visitor.page
    answer = page.request.get(stage.dashboard.url, headers={"host": "evil.example"})
    assert answer.status == 403


def logged_in(page: Page, password: str) -> bool:
    page.get_by_label("Password").fill(password)
    page.get_by_role("button", name="Log in").click()
    page.wait_for_load_state()
    return not page.get_by_label("Password").is_visible()


def test_with_a_password_nothing_is_shown_before_it(stage: Stage, newcomer: Visitor, tmp_path: Path):
    file = tmp_path / "password"
    file.write_text("correct horse\n")
    options = ("--password-file", str(file), "--read-only")
    with running(Dashboard(stage.service.endpoint, *options)) as locked:
        page = newcomer.page
        page.goto(f"{locked.url}/station/cell-2")
        expect(page.locator("h1")).to_have_text("Caesura")
        page.get_by_label("Password").fill("wrong horse")
        page.get_by_role("button", name="Log in").click()
        expect(page.get_by_role("alert")).to_have_text("That is not the password.")
        assert newcomer.barriers() == []
        eventually(lambda: logged_in(page, "correct horse"))  # a wrong one delays its address by a second
        expect(page.locator(".app").first).to_be_visible()
        expect(page.get_by_text("Corrections are off")).to_be_visible()
        answer = page.request.put(f"{locked.url}/uploads/u-1/a.csv", data="t,px,py,pz")
        why = "This dashboard only reads: playing a recording needs an operator's credentials."
        assert (answer.status, answer.text()) == (403, why)
        page.close()
        assert locked.end() == 0
