"""Two versions of one program: made by the service, compared value by value, and there after a restart."""

from __future__ import annotations

import re
from contextlib import closing
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

import typer
from playwright.sync_api import expect
from typer.testing import CliRunner

from caesura_clients import Caesura, query
from caesura_clients.cli.commands import register
from caesura_clients.dashboard.correction_requests import EditRefused
from caesura_clients.dashboard.program_differences import compared_versions, differing
from caesura_clients.program_editing import edit_program, reference
from caesura_protocol.app_kinds import app_title
from caesura_protocol.messages import (
    App,
    AppChange,
    ChangeApp,
    DeleteApp,
    DuplicateApp,
    MoveApp,
    NameProgram,
    ProgramAction,
    Redo,
    Undo,
)
from caesura_protocol.transport.memory import MemoryNetwork
from clients.answering import Answering
from clients.examples import snapshot
from dashboard.browser import DESK, PATIENCE_MS, Visitor, looks_right, needs_chromium
from dashboard.stage import Bridges, Dashboard
from harness.demonstrations import guided
from harness.processes import ServiceProcess, running
from harness.programs import pick_and_place

expect.set_options(timeout=PATIENCE_MS)
OVER = ("cell-1", "over")


# As the dashboard answers where the service did not answer in time.
FAILED = """() => runMethod(+document.querySelector(".program").closest("[id^=c]").id.slice(1), "compared",
  [{ said: "Not compared: the service is busy.", failed: true, rows: [] }])"""


def moved(app: App) -> App:
    return app.model_copy(update={"changes": (AppChange(field="place", author="Ann", edit=1),)})


def place(*metres: float) -> str:
    return f"({', '.join(f'{1000 * value:.1f}' for value in metres)}) mm"


def test_values_that_differ_stand_at_their_app_before_and_after():
    first, *rest = pick_and_place()
    x, y, z = first.target or ()
    slower = first.model_copy(update={"speed": 0.5, "name": "above", "target": (x, y, z + 0.01)})
    (row,) = differing([first, *rest], [slower, *rest])
    assert row["app"] == "1 · above"
    changes = {what: (before, after) for what, before, after in row["changes"]}
    assert changes["name"] == ("none", "'above'")
    assert changes["speed"] == ("100 %", "50 %")
    assert changes["target"] == (place(x, y, z), place(x, y, z + 0.01))
    assert differing([first, *rest], [first, *rest]) == []


def test_an_app_that_is_added_left_out_or_moved_is_named_and_those_that_made_room_are_not():
    apps = list(pick_and_place())
    copy = apps[0].model_copy(update={"added": 1})
    (added,) = differing(apps, [apps[0], copy, *apps[1:]])
    assert (added["app"].split(" ")[0], added["was"], added["changes"]) == ("2", "added", [])
    (gone,) = differing(apps, apps[1:])
    assert (gone["app"].split(" ")[0], gone["was"]) == ("1", "left out")
    (place,) = differing(apps, [*apps[1:], moved(apps[0])])
    assert place["changes"] == [["place", "1", str(len(apps))]]
    added = apps[0].model_copy(update={"added": 2})
    _, place = differing(apps, [apps[0], added, moved(apps[2]), apps[1], *apps[3:]])
    title = app_title(added.kind)
    assert place["changes"] == [["place", "", f"3, after {title}"]], "not from 3 to 3"


@pytest.mark.parametrize("request_", [{}, {"from": 0}, {"from": -1, "to": 0}, {"from": "0", "to": 1}])
def test_what_names_no_versions_is_never_asked(request_):
    with pytest.raises(EditRefused, match="choose two versions"):
        compared_versions(MemoryNetwork().transport(), *OVER, request_)


def test_a_service_without_versions_is_named_and_a_session_that_is_not_there_too():
    network = MemoryNetwork()
    transport = network.transport()
    with Answering(network.transport()) as service:
        whole = snapshot(1, "motion", station="cell-1", session="over", state="closed")
        program = whole.program.model_copy(update={"edit_revision": 7})
        service.snapshots = [whole.model_copy(update={"program": program})]
        assert compared_versions(transport, *OVER, {"from": 7, "to": 7})["said"] == "No app differs."
        with pytest.raises(EditRefused, match="the service of cell-1 has no versions of a program"):
            compared_versions(transport, *OVER, {"from": 0, "to": 7})
        with pytest.raises(EditRefused, match="has no session gone"):
            compared_versions(transport, "cell-1", "gone", {"from": 0, "to": 7})


