"""A part of a program that was taught again takes the place of the part: the rest stays, byte for byte."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    App,
    AppReference,
    ChangeApp,
    DeleteApp,
    DuplicateApp,
    EditProgram,
    MoveApp,
    Redo,
    ReplacePart,
    Undo,
)
from caesura_protocol.programs.document import document
from caesura_service.program_edits.edit_log import EditLog, log_of
from caesura_service.program_edits.program_with_edits import check_applies, with_edits
from harness.programs import app, pick_and_place, press
from service.program_edits.edits import edited, log, program, ref, taught

AGAIN = tuple(  # a grasp and a carry, a quarter of a second into a session of their own
    one.model_copy(update={"t0": one.t0 - 1.55, "tn": one.tn - 1.55, "segments": (4,)})
    for one in pick_and_place()[1:3]
)
PART = ReplacePart(first=ref(pick_and_place()[1]), last=ref(pick_and_place()[3]), session="s2")


def canonical(apps: Sequence[App]) -> list[str]:
    return [json.dumps(one.model_dump(mode="json"), sort_keys=True) for one in apps]


def test_a_part_is_replaced_and_every_app_outside_stays_byte_for_byte():
    named = ChangeApp(app=ref(taught()[-1]), name="home", note="slowly")
    before = edited(taught(), named)
    after = edited(taught(), named, PART, again=AGAIN)
    assert [one.kind for one in after.apps] == [
        "move_to_contact", "grasp", "transport", "gripper_move", "cartesian_motion",
    ]  # fmt: skip
    assert canonical(after.apps[:1]) == canonical(before.apps[:1])
    assert canonical(after.apps[3:]) == canonical(before.apps[4:])
    assert [one.state for one in after.edits] == ["applied", "applied"]


def test_an_edit_of_an_app_that_is_taught_again_is_named():
    # A force that an operator had lowered was the taught one again, and the edit was listed as applied.
    first, last = press()[0], press()[1]
    change = ChangeApp(app=ref(last), force_n=4.0, name="the pump")
    part = ReplacePart(first=ref(last), last=ref(last), session="s2")
    made = edited(press(), ChangeApp(app=ref(first), name="reach"), change, part, again=press()[1:2])
    assert made.apps[1].name is None
    assert [one.state for one in made.edits] == ["applied"] * 3
    (note,) = [one for one in made.notes if "replaced" in one]
    assert note == "Edit 2 by Ann (change) is applied: edit 3 replaced 'apply force' at 2.60 to 4.20 s."
    back = log(change, part, Undo(), again=press()[1:2])
    assert not with_edits(program(press()), back).notes


def test_new_apps_begin_where_the_part_began_and_keep_their_durations():
    new = edited(taught(), PART, again=AGAIN).apps[1:3]
    assert [(one.t0, one.tn) for one in new] == [
        (1.8, pytest.approx(3.5)),
        (pytest.approx(4.0), pytest.approx(5.7)),
    ]
    assert [(one.added, one.segments) for one in new] == [(1, ()), (1, ())]
    marks = [(mark.field, mark.author, mark.edit) for one in new for mark in one.changes]
    assert marks == [("taught_again", "Ann", 1)] * 2
    assert [one.target for one in new] == [one.target for one in AGAIN]


def test_a_part_begins_where_its_app_does_whatever_time_the_reference_has():
    copied = DuplicateApp(app=ref(pick_and_place()[1]))
    wanted = AppReference(kind="grasp", t0=1.7e308, tn=1.7e308, added=1)
    made = edited(taught(), copied, ReplacePart(first=wanted, last=wanted, session="s2"), again=AGAIN)
    assert [one.t0 for one in made.apps if one.added == 2] == [1.8, pytest.approx(4.0)]
    assert document(made).apps[-1].tn < 60.0


def test_new_apps_are_edited_each_by_itself_and_undo_takes_the_part_back():
    new = edited(taught(), PART, again=AGAIN).apps[1:3]
    moved = MoveApp(app=ref(new[1]), after=None)
    named = ChangeApp(app=ref(new[1]), name="carry")
    made = edited(taught(), PART, named, moved, again=AGAIN)
    assert [one.name for one in made.apps] == ["carry", *[None] * 4]
    gone = edited(
        taught(), PART, DeleteApp(app=ref(new[0])), ChangeApp(app=ref(new[0]), name="x"), again=AGAIN
    )
    assert gone.edits[2].reason == "the app 'grasp' was deleted by edit 2"
    assert [one.name for one in gone.apps] == [None] * 4
    back = log(PART, Undo(), again=AGAIN)
    assert with_edits(program(taught()), back).apps == taught()
    again = back.after(EditProgram(session="s1", revision=2, author="Bo", action=Redo()), 1.0)
    assert canonical(with_edits(program(taught()), again).apps) == canonical(
        edited(taught(), PART, again=AGAIN).apps
    )
    assert log_of(with_edits(program(taught()), back)) == back


def test_a_part_of_one_kind_twice_keeps_its_apps_apart():
    twice = (taught()[0], taught()[0].model_copy(update={"t0": 2.0, "tn": 3.0}))
    new = edited(taught(), PART, again=twice).apps[1:3]
    made = edited(taught(), PART, ChangeApp(app=ref(new[1]), name="second"), again=twice)
    assert [one.name for one in made.apps[1:3]] == [None, "second"]
    only = edited(taught(), PART, DeleteApp(app=ref(new[0])), DeleteApp(app=ref(new[0])), again=twice)
    assert [one.state for one in only.edits] == ["applied", "applied", "not_applied"]


def test_a_part_that_is_gone_after_a_correction_is_listed_and_comes_back():
    corrected = (taught()[0], app("apply_force", 1.8, 3.5, force=(0.0, 0.0, -3.0)), *taught()[2:])
    made = edited(corrected, PART, again=AGAIN)
    assert made.apps == corrected
    assert (made.edits[0].state, str(made.edits[0].reason)[:31]) == (
        "not_applied",
        "the app 'grasp' at 1.80 to 3.50",
    )
    assert "(replace_part) is not applied" in made.notes[-1]
    assert len(edited(taught(), PART, again=AGAIN).apps) == 5


def test_a_part_follows_its_boundaries_and_its_apps_stay_as_they_were_taught():
    earlier = [one.model_copy(update={"t0": one.t0 - 0.1, "tn": one.tn - 0.1}) for one in taught()]
    made = edited(earlier, PART, again=AGAIN)
    assert made.edits[0].state == "applied"
    assert canonical(made.apps[1:3]) == canonical(edited(taught(), PART, again=AGAIN).apps[1:3])
    assert canonical(made.apps[3:]) == canonical(earlier[4:])


def test_new_apps_exert_no_more_than_the_limit_of_the_cell():
    part = ReplacePart(first=ref(press()[1]), last=ref(press()[1]), session="s2")
    new = edited(press(), part, again=press()[1:2], force_limit_n=6.0).apps[1]
    assert (new.force, new.force_taught) == (pytest.approx((0.0, 0.0, -6.0)), (0.0, 0.0, -10.0))


def test_a_part_that_makes_no_sense_is_refused_with_the_reason():
    backwards = ReplacePart(first=PART.last, last=PART.first, session="s2")
    with pytest.raises(ProtocolError, match="the last app of the part comes before the first one"):
        check_applies(program(taught()), log(backwards, again=AGAIN))
    with pytest.raises(ProtocolError, match="'grasp' was replaced by edit 1"):
        check_applies(program(taught()), log(PART, PART, again=AGAIN))
    with pytest.raises(ProtocolError, match="session s2 has no apps"):
        check_applies(program(taught()), log(PART))


def parts(*placed: tuple[int, int | None]) -> EditLog:
    """Parts of 100 apps each in the place of an app of `taught`, or of all that an earlier edit taught."""
    made = EditLog()
    many = tuple(
        app("cartesian_motion", float(k), k + 1.0, (0.0, -0.5, 0.3), orientation=None) for k in range(100)
    )
    for place, replaced in placed:
        old = taught()[place]
        first, last = ref(old), ref(old)
        if replaced is not None:
            begins = [AppReference(kind=one.kind, t0=old.t0 + one.t0, tn=old.t0 + one.tn) for one in many]
            first, last = (one.model_copy(update={"added": replaced}) for one in (begins[0], begins[-1]))
        action = ReplacePart(first=first, last=last, session="s2")
        command = EditProgram(session="s1", revision=made.revision, author="Ann", action=action)
        made = made.after(command, 100.0, many)
    return made


def test_apps_that_an_edit_replaces_do_not_count_as_taught_again():
    three = parts((0, None), (1, None), (2, None))
    check_applies(program(taught()), three)
    again = parts((0, None), (1, None), (2, None), (1, 2))
    check_applies(program(taught()), again)
    assert [one.state for one in with_edits(program(taught()), again).edits] == ["applied"] * 4
    with pytest.raises(ProtocolError, match="would have 400 apps that were taught again, of 300") as refused:
        check_applies(program(taught()), parts((0, None), (1, None), (2, None), (3, None)))
    assert refused.value.value is None, "two numbers would be revisions"


def test_what_edits_hold_for_undo_is_bounded_too():
    parts(*[(0, None)] * 10)
    with pytest.raises(ProtocolError, match=r"would hold 1100 apps .* of 1000 at most") as refused:
        parts(*[(0, None)] * 11)
    assert refused.value.value is None, "two numbers would be revisions"


def test_a_document_keeps_durations_outside_the_part_and_pauses_within_it():
    apps = document(edited(taught(), PART, again=AGAIN)).apps
    assert [round(one.tn - one.t0, 9) for one in apps] == [1.6, 1.7, 1.7, 2.3, 1.9]
    pauses = [round(two.t0 - one.tn, 5) for one, two in itertools.pairwise(apps)]
    assert pauses == [0.0, 0.5, 0.0, 0.3], "half a second was taught between grasp and carry"
