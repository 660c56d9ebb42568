"""Nothing is lost between a robot and the service: losses, restarts, late services and early ends."""

import threading
from contextlib import ExitStack
from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest

from caesura_clients.bridge import Bridge, BridgeSettings, new_session_name
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.bridge.sources.paced_source import FAST
from caesura_protocol.errors import CaesuraError, ProtocolError, SourceError, Unreachable
from caesura_protocol.keys import NAME_PATTERN, station_key
from caesura_protocol.messages import Description
from caesura_protocol.programs.safety import CellSettings
from clients.bridging import QUICK, REPLAY_KEY, Losing, assert_everything_arrived, file_source, replayed
from clients.examples import LiveSource, samples
from clients.fake_service import FakeService, eventually


def test_every_sample_arrives_once_and_in_order(network):
    source = file_source(1010)
    with FakeService(network.transport()) as service, Bridge(network.transport(), "cell-1", source) as bridge:
        ack = bridge.run()
    assert (ack.state, ack.next_seq, bridge.sent, bridge.acknowledged) == ("closed", 51, 51, 51)
    assert_everything_arrived(service, source)
    assert service.batches[-1].n == 10


def test_the_service_receives_what_the_source_is(memory):
    source = file_source(20)
    with (
        FakeService(memory.transport()) as service,
        Bridge(memory.transport(), "cell-1", source, session="mine", epoch=3, preset="people") as bridge,
    ):
        bridge.run()
    opening = service.openings[0]
    assert (opening.session, opening.epoch, opening.preset) == ("mine", 3, "people")
    assert opening.columns == source.columns
    assert (opening.wrench_source, opening.force_frame, opening.length_unit) == ("flange_sensor", "base", "m")


@pytest.mark.parametrize("stated", [None, Description(task="wipe", tags=("dry",))])
def test_a_recording_that_is_played_keeps_its_description_where_nothing_else_is_stated(memory, stated):
    of_file = Description(task="press", operator="Ann", tags=("wet",), success=False)
    played = FileSource(replace(file_source(20).recording, description=of_file), pace=FAST)
    bridge = Bridge(memory.transport(), "cell-1", played, session="mine", description=stated)
    with FakeService(memory.transport()) as service, bridge:
        bridge.run()
    kept = of_file if stated is None else of_file.model_copy(update={"task": "wipe", "tags": ("dry",)})
    assert service.openings[0].description == kept


@pytest.mark.parametrize(
    "lost",
    [{0}, {7}, {3, 4, 5, 20}, set(range(0, 50, 2)), {49}, {48, 49}, set(range(50))],
    ids=lambda lost: str(sorted(lost)),  # a set is in another order where its module comes from a .pyc
)
def test_lost_batches_are_asked_for_and_sent_again(memory, lost):
    memory.lose = Losing(*lost)
    source = file_source(1000)
    with (
        FakeService(memory.transport()) as service,
        Bridge(memory.transport(), "cell-1", source, settings=QUICK) as bridge,
    ):
        assert bridge.run().next_seq == 50
    assert_everything_arrived(service, source)


def test_a_lost_tail_is_determined_by_the_heartbeat_while_the_robot_rests(memory):
    memory.lose = Losing(2)
    with (
        FakeService(memory.transport()) as service,
        Bridge(memory.transport(), "cell-1", LiveSource(), settings=QUICK) as bridge,
    ):
        bridge.wait_open(30.0)
        bridge.send(samples(60))
        eventually(lambda: service.next_seq == 3)
    assert service.beats[-1].seq == 2


def test_a_source_that_reads_its_pose_seldom_is_named(memory):
    t = np.arange(1000) / 100.0
    x = 0.1 * np.floor(t * 7.0) / 7.0
    source = LiveSource([np.column_stack([t, x, x, x])])
    with FakeService(memory.transport()), Bridge(memory.transport(), "cell-1", source) as bridge:
        bridge.wait_open(30.0)
        assert bridge.slow_pose is None
        bridge.run()
        assert "about 7.1 times a second" in bridge.slow_pose


def test_a_service_that_ignores_which_way_is_up_is_named(memory):
    settings = BridgeSettings(reopen_s=0.02, retry_s=0.02, setting=CellSettings(up=(0.0, 0.0, -1.0)))
    with (
        FakeService(memory.transport()) as service,
        Bridge(memory.transport(), "cell-1", LiveSource(), session="s1", settings=settings) as bridge,
    ):
        bridge.wait_open(30.0)
        assert bridge.ignored_up is None
        service.reads_up = False  # another instance takes over, which is older
        eventually(lambda: bridge.ignored_up is not None)
    assert bridge.ignored_up == (
        "the service ignores that up is 0,0,-1: it is an older version, or was when s1 began. "
        "There loads weigh against z. Update the service and teach this again"
    )


