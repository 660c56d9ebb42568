"""Who lives, as one instance sees it."""

from __future__ import annotations

import pytest

from caesura_service.server.membership import RETURN_S, SETTLE_S, Membership


@pytest.fixture
def seen() -> Membership:
    """By `a`, at 0 s, with `b` and `c` there."""
    membership = Membership("a")
    for other in "bc":
        assert membership.add(other, 0.0)
    return membership


def test_one_that_goes_is_gone_once_it_is_known_that_our_own_link_stands(seen):
    seen.remove("b", 1.0)
    assert seen.members(1.0) == {"a", "b", "c"}
    assert seen.next_change_s(1.0) == 1.0 + SETTLE_S
    assert seen.members(1.0 + SETTLE_S) == {"a", "c"}
    assert seen.add("b", 2.0)


def test_one_that_blinks_was_never_gone(seen):
    seen.remove("b", 1.0)
    assert not seen.add("b", 1.0 + SETTLE_S / 2)
    assert seen.members(9.0) == {"a", "b", "c"}


def test_our_own_token_says_nothing(seen):
    assert not seen.add("a", 1.0)
    seen.remove("a", 1.0)
    assert seen.members(9.0) == {"a", "b", "c"}


@pytest.mark.parametrize("order", [("b", "c", "link"), ("link", "b", "c"), ("b", "link", "c")])
def test_with_our_own_link_no_instance_is_gone_until_there_was_time_to_come_back(seen, order):
    for each in order:
        seen.link_lost() if each == "link" else seen.remove(each, 1.0)
    assert seen.members(60.0) == {"a", "b", "c"}
    assert seen.next_change_s(60.0) == float("inf")
    seen.link_restored(60.0)
    assert not seen.add("b", 60.3)
    assert seen.members(60.0 + RETURN_S) == {"a", "b"}
    assert seen.add("c", 70.0)


def test_a_link_that_is_lost_late_still_counts_for_instances_that_are_not_missed_yet(seen):
    seen.remove("b", 1.0)
    seen.link_lost()  # told after SETTLE_S, but before anybody asked for the members
    assert seen.members(1.0 + 2 * SETTLE_S) == {"a", "b", "c"}


def test_a_link_that_is_lost_again_starts_anew(seen):
    seen.link_lost()
    seen.link_restored(1.0)
    seen.link_lost()
    seen.link_restored(2.0)
    assert seen.members(1.5 + RETURN_S) == {"a", "b", "c"}
    assert seen.members(2.0 + RETURN_S) == {"a"}


def test_who_was_there_before_we_watched_counts_until_it_would_have_been_seen():
    membership = Membership("a")
    membership.begin({"a", "b", "c"})
    assert membership.members(100.0) == {"a", "b", "c"}
    membership.start_watching(100.0)
    assert not membership.add("b", 100.1)  # nobody new
    assert membership.members(100.0 + RETURN_S) == {"a", "b"}
