"""The queue of a reader: no station takes another one's place or time in it."""

from __future__ import annotations

import random
import threading
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue

import pytest

from caesura_protocol.transport.inbox import LANES, Inbox, ReceivedSample, TokenChange
from harness.clock import Clock

DEADLINE_S = 10.0


def sample(station: str, number: int = 0, size: int = 0) -> ReceivedSample:
    return ReceivedSample(f"caesura/v1/station/{station}/samples", bytes(size), str(number))


def stations_of(inbox: Inbox) -> list[str]:
    return [item.key.split("/")[3] for item in iter(lambda: inbox.get(0.0), None)]


def test_a_station_that_floods_a_reader_loses_its_own_messages_alone():
    inbox = Inbox(capacity=100)
    for number in range(10_000):
        inbox.offer(sample("flood", number))
        if number % 400 == 0:
            inbox.offer(sample("cell-1", number))
            inbox.offer(sample("cell-2", number))
    read = [*iter(lambda: inbox.get(0.0), None)]
    for station in ("cell-1", "cell-2"):
        assert [int(one.encoding) for one in read if station in one.key] == [*range(0, 10_000, 400)]
    assert [int(one.encoding) for one in read if "flood" in one.key] == [*range(9950, 10_000)]
    assert inbox.dropped == 10_000 - 50


def test_a_station_that_sends_large_messages_loses_its_own_alone():
    inbox = Inbox(capacity_bytes=10_000)
    for number in range(1000):
        inbox.offer(sample("flood", number, 900))
        if number % 100 == 0:
            inbox.offer(sample("cell-1", number, 90))
    assert Counter(stations_of(inbox))["cell-1"] == 10


def test_stations_take_turns_by_the_time_of_the_work_on_their_messages():
    clock = Clock()
    inbox = Inbox(clock=clock)
    for number in range(20):
        inbox.offer(sample("costly", number))
    cost = {"costly": 0.05, "cheap": 0.001}
    waited = []
    for _ in range(200):
        inbox.offer(sample("cheap"))
        began = clock.now
        while (item := inbox.get(0.0)) is not None and "costly" in item.key:
            clock.now += cost["costly"]
        waited.append(clock.now - began)
        clock.now += cost["cheap"]
    assert max(waited) <= cost["costly"] + 1e-9
    assert sum(waited) <= 200 * cost["cheap"] + 2 * cost["costly"]  # half of the time each


def test_a_reader_that_was_suspended_goes_on_with_the_station_that_it_read():
    """It read others alone for as long as it had been suspended, where one of them floods it."""
    clock = Clock()
    inbox = Inbox(clock=clock)
    for number in range(3):
        inbox.offer(sample("cell-1", number))
    inbox.get(0.0)
    clock.now += 60.0
    read = []
    for number in range(100):
        inbox.offer(sample("flood", number))
        item = inbox.get(0.0)
        assert item is not None
        read.append(item.key)
        clock.now += 0.05
    assert sum("cell-1" in key for key in read) == 2


def test_a_station_without_messages_earns_no_credit():
    clock = Clock()
    inbox = Inbox(clock=clock)
    for _ in range(100):
        inbox.offer(sample("busy"))
        inbox.get(0.0)
        clock.now += 1.0
    for number in range(4):
        inbox.offer(sample("busy", number))
        inbox.offer(sample("late", number))
    order = []
    while (item := inbox.get(0.0)) is not None:
        order.append(item.key.split("/")[3])
        clock.now += 1.0
    assert max(len(run) for run in "".join(name[0] for name in order).split("b")) <= 2


def test_the_messages_of_a_station_keep_their_order_and_none_is_lost_with_room():
    made = random.Random(7)
    inbox = Inbox(capacity=64)
    sent: dict[str, list[int]] = {}
    read: dict[str, list[int]] = {}
    for number in range(5000):
        name = made.choice("abcdef")
        if len(inbox) < 64 and made.random() < 0.5:
            inbox.offer(sample(name, number))
            sent.setdefault(name, []).append(number)
        elif (item := inbox.get(0.0)) is not None:
            read.setdefault(item.key.split("/")[3], []).append(int(item.encoding))
    for item in iter(lambda: inbox.get(0.0), None):
        read.setdefault(item.key.split("/")[3], []).append(int(item.encoding))
    assert (read, inbox.dropped, len(inbox)) == (sent, 0, 0)


def test_a_full_inbox_never_holds_more_than_it_may_and_counts_every_drop():
    made = random.Random(8)
    inbox = Inbox(capacity=10, capacity_bytes=1000)
    read = 0
    for number in range(3000):
        inbox.offer(sample(made.choice("abc"), number, made.choice((0, 50, 400, 2000))))
        assert 1 <= len(inbox) <= 10
        if made.random() < 0.2:
            read += inbox.get(0.0) is not None
    rest = len(stations_of(inbox))
    assert read + rest + inbox.dropped == 3000


