"""A robot's loop calls `send` at 1 kHz and must not wait, whatever the network does.

That is kept by construction: `send` calls nothing of the transport, and no lock that it takes is held while
somebody calls the transport. How long it takes under real faults is measured by `make faults`.
"""

import os
import sys
import threading
from contextlib import contextmanager

import pytest

from caesura_clients.bridge import Bridge, BridgeSettings
from caesura_protocol.codec import unpack_samples
from caesura_protocol.keys import ReplayRange, replay_parameters, station_key
from clients.examples import LiveSource, samples
from clients.fake_service import FakeService, eventually

QUICK = BridgeSettings(retry_s=0.02, heartbeat_s=0.05, tick_s=0.005, max_latency_s=0.02)
DEADLINE_S = 30.0


class StuckTransport:
    """A transport whose puts and answers stand still while `stuck`, and which knows who has called it."""

    def __init__(self, transport):
        self.callers = set()
        self.standing = threading.Semaphore(0)  # one for each call that has come to a stand
        self.free = threading.Event()
        self.free.set()
        self._transport = transport
        self.endpoint = transport.endpoint

    def put(self, *args, **options):
        self._called()
        self._transport.put(*args, **options)

    def query(self, *args, **options):
        self._called()
        return self._transport.query(*args, **options)

    @contextmanager
    def answer(self, key, inbox):
        with self._transport.declare_queryable(key, CallingBackInbox(inbox, self._called)):
            yield

    def __getattr__(self, name):
        return getattr(self._transport, name)

    def _called(self):
        self.callers.add(threading.current_thread())
        if not self.free.is_set():
            self.standing.release()
            assert self.free.wait(DEADLINE_S)


class CallingBackInbox:
    """An inbox whose questions call back before each reply."""

    def __init__(self, inbox, called):
        self._inbox = inbox
        self._called = called

    def offer(self, question):
        reply = question.reply

        def calling(*args):
            self._called()
            reply(*args)

        question.reply = calling
        self._inbox.offer(question)


def a_loop(bridge, cycles, t0=0.0):
    """One sample a call, in a thread of its own; False where it hangs."""
    rows = samples(cycles, t0=t0)
    loop = threading.Thread(target=lambda: [bridge.send(rows[i : i + 1]) for i in range(cycles)], daemon=True)
    loop.start()
    loop.join(DEADLINE_S)
    return not loop.is_alive()


@pytest.fixture
def stuck(memory):
    return StuckTransport(memory.transport())


def test_send_calls_nothing_of_the_network(memory, stuck):
    with FakeService(memory.transport()) as service, Bridge(stuck, "cell-1", LiveSource()) as bridge:
        bridge.wait_open(DEADLINE_S)
        for start in range(10):
            bridge.send(samples(100, t0=start / 10))
        eventually(lambda: service.rows() == 1000)
    assert threading.current_thread() not in stuck.callers


def test_send_goes_on_while_a_put_stands_still_and_nothing_is_lost(memory, stuck):
    with (
        FakeService(memory.transport()) as service,
        Bridge(stuck, "cell-1", LiveSource(), settings=QUICK) as bridge,
    ):
        bridge.wait_open(DEADLINE_S)
        stuck.free.clear()
        bridge.send(samples(20))
        assert stuck.standing.acquire(timeout=DEADLINE_S)
        assert a_loop(bridge, 200, t0=0.02)
        assert bridge.sent == 11
        stuck.free.set()
        assert bridge.finish().next_seq == 11
    assert [row for batch in service.batches for row in unpack_samples(batch)[:, 0]] == pytest.approx(
        samples(220)[:, 0]
    )


def test_send_goes_on_while_a_replay_stands_still(memory, stuck):
    with Bridge(stuck, "cell-1", LiveSource(), settings=QUICK) as bridge:
        bridge.send(samples(200))
        eventually(lambda: bridge.sent == 10)
        stuck.free.clear()
        wanted = replay_parameters(ReplayRange(0, 9, 10))
        asking = threading.Thread(
            target=lambda: memory.transport().query(station_key("cell-1", "replay"), parameters=wanted),
            daemon=True,
        )
        asking.start()
        assert stuck.standing.acquire(timeout=DEADLINE_S)
        assert a_loop(bridge, 200, t0=0.2)
        stuck.free.set()
        asking.join(DEADLINE_S)


