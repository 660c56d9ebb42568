"""The part of program editing that needs no browser: what is offered, what a check finds, what is refused."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from caesura_clients.dashboard import program_edits
from caesura_clients.dashboard.correction_requests import EditRefused
from caesura_clients.dashboard.edit_conflicts import EditConflict
from caesura_clients.dashboard.program_edits import CHECKED, ProgramDesk, parse
from caesura_clients.dashboard.program_timeline import Timeline
from caesura_clients.program_editing import in_words, names_of, outcome_words, reference
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    Ack,
    App,
    AppChange,
    ChangeApp,
    DeleteApp,
    InsertApp,
    MoveApp,
    Program,
    ProgramAction,
    ProgramEdit,
    Undo,
)
from caesura_protocol.programs import document
from caesura_protocol.programs.app_time_shifts import edited_times
from caesura_protocol.programs.export_formats import WRITERS
from caesura_protocol.robots import grippers
from harness.programs import pick_and_place, press


def program(*apps: App, **changes: Any) -> Program:
    fields = {"station": "cell-1", "session": "s1", "instance": "test-1", "epoch": 1, "version": 4, "t": 12.0}
    return Program(**({"complete": True} | fields | changes), apps=apps)


def test_an_app_offers_the_fields_that_it_has_and_the_places_it_can_go_to():
    cards = Timeline().of(program(*press()))["apps"]
    assert [sorted(card["values"]) for card in cards] == [["target"], ["force_n", "target"], ["target"]]
    assert cards[1]["values"]["force_n"] == 10.0
    assert [card["earlier"] is None for card in cards] == [True, False, False]
    assert cards[1]["earlier"] == {"after": None}
    assert cards[1]["later"]["after"] == cards[2]["reference"]
    assert cards[2]["later"] is None


def test_marks_name_the_author_and_the_taught_value():
    marks = (
        AppChange(field="force_n", author="Ann", edit=1, inferred=10.0),
        AppChange(field="target", author="Bo", edit=2, inferred=(0.1, 0.2, 0.3)),
        AppChange(field="place", author="Bo", edit=3),
    )
    card = Timeline().of(program(press()[1].model_copy(update={"changes": marks})))["apps"][0]
    assert card["changes"] == [
        "force by Ann (taught 10 N)",
        "target by Bo (taught 100, 200, 300 mm)",
        "place in the program by Bo",
    ]


def edit(number: int, action: ProgramAction) -> ProgramEdit:
    return ProgramEdit(number=number, author="Ann", at=0.0, action=action, state="applied")


def test_edits_call_apps_by_the_names_that_their_cards_have():
    first, second, third = press()
    edits = (
        edit(1, ChangeApp(app=reference(second), name="press the seal")),
        edit(2, MoveApp(app=reference(third), after=reference(second))),
        edit(3, ChangeApp(app=reference(third), name="back")),
        edit(4, DeleteApp(app=reference(third))),
        edit(5, InsertApp(after=reference(first), kind="cartesian_motion", name="detour")),
    )
    named = second.model_copy(update={"name": "press the seal"})
    held = program(first, named, edits=edits, edit_revision=5)
    listed = [words for _, words, *_ in Timeline().of(held)["edits"]]
    then = f"at {third.t0:.1f} s"
    assert listed == [
        "app 2 (press the seal): name set",
        f"'back' {then} moved after app 2 (press the seal)",
        f"'back' {then}: name set",
        f"'back' {then} deleted",
        "'detour' inserted after app 1 (move to contact)",
    ]
    ack = Ack(session="s1", next_seq=0, state="closed", program_edit=edits[3])
    words = outcome_words(Undo(), ack, names=names_of(held))
    assert words == f"undone: 'back' {then} deleted (edit 4 by Ann)"


def test_an_app_that_an_edit_added_is_named_like_every_other():
    """It was named 'detour' of edit 5, and nothing else on the page names an app by an edit."""
    first, second, _ = press()
    added = first.model_copy(update={"added": 5, "name": "detour"})
    wanted = ChangeApp(app=reference(added), note="slowly")
    held = program(first, added, second)
    assert in_words(wanted, names=names_of(held)) == "app 2 (detour): note set"
    assert in_words(wanted, names=names_of(program(first))) == "'move to contact' that edit 5 added: note set"


@pytest.mark.parametrize(
    ("apps", "robot", "offered"),
    [
        (pick_and_place(), "ur5e", True),
        (pick_and_place(), None, True),
        (pick_and_place(), "arm-of-a-package", True),
        (pick_and_place(), "panda", False),  # its own hand
        (press(), "ur5e", False),  # grasps nothing
    ],
)
def test_a_gripper_is_asked_for_where_something_is_gripped_and_none_is_known(apps, robot, offered):
    found = Timeline().of(program(*apps, robot=robot))["grippers"]
    assert bool(found) == offered
    assert all(name in grippers() and title for name, title in found)


def test_an_export_states_the_gripper_that_was_chosen():
    pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")
    from caesura_clients.dashboard.server import _exported  # noqa: PLC0415

    update = SimpleNamespace(program=program(*pick_and_place(), robot="ur5e"), phases=())
    world = SimpleNamespace(update=lambda station, session: update)
    site = SimpleNamespace(gateway=SimpleNamespace(world=world))
    refused = _exported(site, "cell-1", "s1", "urscript", None)
    assert (refused.status_code, b"no gripper is stated" in refused.body) == (409, True)
    assert b"--" not in refused.body, "a page has no options"
    written = _exported(site, "cell-1", "s1", "urscript", "robotiq_2f_85")
    assert (written.status_code, b"rq_" in written.body or b"socket" in written.body) == (200, True)
    unknown = _exported(site, "cell-1", "s1", "urscript", "claw")
    assert (unknown.status_code, b"gripper 'claw' is not known" in unknown.body) == (409, True)


def test_findings_stand_at_their_app_once_the_program_is_complete():
    without_grasp = [one for one in pick_and_place() if one.kind != "grasp"]
    shown = Timeline().of(program(*without_grasp))
    reasons = [[reason for _, reason in card["findings"]] for card in shown["apps"]]
    nothing = "carries, but nothing was grasped: an app 'grasp' must come before it"
    assert reasons[1][0].startswith(nothing), "the card states which app it is"
    taught = Timeline().of(program(*without_grasp, complete=False))
    assert not any(card["findings"] for card in taught["apps"])


def test_a_program_is_offered_in_the_formats_of_its_robot():
    def offered(robot: str | None) -> list[str]:
        return [title for title, _ in Timeline().of(program(*press(), robot=robot))["exports"]]

    assert offered("panda") == ["JSON", "franky script", "behaviour tree"]
    assert offered("ur5e") == ["JSON", "URScript", "behaviour tree"]
    assert offered(None) == offered("unheard-of") == [writer.title for writer in WRITERS.values()]


def test_a_finding_advises_what_can_be_done_on_a_page():
    """It advised options of the command line, and to edit a file that a page does not have."""
    apps = [one.model_copy(update={"orientation": None, "load_kg": None}) for one in pick_and_place()]
    shown = Timeline().of(program(*apps))
    said = [reason for _, reason in shown["findings"]]
    said += [reason for app in shown["apps"] for _, reason in app["findings"]]
    assert any("its current one. To have it, play the recording again with" in one for one in said)
    assert any("0 kg are assumed: export JSON, and enter load_kg in that file" in one for one in said)
    assert not any("--" in one for one in said), said


def test_what_a_browser_sends_is_checked():
    with pytest.raises(EditRefused, match=r"^Not done: action.*[^.]\.$"):
        parse({"session": "s1", "revision": 0, "author": "Ann", "action": {"do": "explode"}})


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"gripper_width": -0.05}, "the gripper width is -50 mm, expected at least 0 mm"),
        ({"speed": 9.0}, "the speed is 900 %, expected at most 200 %"),
    ],
)
def test_a_number_beyond_its_limit_is_refused_in_the_unit_of_the_page(values, words):
    """A width that was typed in mm was refused in metres."""
    app = {"kind": "grasp", "t0": 0.0, "tn": 1.0}
    with pytest.raises(EditRefused) as refused:
        parse(
            {"session": "s1", "revision": 0, "author": "Ann", "action": {"do": "change", "app": app} | values}
        )
    assert str(refused.value) == f"Not done: {words}."


def test_a_refusal_of_the_service_is_said_in_words(monkeypatch):
    def refuses(*_: object) -> None:
        raise ProtocolError("conflict", "another operator has edited the program meanwhile", value=0, limit=1)

    monkeypatch.setattr("caesura_clients.dashboard.program_edits.send", refuses)
    undo = {"session": "s1", "revision": 0, "author": "Ann", "action": {"do": "undo"}}
    with pytest.raises(EditRefused, match="another operator changed this meanwhile"):
        ProgramDesk(None).carry_out("cell-1", undo)  # type: ignore[arg-type]


class Overtaken:
    """A service whose program another operator has just edited: the page has not heard of it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, now: Program) -> None:
        self.now, self.made = now, list[Any]()
        monkeypatch.setattr(program_edits, "send", self._send)
        monkeypatch.setattr(program_edits, "snapshot", lambda *_: SimpleNamespace(program=now))

    def _send(self, _transport: object, _station: str, command: Any) -> Ack:
        if command.revision != self.now.edit_revision:
            limit = self.now.edit_revision
            raise ProtocolError("conflict", "edited meanwhile", value=command.revision, limit=limit)
        self.made.append(command)
        return Ack(session="s1", next_seq=0, state="open")


