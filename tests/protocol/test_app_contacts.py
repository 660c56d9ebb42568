"""Which apps a contact ends, by their kind and by what was felt at the next one."""

from __future__ import annotations

import pytest

from caesura_protocol.app_contacts import ends_in_contact
from caesura_protocol.messages import Vector
from harness.programs import app

PLACE = (0.4, 0.0, 0.2)
FELT: Vector = (0.0, 0.0, -2.0)


@pytest.mark.parametrize(
    ("kind", "following", "felt", "ends"),
    [
        ("move_to_contact", None, None, True),
        ("cartesian_motion", "gripper_move", FELT, False),
        ("transport", "apply_force", None, True),
        ("transport", "gripper_move", FELT, True),
        ("hold", "gripper_move", FELT, True),
        ("transport", "gripper_move", None, False),
        ("hold", "gripper_move", None, False),
        ("transport", "cartesian_motion", None, False),
        ("transport", None, None, False),
    ],
)
def test_a_contact_ends_a_carry_where_it_was_felt(
    kind: str, following: str | None, felt: Vector | None, ends: bool
) -> None:
    after = None if following is None else app(following, 2.0, 3.0, PLACE, force_taught=felt)
    assert ends_in_contact(app(kind, 0.0, 2.0, PLACE), after) is ends