@pytest.mark.parametrize("up", [None, (0.0, 0.0, 1.0)])
def test_an_older_service_has_nothing_to_ignore_where_the_base_is_upright(memory, up):
    settings = BridgeSettings(setting=CellSettings(up=up))
    with FakeService(memory.transport()) as service:
        service.reads_up = False
        with Bridge(memory.transport(), "cell-1", LiveSource(), settings=settings) as bridge:
            bridge.wait_open(30.0)
            assert bridge.ignored_up is None


def test_a_batch_that_does_not_fill_goes_after_a_while(memory):
    now_s = [0.0]
    with (
        FakeService(memory.transport()) as service,
        Bridge(memory.transport(), "cell-1", LiveSource(), clock=lambda: now_s[0]) as bridge,
    ):
        bridge.wait_open(30.0)
        bridge.send(samples(3))
        now_s[0] = 0.9 * bridge.settings.max_latency_s
        assert bridge.sent == 0
        now_s[0] = bridge.settings.max_latency_s
        eventually(lambda: service.rows() == 3)


def test_a_service_that_lost_the_session_unnoticed_is_sent_it_again(memory):
    settings = BridgeSettings(reopen_s=0.02, retry_s=0.02, heartbeat_s=60.0)
    with (
        FakeService(memory.transport()) as service,
        Bridge(memory.transport(), "cell-1", LiveSource(), settings=settings) as bridge,
    ):
        bridge.wait_open(30.0)
        bridge.send(samples(100))
        eventually(lambda: service.next_seq == 5)
        service.openings.clear()
        service.batches.clear()
        eventually(lambda: bool(service.openings) and service.next_seq == 5)


def test_a_file_waits_for_a_service_that_comes_later(network):
    source, acks = file_source(100), []
    with Bridge(network.transport(), "cell-1", source, settings=QUICK) as bridge:
        thread = threading.Thread(target=lambda: acks.append(bridge.run()), daemon=True)
        thread.start()
        with pytest.raises(Unreachable, match=f"cell-1/{bridge.session}"):
            bridge.wait_open(0.05)
        assert bridge.sent == 0
        with FakeService(network.transport()) as service:
            thread.join(30.0)
    assert acks[0].state == "closed"
    assert_everything_arrived(service, source)


def test_a_live_robot_does_not_wait_and_its_past_is_sent_when_a_service_comes(network):
    with Bridge(network.transport(), "cell-1", LiveSource(), settings=QUICK) as bridge:
        for start in range(10):
            bridge.send(samples(100, t0=start / 10))
        assert bridge.sent == 50
        with FakeService(network.transport()) as service:
            eventually(lambda: service.next_seq == 50)
            assert bridge.finish().state == "closed"


@pytest.mark.parametrize("journal", [True, False], ids=["with a journal", "without a journal"])
def test_a_restarted_service_is_sent_the_session_again_and_misses_nothing(network, journal):
    with Bridge(network.transport(), "cell-1", LiveSource(), settings=QUICK) as bridge:
        with FakeService(network.transport()) as first:
            bridge.wait_open(30.0)
            bridge.send(samples(400))
            eventually(lambda: first.next_seq == 20)
        bridge.send(samples(400, t0=0.4))
        second = FakeService(network.transport(), "fake-2")
        second.batches = list(first.batches) if journal else []
        with second:
            eventually(lambda: second.next_seq == 40)
            bridge.send(samples(400, t0=0.8))
            assert bridge.finish().next_seq == 60
    assert second.openings[0] == first.openings[0]


def test_a_restarted_router_costs_no_sample(router):
    with (
        FakeService(router.transport()) as service,
        Bridge(router.transport(), "cell-1", LiveSource(), settings=QUICK) as bridge,
    ):
        bridge.wait_open(30.0)
        bridge.send(samples(200))
        eventually(lambda: service.next_seq == 10)
        router.stop()
        bridge.send(samples(200, t0=0.2))
        router.start()
        bridge.send(samples(200, t0=0.4))
        eventually(lambda: service.next_seq == 30)
        assert bridge.finish().state == "closed"


