"""The table of moves."""

from itertools import product
from typing import get_args

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_service.publishing.lifecycle import TRANSITIONS, Lifecycle, LifecycleEvent, next_state


@pytest.mark.parametrize(("state", "move"), list(product(get_args(Lifecycle), get_args(LifecycleEvent))))
def test_a_move_leads_where_the_table_says_or_is_a_conflict_that_names_the_alternatives(state, move):
    if (state, move) in TRANSITIONS:
        assert next_state(state, move) == TRANSITIONS[state, move]
        return
    with pytest.raises(ProtocolError) as caught:
        next_state(state, move)
    assert caught.value.code == "conflict"
    assert caught.value.value == move
    assert caught.value.expected == [allowed for known, allowed in TRANSITIONS if known == state]


def test_nothing_leaves_the_end():
    assert {after for (state, _), after in TRANSITIONS.items() if state != "open"} == {"closed", "failed"}
