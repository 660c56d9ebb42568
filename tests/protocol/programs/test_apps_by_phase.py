"""The apps of a phase are a group of the program; a phase without a group is named."""

from __future__ import annotations

from typing import Any

import pytest

from caesura_protocol.messages import App, AppChange, AppReference, Phase, ProgramEdit, ReplacePart
from caesura_protocol.programs.apps_by_phase import (
    Group,
    edited_group_notes,
    groups_by_first,
    groups_of,
    ungrouped_notes,
)
from caesura_protocol.programs.checks import document_findings
from harness.programs import app, as_file


def phase(first: int, last: int, **fields: Any) -> Phase:
    """A phase whose segments last a second each."""
    made = {"t0": float(first), "tn": last + 1.0, "first_segment": first, "last_segment": last}
    stated = {"kind": "contact", "probability": 0.9, "certainty": "final"} | fields
    return Phase.model_validate(made | stated)


REACH, WIPE, RETRACT = phase(0, 1, kind="free"), phase(2, 2, name="wipe"), phase(3, 3, kind="free")
ACROSS = (
    app("move_to_contact", 0.0, 3.0, (0.0, 0.4, 0.2), segments=(0, 1, 2)),
    app("cartesian_motion", 3.0, 4.0, (0.0, 0.4, 0.3), segments=(3,)),
)


def test_a_phase_that_an_app_of_the_phase_before_crosses_is_named():
    # The name that an operator gave to it was in no group, and nothing said so.
    phases = (REACH, WIPE, RETRACT)
    assert [one.name for one in groups_of(ACROSS, phases)] == ["free 1", "free 2"]
    assert list(ungrouped_notes(ACROSS, phases)) == [
        "Phase 2 (wipe) at 2.0–3.0 s is no group of the program: it lies in app 1 (move to contact), which "
        "begins in the phase before."
    ]


TWICE = (phase(0, 0, kind="free"), phase(1, 3, name="wipe", strokes=3), phase(4, 4, kind="free"))
FIVE = tuple(
    app("cartesian_motion", t, t + 1.0, (0.0, 0.4, 0.1 * t), segments=(int(t),))
    for t in (0.0, 1.0, 2.0, 3.0, 4.0)
)


def marked(one: App, **update: Any) -> App:
    mark = AppChange(field="place", author="Ann", edit=1)
    return one.model_copy(update={"changes": (mark,), **update})


def test_a_group_has_the_strokes_that_were_taught_and_the_numbers_of_its_apps():
    headings = [one.heading for one in groups_of(FIVE, TWICE)]
    assert headings == ["free 1: app 1", "wipe, 3 strokes taught: apps 2–4", "free 2: app 5"]


def test_a_group_that_edits_divided_is_left_out_and_named():
    # A name that an operator gave it was lost, and nothing said so.
    apps = (FIVE[0], FIVE[1], marked(FIVE[4]), FIVE[2], FIVE[3])
    assert [one.name for one in groups_of(apps, TWICE)] == ["free 1", "free 2"]
    assert list(edited_group_notes(apps, TWICE)) == [
        "Phase 2 (wipe) is no group of the program: apps of another one were put between its apps."
    ]


def test_a_group_keeps_its_number_if_one_before_it_is_divided():
    # The third phase, `contact 2` until then, became `contact 1`, which had been the first one.
    phases = (phase(0, 1), phase(2, 2, kind="free"), phase(3, 4))
    assert [one.name for one in groups_of(FIVE, phases)] == ["contact 1", "free 1", "contact 2"]
    apps = (FIVE[0], marked(FIVE[2]), FIVE[1], *FIVE[3:])
    assert [one.name for one in groups_of(apps, phases)] == ["free 1", "contact 2"]


def replaced(number: int, first: App, last: App) -> ProgramEdit:
    """An edit that replaces the apps from one to another."""
    ends = (AppReference(kind=one.kind, t0=one.t0, tn=one.tn, added=one.added) for one in (first, last))
    action = ReplacePart(**dict(zip(("first", "last"), ends, strict=True)), session="s2")
    return ProgramEdit(number=number, author="Ann", at=0.0, action=action, state="applied")


def again(edit: int, t0: float, tn: float) -> App:
    """An app of another session, at times that need not be those of the apps that it replaces."""
    mark = AppChange(field="taught_again", author="Ann", edit=edit)
    return marked(FIVE[0], t0=t0, tn=tn, segments=(), added=edit, changes=(mark,))