@pytest.mark.parametrize("can_wait", [True, False])
def test_a_refused_session_is_raised_to_the_sender(network, can_wait):
    service = FakeService(network.transport())
    service.refuse = ProtocolError("forbidden", "not your station", value="cell-1")
    source = LiveSource([samples(10)])
    source.can_wait = can_wait
    with service, Bridge(network.transport(), "cell-1", source, settings=QUICK) as bridge:
        if not can_wait:
            with pytest.raises(ProtocolError):
                bridge.wait_open(30.0)
        with pytest.raises(ProtocolError, match="not your station"):
            bridge.run()


@pytest.mark.parametrize("code", ["overloaded", "internal"])
def test_a_service_that_cannot_now_is_asked_again(memory, code):
    service = FakeService(memory.transport())
    service.refuse = ProtocolError(code, "later")
    with service, Bridge(memory.transport(), "cell-1", file_source(100), settings=QUICK) as bridge:
        with pytest.raises(Unreachable):
            bridge.wait_open(0.1)
        eventually(lambda: bridge.postponed == "later")
        with pytest.raises(Unreachable, match="later"):
            bridge.wait_open(0.1)
        service.refuse = None
        assert bridge.run().next_seq == 5


def test_a_source_that_can_wait_never_has_more_than_a_window_under_way(memory):
    settings = BridgeSettings(window_batches=16, tick_s=0.005, ring_span_s=0.1, stall_s=0.05)
    source = file_source(2000)
    with FakeService(memory.transport()) as service, ExitStack() as stack:
        bridge = stack.enter_context(Bridge(memory.transport(), "cell-1", source, settings=settings))
        bridge.wait_open(30.0)
        service.hold = True
        thread = threading.Thread(target=bridge.run, daemon=True)
        thread.start()
        eventually(lambda: bridge.sent == 16)
        openings = len(service.openings)
        eventually(lambda: len(service.openings) > openings + 10)
        assert bridge.sent == 16
        assert memory.transport().query(REPLAY_KEY, parameters="from=0;to=99;max=99").refusals == ()
        service.hold = False
        thread.join(30.0)
    assert_everything_arrived(service, source)
    assert service.refusals == []


def test_a_late_batch_beside_a_full_window_evicts_nothing(memory):
    settings = BridgeSettings(window_batches=4, tick_s=0.005, ring_span_s=0.001, max_latency_s=0.02)
    source = LiveSource([samples(30, t0=0.07), samples(150, t0=0.1)])
    source.can_wait = True
    with FakeService(memory.transport()) as service, ExitStack() as stack:
        bridge = stack.enter_context(Bridge(memory.transport(), "cell-1", source, settings=settings))
        bridge.wait_open(30.0)
        service.hold = True
        bridge.send(samples(70))
        eventually(lambda: bridge.sent == 4)
        thread = threading.Thread(target=bridge.run, daemon=True)
        thread.start()
        eventually(lambda: bridge.sent == 5)
        assert len(replayed(memory.transport(), 0, 4).replies) == 5
        service.hold = False
        thread.join(30.0)
    assert service.rows() == 250


def test_what_a_waiting_bridge_lost_is_sent_again_without_being_asked(memory):
    settings = BridgeSettings(window_batches=8, tick_s=0.005, stall_s=0.02, heartbeat_s=60.0)
    memory.lose = Losing(2, *range(8, 12))
    source = file_source(400)
    with (
        FakeService(memory.transport()) as service,
        Bridge(memory.transport(), "cell-1", source, settings=settings) as bridge,
    ):
        service.asks = False
        bridge.run()
    assert_everything_arrived(service, source)


def test_a_service_that_comes_late_learns_at_once_what_was_sent_before(memory):
    settings = BridgeSettings(heartbeat_s=60.0, retry_s=0.02)
    with Bridge(memory.transport(), "cell-1", LiveSource(), settings=settings) as bridge:
        bridge.send(samples(100))
        with FakeService(memory.transport()) as service:
            eventually(lambda: service.next_seq == 5)


def test_a_service_that_was_away_for_longer_than_the_span_of_the_ring_gets_everything(memory):
    """What the ring had evicted was a gap, though there was room for it."""
    settings = BridgeSettings(ring_span_s=0.1, retry_s=0.02)
    with Bridge(memory.transport(), "cell-1", LiveSource(), settings=settings) as bridge:
        bridge.send(samples(5000))
        with FakeService(memory.transport()) as service:
            eventually(lambda: service.next_seq == 250)
            assert service.refusals == []


