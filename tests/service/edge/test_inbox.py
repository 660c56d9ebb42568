"""The queue before the worker: what it drops, and what it does not."""

from __future__ import annotations

from caesura_service.edge.inbox import Inbox, QueueSettings


def inbox_of(capacity: int = 10, capacity_bytes: int = 1000, shares: int = 1) -> Inbox[int]:
    return Inbox(QueueSettings(capacity, capacity_bytes, shares))


def test_items_come_out_in_the_order_in_which_they_went_in():
    inbox = inbox_of()
    assert inbox.offer(1, "a")
    assert inbox.insist(2)
    assert inbox.offer(3, "b")
    assert [inbox.get(0.0) for _ in range(4)] == [1, 2, 3, None]


def test_a_full_queue_drops_the_newest_samples_and_counts_them():
    inbox = inbox_of(2)
    assert [inbox.offer(item, "a") for item in range(4)] == [True, True, False, False]
    assert inbox.dropped == 2
    assert [inbox.get(0.0), inbox.get(0.0), inbox.get(0.0)] == [0, 1, None]


def test_a_queue_full_of_bytes_drops_what_does_not_fit_and_takes_what_does():
    inbox = inbox_of(capacity_bytes=100)
    assert [inbox.offer(1, "a", 80), inbox.offer(2, "b", 30), inbox.offer(3, "b", 20)] == [True, False, True]
    inbox.get(0.0)
    assert inbox.offer(4, "b", 80)


def test_one_source_cannot_take_more_than_its_share_of_items_or_of_bytes():
    inbox = inbox_of(4, 100, shares=2)
    assert [inbox.offer(item, "a") for item in range(3)] == [True, True, False]
    assert [inbox.offer(item, "b", 40) for item in range(2)] == [True, False]
    inbox.get(0.0)
    assert inbox.offer(9, "a")


def test_commands_are_taken_when_samples_are_not_until_their_own_room_is_used_up():
    inbox = inbox_of(2)
    assert [inbox.offer(item, "a") for item in range(3)] == [True, True, False]
    assert [inbox.insist(item) for item in range(3)] == [True, True, False]
    inbox.deliver(9)
    assert inbox.dropped == 1
    assert len(inbox) == 5


def test_what_was_taken_out_leaves_nothing_behind():
    inbox = inbox_of(4, 100, shares=2)
    for source in ("a", "b", "c"):
        inbox.offer(1, source, 10)
    while inbox.get(0.0):
        pass
    assert (inbox._of_source, inbox._total) == ({}, (0, 0))


def test_a_waiting_reader_can_be_woken():
    inbox = inbox_of()
    inbox.wake()
    assert inbox.get(60.0) is None
