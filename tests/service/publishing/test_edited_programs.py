"""What was made of a session's edits is kept with its state, for few sessions, and made in slices."""

from __future__ import annotations

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import App, AppReference, ChangeApp, Program
from caesura_service.cooperative_scheduler import Slices
from caesura_service.program_edits import EditLog
from caesura_service.program_edits.edited_app_list import EditedAppList
from caesura_service.publishing import edited_programs
from caesura_service.publishing.edited_programs import EditedPrograms
from service.program_edits.edits import log, program, ref, taught

EDITS = log(*(ChangeApp(app=ref(taught()[0]), name=f"n{number}") for number in range(100)))
GONE = ChangeApp(app=AppReference(kind="hold", t0=-5.0, tn=1e6), note="n")


@pytest.fixture
def applied(monkeypatch) -> list[int]:
    """The numbers of the edits that are applied."""
    numbers: list[int] = []
    apply = EditedAppList.apply
    monkeypatch.setattr(
        EditedAppList, "apply", lambda self, edit: numbers.append(edit.number) or apply(self, edit)
    )
    return numbers


def inferred() -> Program:
    return program(taught())


def test_a_refused_edit_costs_one_edit_and_a_version_is_made_once(applied):
    made, header, apps = EditedPrograms(), inferred(), inferred()
    made.edited(header, apps, EDITS)
    assert len(applied) == 100
    refused = EditLog((*EDITS.active, *log(GONE).active), (), 101)
    for _ in range(5):
        with pytest.raises(ProtocolError, match="no longer in the program"):
            made.check_applies(apps, refused)
    assert len(applied) == 101
    first = made.edited(header, apps, EDITS, 90)
    assert made.edited(header, apps, EDITS, 90) is first
    assert made.edited(header, apps, EDITS) is made.edited(header, apps, EDITS)
    assert applied[101:] == list(range(65, 91))
    assert (first.apps[0].name, first.edit_revision) == ("n89", 90)


def test_few_sessions_keep_what_was_made_of_their_edits(applied):
    header, apps = inferred(), inferred()
    sessions = [EditedPrograms() for _ in range(edited_programs.SESSIONS + 1)]
    for one in sessions:
        one.edited(header, apps, EDITS)
    del applied[:]
    for one in sessions[1:]:
        one.edited(header, apps, EDITS)
    assert not applied
    sessions[0].edited(header, apps, EDITS)
    assert len(applied) == 100


def test_many_edits_give_way_and_come_to_the_same():
    header, apps, made = inferred(), inferred(), list[Program]()
    slices = Slices(slice_s=0.0)
    is_done = slices.begin("station", lambda: made.append(EditedPrograms().edited(header, apps, EDITS)))
    turns = 0
    while not is_done:
        is_done, turns = slices.go_on("station"), turns + 1
    slices.stop()
    assert turns > len(EDITS.active)
    whole: tuple[App, ...] = tuple(EditedPrograms().edited(header, apps, EDITS).apps)
    assert tuple(made[0].apps) == whole
