"""A long message comes out of its pieces as it went in, whatever happens to them on the way."""

import random

import pytest

from caesura_protocol import fragments
from caesura_protocol.codec import Encoded, decode, encode, encoding_of
from caesura_protocol.errors import ProtocolError
from caesura_protocol.fragments import Reassembler, fragment
from caesura_protocol.messages import (
    MAX_MESSAGE_BYTES,
    MAX_WHOLE_BYTES,
    PIECE_BYTES,
    Changepoint,
    Changepoints,
    Piece,
)

KEY = "caesura/v1/station/cell-1/program"
BYTES = 75  # of a changepoint
LONG = 3 * MAX_MESSAGE_BYTES // BYTES  # three messages' worth


def changepoints(length: int, seq: int = 0) -> Changepoints:
    head = {"station": "cell-1", "session": "s1", "instance": "caesura-0", "epoch": 1, "seq": seq, "t": 0.0}
    return Changepoints(
        **head, first=0, changepoints=(Changepoint(t=1.5, probability=0.9, certainty="final"),) * length
    )


def joined(joining: Reassembler, parts: list[Encoded]) -> list[Encoded]:
    return [whole for part in parts if (whole := joining.add(KEY, part)) is not None]


def test_what_fits_into_a_message_goes_as_it_always_did():
    short = changepoints(10)
    (only,) = fragment(short)
    assert only == encode(short)
    assert Reassembler().add(KEY, only) == only


def test_what_does_not_fit_goes_in_pieces_that_do():
    long = changepoints(LONG)
    with pytest.raises(ProtocolError, match="too_large"):
        encode(long)
    parts = [*fragment(long)]
    assert all(len(part.payload) < MAX_MESSAGE_BYTES for part in parts)
    assert {part.encoding for part in parts} == {encoding_of(Piece)}
    ((payload, encoding),) = joined(Reassembler(), parts)
    assert decode(payload, encoding, Changepoints, limit=MAX_WHOLE_BYTES) == long


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_order_doubles_and_another_message_between_do_not_matter(seed: int):
    one, other = changepoints(LONG, 1), changepoints(LONG, 2)
    parts = [*fragment(one), *fragment(other), *fragment(one)]
    random.Random(seed).shuffle(parts)
    joining = Reassembler()
    found = [decode(*whole, Changepoints, limit=MAX_WHOLE_BYTES).seq for whole in joined(joining, parts)]
    assert {1, 2} <= {*found}


def test_a_message_that_lacks_a_piece_is_never_delivered_and_makes_room_for_newer_ones():
    joining = Reassembler()
    for seq in range(10):
        assert joined(joining, [*fragment(changepoints(LONG, seq))][1:]) == []
        assert joining.unfinished == min(seq + 1, fragments.UNFINISHED)
    assert len(joined(joining, [*fragment(changepoints(LONG, 10))])) == 1


def test_pieces_on_many_keys_have_one_bound(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(fragments, "HELD_BYTES", 10 * PIECE_BYTES)
    joining, (first, *rest) = Reassembler(), [*fragment(changepoints(LONG))]
    for number in range(50):
        assert joining.add(f"{KEY}-{number}", first) is None
        assert joining.add(f"{KEY}-{number}", first) is None
        assert joining.held_bytes <= 10 * PIECE_BYTES
    assert joining.unfinished == 9
    assert len([whole for part in rest if (whole := joining.add(f"{KEY}-49", part))]) == 1
    assert 0 < joining.unfinished < 9


def test_what_is_too_long_even_for_pieces_is_refused_with_the_limit(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(fragments, "MAX_WHOLE_BYTES", 2 * MAX_MESSAGE_BYTES)
    with pytest.raises(ProtocolError) as caught:
        [*fragment(changepoints(LONG))]
    assert (caught.value.code, caught.value.limit) == ("too_large", 2 * MAX_MESSAGE_BYTES)


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"number": 2}, "malformed"),
        ({"count": 0}, "malformed"),
        ({"count": MAX_WHOLE_BYTES // PIECE_BYTES + 1}, "malformed"),
        ({"payload": b"\0" * (PIECE_BYTES + 1)}, "malformed"),
    ],
)
def test_a_piece_that_cannot_be_is_refused(fields: dict[str, object], code: str):
    sound = {"encoding": encoding_of(Changepoints), "whole": 1, "number": 0, "count": 2, "payload": b""}
    with pytest.raises(ProtocolError) as caught:
        Reassembler().add(KEY, encode(Piece.model_construct(**sound | fields)))
    assert caught.value.code == code


def test_nothing_but_pieces_may_be_long():
    with pytest.raises(ProtocolError, match="too_large"):
        Reassembler().add(KEY, Encoded(b"\0" * (MAX_MESSAGE_BYTES + 1), encoding_of(Changepoints)))