def test_a_service_that_asks_for_the_same_batch_again_cannot_store_it(memory):
    now_s = [100.0]
    with Bridge(memory.transport(), "cell-1", LiveSource(), clock=lambda: now_s[0]) as bridge:

        def stuck_s(first: int, later_s: float) -> float:
            now_s[0] += later_s
            assert replayed(memory.transport(), first, first + 9).refusals == ()
            return bridge.stuck_s

        assert bridge.stuck_s == 0.0
        assert [stuck_s(4, later) for later in (0.0, 1.0, 1.5)] == [0.0, 1.0, 2.5]
        assert stuck_s(5, 0.5) == 0.0, "it has the one before"
        assert stuck_s(5, 2.0) == 2.0
        now_s[0] += 3.0
        assert bridge.stuck_s == 0.0, "it no longer asks"
        assert stuck_s(5, 0.0) == 0.0


def test_a_range_is_replayed_in_order_and_no_further_than_asked(network):
    transport = network.transport()
    with Bridge(network.transport(), "cell-1", LiveSource(), settings=QUICK) as bridge:
        bridge.send(samples(200))
        eventually(lambda: len(replayed(transport, 0, 0).replies) == 1)
        assert len(replayed(transport, 3, 6).replies) == 4
        assert len(replayed(transport, 3, 6, limit=2).replies) == 2
        assert len(replayed(transport, 8, 999).replies) == 2
        assert replayed(transport, 50, 60) == ((), ())
        assert len(replayed(transport, 3, 6, session=bridge.session).replies) == 4
        (refusal,) = replayed(transport, 3, 6, session="abandoned").refusals
        assert (refusal.code, refusal.expected) == ("unknown_session", bridge.session)
        (refusal,) = transport.query(REPLAY_KEY, parameters="from=x").refusals
        assert refusal.code == "malformed"


def test_what_the_ring_no_longer_has_is_refused_and_the_oldest_is_named(memory):
    settings = BridgeSettings(ring_samples=100)
    with Bridge(memory.transport(), "cell-1", LiveSource(), settings=settings) as bridge:
        bridge.send(samples(1000))
        (refusal,) = replayed(memory.transport(), 0, 9).refusals
        assert (refusal.code, refusal.value) == ("evicted", 0)
        assert replayed(memory.transport(), refusal.limit, refusal.limit).replies


@pytest.mark.parametrize(
    ("chunk", "message"),
    [
        (np.ones((3, 5)), r"shape \(3, 5\)"),
        (np.ones(4), "shape"),
        (np.array([[0.0, 1.0, np.nan, 1.0]]), "py is nan"),
        (np.array([[np.inf, 1.0, 1.0, 1.0]]), "t is inf"),
        ([[0.0, 1.0, 1.0, 1.0]], r"chunk is a list, expected an array of numbers \(k, 4\)"),
    ],
)
def test_what_cannot_be_sent_is_refused_here_and_harms_nothing(memory, chunk, message):
    with (
        FakeService(memory.transport()) as service,
        Bridge(memory.transport(), "cell-1", LiveSource(), settings=QUICK) as bridge,
    ):
        bridge.send(samples(10))
        with pytest.raises(SourceError, match=message):
            bridge.send(chunk)
        bridge.send(samples(10, t0=0.01))
        bridge.finish()
    assert service.rows() == 20


@pytest.mark.parametrize("can_wait", [True, False])
def test_a_name_that_is_taken_is_refused_before_anything_is_lost(memory, can_wait):
    source = file_source(100)
    source.can_wait = can_wait
    with FakeService(memory.transport()) as service:
        with Bridge(memory.transport(), "cell-1", file_source(200), session="mine") as bridge:
            bridge.run()
        with Bridge(memory.transport(), "cell-1", source, session="mine") as bridge:
            with pytest.raises(CaesuraError, match="cell-1/mine already has 10 batches"):
                bridge.wait_open(30.0)
            with pytest.raises(CaesuraError, match="another name"):
                bridge.run()
        assert service.next_seq == 10


def test_a_restarted_bridge_takes_its_session_up_where_the_service_stands(memory):
    with FakeService(memory.transport()) as service:
        with Bridge(memory.transport(), "cell-1", LiveSource(), session="mine", settings=QUICK) as bridge:
            bridge.send(samples(100))
            eventually(lambda: service.next_seq == 5)
        source = LiveSource([samples(100, t0=0.2)])
        with Bridge(memory.transport(), "cell-1", source, session="mine", epoch=1, settings=QUICK) as bridge:
            assert bridge.run().next_seq == 10
    assert [batch.epoch for batch in service.batches] == [0] * 5 + [1] * 5
    assert service.duplicates == 0


