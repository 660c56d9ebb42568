"""The table of moves."""

from itertools import product
from typing import get_args

import pytest

from caesura_clients.refusal_words import refusal_words
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Insert
from caesura_service.publishing.lifecycle_transitions import (
    TRANSITIONS,
    Lifecycle,
    LifecycleEvent,
    next_state,
)


@pytest.mark.parametrize(("state", "move"), list(product(get_args(Lifecycle), get_args(LifecycleEvent))))
def test_a_move_leads_where_the_table_says_or_is_a_conflict_in_words(state, move):
    if (state, move) in TRANSITIONS:
        assert next_state(state, move) == TRANSITIONS[state, move]
        return
    with pytest.raises(ProtocolError, match=f"{state}: it takes no ") as caught:
        next_state(state, move)
    assert caught.value.code == "conflict"


def test_a_refused_correction_names_what_people_can_do_and_no_message_of_a_bridge():
    with pytest.raises(ProtocolError) as caught:
        next_state("failed", "edit")
    assert refusal_words(caught.value, Insert(t=1.0)) == (
        "the session has failed: it takes no corrections, only description and edits of its program"
    )


def test_nothing_leaves_the_end():
    assert {after for (state, _), after in TRANSITIONS.items() if state != "open"} == {"closed", "failed"}
