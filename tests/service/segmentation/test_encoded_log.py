"""What is packed away reads as what was kept as it was."""

from unittest import mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from caesura_protocol.codec import encode
from caesura_protocol.messages import Changepoint, Changepoints, Snapshot
from caesura_service.publishing.state_updates import first_difference
from caesura_service.segmentation.encoded_log import EncodedMessageLog, MessageSequence, alike


def changepoint(t: float) -> Changepoint:
    return Changepoint(t=t, probability=0.1, certainty="final", t_low=t - 0.1, t_high=None)


def shown_of(every: list[Changepoint], packed: int, first: int = 0) -> MessageSequence[Changepoint]:
    kept = EncodedMessageLog(Changepoint)
    kept.extend(every[:packed])
    return MessageSequence(kept, every[packed:], first=first)


@given(
    st.lists(st.floats(allow_nan=False, allow_infinity=False).map(changepoint), max_size=6),
    st.integers(0, 6),
    st.integers(0, 1),
    st.slices(8),
    st.integers(-8, 8),
)
def test_it_is_the_sequence_that_it_was(
    every: list[Changepoint], packed: int, first: int, some: slice, one: int
):
    shown, plain = shown_of(every, packed, first), tuple(every[first:])
    assert (len(shown), tuple(shown), shown[some]) == (len(plain), plain, plain[some])
    assert shown == plain
    assert plain == shown
    if -len(plain) <= one < len(plain):
        assert shown[one] == plain[one]
    else:
        with pytest.raises(IndexError):
            shown[one]


def test_what_a_view_shows_stays_as_more_is_packed():
    every = [changepoint(float(i)) for i in range(6)]
    kept = EncodedMessageLog(Changepoint)
    kept.extend(every[:2])
    before = MessageSequence(kept, every[2:4], first=1)
    kept.extend(every[2:4])
    after = MessageSequence(kept, every[4:], first=1)
    assert tuple(before) == tuple(every[1:4])
    assert tuple(after) == tuple(every[1:])


@given(st.integers(0, 4), st.integers(0, 4), st.integers(0, 1))
def test_what_is_kept_goes_over_the_wire_without_being_read(count: int, packed: int, first: int):
    every = [changepoint(float(i)) for i in range(count)]
    shown, plain = shown_of(every, min(packed, count), first), tuple(every[first:])
    message = Changepoints(
        station="a", session="b", instance="c", epoch=1, seq=0, t=0.0, first=0, changepoints=()
    )
    wrapped = [message.model_copy(update={"changepoints": known}) for known in (shown, plain)]
    with mock.patch.object(EncodedMessageLog, "read", side_effect=AssertionError("was read")):
        assert encode(wrapped[0]) == encode(wrapped[1])
    outer = [Snapshot.model_construct(changepoints=within) for within in wrapped]
    assert encode(outer[0]) == encode(outer[1])


@given(st.integers(0, 5), st.integers(0, 5), st.integers(0, 6))
def test_two_differ_where_they_would_unpacked(packed: int, more: int, changed: int):
    old = [changepoint(float(i)) for i in range(6)]
    new = [*old[:changed], *map(changepoint, (20.0, 21.0))] if changed < 6 else old
    kept = EncodedMessageLog(Changepoint)
    kept.extend(old[: min(packed, changed)])
    before = MessageSequence(kept, old[len(kept) :])
    known = len(kept)
    kept.extend(new[known : known + min(more, max(changed - known, 0))])
    after = MessageSequence(kept, new[len(kept) :])
    assert alike(before, after) == known
    assert first_difference(before, after) == first_difference(tuple(old), tuple(new))
    assert first_difference(before, after) == (None if changed == 6 else changed)


def test_only_what_is_packed_is_known_to_be_alike():
    every = [changepoint(float(i)) for i in range(4)]
    assert alike(shown_of(every, 2), shown_of(every, 2)) == 2
    assert alike(shown_of(every, 2), shown_of([every[1], *every[1:]], 2)) == 0
    assert alike(shown_of(every, 0), shown_of(every, 2)) == 0
    assert shown_of(every, 2) == shown_of(every, 3)
    assert shown_of(every, 2) != shown_of(every[:3], 2)