def saved(app: App, seen: dict[str, Any], **values: Any) -> dict[str, Any]:
    action = {"do": "change", "app": reference(app).model_dump(), **values}
    return {"session": "s1", "revision": 0, "author": "Ann", "action": action, "seen": seen}


def by_bob(app: App, field: str, **values: Any) -> App:
    return app.model_copy(update={"changes": (AppChange(field=field, author="Bob", edit=1),), **values})


def test_an_edit_that_was_overtaken_by_one_of_another_field_counts_beside_it(monkeypatch: pytest.MonkeyPatch):
    (taught, *_) = press()
    x, y, z = taught.target or (0.0, 0.0, 0.0)
    moved = by_bob(taught, "target", target=(x, y, z + 0.01))
    service = Overtaken(monkeypatch, program(moved, edit_revision=1))
    request = saved(taught, {"target": [round(1000 * x, 1), None, None]}, target=[x + 0.02, y, z])
    ProgramDesk(None).carry_out("cell-1", request, program=program(taught))  # type: ignore[arg-type]
    (made,) = service.made
    assert made.revision == 1
    assert made.action.target == pytest.approx((x + 0.02, y, z + 0.01)), "a coordinate is a field of its own"


def test_an_edit_that_was_overtaken_by_one_of_the_same_field_is_refused_with_both_values(
    monkeypatch: pytest.MonkeyPatch,
):
    taught = press()[1]
    pressed = by_bob(taught, "force_n", force=(0.0, 0.0, -6.0))
    service = Overtaken(monkeypatch, program(pressed, edit_revision=1))
    request = saved(taught, {"force_n": 10.0}, force_n=4.0)
    with pytest.raises(
        EditConflict, match="Bob has set the force to 6 N meanwhile; you set it to 4 N"
    ) as asked:
        ProgramDesk(None).carry_out("cell-1", request, program=program(taught))  # type: ignore[arg-type]
    assert asked.value.found == {"force_n": 6.0}
    assert service.made == []
    anyway = saved(taught, asked.value.found, force_n=4.0)
    ProgramDesk(None).carry_out("cell-1", anyway)  # type: ignore[arg-type]
    assert [one.action.force_n for one in service.made] == [4.0]