def edit(caesura: Caesura, action: ProgramAction) -> None:
    edit_program(caesura.transport, *OVER, action, author="Ann")


@needs_chromium
def test_an_operator_compares_versions_by_keyboard_and_after_a_restart(opened: Visitor, tmp_path: Path):
    journal = tmp_path / "journal"
    with running(ServiceProcess(journal)) as service, closing(Bridges(service, tmp_path)) as bridges:
        bridges.teach("cell-1", guided(), session="over", pace="fast")
        bridges.wait("cell-1")
        with bridges.reader() as caesura:
            taught = caesura.snapshot(*OVER).program.apps
            pressing = next(one for one in taught if one.kind == "apply_force")
            edit(caesura, NameProgram(name="Press the pump"))
            edit(caesura, ChangeApp(app=reference(pressing), force_n=4.0, name="press"))
            edit(caesura, DeleteApp(app=reference(taught[0])))
            edit(caesura, DuplicateApp(app=reference(pressing)))
            edit(caesura, Undo())
            edit(caesura, MoveApp(app=reference(taught[-1]), after=None))
            shown = caesura.snapshot(*OVER).program
            assert query.program_at_edit(caesura.transport, *OVER, 0).apps == taught
            second = query.program_at_edit(caesura.transport, *OVER, 2)
            assert [one.number for one in second.edits] == [1, 2]
            assert [one.name for one in second.apps if one.name] == ["press"]
            assert query.program_at_edit(caesura.transport, *OVER, 6).apps == shown.apps
    with running(ServiceProcess(journal)) as service, running(Dashboard(service.endpoint)) as dashboard:
        visitor, page = opened, opened.page
        visitor.begin_again(DESK)
        page.goto(f"{dashboard.url}/sessions/cell-1/over")
        versions = page.locator(".versions")
        versions.locator("summary").focus()
        page.keyboard.press("Enter")
        said, rows = versions.locator(".versions-said"), versions.locator("li")
        expect(said).to_have_text("3 apps differ; the name is Press the pump, was none.")
        offered = versions.locator(".version-to option").all_inner_texts()
        named = [words.split(":")[0] for words in offered]
        assert named == ["as inferred", "edit 1", "edit 2", "edit 3", "edit 6"]
        pressed = rows.filter(has_text="press").locator("dl div")
        values = [re.compile("name *none → 'press'"), re.compile(r"force *[1-9][0-9.]+ N → 4 N")]
        expect(pressed).to_have_text(values)
        expect(rows.filter(has_text="is left out")).to_have_count(1)
        expect(rows.filter(has_text="place")).to_contain_text(f"{len(taught)} → 1")
        expect(versions, "without scrolling, all of it is in sight").to_be_in_viewport(ratio=1.0)
        page.evaluate("() => document.querySelector('.versions').scrollIntoView()")
        looks_right(visitor, "versions", within=".versions")

        versions.locator(".version-from").focus()
        page.keyboard.press("ArrowDown")
        page.keyboard.press("Tab")
        for _ in range(2):
            page.keyboard.press("ArrowUp")
        expect(said).to_have_text("1 app differs.")
        expect(rows.locator("dl div")).to_have_text(values)
        visitor.picture("versions-two")
        page.evaluate(FAILED)
        expect(said).to_have_text("Not compared: the service is busy.")
        expect(said, "it is asked again").to_have_text("1 app differs.")

        with closing(Bridges(service, tmp_path)) as bridges, bridges.reader() as caesura:
            edit(caesura, Undo())
            expect(versions.locator(".version-to option"), "what is undone is no version").to_have_count(4)
            edit(caesura, Redo())
            expect(versions.locator(".version-to option")).to_have_count(5)
        assert visitor.errors == []

        command = typer.Typer()
        register(command)

        def against(version: str) -> str:
            options = ["--station", "cell-1", "--session", "over", "--against", f"cell-1/over@{version}"]
            done = CliRunner().invoke(command, ["program", *options, "--connect", service.endpoint])
            return done.output

        assert against("6") == "no differences from cell-1/over@6\n"
        assert "program: name 'Press the pump', was none" in against("0")
        assert "without what was app 1 (move to contact)" in against("2")
        assert "cell-1/over@9: the newest edit of the program is 8" in against("9")
        assert "'x' is no number of an edit, expected as cell-1/over@3" in against("x")
