"""Edits of a program are a layer: applied again to what is inferred next, listed where they do not apply."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_protocol.app_force_limit import LEAST_FORCE_N
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    App,
    AppReference,
    ChangeApp,
    Correction,
    DeleteApp,
    DuplicateApp,
    EditProgram,
    InsertApp,
    LimitForce,
    MoveApp,
    NameProgram,
    Redo,
    Undo,
)
from caesura_protocol.programs.document import document
from caesura_protocol.programs.export_limits import refuse_beyond_limits
from caesura_service.program_edits import edited_app_list
from caesura_service.program_edits.edit_log import EditLog, log_of
from caesura_service.program_edits.program_with_edits import apply, check_applies, with_edits
from harness.programs import app, pick_and_place, press, pressed_harder_before
from service.program_edits.edits import PATH, edited, log, program, ref, taught


def test_without_edits_the_program_is_the_inferred_one_itself():
    inferred = program(taught())
    assert with_edits(inferred, EditLog()) is inferred


def test_an_app_gets_other_values_with_marks_of_author_and_inferred_value():
    approach = taught()[0]
    change = ChangeApp(app=ref(approach), name="above", note="slowly", speed=0.5, target=(0.0, -0.673, 0.107))
    made = edited(taught(), change)
    changed = made.apps[0]
    assert (changed.name, changed.note, changed.speed, changed.target) == (
        "above",
        "slowly",
        0.5,
        (0.0, -0.673, 0.107),
    )
    marks = {one.field: (one.author, one.edit, one.inferred) for one in changed.changes}
    assert marks == {
        "name": ("Ann", 1, None),
        "note": ("Ann", 1, None),
        "speed": ("Ann", 1, None),
        "target": ("Ann", 1, approach.target),
    }
    assert changed.joints is None, "these were taught at another target"
    assert changed.path is not None
    assert changed.path.deviation_m == pytest.approx(0.015)
    assert made.apps[1:] == taught()[1:]
    assert [(one.number, one.state) for one in made.edits] == [(1, "applied")]


def test_fields_of_a_path_are_set_together_and_one_is_taken_back_alone():
    first = ref(taught()[0])
    both = ChangeApp(app=first, target=(0.0, -0.673, 0.107), tolerance_m=0.02)
    path = edited(taught(), both).apps[0].path
    assert path is not None
    assert (path.tolerance_m, path.deviation_m) == (0.02, pytest.approx(0.015))
    back = edited(taught(), both, ChangeApp(app=first, as_taught=("target",))).apps[0]
    assert (back.target, back.joints) == (taught()[0].target, taught()[0].joints)
    assert back.path == PATH.model_copy(update={"tolerance_m": 0.02})
    assert [one.field for one in back.changes] == ["tolerance_m"]


@pytest.mark.parametrize("edit", [{"target": (0.0, -0.673, 0.107)}, {"tolerance_m": 0.02}])
def test_another_target_is_no_place_to_go_on_from(edit: dict[str, Any]):
    """The velocity is that of the hand at the target that was taught."""
    first, *rest = taught()
    velocity = (0.0, 0.01, -0.08)
    first = first.model_copy(update={"path": PATH.model_copy(update={"end_velocity": velocity})})
    path = edited((first, *rest), ChangeApp(app=ref(first), **edit)).apps[0].path
    assert path is not None
    assert path.end_velocity == (None if "target" in edit else velocity)


def test_an_edit_of_an_app_that_a_correction_joined_with_another_one_says_so():
    """No operator deleted the second carry: the program must not lose it in silence."""
    apps = pick_and_place()
    lift, carry = apps[2:4]
    joined = (*apps[:2], lift.model_copy(update={"tn": carry.tn, "target": carry.target}), *apps[4:])
    delete = DeleteApp(app=ref(lift))
    assert edited(apps, delete).edits[0].reason is None
    made = edited(joined, delete)
    assert [one.kind for one in made.apps].count("transport") == 0
    reason = "'transport' at 4.00 to 7.50 s was at 4.00 to 5.70 s when it was edited"
    assert (made.edits[0].state, made.edits[0].reason) == ("applied", reason)
    assert made.notes[-1] == f"Edit 1 by Ann (delete) is applied: {reason}."
    nearly = (*apps[:2], lift.model_copy(update={"tn": lift.tn + 0.2}), *apps[3:])
    deleted = "Taught and deleted: transport at 4.0 s (Ann)."
    assert edited(nearly, delete).notes == (deleted,), "its boundary was corrected"
    assert log_of(made).active[0].reason is None


def limited(newton: float | None, t: float = 3.0) -> tuple[Correction, ...]:
    return (Correction(number=1, author="Bo", at=100.0, action=LimitForce(t=t, newton=newton)),)


def test_no_edit_exerts_more_than_the_limit_that_a_correction_sets_for_the_app():
    """Whichever of the two was first; a limit above the force that was taught leaves no trace in the app."""
    touch, taught_press, leave = press()
    pressing = taught_press.model_copy(update={"segments": (2,)})
    apps = (touch, pressing, leave)
    harder = ChangeApp(app=ref(pressing), force_n=14.0)
    held = edited(apps, harder, corrections=limited(12.0))
    assert held.apps == apps
    reason = "14 N is more than the limit that a correction sets for the app, 12 N"
    assert (held.edits[0].state, held.edits[0].reason) == ("not_applied", reason)
    for corrections in ((), limited(None), limited(12.0, t=9.0), limited(14.0)):
        assert edited(apps, harder, corrections=corrections).apps[1].force == (0.0, 0.0, -14.0)
    cut = pressing.model_copy(update={"force": (0.0, 0.0, -4.0), "force_taught": (0.0, 0.0, -10.0)})
    reason = "14 N is more than the limit that a correction sets for the app, 4 N"
    assert edited((touch, cut, leave), harder).edits[0].reason == reason, "of a list of an older version"
    within = ChangeApp(app=ref(cut), force_n=4.0)
    assert edited((touch, cut, leave), within).edits[0].state == "applied"


def test_a_force_keeps_the_direction_that_was_taught_and_the_limit_of_the_cell():
    pressing = press()[1]
    made = edited(press(), ChangeApp(app=ref(pressing), force_n=4.0)).apps[1]
    assert made.force == pytest.approx((0.0, 0.0, -4.0))
    limited = edited(press(), ChangeApp(app=ref(pressing), force_n=40.0), force_limit_n=20.0)
    assert limited.apps == press()
    assert limited.edits[0].reason == "40 N is more than the cell's force limit, 20 N"
    assert "Edit 1 by Ann (change) is not applied: 40 N is more" in limited.notes[-1]


@pytest.mark.parametrize("newtons", [0.0, 2e-6, 0.99 * LEAST_FORCE_N, LEAST_FORCE_N, 0.0011])
def test_a_press_that_no_script_states_is_refused_and_every_other_is_written(newtons: float):
    """Presses of 1e-6 to 1e-3 N were accepted, and then refused by every exporter of scripts."""
    touch, pressing, leave = press()
    slanted = pressing.model_copy(update={"force": (1.0, 2.0, -3.0), "force_taught": (1.0, 2.0, -3.0)})
    actions = (
        ChangeApp(app=ref(slanted), force_n=newtons),
        InsertApp(after=ref(touch), kind="apply_force", force=(0.0, 0.0, -newtons)),
    )
    for action in actions:
        made = edited((touch, slanted, leave), action)
        if newtons < LEAST_FORCE_N:
            assert made.edits[0].reason == f"{newtons:g} N is less than the least of a press, 0.001 N"
        else:
            assert made.edits[0].state == "applied"
        refuse_beyond_limits(document(made))


def test_rests_beside_a_stroke_are_pressed_harder_or_softer_with_it():
    apps = pressed_harder_before()
    softer = edited(apps, ChangeApp(app=ref(apps[1]), force_n=5.0)).apps[1]
    assert (softer.rest_before.newton, softer.rest_after.newton) == pytest.approx((6.0, 2.5))
    assert softer.rest_before.newton_taught == 18.0
    harder = edited(apps, ChangeApp(app=ref(apps[1]), force_n=20.0), force_limit_n=20.0).apps[1]
    assert (harder.rest_before.newton, harder.rest_after.newton) == pytest.approx((20.0, 10.0))


def test_apps_are_deleted_duplicated_moved_and_inserted():
    a, b, c, *_ = taught()
    kinds = [one.kind for one in taught()]
    assert [x.kind for x in edited(taught(), DeleteApp(app=ref(b))).apps] == [kinds[0], *kinds[2:]]
    twice = edited(taught(), DuplicateApp(app=ref(b))).apps
    assert [x.kind for x in twice] == [*kinds[:2], kinds[1], *kinds[2:]]
    assert (twice[2].added, twice[2].changes[0].field) == (1, "added")
    moved = edited(taught(), MoveApp(app=ref(a), after=ref(c))).apps
    assert [x.kind for x in moved] == [kinds[1], kinds[2], kinds[0], *kinds[3:]]
    assert moved[2].changes[0].field == "place"
    assert edited(taught(), MoveApp(app=ref(c), after=None)).apps[0].kind == kinds[2]
    made = edited(taught(), InsertApp(after=ref(a), kind="cartesian_motion", target=(0.1, -0.5, 0.3))).apps[1]
    assert (made.kind, made.target, made.t0, made.tn, made.confidence) == (
        "cartesian_motion",
        (0.1, -0.5, 0.3),
        1.8,
        3.8,
        1.0,
    )


def test_a_copy_and_an_inserted_app_are_edited_like_others():
    first = taught()[0]
    copied = edited(taught(), DuplicateApp(app=ref(first))).apps[1]
    changed = ChangeApp(app=ref(copied), name="again", target=(0.0, -0.6, 0.2))
    made = edited(taught(), DuplicateApp(app=ref(first)), changed, MoveApp(app=ref(copied), after=None))
    assert [one.state for one in made.edits] == ["applied"] * 3
    assert (made.apps[0].name, made.apps[1].name) == ("again", None)
    assert {one.field for one in made.apps[0].changes} == {"added", "name", "target", "place"}


def test_a_position_gets_a_name_and_loses_it_again():
    approach = taught()[0]
    named = ChangeApp(app=ref(approach), target_name="above the tray")
    made = edited(taught(), named).apps[0]
    assert (made.target_name, made.target, made.joints) == (
        "above the tray",
        approach.target,
        approach.joints,
    )
    assert [one.field for one in made.changes] == ["target_name"]
    again = edited(taught(), named, ChangeApp(app=ref(approach), as_taught=("target_name",)))
    assert again.apps == taught()
    nowhere = approach.model_copy(update={"target": None})
    (listed,) = edited([nowhere], named).edits
    assert (listed.state, listed.reason) == ("not_applied", "'move to contact' has no target")


@pytest.mark.parametrize(
    ("action", "reason"),
    [
        (ChangeApp(app=ref(pick_and_place()[1]), target=(0.0, 0.0, 0.0)), "'grasp' has no target"),
        (ChangeApp(app=ref(pick_and_place()[0]), force_n=1.0), "'move to contact' exerts no force"),
        (ChangeApp(app=ref(pick_and_place()[0]), gripper_width=0.0), "'move to contact' moves no fingers"),
        (ChangeApp(app=ref(pick_and_place()[0]), tolerance_m=0.1), "'move to contact' has no path"),
        (ChangeApp(app=ref(pick_and_place()[1]), speed=0.5), "'grasp' is no movement in free space"),
        (ChangeApp(app=ref(pick_and_place()[0])), "it changes no field"),
        (InsertApp(after=None, kind="apply_force"), "'apply force' needs a force"),
        (
            InsertApp(after=None, kind="apply_force", force=(0.0, 0.0, 0.0)),
            "0 N is less than the least of a press, 0.001 N",
        ),
        (
            MoveApp(app=ref(press()[0]), after=None),
            "at 0.80 to 2.60 s is no longer in the program",
        ),
        (
            MoveApp(app=ref(pick_and_place()[0]), after=ref(pick_and_place()[0])),
            "an app cannot come after itself",
        ),
    ],
)
def test_an_edit_that_makes_no_sense_is_refused_with_the_reason(action, reason):
    with pytest.raises(ProtocolError, match=reason) as refused:
        check_applies(program(pick_and_place()), log(action))
    assert refused.value.code == "conflict"


def test_an_app_is_found_again_after_its_boundaries_have_moved_and_while_it_grows():
    last = taught()[-1]
    change = ChangeApp(app=ref(last), name="home")
    for t0, tn in ((10.1, 30.0), (10.4, 12.0), (9.9, 11.8)):
        later = last.model_copy(update={"t0": t0, "tn": tn})
        made = edited((*taught()[:-1], later), change)
        assert made.apps[-1].name == "home", (t0, tn)
    more = (*taught(), app("move_to_contact", 13.0, 14.0, (0.0, -0.5, 0.1)))
    made = edited(more, change, MoveApp(app=ref(last), after=None))
    assert made.apps[0].name == "home"
    assert made.apps[-1] == more[-1], "what is taught later follows"


def test_an_edit_whose_app_is_gone_is_listed_with_the_reason_and_applies_again_when_it_is_back():
    grasp = taught()[1]
    deleted = DeleteApp(app=ref(grasp))
    rename = ChangeApp(app=ref(grasp), name="pick")
    corrected = (taught()[0], app("apply_force", 1.8, 3.5, force=(0.0, 0.0, -3.0)), *taught()[2:])
    made = edited(corrected, rename)
    (listed,) = made.edits
    assert made.apps == corrected
    assert (listed.state, listed.reason) == (
        "not_applied",
        "the app 'grasp' at 1.80 to 3.50 s is no longer in the program: "
        "now there is 'apply force' at 1.80 to 3.50 s",
    )
    assert edited(taught(), rename).apps[1].name == "pick"
    assert edited(taught(), deleted, rename).edits[1].reason == "the app 'grasp' was deleted by edit 1"


def test_undo_and_redo_take_one_edit_each_and_a_new_edit_ends_redo():
    first, last = ref(taught()[0]), ref(taught()[-1])
    made = log(ChangeApp(app=first, name="one"), ChangeApp(app=last, name="two"), Undo(), Undo(), Redo())
    shown = with_edits(program(taught()), made)
    assert (shown.apps[0].name, shown.apps[-1].name) == ("one", None)
    assert [(one.number, one.state) for one in shown.edits] == [(1, "applied"), (2, "undone")]
    assert (log_of(shown), shown.edit_revision) == (made, 5)
    ended = made.after(EditProgram(session="s1", revision=5, author="Bo", action=NameProgram(name="w")), 1.0)
    with pytest.raises(ProtocolError, match="no edit to redo"):
        ended.after(EditProgram(session="s1", revision=6, author="Bo", action=Redo()), 1.0)
    with pytest.raises(ProtocolError, match="no edit to undo"):
        log(Undo())
    assert with_edits(program(taught()), ended).name == "w"


REFERENCES = st.sampled_from([ref(one) for one in taught()])
ACTIONS = st.one_of(
    st.builds(
        ChangeApp,
        app=REFERENCES,
        name=st.sampled_from([None, "a", "b"]),
        speed=st.sampled_from([None, 0.5]),
        target=st.sampled_from([None, (0.0, -0.5, 0.2)]),
        gripper_width=st.sampled_from([None, 0.02]),
        as_taught=st.sampled_from([(), ("name",), ("target", "speed")]),
    ),
    st.builds(MoveApp, app=REFERENCES, after=st.one_of(st.none(), REFERENCES)),
    st.builds(DeleteApp, app=REFERENCES),
    st.builds(DuplicateApp, app=REFERENCES),
    st.builds(
        InsertApp, after=REFERENCES, kind=st.sampled_from(["gripper_move", "cartesian_motion", "apply_force"])
    ),
)


@settings(max_examples=80, deadline=None)
@given(st.lists(ACTIONS, max_size=8), st.data())
def test_edits_lose_no_app_in_silence_and_undo_restores_what_was(actions, data):
    inferred = program(taught())
    made = log(*actions)
    shown = with_edits(inferred, made)
    applied = [one.action for one in shown.edits if one.state == "applied"]
    assert all(one.reason for one in shown.edits if one.state == "not_applied")
    deleted = sum(isinstance(one, DeleteApp) for one in applied)
    added = sum(isinstance(one, DuplicateApp | InsertApp) for one in applied)
    assert len(shown.apps) == len(inferred.apps) - deleted + added
    assert all(len({mark.field for mark in one.changes}) == len(one.changes) for one in shown.apps)
    steps = data.draw(st.integers(0, len(actions)))
    for _ in range(steps):
        made = made.after(EditProgram(session="s1", revision=0, author="Ann", action=Undo()), 1.0)
    kept = actions[: len(actions) - steps]
    assert with_edits(inferred, made).apps == edited(taught(), *kept).apps
    for _ in range(steps):
        made = made.after(EditProgram(session="s1", revision=0, author="Ann", action=Redo()), 1.0)
    assert with_edits(inferred, made).apps == shown.apps


@settings(max_examples=60, deadline=None)
@given(st.lists(ACTIONS, max_size=5), st.lists(ACTIONS, max_size=5), st.integers(1, 6))
def test_edits_mean_the_same_whether_more_was_taught_before_or_after_them(early, late, count):
    """Edits that applied to the beginning of a program apply to the whole in the same way."""
    beginning = apply(taught()[:count], log(*early).active)
    whole = apply(taught(), log(*early, *late).active)
    for one, two in zip(beginning.edits, whole.edits, strict=False):
        assert one.state == "not_applied" or two.state == "applied"


def test_the_reason_of_an_edit_names_few_apps():
    first, *_ = taught()
    many = [first.model_copy(update={"t0": float(i), "tn": i + 1.0}) for i in range(50)]
    everywhere = AppReference(kind="grasp", t0=-1e300, tn=1e300)
    (listed,) = edited(many, DeleteApp(app=everywhere)).edits
    assert listed.state == "not_applied"
    assert str(listed.reason).endswith("at 2.00 to 3.00 s and 47 more")


def test_the_reason_of_an_edit_is_short_whatever_time_it_names():
    for t0, when in ((1e308, "1e+308"), (-1e308, "-1e+308 to 1e+308")):
        gone = DeleteApp(app=AppReference(kind="grasp", t0=t0, tn=1e308))
        (edit,) = edited((), gone).edits
        assert str(edit.reason).startswith(f"the app 'grasp' at {when} s is no longer in")
        assert len(str(edit.reason)) < 100


def test_an_edit_is_compared_with_apps_of_its_time_alone(monkeypatch):
    first, *_ = taught()
    many = [first.model_copy(update={"t0": float(i), "tn": i + 1.0}) for i in range(300)]
    compared: list[App] = []
    common = edited_app_list.common_share
    monkeypatch.setattr(
        edited_app_list, "common_share", lambda wanted, app: compared.append(app) or common(wanted, app)
    )
    moved = [AppReference(kind=one.kind, t0=one.t0 + 0.2, tn=one.tn + 0.2) for one in many[:100]]
    made = edited(many, *(ChangeApp(app=one, name="reach") for one in moved))
    assert {one.state for one in made.edits} == {"applied"}
    assert len(compared) <= 4 * len(moved)  # not with all 300


FAR, STRONG = (1.7e308, 1.7e308, -1.7e308), (1.7e308, 0.0, 1.7e308)


def test_a_value_beyond_any_robot_is_refused_before_it_is_infinite_or_no_number():
    first, *_ = taught()
    faint = app("apply_force", 20.0, 22.0, force=(1e-320, 0.0, 0.0))
    press_faintly = InsertApp(after=None, kind="apply_force", force=(1e-320, 0.0, 0.0))
    for actions, why in (
        ([ChangeApp(app=ref(first), target=FAR)], "more than 100000 mm away from the base"),
        ([InsertApp(after=None, kind="cartesian_motion", target=FAR)], "more than 100000 mm away"),
        ([InsertApp(after=None, kind="apply_force", force=STRONG)], "more than any robot exerts"),
        ([press_faintly], "is less than the least of a press"),
        ([ChangeApp(app=ref(faint), force_n=1e300)], "has no direction of force"),
    ):
        shown = edited((*taught(), faint), *actions)
        assert why in str(shown.edits[-1].reason)
        assert all(math.isfinite(x) for one in shown.apps for x in (*(one.target or ()), *(one.force or ())))


def test_taught_apps_that_people_deleted_are_a_note_and_added_ones_are_not():
    """Who read a program without its taught press had no sign of it: neither a note nor a finding."""
    apps = pick_and_place()
    made = edited(apps, DeleteApp(app=ref(apps[0])), DeleteApp(app=ref(apps[5])))
    assert made.notes == ("Taught and deleted: move to contact at 0.2 s (Ann), move at 10.1 s (Ann).",)
    copied = edited(apps, DuplicateApp(app=ref(apps[0])))
    added = next(app for app in copied.apps if app.added is not None)
    again = edited(apps, DuplicateApp(app=ref(apps[0])), DeleteApp(app=ref(added)))
    assert [one.kind for one in again.apps] == [one.kind for one in apps]
    assert again.notes == ()