def test_a_part_that_was_taught_again_stays_in_its_group():
    # Its time is that of another session: the group it lies in was left out, and another one, too.
    apps, edits = (*FIVE[:2], again(1, 4.2, 5.0), *FIVE[3:]), [replaced(1, FIVE[2], FIVE[2])]
    found = [one.heading for one in groups_of(apps, TWICE, edits)]
    assert found == [one.heading for one in groups_of(FIVE, TWICE)]


def test_a_phase_that_was_taught_again_keeps_its_name():
    # The group was gone with the name that an operator gave it, and no note named it.
    for part in ([again(1, 1.0, 9.0)], [again(1, 1.0, 1.2), again(1, 1.2, 1.4)]):
        apps, edits = (FIVE[0], *part, FIVE[4]), [replaced(1, FIVE[1], FIVE[3])]
        assert [one.name for one in groups_of(apps, TWICE, edits)] == ["free 1", "wipe", "free 2"]
        assert [(one.first, one.last) for one in groups_of(apps, TWICE, edits)][1] == (1, len(part))
        assert not list(edited_group_notes(apps, TWICE, edits))


def test_the_end_of_a_phase_that_was_taught_again_is_in_its_group():
    # It was in no group: the heading of its phase named one app of two.
    apps, edits = (*FIVE[:3], again(1, 3.0, 9.0), FIVE[4]), [replaced(1, FIVE[3], FIVE[3])]
    assert [one.heading for one in groups_of(apps, TWICE, edits)][1] == "wipe, 3 strokes taught: apps 2–4"


def test_a_part_that_was_taught_again_twice_keeps_the_name_of_its_phase():
    first, second = again(1, 1.0, 9.0), again(2, 1.0, 2.0)
    edits = [replaced(1, FIVE[1], FIVE[3]), replaced(2, first, first)]
    groups = groups_of((FIVE[0], second, FIVE[4]), TWICE, edits)
    assert [one.name for one in groups] == ["free 1", "wipe", "free 2"]


def test_a_named_phase_that_was_taught_again_as_a_lesser_part_is_named():
    phases = (phase(0, 0, kind="free", name="reach"), *TWICE[1:])
    apps, edits = (again(1, 0.0, 3.0), FIVE[4]), [replaced(1, FIVE[0], FIVE[3])]
    assert [one.heading for one in groups_of(apps, phases, edits)] == [
        "wipe, 3 strokes taught: app 1",
        "free 1: app 2",
    ]
    assert list(edited_group_notes(apps, phases, edits)) == [
        "Phase 1 (reach) is no group of the program: edit 1 replaced what was taught in its time, "
        "and more of phase 2."
    ]
    undone = [edits[0].model_copy(update={"state": "undone"})]
    assert not list(edited_group_notes(FIVE, phases, undone))


def test_a_group_whose_apps_were_deleted_is_none_and_needs_no_note():
    apps = (FIVE[0], FIVE[4])
    assert [one.heading for one in groups_of(apps, TWICE)] == ["free 1: app 1", "free 2: app 2"]
    assert not list(edited_group_notes(apps, TWICE))


def test_an_app_without_segments_that_begins_in_the_phase_before_divides_no_group():
    # Its group began before the end of the one before, and one of the two could not be shown.
    grasp = app("grasp", 0.9, 1.4, segments=())
    apps = (FIVE[0], FIVE[1], grasp, *FIVE[2:])
    assert [(one.first, one.last) for one in groups_of(apps, TWICE)] == [(0, 0), (1, 4), (5, 5)]


def test_groups_of_a_changed_file_that_do_not_fit_are_named():
    groups = (Group(first=0, last=1, name="reach"), Group(first=1, last=2, name="wipe"))
    groups += (Group(first=4, last=9, name="retract"), Group(first=3, last=2, name="back"))
    program = as_file(FIVE).model_copy(update={"groups": groups})
    assert [one.name for one in groups_by_first(groups, len(FIVE)).values()] == ["reach"]
    said = [one.reason.split(":")[0] for one in document_findings(program) if "is not shown" in one.reason]
    assert said == ["group wipe", "group retract", "group back"]


def test_a_phase_with_a_name_and_without_an_app_is_named():
    (note,) = ungrouped_notes(ACROSS[1:], (WIPE, RETRACT))
    assert note == "Phase 1 (wipe) at 2.0–3.0 s is no group of the program: it has no app."


@pytest.mark.parametrize(
    ("apps", "phases"),
    [
        (ACROSS, (REACH, RETRACT)),
        (ACROSS, (phase(0, 3),)),
        (ACROSS[1:], (phase(2, 2), RETRACT)),  # a rest
        ((), ()),
    ],
)
def test_phases_with_a_group_and_rests_are_not_named(apps, phases):
    assert not list(ungrouped_notes(apps, phases))
