"""The queue before the worker: what it drops, and what it does not."""

from __future__ import annotations

import pytest

from caesura_service.server.work_queue import SOURCES, WHOLE, QueueSettings, WorkQueue


def inbox_of(capacity: int = 10, capacity_bytes: int = 1000, shares: int = 1) -> WorkQueue[int]:
    return WorkQueue(QueueSettings(capacity, capacity_bytes, shares))


def test_items_come_out_in_the_order_in_which_they_went_in():
    inbox = inbox_of()
    assert inbox.offer(1, "a")
    assert inbox.put(2)
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
    assert [inbox.put(item) for item in range(3)] == [True, True, False]
    inbox.put_unbounded(9)
    assert inbox.dropped == 1
    assert len(inbox) == 5


def test_what_was_taken_out_leaves_nothing_behind():
    inbox = inbox_of(4, 100, shares=2)
    for source in ("a", "b", "c"):
        inbox.offer(1, source, 10)
    while inbox.get(0.0):
        pass
    assert {(load.items, load.size) for load in inbox._of_source.values()} == {(0, 0)}
    assert (inbox._total.size, inbox.fill_ratio(), inbox.overloaded_sources) == (0, 0.0, frozenset())


def test_a_waiting_reader_can_be_woken():
    inbox = inbox_of()
    inbox.wake()
    assert inbox.get(60.0) is None


def taken(inbox: WorkQueue[int], *, spent_s: dict[int, float]) -> list[int]:
    """Everything, as it has its turn, if the work on an item takes so long."""
    order = []
    while (item := inbox.get(0.0)) is not None:
        order.append(item)
        inbox.charge(spent_s.get(item, 0.001))
    return order


def test_the_lane_that_has_used_least_is_next_and_within_one_nothing_overtakes():
    inbox = inbox_of()
    for item in (10, 11, 12):
        inbox.offer(item, "dense")
    for item in (20, 21, 22):
        inbox.offer(item, "honest")
    assert taken(inbox, spent_s={10: 0.2, 11: 0.2}) == [10, 20, 21, 22, 11, 12]


def test_a_lane_that_has_had_little_more_than_others_is_served_in_order_of_arrival():
    inbox = inbox_of()
    for item in (10, 11, 12):
        inbox.offer(item, "busy")
    for item in (20, 21, 22):
        inbox.offer(item, "calm")
    assert taken(inbox, spent_s={10: 0.05, 11: 0.06}) == [10, 20, 11, 21, 22, 12]


def test_a_lane_that_was_idle_waits_for_no_work_that_was_done_before_and_has_no_claim_to_it():
    inbox = inbox_of()
    inbox.offer(10, "dense")
    assert taken(inbox, spent_s={10: 5.0}) == [10]
    inbox.offer(11, "dense")
    inbox.get(0.0)
    inbox.charge(5.0)
    for item in (20, 21, 22):
        inbox.offer(item, "late", lane="late")
    inbox.offer(12, "dense")
    assert taken(inbox, spent_s={20: 3.0, 21: 3.0}) == [20, 21, 12, 22]


def test_samples_and_commands_of_a_station_share_a_lane_and_what_is_put_back_is_its_next():
    inbox = inbox_of()
    inbox.offer(1, "a/samples", lane="a")
    inbox.offer(2, "a", lane="a")
    assert inbox.put_command(3, "a")
    assert inbox.get(0.0) == 1
    inbox.put_back(9)
    assert (len(inbox), taken(inbox, spent_s={})) == (3, [9, 2, 3])


def test_what_stands_aside_waits_until_no_other_lane_has_a_turn():
    inbox = inbox_of()
    for lane in ("a", "b"):
        inbox.offer(1, lane)
        inbox.get(0.0)
        inbox.put_back(10 if lane == "a" else 20, stands_aside=True)
    inbox.offer(2, "c")
    inbox.offer(3, "d")
    assert [inbox.get(0.0), inbox.get(0.0)] == [2, 3]
    assert [inbox.get(0.0), inbox.get(0.0)] == [10, 20], "in the order in which they stood aside"
    assert (inbox.get(0.0), len(inbox)) == (None, 0)


def test_what_stands_aside_has_its_turn_once_something_else_arrives_in_its_lane():
    inbox = inbox_of()
    inbox.offer(1, "a")
    inbox.get(0.0)
    inbox.put_back(10, stands_aside=True)
    inbox.offer(2, "b")
    assert inbox.get(0.0) == 2
    inbox.offer(3, "a")
    inbox.offer(4, "c")
    assert [inbox.get(0.0) for _ in range(4)] == [10, 4, 3, None]


def test_behind_what_stands_aside_something_waits_already():
    inbox = inbox_of()
    inbox.offer(1, "a")
    inbox.offer(2, "b")
    inbox.offer(3, "a")
    assert inbox.get(0.0) == 1
    inbox.put_back(10, stands_aside=True)
    assert [inbox.get(0.0) for _ in range(4)] == [2, 10, 3, None]


