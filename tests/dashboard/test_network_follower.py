"""What the network says is there to be read, and what goes wrong with it is told and got over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from caesura_clients.dashboard.network_follower import NetworkFollower
from caesura_clients.dashboard.replacement_sessions import ReplacementSessions
from caesura_clients.query import services, stations
from caesura_clients.session_follower import SessionRemoved
from caesura_protocol.codec import Encoded, encode, encode_error, pack_samples
from caesura_protocol.derived_columns import ROTATION
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import SampleRange, service_key, session_key, station_key
from caesura_protocol.messages import (
    BridgeStatus,
    Heartbeat,
    Posterior,
    Program,
    RecordedSamples,
    ServiceStatus,
)
from caesura_protocol.minmax_decimation import unpack_points
from clients.answering import Answering
from clients.examples import example, segments, snapshot
from clients.fake_service import eventually

COLUMNS = ("t", "px", "py", "pz")


def failing(*_: object) -> None:
    raise RuntimeError("no such luck")


STATUS = service_key("fake-1", "status")


def station():
    return snapshot(1).status.station


def samples(count=500, session="s1", columns=COLUMNS, t0=0.0):
    t = t0 + np.arange(count) / 1000.0
    return encode(pack_samples(np.column_stack([t] * len(columns)), columns, session=session, epoch=0, seq=0))


@pytest.fixture
def answering(memory):
    with Answering(memory.transport()) as answering:
        answering.snapshots = [snapshot(1, "motion")]
        answering.answers[STATUS] = encode(example(ServiceStatus))
        yield answering


@pytest.fixture
def gateway(memory, answering):
    with NetworkFollower(memory.transport(), refresh_s=0.1) as gateway:
        eventually(lambda: gateway.world.updates and gateway.world.alive and gateway.world.services)
        yield gateway


def test_two_sessions_of_a_station_that_grow_in_turn_are_known_until_one_is_over(gateway, answering):
    reached = {"s1": 1.0, "s2": 1.0}

    def reach(session: str, t: float, state: str = "open") -> None:
        reached[session] = t
        answering.snapshots = [
            snapshot(round(t), session=name, t=t, state=state if name == session else "open")
            for name, t in reached.items()
        ]
        answering.put(next(one.status for one in answering.snapshots if one.status.session == session))
        eventually(lambda: (found := gateway.world.update(station(), session)) and found.t == t)

    for number in range(1, 5):
        for session in reached:
            reach(session, float(number))
    eventually(lambda: gateway.world.parallel == {station(): ("s1", "s2")})
    reach("s2", 9.0, state="closed")
    eventually(lambda: gateway.world.parallel == {})


def test_a_station_that_opens_many_sessions_is_asked_for_its_program_once_a_second(memory, answering):
    """Each asked for the programs of all stations: at 100 sessions a second a dashboard was 9 s behind."""
    now, program = [100.0], station_key(station(), "program")
    with NetworkFollower(memory.transport(), refresh_s=0.1, clock=lambda: now[0]) as gateway:
        eventually(lambda: gateway.world.updates)
        answering.snapshots = [snapshot(1, session=f"s{number}") for number in range(1, 31)]
        for one in answering.snapshots:
            answering.put(one.status)
        eventually(lambda: len(gateway.world.updates) == 30)
        assert answering.asked.count(program) == 1
        assert station_key("*", "program") not in answering.asked
        newest = example(Program).model_copy(update={"station": station(), "session": "s30"})
        answering.answers[program] = encode(newest)
        now[0] += 1.0
        eventually(lambda: gateway.world.current == {station(): "s30"})
        assert answering.asked.count(program) == 2


def holds(answering, *sessions):
    """The service holds these closed sessions, and publishes nothing of those that go."""
    answering.snapshots = [snapshot(1, session=name, state="closed", opened=None) for name in sessions]
    status = {"sessions_open": 0, "sessions_closed": len(sessions)}
    answering.answers[STATUS] = encode(example(ServiceStatus).model_copy(update=status))


def test_a_closed_session_that_the_service_holds_no_longer_is_dropped_at_once(gateway, answering):
    holds(answering, "s1", "s2", "s3")
    for one in answering.snapshots:
        answering.put(one.status)
    eventually(lambda: len(gateway.world.updates) == 3)
    holds(answering, "s2", "s3")
    eventually(lambda: set(gateway.world.updates) == {(station(), "s2"), (station(), "s3")})
    assert set(gateway.world.first_seen) == set(gateway.world.updates)
    holds(answering)
    eventually(lambda: gateway.world.updates == gateway.world.first_seen == {})


def test_a_session_that_leaves_memory_is_not_shown_as_it_was_before_its_corrections(gateway, answering):
    """It was read from the journal before it was held: the dashboard showed that state from then on."""
    held = gateway.world.update(station())
    before = replace(held, segments=())
    gateway._change(stored={(held.station, held.session): before})
    holds(answering)
    answering.put(held.status.model_copy(update={"seq": 9, "state": "closed"}))
    eventually(lambda: gateway.world.updates == {})
    assert gateway.world.update(held.station, held.session) is None


@pytest.mark.parametrize("was_removed", [True, False])
def test_a_session_whose_name_is_used_again_has_no_samples_of_the_one_before(
    gateway, memory, answering, was_removed
):
    """The new one was stale until it was as long as the old one, whose samples were drawn in it."""
    robot, key = memory.transport(), station_key(station(), "samples")
    known = gateway.world.update(station())
    robot.put(key, samples(500, session=known.session, t0=8.0))
    eventually(lambda: station() in gateway.received)
    if was_removed:
        holds(answering)
        answering.put(known.status.model_copy(update={"seq": 9, "state": "closed"}))
        eventually(lambda: gateway.world.updates == {})
    again = {"epoch": known.status.epoch + 1, "opened": known.status.opened + 600.0}
    answering.snapshots = [snapshot(1, "motion", session=known.session, **again)]
    answering.put(answering.snapshots[0].status)
    eventually(lambda: (new := gateway.world.update(station())) and new.status.epoch == again["epoch"])
    robot.put(key, samples(100, session=known.session))
    eventually(lambda: station() in gateway.received and gateway.received[station()].t < 1.0)
    drawn = gateway.samples(station(), known.session, SampleRange(0.0, 9.0, 100, ("px",)))
    assert drawn.last == pytest.approx(0.099)


def test_what_there_was_before_is_known(gateway):
    update = gateway.world.update(station())
    assert [one.kind for one in update.segments] == ["motion"]
    assert gateway.world.alive == {"fake-1"}
    assert gateway.world.trouble == ""


def test_what_is_published_is_known(gateway, answering):
    answering.put(segments(2, 0, "motion", "contact"))
    eventually(lambda: len(gateway.world.update(station()).segments) == 2)


def test_the_sessions_that_may_replace_a_part_are_listed_anew_where_one_of_them_changed(gateway, answering):
    choice, one = ReplacementSessions(), snapshot(1)
    before = choice.of(gateway.world, station(), "other")
    answering.put(segments(2, 0, "motion", "contact"))
    eventually(lambda: len(gateway.world.update(station()).segments) == 2)
    assert choice.of(gateway.world, station(), "other") is before, "a session that goes on is none of them"
    answering.put(one.status.model_copy(update={"seq": 9, "state": "closed"}))
    eventually(lambda: gateway.world.update(station()).closed)
    shown = choice.of(gateway.world, station(), "other")
    assert [name for name, _ in shown] == [one.status.session]
    assert choice.of(gateway.world, station(), one.status.session) == []


def test_samples_become_signals_and_an_age(gateway, memory):
    memory.transport().put(station_key("cell-7", "samples"), samples())
    eventually(lambda: "cell-7" in gateway.received)
    assert gateway.received["cell-7"].t == pytest.approx(0.499)


def test_the_longest_silent_station_makes_room_for_the_signals_of_another(gateway, memory, monkeypatch):
    """256 names with a batch each, and no station that came later had signals."""
    monkeypatch.setattr("caesura_clients.dashboard.network_follower.STATIONS", 2)
    for name in ("cell-7", "cell-8", "cell-9"):
        memory.transport().put(station_key(name, "samples"), samples())
        eventually(lambda name=name: name in gateway.received)
    eventually(lambda: gateway.received.keys() == {"cell-8", "cell-9"})


def test_batches_that_are_sent_again_are_no_newest_samples(gateway, memory):
    # A bridge sends batches again that the service cannot store. They looked like a demonstration going on.
    robot, key = memory.transport(), station_key("cell-7", "samples")
    robot.put(key, samples(session="new"))
    eventually(lambda: "cell-7" in gateway.received)
    known = gateway.received["cell-7"]
    robot.put(key, samples(session="new"))
    robot.put(station_key("cell-8", "samples"), samples())
    eventually(lambda: "cell-8" in gateway.received)
    assert gateway.received["cell-7"] is known
    robot.put(key, samples(session="newer"))
    eventually(lambda: gateway.received["cell-7"].session == "newer")


def test_a_bridge_in_standby_is_followed_however_many_there_are(gateway, memory, monkeypatch):
    monkeypatch.setattr("caesura_clients.dashboard.network_follower.STATIONS", 1)
    robot = memory.transport()
    for station, state in (("cell-7", "ready"), ("cell-8", "ready"), ("cell-7", "teaching")):
        status = BridgeStatus(station=station, bridge="b", state=state, source="franky")
        robot.put(station_key(station, "bridge_status"), encode(status))
    eventually(lambda: [one.state for one in gateway.world.standby.values()] == ["teaching"])
    assert list(gateway.world.standby) == ["cell-7"]


def test_the_newest_samples_are_read_here_and_others_asked_for(gateway, memory, answering):
    wanted = SampleRange(0.0, 0.5, 100, ("px",))
    robot, session = memory.transport(), snapshot(1).status.session
    robot.put(station_key(station(), "samples"), samples(session=session))
    eventually(lambda: station() in gateway.received)
    found = gateway.samples(station(), session, wanted)
    assert (found.instance, found.last) == ("dashboard", pytest.approx(0.499))
    key = session_key(station(), "older", "samples")
    answering.answers[key] = encode(example(RecordedSamples))
    assert gateway.samples(station(), "older", wanted) == example(RecordedSamples)


def test_a_dashboard_that_joins_late_asks_for_the_first_orientation_of_a_session(gateway, memory, answering):
    columns, session = ("t", "qx", "qy", "qz", "qw"), snapshot(1).status.session
    robot, key = memory.transport(), station_key(station(), "samples")
    for seq in (7, 8):
        rows = np.column_stack([seq + np.arange(500) / 1000.0, np.tile([0.0, 0.0, 0.6, 0.8], (500, 1))])
        robot.put(key, encode(pack_samples(rows, columns, session=session, epoch=0, seq=seq)))
        eventually(lambda seq=seq: station() in gateway.received and gateway.received[station()].t > seq)
        if seq == 7:
            answer = example(RecordedSamples).model_copy(update={"first_orientation": (0.0, 0.0, 0.0, 1.0)})
            answering.answers[session_key(station(), session, "samples")] = encode(answer)
            assert gateway.samples(station(), session, SampleRange(7.1, 7.2, 100, ROTATION)) == answer
    found = gateway.samples(station(), session, SampleRange(8.1, 8.2, 100, ROTATION))
    assert found.instance == "dashboard"
    assert unpack_points(found)["rotation_z"][:, 1] == pytest.approx(2.0 * np.arctan2(0.6, 0.8))


def test_the_samples_of_a_session_that_has_ended_are_asked_for(gateway, memory, answering):
    """The last ones had not arrived here: a page drew 3.0 s of 5.4 s for as long as the dashboard ran."""
    wanted, status = SampleRange(0.0, 0.5, 100, ("px",)), snapshot(1).status
    memory.transport().put(station_key(station(), "samples"), samples(session=status.session))
    eventually(lambda: station() in gateway.received)
    closed = status.model_copy(update={"seq": 9, "state": "closed"})
    answering.snapshots = [one.model_copy(update={"status": closed}) for one in answering.snapshots]
    answering.put(closed)
    eventually(lambda: gateway.world.update(station()).closed)
    answering.answers[session_key(station(), status.session, "samples")] = encode(example(RecordedSamples))
    assert gateway.samples(station(), status.session, wanted) == example(RecordedSamples)


def test_rubbish_and_heartbeats_are_no_samples(gateway, memory):
    robot, key = memory.transport(), station_key("cell-7", "samples")
    robot.put(key, Encoded(b"rubbish", "application/msgpack;caesura.SampleBatch.v1"))
    robot.put(key, encode(Heartbeat(session="s1", epoch=0, seq=3)))
    robot.put(station_key("cell-8", "samples"), samples())
    eventually(lambda: "cell-8" in gateway.received)
    assert "cell-7" not in gateway.received


def test_a_bridge_that_changes_its_columns_ends_nobodys_signals(gateway, memory):
    robot, key = memory.transport(), station_key("cell-7", "samples")
    robot.put(key, samples())
    robot.put(key, samples(columns=(*COLUMNS, "fx", "fy", "fz"), t0=0.5))
    robot.put(station_key("cell-8", "samples"), samples())
    eventually(lambda: "cell-8" in gateway.received and gateway.received["cell-7"].t > 0.9)
    assert gateway.world.trouble == ""


def test_a_strangers_token_changes_nothing(gateway, memory):
    robot = memory.transport()
    with (
        robot.declare_token("caesura/v1/station/Cell-9/alive"),
        robot.declare_token("caesura/v1/service/Foo/alive"),
    ):
        with robot.declare_token(station_key("cell-7", "alive")):
            eventually(lambda: "cell-7" in gateway.world.bridges)
            assert stations(robot) == ["cell-7"]
            assert services(robot) == ["fake-1"]
        eventually(lambda: gateway.world.bridges == frozenset())
    assert gateway.world.trouble == ""


def test_what_went_wrong_once_is_got_over(gateway, memory, monkeypatch):
    robot = memory.transport()
    with robot.declare_token(station_key("cell-7", "alive")):
        eventually(lambda: "cell-7" in gateway.world.bridges)
        with monkeypatch.context() as patch:
            patch.setattr(gateway, "_sampled", failing)
            robot.put(station_key("cell-8", "samples"), samples())
            eventually(lambda: "no such luck" in gateway.world.trouble)
    robot.put(station_key("cell-8", "samples"), samples())
    eventually(lambda: gateway.world.trouble == "")
    assert gateway.world.bridges == frozenset()


def test_which_session_is_current_is_asked_until_an_answer_comes(gateway, answering):
    program = example(Program)
    key = station_key(program.station, "program")
    answering.refusals[key] = encode_error(ProtocolError("overloaded", "not now"))
    later = snapshot(1, "motion", station=program.station, session="later")
    answering.put(later.segments)
    answering.snapshots.append(later)
    eventually(lambda: (program.station, "later") in gateway.world.updates)
    del answering.refusals[key]
    answering.answers[key] = encode(program.model_copy(update={"session": "later"}))
    for seq in range(2, 4):
        answering.put(segments(seq, 0, "hold", station=program.station, session="later"))
    eventually(lambda: gateway.world.current.get(program.station) == "later")


def test_a_bridge_comes_and_goes(gateway, memory):
    with memory.transport().declare_token(station_key("cell-7", "alive")):
        eventually(lambda: "cell-7" in gateway.world.bridges)
    eventually(lambda: "cell-7" not in gateway.world.bridges)


def test_a_late_status_of_a_bridge_that_is_gone_is_not_that_of_the_next_one(gateway, memory):
    """The next one was not in standby: Start stayed enabled, and no press was ever answered."""
    robot, token = memory.transport(), station_key("cell-7", "alive")
    late = BridgeStatus(station="cell-7", bridge="b", state="ready", source="franky")
    with robot.declare_token(token):
        eventually(lambda: "cell-7" in gateway.world.bridges)
    eventually(lambda: "cell-7" not in gateway.world.bridges)
    robot.put(station_key("cell-7", "bridge_status"), encode(late))
    eventually(lambda: "cell-7" in gateway.world.standby)
    with robot.declare_token(token):
        eventually(lambda: "cell-7" in gateway.world.bridges)
        assert gateway.world.bridge_status("cell-7") is None


def test_run_lengths_are_kept_in_order(gateway, answering):
    answering.snapshots = [snapshot(1, "motion", epoch=99)]
    session = answering.snapshots[0].status.session
    for seq in range(5):
        one = example(Posterior).model_copy(update={"seq": seq, "t": float(seq), "epoch": 99})
        answering.put(one.model_copy(update={"station": station(), "session": session}), "posterior")
    eventually(lambda: len(gateway.posteriors(station(), session)) == 5)
    assert [one.t for one in gateway.posteriors(station(), session)] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert gateway.posteriors(station(), "another") == ()


def test_a_service_that_goes_is_trouble_and_one_that_comes_back_ends_it(memory):
    with NetworkFollower(memory.transport(), refresh_s=0.1) as gateway:
        eventually(lambda: "no service is alive" in gateway.world.trouble)
        with Answering(memory.transport()) as answering:
            answering.answers[STATUS] = encode(example(ServiceStatus))
            eventually(lambda: gateway.world.trouble == "")


def test_pages_of_two_instances_leave_no_session_out(memory, update, monkeypatch):
    stored = {
        name: [snapshot(1, "motion", station=name, session=f"s{i}") for i in range(count)]
        for name, count in (("cell-1", 5), ("cell-2", 3))
    }

    def page(_transport, _station, _session, *, skip):
        return [one for sessions in stored.values() for one in sessions[skip : skip + 2]]

    monkeypatch.setattr("caesura_clients.dashboard.network_follower.stored_snapshots", page)
    follower = NetworkFollower(memory.transport())
    held = [update("motion", station=name, session="held", instance=f"of-{name}") for name in stored]
    follower._change(updates={(one.station, one.session): one for one in held})
    while follower.read_stored():
        pass
    assert set(follower.world.stored) == {
        (name, one.status.session) for name, sessions in stored.items() for one in sessions
    }


def test_sessions_that_leave_memory_after_all_older_ones_were_read_are_read_next(memory, monkeypatch):
    """They were on the first page, and the next query was for the last one: no list had them again."""
    stored = [snapshot(1, "motion", session=f"s{i:02}") for i in range(5)]

    def page(_transport, _station, _session="*", *, skip):
        return list(reversed(stored))[skip : skip + 2]

    monkeypatch.setattr("caesura_clients.dashboard.network_follower.stored_snapshots", page)
    follower = NetworkFollower(memory.transport())
    assert [follower.read_stored() for _ in range(4)] == [2, 2, 1, 0]
    for number in range(5, 8):
        stored.append(snapshot(1, "motion", session=f"s{number:02}"))
        follower._take(SessionRemoved(station(), f"s{number:02}"))
    assert [follower.read_stored() for _ in range(3)] == [2, 2, 0]
    assert {session for _, session in follower.world.stored} == {f"s{i:02}" for i in range(8)}