def test_a_name_that_something_else_has_too_is_stated_with_what_has_it(monkeypatch: pytest.MonkeyPatch):
    first, second, *_ = press()
    x, y, z = first.target or (0.0, 0.0, 0.0)
    other = second.model_copy(
        update={"name": "press", "target_name": "tray", "target": (x, y, z + 0.12), "t0": first.t0 + 9.0}
    )
    mine, another = (
        program(first, other),
        program(first).model_copy(update={"session": "s0", "name": "polish"}),
    )
    Overtaken(monkeypatch, mine)
    desk = ProgramDesk(None)  # type: ignore[arg-type]

    def said(**values: Any) -> str:
        request = {**saved(first, {}, **values), "seen": None}
        return desk.carry_out("cell-1", request, program=mine, others=[another])

    assert "name 'press' is also that of app 2: choose another to distinguish them." in said(name="press")
    assert "'tray' is also that of app 2, 120 mm away: choose" in said(target_name="tray")
    assert "also" not in said(target_name="tray", target=[x, y, z + 0.12]), "it is the same place"
    assert "also" not in said(name="polish")
    name = {"session": "s1", "revision": 0, "author": "Ann", "action": {"do": "name", "name": "polish"}}
    words = "The program name 'polish' is also that of the program of cell-1/s0: choose another"
    assert words in desk.carry_out("cell-1", name, program=mine, others=[another])


@pytest.mark.parametrize("count", [3, CHECKED + 1])
def test_a_change_of_a_program_lays_its_times_out_once(count: int, monkeypatch: pytest.MonkeyPatch):
    laid_out: list[int] = []

    def counted(*given: Any) -> Any:
        laid_out.append(len(given[0]))
        return edited_times(*given)

    for module in (document, program_edits):
        monkeypatch.setattr(module, "edited_times", counted)
    slow = press()[0].model_copy(update={"speed": 0.5})
    shown = Timeline().of(program(slow, *press() * (count // 3), *press()[1:]))
    assert laid_out == [count // 3 * 3 + 3]
    assert shown["path"]
