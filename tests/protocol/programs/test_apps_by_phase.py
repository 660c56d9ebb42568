"""The apps of a phase are a group of the program; a phase without a group is named."""

from __future__ import annotations

from typing import Any

import pytest

from caesura_protocol.messages import Phase
from caesura_protocol.programs.apps_by_phase import groups_of, ungrouped_notes
from harness.programs import app


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
