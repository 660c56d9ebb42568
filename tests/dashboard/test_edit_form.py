"""The form at an app: its fields, its buttons, and the form of a new app, as an operator uses them."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

import typer
from playwright.sync_api import Browser, Locator, expect
from typer.testing import CliRunner

from caesura_clients import Caesura
from caesura_clients.cli.commands import register
from caesura_clients.dashboard.web_components import WEB
from caesura_clients.program_editing import reference
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App, DuplicateApp, NameProgram, Program
from dashboard.browser import DESK, PATIENCE_MS, Visitor, looks_right, needs_chromium
from dashboard.stage import Stage
from harness.demonstrations import guided

pytestmark = needs_chromium
AGAIN_MS = 500  # as in focus.js: until then a second Enter is meant for what is gone
expect.set_options(timeout=PATIENCE_MS)


class Desk:
    """An operator at the program of a session that is over, and the service beside it."""

    def __init__(self, visitor: Visitor, caesura: Caesura, station: str) -> None:
        self.visitor, self.page, self._caesura, self.station = visitor, visitor.page, caesura, station

    @property
    def program(self) -> Program:
        return self._caesura.snapshot(self.station, "over").program

    def number(self, kind: str) -> int:
        return next(i for i, one in enumerate(self.program.apps) if one.kind == kind)

    def app(self, kind: str) -> App:
        return self.program.apps[self.number(kind)]

    def open_form(self, kind: str) -> Locator:
        expect(self.page.locator(".app"), "an edit is shown").to_have_count(len(self.program.apps))
        card = self.page.locator(".app").nth(self.number(kind))
        form = card.locator(".app-edit")
        if form.get_attribute("open") is None:
            form.locator("summary").press("Enter")
        expect(form.locator(".save")).to_be_visible()
        return card

    def is_said(self, words: str) -> None:
        expect(self.page.locator(".program-said")).to_have_text(words)


@pytest.fixture
def desk(stage: Stage, opened: Visitor, request: pytest.FixtureRequest) -> Iterator[Desk]:
    """Of a station that no other test has; its name is that of the test."""
    station = request.node.originalname.removeprefix("test_").replace("_", "-")[:30].strip("-")
    stage.teach(station, guided(), session="over", pace="fast")
    stage.wait(station)
    opened.begin_again(DESK)
    opened.is_called("Ann", stage.dashboard.url)
    with stage.reader() as caesura:
        opened.page.goto(f"{stage.dashboard.url}/sessions/{station}/over")
        expect(opened.page.locator(".app").first).to_be_visible()
        yield Desk(opened, caesura, station)
    assert opened.errors == []


def test_every_field_of_a_movement_is_set_and_as_taught_takes_all_of_them_away(desk: Desk):
    page, taught = desk.page, desk.app("cartesian_motion")
    card = desk.open_form("cartesian_motion")
    expect(card.locator(".app-name"), "the form comes into sight").to_be_in_viewport(ratio=1)
    page.locator(".apps").evaluate("(apps) => apps.scrollBy(0, 200)")
    expect(card.locator("h3"), "whose form it is stays in sight").to_be_in_viewport(ratio=1)
    page.locator(".apps").evaluate("(apps) => apps.scrollBy(0, -200)")
    x, y, z = taught.target or (0.0, 0.0, 0.0)
    assert card.locator(".as-taught").is_disabled(), "nothing is set yet"
    assert card.locator(".save").is_disabled(), "nothing is typed yet"
    card.locator(".app-name").fill("Go home")
    card.locator(".app-note").fill("mind the cable")
    card.get_by_label("Target z in mm").fill(f"{1000 * z + 25:.1f}")
    card.locator(".app-target_name").fill("above the tray")
    card.locator(".app-speed").fill("50")
    card.locator(".app-tolerance_m").fill("5")
    looks_right(desk.visitor, "edit-form", within=".app-edit[open]")
    card.locator(".app-tolerance_m").press("Enter")
    said = "name set, note set, target set, position name set, speed set, tolerance set."
    expect(page.locator(".program-said")).to_contain_text(said)

    made = desk.app("cartesian_motion")
    assert (made.name, made.note, made.target_name) == ("Go home", "mind the cable", "above the tray")
    assert made.target == (x, y, pytest.approx(z + 0.025, abs=1e-4)), "what was not typed stays"
    assert made.speed == 0.5
    assert made.path is not None
    assert made.path.tolerance_m == pytest.approx(0.005)
    expect(card.locator("dl")).to_contain_text("50 % of the taught one")
    expect(card.locator(".app-said")).to_have_text("mind the cable")
    expect(card.locator(".marks li")).to_have_count(6)

    card.locator(".as-taught").press("Enter")
    expect(card.locator(".marks")).to_have_count(0)
    assert desk.app("cartesian_motion") == taught
    expect(card.locator(".app-speed")).to_have_value("100")
    assert card.locator(".as-taught").is_disabled()


def test_a_field_that_is_cleared_is_as_taught_and_the_others_stay(desk: Desk):
    card = desk.open_form("apply_force")
    card.locator(".app-name").fill("press")
    card.locator(".app-force_n").fill("4")
    card.locator(".save").press("Enter")
    expect(card.locator(".marks li")).to_have_count(2)
    card.locator(".app-name").fill("")
    card.locator(".save").press("Enter")
    expect(card.locator(".marks li")).to_have_count(1)
    expect(card.locator(".marks")).to_contain_text("force by Ann")
    assert (desk.app("apply_force").name, len(desk.program.apps)) == (None, 3)
    force = card.locator(".app-force_n")
    force.fill("")
    force.press("Enter")  # a number was ignored in silence
    expect(card.locator(".marks")).to_have_count(0)
    expect(force).to_have_value(re.compile(r"^1\d"))
    force.fill("")
    force.press("Tab")
    expect(force, "it is as taught already").to_have_value(re.compile(r"^1\d"))
    expect(card.locator(".save")).to_be_disabled()


def test_what_an_app_cannot_have_is_refused_in_the_words_of_the_command_line(desk: Desk, stage: Stage):
    card = desk.open_form("apply_force")
    card.locator(".app-force_n").fill("0.0001")
    card.locator(".save").press("Enter")
    words = "0.0001 N is less than the least of a press, 0.001 N"
    desk.is_said(f"Not done: {words}.")
    assert desk.program.edits == ()
    assert words in typed(desk, stage, "change", str(desk.number("apply_force") + 1), "force=0.0001")
    with stage.reader() as caesura:
        caesura.edit_program(desk.station, "over", NameProgram(name="Press"), author="Bob")
    desk.is_said("Not done. The program has been edited since: look at the current state.")


def typed(desk: Desk, stage: Stage, *words: str) -> str:
    """What the command line says of an edit that it refuses."""
    command = typer.Typer()
    register(command)
    named = ["edit-program", desk.program.station, "over", *words]
    done = CliRunner().invoke(command, [*named, "--author", "Bob", "--connect", stage.service.endpoint])
    assert done.exit_code == 1
    return done.output.replace("\n", " ")


def order(program: Program) -> list[str]:
    return [one.kind for one in program.apps]


def test_an_app_runs_earlier_and_later_and_edits_are_undone_and_made_again(desk: Desk):
    page, taught = desk.page, order(desk.program)
    undo, redo = (page.get_by_role("button", name=f"{what} edit") for what in ("Undo", "Redo"))
    expect(redo).to_be_hidden()
    desk.open_form("apply_force")
    expect(page.get_by_role("button", name="Run app 1 earlier")).to_have_count(0)
    page.get_by_role("button", name="Run app 2 later").press("Enter")
    desk.is_said("App 2 (apply force) moved after app 3 (move).")
    last_first = [taught[0], taught[2], taught[1]]
    assert order(desk.program) == last_first
    expect(page.locator(".app h3")).to_contain_text(["move to contact", "move", "apply force"])
    expect(page.get_by_role("button", name="Run app 3 later")).to_be_disabled()
    expect(page.get_by_role("button", name="Run app 3 later"), "it kept the focus").to_be_focused()

    undo.press("Enter")
    expect(redo).to_be_visible()
    expect(undo).to_be_hidden()
    expect(redo, "what follows has the focus").to_be_focused()
    page.wait_for_timeout(AGAIN_MS)
    assert order(desk.program) == taught
    redo.press("Enter")
    expect(undo).to_be_visible()
    expect(redo).to_be_hidden()
    assert order(desk.program) == last_first
    page.get_by_role("button", name="Run app 3 earlier").press("Enter")
    expect(page.locator(".app h3")).to_contain_text(["move to contact", "apply force", "move"])
    assert order(desk.program) == taught
    expect(page.get_by_role("button", name="Run app 2 earlier"), "its card was moved").to_be_focused()
    page.keyboard.press("Enter")
    expect(page.get_by_role("button", name="Run app 1 earlier")).to_be_disabled()
    assert order(desk.program) == [taught[1], taught[0], taught[2]]
    page.get_by_role("button", name="Delete app 1").press("Enter")
    expect(page.locator(".app")).to_have_count(2)
    expect(page.get_by_label("Edit app 1"), "the app that has taken its place").to_be_focused()


def test_the_focus_is_passed_on_where_nothing_changes_after_its_button_is_hidden(browser: Browser):
    """A browser takes the focus from what is hidden only once it draws the page: the focus was lost."""
    visitor = Visitor(browser)
    page = visitor.page
    page.set_content("<p><button>Undo edit</button> <button>Redo edit</button></p>")
    page.add_script_tag(content=(WEB / "focus.js").read_text("utf-8"), type="module")
    page.get_by_text("Undo edit").press("Shift")
    page.get_by_text("Undo edit").evaluate("(one) => { one.style.display = 'none'; }")
    expect(page.get_by_text("Redo edit")).to_be_focused(timeout=10 * AGAIN_MS)
    visitor.close()


def new_app(card: Locator, kind: str) -> Locator:
    form = card.locator(".new-app")
    form.locator("select").select_option(kind)
    return form


def test_every_kind_of_app_can_be_inserted_with_the_values_that_it_has(desk: Desk):
    form = desk.open_form("move_to_contact").locator(".new-app")
    offered = form.locator("option").evaluate_all("all => all.map((one) => one.value)")
    assert set(offered) == {"", *APP_KINDS}
    for kind, facts in APP_KINDS.items():
        new_app(desk.open_form("move_to_contact"), kind)
        shown = {
            "target": form.get_by_label("New target z in mm").is_visible(),
            "force": form.get_by_label("New force z in N").is_visible(),
            "width": form.locator(".new-gripper_width").is_visible(),
        }
        assert shown == {
            "target": "target" in facts.ports,
            "force": facts.presses,
            "width": "width" in facts.ports,
        }
        assert form.locator(".new-seconds").is_visible() == bool(facts.needs)


def test_a_hold_is_inserted_with_its_name_and_target(desk: Desk):
    x, y, z = desk.app("move_to_contact").target or (0.0, 0.0, 0.0)
    form = new_app(desk.open_form("move_to_contact"), "hold")
    height = form.get_by_label("New target z in mm")
    expect(height, "where nothing is typed the app stays there").to_have_attribute("placeholder", mm(z))
    looks_right(desk.visitor, "new-hold", within=".app-edit[open]")
    form.locator(".new-name").fill("wait for the glue")
    height.fill(f"{1000 * z + 20:.1f}")
    form.locator(".new-seconds").fill("5")
    form.locator(".insert-app").press("Enter")
    desk.is_said("'wait for the glue' inserted after app 1 (move to contact).")
    made = desk.app("hold")
    edit = desk.page.get_by_label(f"Edit app {desk.number('hold') + 1}", exact=True)
    expect(edit, "the new app comes into sight").to_be_focused()
    expect(form.locator("select"), "another press inserts nothing").to_have_value("")
    assert (made.name, made.tn - made.t0) == ("wait for the glue", pytest.approx(5.0))
    assert made.target == (x, y, pytest.approx(z + 0.02, abs=1e-4))
    taught = desk.app("move_to_contact")
    assert made.orientation == taught.orientation
    desk.open_form("move_to_contact")
    new_app(desk.open_form("move_to_contact"), "transport").locator(".insert-app").press("Enter")
    desk.is_said("'transport' inserted after app 1 (move to contact).")
    assert desk.app("transport").target == taught.target


def mm(metres: float) -> str:
    return f"{1000 * metres:.1f}".removesuffix(".0")


def test_an_app_is_inserted_as_the_first_one(desk: Desk):
    taught = desk.program.apps
    form = desk.page.locator(".first-app")
    form.locator("summary").press("Enter")
    form.locator("select").select_option("hold")
    x, y, z = taught[0].target or (0.0, 0.0, 0.0)
    height = form.get_by_label("New target z in mm")
    expect(height, "where nothing is typed the app is where the next one is").to_have_attribute(
        "placeholder", mm(z)
    )
    looks_right(desk.visitor, "first-app", within=".first-app")
    height.fill(f"{1000 * z + 20:.1f}")
    desk.page.get_by_role("button", name="Insert as the first app").press("Enter")
    desk.is_said("'hold' inserted to the beginning.")
    expect(desk.page.get_by_label("Edit app 1"), "as of any other new app").to_be_focused()
    made, *behind = desk.program.apps
    assert (made.kind, made.target) == ("hold", (x, y, pytest.approx(z + 0.02, abs=1e-4)))
    assert [one.kind for one in behind] == [one.kind for one in taught]
    expect(desk.page.locator(".app h3").first).to_contain_text("1 · hold")


def test_a_program_without_apps_gets_one(desk: Desk):
    for count in range(len(desk.program.apps), 0, -1):
        expect(desk.page.locator(".app")).to_have_count(count)
        desk.page.locator(".app-edit:not(.first-app) summary").last.press("Enter")
        desk.page.get_by_role("button", name=f"Delete app {count}", exact=True).press("Enter")
    expect(desk.page.locator(".app")).to_have_count(0)
    form = desk.page.locator(".first-app")
    form.locator("summary").press("Enter")
    form.locator("select").select_option("move_to_contact")
    for axis, value in zip("xyz", (400, 0, 300), strict=True):
        form.get_by_label(f"New target {axis} in mm").fill(str(value))
    form.locator(".insert-app").press("Enter")
    expect(desk.page.locator(".app h3")).to_contain_text(["move to contact"])
    (made,) = desk.program.apps
    assert made.target == pytest.approx((0.4, 0.0, 0.3))


def test_a_new_gripper_move_gets_a_width(desk: Desk):
    form = new_app(desk.open_form("move_to_contact"), "gripper_move")
    expect(form.locator(".new-seconds")).to_have_count(0)
    form.locator(".new-gripper_width").fill("40")
    form.locator(".insert-app").press("Enter")
    desk.is_said("'move gripper' inserted after app 1 (move to contact).")
    assert desk.app("gripper_move").gripper_width == pytest.approx(0.04)
    card = desk.open_form("gripper_move")
    expect(card.locator(".app-gripper_width")).to_have_value("40")


def test_a_press_is_inserted_with_force_and_duration_and_refused_as_by_the_command_line(
    desk: Desk, stage: Stage
):
    taught = desk.program.apps
    form = new_app(desk.open_form("cartesian_motion"), "apply_force")
    looks_right(desk.visitor, "new-press", within=".app-edit[open]")
    add, force = form.locator(".insert-app"), form.get_by_label("New force z in N")
    add.press("Enter")
    expect(force, "nothing is sent without a force").to_be_focused()
    force.fill("0.0001")
    force.press("Enter")
    least = "0.0001 N is less than the least of a press, 0.001 N"
    desk.is_said(f"Not done: {least}.")
    assert least in typed(desk, stage, "insert", "3", "apply_force", "force=0,0,0.0001")
    force.fill("-8")
    form.locator(".new-seconds").fill("700")
    add.press("Enter")
    long = "700, expected less than or equal to 600"
    expect(desk.page.locator(".program-said")).to_contain_text(long)
    assert desk.program.apps == taught

    form.get_by_label("New force x in N").fill("1.5")
    form.locator(".new-seconds").fill("3.5")
    add.press("Enter")
    desk.is_said("'apply force' inserted after app 3 (move).")
    *before, made = desk.program.apps
    assert tuple(before) == taught
    assert (made.kind, made.force) == ("apply_force", (1.5, 0.0, -8.0))
    assert made.tn - made.t0 == pytest.approx(3.5)
    assert made.target == taught[-1].target
    expect(desk.page.locator(".app").last.locator("dl")).to_contain_text("(1.5, 0.0, -8.0) N")


def test_every_app_of_a_long_program_is_reached_and_edited_by_the_keys(desk: Desk, stage: Stage):
    """The page listed the newest 100 apps, and edits of earlier ones needed the command line."""
    page, visitor = desk.page, desk.visitor
    page.goto("about:blank")  # the page would draw each of a hundred edits
    with stage.reader() as caesura:
        for _ in range(3, 104):
            last = caesura.snapshot(desk.station, "over").program.apps[-1]
            caesura.edit_program(desk.station, "over", DuplicateApp(app=reference(last)), author="Bob")
    page.go_back()
    parts, listed = page.get_by_role("navigation", name="Apps that are listed"), page.locator(".app h3")
    expect(parts.get_by_role("status")).to_have_text("Apps 5 to 104 of 104")
    looks_right(visitor, "parts", within=".parts")

    parts.get_by_role("spinbutton").fill("2")
    parts.get_by_role("spinbutton").press("Enter")
    expect(page.get_by_label("Edit app 2", exact=True), "it can be edited at once").to_be_focused()
    page.keyboard.press("Enter")
    card = page.locator(".app").nth(1)
    card.locator(".app-name").fill("Press here")
    card.locator(".app-name").press("Enter")
    expect(listed.nth(1)).to_have_text("2 · Press here")
    assert desk.program.apps[1].name == "Press here"

    parts.get_by_role("button", name="Newest").press("Enter")
    expect(parts.get_by_role("status")).to_have_text("Apps 5 to 104 of 104")
    page.get_by_label("Edit app 5", exact=True).press("Enter")
    page.get_by_role("button", name="Run app 5 earlier").press("Enter")
    earlier = page.get_by_role("button", name="Run app 4 earlier")
    expect(earlier, "what leaves its part stays in sight").to_be_visible()
    assert desk.program.edits[-1].action.do == "move"
    parts.get_by_role("button", name="First").press("Enter")
    expect(listed.first).to_contain_text("1 ·")
    parts.get_by_role("button", name="Later apps").press("Enter")
    expect(listed.last).to_contain_text("104 ·")
    assert page.locator(".program-path summary").inner_text() == "Path in 3D", "the path is whole"
