"""The table of moves."""

from itertools import product
from typing import get_args

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_service.publishing.lifecycle import MOVES, Move, State, after


@pytest.mark.parametrize(("state", "move"), list(product(get_args(State), get_args(Move))))
def test_a_move_leads_where_the_table_says_or_is_a_conflict_that_names_the_alternatives(state, move):
    if (state, move) in MOVES:
        assert after(state, move) == MOVES[state, move]
        return
    with pytest.raises(ProtocolError) as caught:
        after(state, move)
    assert caught.value.code == "conflict"
    assert caught.value.value == move
    assert caught.value.expected == [allowed for known, allowed in MOVES if known == state]


def test_nothing_leaves_the_end():
    assert {after for (state, _), after in MOVES.items() if state != "open"} == {"closed", "failed"}