def test_a_token_of_a_station_is_not_lost_to_the_samples_of_another():
    inbox = Inbox(capacity=10)
    token = TokenChange("caesura/v1/station/cell-1/alive", alive=False)
    inbox.offer(token)
    for number in range(100):
        inbox.offer(sample("flood", number))
    assert token in iter(lambda: inbox.get(0.0), None)


def backlog(capacity_bytes: int) -> Inbox:
    """A queue that is half full: eight messages of each of seven stations, and a token."""
    inbox = Inbox(capacity_bytes=capacity_bytes)
    for number in range(8):
        for cell in range(7):
            inbox.offer(sample(f"cell-{cell}", number, 60))
    inbox.offer(TokenChange("caesura/v1/station/cell-9/alive", alive=False))
    return inbox


@pytest.mark.parametrize("size", [9_900, 10_000, 1_000_000])
def test_one_huge_message_costs_other_stations_nothing(size: int):
    inbox = backlog(10_000)
    inbox.offer(sample("flood", 0, size))
    assert (len(inbox), inbox.dropped) == (57, 1)
    assert "flood" not in stations_of(inbox)
    inbox.offer(sample("flood", 1, size))
    assert stations_of(inbox) == ["flood"]  # alone it may be of any size


def test_a_message_of_a_new_station_has_room_among_many_shorter_ones():
    inbox = Inbox(capacity=100)
    for number in range(100):
        inbox.offer(sample(f"s{number}"))
    inbox.offer(sample("cell-1", 0, 1000))
    assert "cell-1" in stations_of(inbox)


def test_names_of_which_everything_was_dropped_take_no_memory_and_no_share():
    inbox = Inbox(capacity=1000, capacity_bytes=100_000)
    for number in range(5 * LANES):
        inbox.offer(sample(f"s{number}", 0, 60_000))  # in the place of the one before
    assert len(inbox._turns) <= 2 * LANES
    for number in range(1000):
        inbox.offer(sample("flood", number))
    for number in range(400):
        inbox.offer(sample("cell-1", number))
    assert Counter(stations_of(inbox))["cell-1"] == 400


def test_a_second_consumer_waits_for_the_messages_of_the_station_that_is_served():
    looks, goes_on = threading.Semaphore(0), threading.Event()

    def clock() -> float:
        looks.release()  # a consumer that has the queue's lock until it waits
        return 0.0

    inbox, taken = Inbox(clock=clock), SimpleQueue[str]()

    def consume() -> None:
        item = inbox.get(DEADLINE_S)
        assert isinstance(item, ReceivedSample)
        taken.put(item.encoding)
        goes_on.wait(DEADLINE_S)

    with ThreadPoolExecutor(2) as pool:
        consumers = [pool.submit(consume) for _ in range(2)]
        try:
            assert all(looks.acquire(timeout=DEADLINE_S) for _ in consumers)
            inbox.offer(sample("cell-1", 1))
            assert taken.get(timeout=DEADLINE_S) == "1"
            inbox.offer(sample("cell-1", 2))  # while the first consumer works
            assert taken.get(timeout=DEADLINE_S) == "2"
        finally:
            goes_on.set()
        for one in consumers:
            one.result()


def test_names_that_come_and_go_take_no_memory():
    inbox = Inbox()
    for number in range(3 * LANES):
        inbox.offer(sample(f"s{number}"))
        inbox.get(0.0)
    assert len(inbox._lanes) <= LANES + 1
    assert len(inbox._turns) <= 1


def test_whatever_comes_no_message_is_forgotten_and_a_station_keeps_its_order():
    made = random.Random(3)
    for _ in range(300):
        clock = Clock()
        inbox = Inbox(made.choice((1, 2, 3, 10, 40)), made.choice((1, 300, 2000, 10**6)), clock=clock)
        stations = [f"s{number}" for number in range(made.choice((1, 2, 5, 30)))]
        newest, read, sent = Counter[str](), 0, 0
        while sent < 100:
            if made.random() < 0.6:
                sent += 1
                inbox.offer(sample(made.choice(stations), sent, made.choice((0, 10, 100, 900, 5000))))
            elif (item := inbox.get(0.0)) is not None:
                assert isinstance(item, ReceivedSample)
                assert int(item.encoding) > newest[item.key]
                newest[item.key], read = int(item.encoding), read + 1
                clock.now += made.choice((0.0, 0.1, 5.0))
            else:
                assert not len(inbox)
        assert sent == read + len(inbox) + inbox.dropped
        assert len(stations_of(inbox)) == sent - read - inbox.dropped
