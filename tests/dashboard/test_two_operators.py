"""Two operators at one form: what both have typed into is asked for, what one of them has typed counts."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Locator, expect

from caesura_clients import Caesura
from caesura_clients.program_editing import edit_program, reference
from caesura_protocol.messages import (
    App,
    ChangeApp,
    DeleteApp,
    Description,
    NameProgram,
    Program,
    ProgramAction,
    Undo,
)
from dashboard.browser import DESK, PATIENCE_MS, Visitor, looks_right, needs_chromium
from dashboard.operator import Operator
from dashboard.stage import Stage
from harness.demonstrations import guided

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)


class Beside:
    """Ann at the page of a session that is over; Bob edits it from elsewhere."""

    def __init__(self, visitor: Visitor, caesura: Caesura, station: str) -> None:
        self.visitor, self.page, self._caesura, self._station = visitor, visitor.page, caesura, station

    @property
    def program(self) -> Program:
        return self._caesura.snapshot(self._station, "over").program

    @property
    def app(self) -> App:
        return self.program.apps[-1]

    @property
    def stated(self) -> Description:
        return self._caesura.snapshot(self._station, "over").status.description

    def bob_sets(self, **values: object) -> None:
        change = ChangeApp.model_validate({"app": reference(self.app), **values})
        edit_program(self._caesura.transport, self._station, "over", change, author="Bob")
        expect(self.page.locator(".edits summary"), "the page follows").to_have_text(
            f"Edits: {len(self.program.edits)}"
        )

    def bob_does(self, action: ProgramAction) -> None:
        edit_program(self._caesura.transport, self._station, "over", action, author="Bob")

    def bob_removes(self, t: float) -> None:
        self._caesura.remove(self._station, "over", t, author="Bob")

    def bob_names(self, name: str) -> None:
        named = NameProgram(name=name)
        edit_program(self._caesura.transport, self._station, "over", named, author="Bob")
        expect(self.page.locator(".edits summary"), "the page follows").to_have_text(
            f"Edits: {len(self.program.edits)}"
        )

    def bob_states(self, **values: object) -> None:
        self._caesura.describe(self._station, "over", author="Bob", **values)
        line = self.page.locator(".description summary")
        for value in values.values():
            expect(line, "the page follows").to_contain_text(str(value))

    def bob_states_deleted(self, deleted: bool) -> None:
        self._caesura.describe(self._station, "over", author="Bob", deleted=deleted)

    def carol_notes(self, note: str) -> None:
        self._caesura.describe(self._station, "over", author="Carol", note=note)
        expect(self.page.locator(".description summary"), "the page follows").to_contain_text(note)

    def open_form(self) -> Locator:
        card = self.page.locator(".app").last
        card.locator(".app-edit summary").press("Enter")
        expect(card.locator(".save")).to_be_visible()
        return card

    def open_description(self) -> Locator:
        form = self.page.locator(".description")
        form.locator("summary").press("Enter")
        expect(form.locator(".name-task")).to_be_visible()
        return form


@pytest.fixture
def beside(stage: Stage, opened: Visitor, request: pytest.FixtureRequest) -> Iterator[Beside]:
    """Of a station that no other test has; its name is that of the test."""
    station = request.node.originalname.removeprefix("test_").replace("_", "-")[:30].strip("-")
    stage.teach(station, guided(), session="over", pace="fast")
    stage.wait(station)
    opened.begin_again(DESK)
    opened.is_called("Ann", stage.dashboard.url)
    with stage.reader() as caesura:
        opened.page.goto(f"{stage.dashboard.url}/sessions/{station}/over")
        expect(opened.page.locator(".app").first).to_be_visible()
        yield Beside(opened, caesura, station)
    assert opened.errors == []


def test_a_speed_that_another_operator_has_set_meanwhile_is_asked_for(beside: Beside):
    card = beside.open_form()
    card.locator(".app-speed").fill("50")
    card.locator(".app-note").fill("slowly")
    beside.bob_sets(speed=0.4)
    expect(card.locator("dl")).to_contain_text("40 %")
    card.locator(".save").press("Enter")
    conflict = card.locator(".conflict")
    words = "Not saved: Bob has set the speed to 40 % meanwhile; you set it to 50 %."
    expect(conflict.locator("p")).to_have_text(words)
    expect(conflict.locator(".save-anyway"), "it comes into sight").to_be_in_viewport(ratio=1)
    assert (beside.app.speed, beside.app.note) == (0.4, None)
    expect(card.locator(".app-speed"), "what was typed is kept").to_have_value("50")
    looks_right(beside.visitor, "program-conflict", within=".app-edit[open]")
    card.locator(".save").press("Enter")
    expect(conflict.locator(".save-anyway"), "it was answered").to_be_enabled()
    expect(conflict.locator("p"), "Save asks again").to_have_text(words)
    assert beside.app.speed == 0.4
    conflict.locator(".save-anyway").press("Enter")
    expect(conflict).to_have_count(0)
    expect(card.locator("dl")).to_contain_text("50 %")
    assert (beside.app.speed, beside.app.note) == (0.5, "slowly")
    card.locator(".app-speed").fill("60")
    card.locator(".save").press("Enter")
    expect(card.locator("dl"), "one's own edit is no conflict").to_contain_text("60 %")


def test_fields_of_two_operators_both_count(beside: Beside):
    x, y, z = beside.app.target or (0.0, 0.0, 0.0)
    card = beside.open_form()
    card.get_by_label("Target x in mm").fill(f"{1000 * x + 10:.1f}")
    card.locator(".app-name").fill("Go home")
    beside.bob_sets(speed=0.4, target=(x, y, z + 0.025))
    expect(card.get_by_label("Target z in mm")).to_have_value(f"{1000 * z + 25:.1f}".removesuffix(".0"))
    card.locator(".save").press("Enter")
    expect(beside.page.locator(".program-said")).to_contain_text("target set")
    made = beside.app
    assert (made.name, made.speed) == ("Go home", 0.4)
    assert made.target == pytest.approx((x + 0.01, y, z + 0.025), abs=1e-4)


def test_what_another_operator_has_set_can_be_taken(beside: Beside):
    card = beside.open_form()
    card.locator(".app-name").fill("Go home")
    beside.bob_sets(name="Retreat")
    card.locator(".save").press("Enter")
    conflict = card.locator(".conflict")
    said = "Not saved: Bob has set the name to 'Retreat' meanwhile; you set it to 'Go home'."
    expect(conflict.locator("p")).to_have_text(said)
    conflict.locator(".take-new").press("Enter")
    expect(card.locator(".app-name")).to_have_value("Retreat")
    expect(conflict).to_have_count(0)
    expect(card.locator(".save"), "nothing is left to be saved").to_be_disabled()


def test_what_is_typed_into_the_form_of_an_app_that_goes_comes_back_with_it(beside: Beside):
    card = beside.open_form()
    card.locator(".app-speed").fill("50")
    beside.bob_does(DeleteApp(app=reference(beside.app)))
    said = "is no longer shown. What was typed into its form is not saved, and comes back with it."
    expect(beside.page.locator(".program-said.failed")).to_contain_text(said)
    expect(beside.page.locator(".app-speed")).to_have_count(0)
    beside.bob_does(Undo())
    expect(card.locator(".app-speed"), "what was typed is kept").to_have_value("50")
    expect(beside.page.locator(".program-said"), "it stated that the app was not shown").to_contain_text(
        "is shown again. What was typed into its form is not saved yet."
    )
    card.locator(".save").press("Enter")
    expect(card.locator("dl")).to_contain_text("50 %")
    assert beside.app.speed == 0.5


def test_the_name_of_a_program_is_not_overwritten(beside: Beside):
    name = beside.page.locator(".program-name")
    name.press_sequentially("Wipe")
    beside.bob_names("Polish")
    expect(name, "what is being typed stays").to_have_value("Wipe")
    name.press("Enter")
    conflict = beside.page.locator(".program-tools .conflict")
    said = "Not saved: Bob has set the name to 'Polish' meanwhile; you set it to 'Wipe'."
    expect(conflict.locator("p")).to_have_text(said)
    assert beside.program.name == "Polish"
    conflict.locator(".save-anyway").press("Enter")
    expect(beside.page.locator(".program-said")).to_have_text("Program named 'Wipe'.")
    assert beside.program.name == "Wipe"


def test_a_task_that_another_operator_has_named_meanwhile_is_asked_for(beside: Beside):
    form = beside.open_description()
    task = form.locator(".name-task")
    task.press_sequentially("wipe")
    beside.bob_states(task="polish")
    beside.carol_notes("mind the cable")
    task.press("Enter")
    conflict = form.locator(".conflict")
    said = "Not saved: Bob has set the task to 'polish' meanwhile; you set it to 'wipe'."
    expect(conflict.locator("p")).to_have_text(said)
    assert beside.stated.task == "polish"
    expect(task, "what was typed is kept").to_have_value("wipe")
    looks_right(beside.visitor, "description-conflict", within=".description")
    conflict.locator(".save-anyway").press("Enter")
    expect(form.locator(".saved")).to_contain_text("Saved.")
    assert beside.stated.task == "wipe"


def test_tags_and_a_note_of_two_operators_both_count_and_undo_takes_one_back(beside: Beside):
    form = beside.open_description()
    form.locator(".name-note").press_sequentially("mind the cable")
    beside.bob_states(task="polish")
    beside.bob_states(operator="Bob")
    form.locator(".name-note").press("Enter")
    expect(form.locator(".saved")).to_contain_text("Saved.")
    assert (beside.stated.note, beside.stated.task) == ("mind the cable", "polish")
    beside.bob_states(task="wipe")
    form.locator(".take-back").press("Enter")
    expect(form.locator("summary")).not_to_contain_text("mind the cable")
    expect(form.locator(".saved")).to_contain_text("Saved.")
    assert (beside.stated.note, beside.stated.task) == (None, "wipe"), "undo leaves what others have set"


def test_undo_waits_for_the_change_that_is_being_saved(beside: Beside, stage: Stage):
    """It took the change before that one back."""
    form = beside.open_description()
    note, tags, undo = (form.locator(one) for one in (".name-note", ".name-tags", ".take-back"))
    note.fill("calm hand")
    note.press("Enter")
    expect(form.locator(".saved")).to_contain_text("Saved.")
    stage.service.freeze()
    try:
        tags.fill("left")
        tags.press("Enter")
        expect(form.locator(".saved")).to_contain_text("Saving …")
        undo.dispatch_event("click")
    finally:
        stage.service.thaw()
    expect(form.locator(".saved")).to_contain_text("Saved.")
    assert (beside.stated.note, beside.stated.tags) == ("calm hand", ("left",))
    undo.press("Enter")
    expect(form.locator("summary")).not_to_contain_text("left")
    expect(form.locator(".saved")).to_contain_text("Saved.")
    assert (beside.stated.note, beside.stated.tags) == ("calm hand", ())


def test_a_session_that_another_operator_restores_is_not_called_deleted(beside: Beside):
    form = beside.open_description()
    delete, saved = form.locator(".delete"), form.locator(".saved")
    delete.press("Enter")
    expect(saved).to_contain_text("Deleted: lists leave it out. Undo")
    beside.bob_states_deleted(False)
    expect(delete).to_have_text("Delete")
    expect(saved).to_have_text("")
    beside.bob_states_deleted(True)
    expect(saved).to_contain_text("Deleted: lists leave it out.")
    delete.press("Enter")
    expect(saved).to_contain_text("Restored. Undo")
    beside.bob_states_deleted(True)
    expect(saved).to_contain_text("Deleted: lists leave it out; its samples stay")
    expect(form.locator(".take-back"), "it is deleted already").to_have_count(0)


TIMES = "() => document.querySelector('.plots').plots.state.changepoints.map(([t]) => t)"


def test_a_changepoint_that_goes_while_it_is_dragged_is_named(beside: Beside):
    """The page stated that no changepoint is selected, and how to select one."""
    page, operator = beside.page, Operator.at(beside.page, beside.visitor)
    times = page.evaluate(TIMES)
    t = times[1]
    page.mouse.move(*operator.place(t))
    page.mouse.down()
    page.mouse.move(*operator.place(t + 0.2))
    beside.bob_removes(t)
    page.wait_for_function(f"(count) => ({TIMES})().length < count", arg=len(times))
    page.mouse.move(*operator.place(t + 0.25))
    page.mouse.up()
    operator.is_shown("Not done. The changepoint was moved or removed while you dragged it")
    expect(page.locator(".corrections li")).to_have_count(1)