def test_so_many_commands_of_one_station_wait_and_those_of_another_have_their_own_room():
    inbox: WorkQueue[int] = WorkQueue(QueueSettings(10, commands=2))
    assert [inbox.put_command(item, "a") for item in range(3)] == [True, True, False]
    assert inbox.put_command(4, "b")
    inbox.get(0.0)
    assert inbox.put_command(5, "a")


# --- overload -------------------------------------------------------------------------------------------


def pressed_inbox(*, announced: bool = False) -> WorkQueue[int]:
    """Room for 16 items, 8 of a source; pressed at 10 and 5, relieved at 4 and 2."""
    return WorkQueue(QueueSettings(16, 1600, 2, overloaded_at=0.625, relieved_at=0.25), announced=announced)


def test_a_source_that_fills_its_share_is_pressed_until_most_of_it_is_gone():
    inbox = pressed_inbox()
    for item in range(4):
        inbox.offer(item, "a")
    assert not inbox.overloaded_sources
    assert not inbox.overload_changed.is_set()
    inbox.offer(4, "a")
    assert inbox.is_overloaded("a", "a/samples")
    assert not inbox.is_overloaded("b")
    assert inbox.overload_changed.is_set()
    for left in (4, 3):
        inbox.get(0.0)
        assert inbox.is_overloaded("a"), left
    inbox.get(0.0)
    assert not inbox.overloaded_sources
    assert inbox.revision == 2


def test_bytes_press_like_items():
    inbox = pressed_inbox()
    inbox.offer(1, "a", 499)
    assert not inbox.overloaded_sources
    inbox.offer(2, "a", 1)
    assert inbox.overloaded_sources == {"a"}
    assert inbox.fill_ratio() == pytest.approx(500 / 800)


def test_a_queue_that_ends_in_commands_is_relieved_too():
    inbox = pressed_inbox()
    for source in "aaaabbbbcc":
        inbox.offer(0, source)
    for item in range(6):
        assert inbox.put(item)
    assert inbox.overloaded_sources == {WHOLE}
    while inbox.get(0.0) is not None:
        pass
    assert not inbox.overloaded_sources


def test_a_queue_that_many_fill_is_pressed_as_a_whole_and_so_is_every_sender():
    inbox = pressed_inbox()
    for source in ("a", "b", "c"):
        for item in range(3):
            inbox.offer(item, source)
    assert not inbox.is_overloaded("a")
    inbox.offer(9, "d")
    assert inbox.overloaded_sources == {WHOLE}
    assert inbox.is_overloaded("z")


def test_nothing_is_dropped_before_the_overload_is_announced_and_then_what_is_too_much():
    inbox = pressed_inbox(announced=True)
    assert all(inbox.offer(item, "a") for item in range(8))
    assert all(inbox.offer(item, "a") for item in range(8))  # as much again, while nobody has been told
    assert not inbox.offer(99, "a")  # but no more than that
    for _ in range(8):
        inbox.get(0.0)
    inbox.confirm_announced()
    assert not inbox.offer(99, "a")
    assert inbox.offer(0, "b")
    assert inbox.dropped == 2


def test_every_overload_is_announced_anew():
    inbox = pressed_inbox(announced=True)
    for _ in range(2):
        assert all(inbox.offer(item, "a") for item in range(9))
        inbox.confirm_announced()
        assert not inbox.offer(9, "a")
        while inbox.get(0.0) is not None:
            pass
    assert inbox.dropped == 2


def test_sources_that_come_and_go_are_forgotten():
    inbox: WorkQueue[int] = WorkQueue(QueueSettings())
    for index in range(2 * SOURCES):
        inbox.offer(index, f"source-{index}")
        assert inbox.get(0.0) == index
    assert len(inbox._of_source) <= SOURCES


def test_what_was_dropped_is_reported_by_source_once_and_bounded():
    inbox = pressed_inbox()
    for item in range(11):
        inbox.offer(item, "a")
    for index in range(2 * SOURCES):
        inbox.offer(1, f"big-{index}", 10_000)
    drops = inbox.pop_drops()
    assert drops["a"] == 3
    assert len(drops) == SOURCES
    assert inbox.dropped == 3 + 2 * SOURCES
    assert inbox.pop_drops() == {}


@pytest.mark.parametrize("marks", [(0.5, 0.5), (0.2, 0.4), (1.1, 0.5), (0.5, -0.1)])
def test_marks_that_are_out_of_order_are_refused(marks):
    with pytest.raises(ValueError, match="expected 0 ≤ relieved_at < overloaded_at ≤ 1"):
        QueueSettings(overloaded_at=marks[0], relieved_at=marks[1])
