"""The queue before the worker: what it drops, and what it does not."""

from caesura_service.edge.inbox import Inbox


def test_items_come_out_in_the_order_in_which_they_went_in():
    inbox: Inbox[int] = Inbox(10)
    assert inbox.offer(1, "a")
    assert inbox.insist(2)
    assert inbox.offer(3, "b")
    assert [inbox.get(0.0) for _ in range(4)] == [1, 2, 3, None]


def test_a_full_queue_drops_the_newest_samples_and_counts_them():
    inbox: Inbox[int] = Inbox(2)
    assert [inbox.offer(item, "a") for item in range(4)] == [True, True, False, False]
    assert inbox.dropped == 2
    assert [inbox.get(0.0), inbox.get(0.0), inbox.get(0.0)] == [0, 1, None]


def test_one_source_cannot_take_more_than_its_share():
    inbox: Inbox[str] = Inbox(4, share=2)
    assert [inbox.offer("flood", "a") for _ in range(3)] == [True, True, False]
    assert inbox.offer("other", "b")
    inbox.get(0.0)
    assert inbox.offer("again", "a")


def test_commands_are_taken_when_samples_are_not_until_their_own_room_is_used_up():
    inbox: Inbox[int] = Inbox(2)
    assert [inbox.offer(item, "a") for item in range(3)] == [True, True, False]
    assert [inbox.insist(item) for item in range(3)] == [True, True, False]
    assert inbox.dropped == 1
    assert len(inbox) == 4