def test_a_bridge_is_seen_while_it_is_there(network):
    transport, key = network.transport(), station_key("cell-1", "alive")
    with Bridge(network.transport(), "cell-1", LiveSource()):
        eventually(lambda: transport.list_tokens(key) == (key,))
    eventually(lambda: transport.list_tokens(key) == ())


def test_a_bridge_leaves_no_thread_behind(memory):
    before = set(threading.enumerate())
    with Bridge(memory.transport(), "cell-1", LiveSource()):
        assert len(set(threading.enumerate()) - before) == 3
    assert set(threading.enumerate()) == before


def test_session_names_sort_by_time_and_differ():
    early, late = (
        new_session_name(datetime(2026, 3, 14, 9, 26)),
        new_session_name(datetime(2026, 3, 14, 9, 27)),
    )
    assert early.startswith("s20260314-092600-")
    assert early < late
    assert len({new_session_name(datetime(2026, 3, 14)) for _ in range(20)}) > 15
    assert __import__("re").fullmatch(NAME_PATTERN, early)


def test_a_preset_must_have_a_name(memory):
    with pytest.raises(ProtocolError, match="preset is not a valid name"):
        Bridge(memory.transport(), "cell-1", LiveSource(), preset="A B")


@pytest.mark.parametrize("name", ["", "Cell 1", "a/b", "*"])
def test_a_station_must_have_a_name(memory, name):
    with pytest.raises(ProtocolError, match="not a valid name"):
        Bridge(memory.transport(), name, LiveSource())


def test_a_source_that_declares_an_unknown_unit_is_refused_by_name(memory):
    source = LiveSource()
    source.wrench_source = "sensor"
    with pytest.raises(SourceError, match="wrench_source is 'sensor', expected one of flange_sensor"):
        Bridge(memory.transport(), "cell-1", source)


@pytest.mark.parametrize(("robot", "stated"), [("my_arm", "my_arm"), (None, None), (object(), None)])
def test_a_source_states_its_arm(memory, robot, stated):
    """An arm of one's own was a setting of the cell, stated nowhere: joints were read as a Panda's."""
    source = LiveSource()
    source.robot = robot
    with FakeService(memory.transport()) as service, Bridge(memory.transport(), "cell-1", source) as bridge:
        bridge.send(samples(10))
        bridge.finish()
    assert service.openings[0].robot == stated


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        (
            CellSettings(up=(0.0, 0.0, 2.0)),
            r"up is 0,0,2 of length 2, expected 1 ± 0\.001: is it 0,0,1",
        ),
        (CellSettings(up="-z"), "up is '-z', expected an array"),
        (CellSettings(force_limit_n=-3.0), r"force_limit_n is -3\.0, expected greater than 0"),
    ],
)
def test_a_custom_source_that_states_a_wrong_cell_is_refused_in_words(memory, setting, words):
    source = LiveSource()
    source.setting = setting
    with pytest.raises(SourceError, match=f"the source: {words}"):
        Bridge(memory.transport(), "cell-1", source)


def test_an_arm_without_a_possible_name_is_refused(memory):
    source = LiveSource()
    source.robot = "My Arm"
    with pytest.raises(SourceError, match="robot is 'My Arm', expected a name as of `caesura robots`"):
        Bridge(memory.transport(), "cell-1", source)


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        (
            "qw",
            1.4,
            r"sample 3: quaternion has norm 1\.4, expected 1 ± 0\.1: divide each quaternion",
        ),
        ("qw", 0.0, r"sample 3: quaternion has norm 0, expected 1 ± 0\.1: leave out the samples"),
        (
            "gripper",
            80.0,
            r"sample 3: gripper is 80, expected an opening \[m\] or a closed flag within ±1",
        ),
        ("gripper", -0.5, r"sample 3: gripper is -0\.5, expected an opening of 0 m or more"),
    ],
)
def test_values_that_no_session_takes_are_refused_at_the_source(memory, column, value, words):
    # The service refused each batch, and `run` returned as if the demonstration had been recorded.
    source = LiveSource()
    source.columns = ("t", "px", "py", "pz", "qx", "qy", "qz", "qw", "gripper")
    rows = np.zeros((20, len(source.columns)))
    rows[:, 0], rows[:, 7] = np.arange(20) / 100.0, 1.0
    rows[3, source.columns.index(column)] = value
    with Bridge(memory.transport(), "cell-1", source) as bridge, pytest.raises(SourceError, match=words):
        bridge.send(rows)