def test_send_goes_on_while_batches_are_sent_again_and_while_the_session_is_opened(memory, stuck):
    with FakeService(memory.transport()) as service, Bridge(stuck, "cell-1", LiveSource()) as bridge:
        bridge.wait_open(DEADLINE_S)
        service.hold = True
        bridge.send(samples(200))
        stuck.free.clear()
        for call in (lambda: bridge._sender.resend(0, 64), bridge._open_and_announce):
            thread = threading.Thread(target=call, daemon=True)
            thread.start()
            assert stuck.standing.acquire(timeout=DEADLINE_S)
        assert a_loop(bridge, 200, t0=0.2)
        stuck.free.set()
        thread.join(DEADLINE_S)


on_linux = pytest.mark.skipif(sys.platform != "linux", reason="threads have no priorities of their own")


class ThreadScheduling:
    """The scheduling of the system's threads, by native id; 0 is the calling thread."""

    def __init__(self, monkeypatch, policy, priority, refusal=None):
        self.of = {0: (policy, priority)}
        self.refusal = refusal
        monkeypatch.setattr(os, "sched_getscheduler", lambda thread: self.of[thread][0])
        monkeypatch.setattr(os, "sched_getparam", lambda thread: os.sched_param(self.of[thread][1]))
        monkeypatch.setattr(os, "sched_setscheduler", self.set)

    def set(self, thread, policy, param):
        if self.refusal is not None:
            raise self.refusal
        self.of[thread] = policy, param.sched_priority


def sent_with(memory):
    """Send samples; return the native ids of the bridge's threads."""
    with FakeService(memory.transport()), Bridge(memory.transport(), "cell-1", LiveSource()) as bridge:
        bridge.wait_open(DEADLINE_S)
        bridge.send(samples(20))
        bridge.send(samples(20, t0=0.02))
        return {one.native_id for one in threading.enumerate() if "cell-1" in one.name}


@on_linux
@pytest.mark.parametrize(("priority", "shared"), [(10, 9), (1, 1)])
def test_the_threads_of_a_bridge_have_a_priority_just_below_that_of_the_loop(
    memory, monkeypatch, priority, shared
):
    """Without one they held the interpreter's lock for 24 ms while the machine ran other processes."""
    scheduling = ThreadScheduling(monkeypatch, os.SCHED_FIFO, priority)
    threads = sent_with(memory)
    assert len(threads) == 3
    assert scheduling.of == {0: (os.SCHED_FIFO, priority), **dict.fromkeys(threads, (os.SCHED_FIFO, shared))}


@on_linux
def test_a_priority_that_children_of_the_loop_do_not_inherit_is_one(memory, monkeypatch):
    """RealtimeKit gives no other."""
    policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
    scheduling = ThreadScheduling(monkeypatch, policy, 10)
    threads = sent_with(memory)
    assert scheduling.of == {0: (policy, 10), **dict.fromkeys(threads, (policy, 9))}


@on_linux
def test_the_threads_of_a_bridge_keep_their_priority_where_the_loop_has_none(memory, monkeypatch):
    scheduling = ThreadScheduling(monkeypatch, os.SCHED_OTHER, 0)
    assert sent_with(memory)
    assert scheduling.of == {0: (os.SCHED_OTHER, 0)}


@on_linux
def test_a_system_that_refuses_a_priority_is_named_and_the_loop_goes_on(memory, monkeypatch, caplog):
    ThreadScheduling(monkeypatch, os.SCHED_FIFO, 10, PermissionError(1, "Operation not permitted"))
    threads = sent_with(memory)
    assert caplog.text.count("Operation not permitted") == len(threads)


def test_no_thread_takes_the_lock_of_the_robots_loop_before_samples_have_waited(memory):
    with FakeService(memory.transport()), Bridge(memory.transport(), "cell-1", LiveSource()) as bridge:
        sender = bridge._sender
        bridge.send(samples(1))
        with sender._numbering:
            flushing = threading.Thread(target=lambda: sender.flush(older_than_s=3600.0), daemon=True)
            flushing.start()
            flushing.join(DEADLINE_S)
            assert not flushing.is_alive()


def test_what_is_pushed_while_a_bridge_finishes_has_a_number(memory):
    """The age of samples that came after the look at the clock was below 0: they were not flushed."""
    with FakeService(memory.transport()), Bridge(memory.transport(), "cell-1", LiveSource()) as bridge:
        sender, clock = bridge._sender, bridge._sender._clock
        sender.flush()
        before = sender.last_seq

        def clock_of_a_thread_that_is_overtaken():
            now, sender._clock = clock(), clock
            sender.push(samples(1))
            return now

        sender._clock = clock_of_a_thread_that_is_overtaken
        sender.flush()
        assert sender.last_seq == before + 1
