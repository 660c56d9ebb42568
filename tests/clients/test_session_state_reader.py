"""A reader ends up with what the service knows, whatever the network drops."""

import threading

import pytest

from caesura_clients.session_follower import ServiceAvailability, SessionRemoved, events, follow
from caesura_clients.session_state_reader import SessionReader, Update
from caesura_protocol.codec import Encoded, encode_error
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import service_key, session_key
from caesura_protocol.messages import Changepoints, Phase, Posterior, Program, SessionStatus, Snapshot
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_protocol.transport.transport_interface import Transport
from clients.answering import Answering
from clients.examples import changepoint, example, segments, snapshot


def kinds(update):
    return [segment.kind for segment in update.segments]


def reader(*known, seq=0):
    started = SessionReader()
    assert started.restart(snapshot(seq, *known)) == "changed"
    return started


def test_a_reader_starts_from_the_snapshot():
    whole = example(Snapshot)
    started = SessionReader()
    assert started.restart(whole) == "changed"
    assert started.update.segments == whole.segments.segments
    assert (started.update.station, started.update.session) == ("cell-1", whole.status.session)
    assert started.restart(whole) == "unchanged"


def test_without_a_snapshot_every_message_is_a_hole():
    assert SessionReader().receive(segments(0, 0, "motion")) == "hole"


@pytest.mark.parametrize("model", [Posterior, SessionStatus, Program])
def test_the_time_of_an_update_is_that_of_the_newest_result(model):
    """A status comes once in a while, and `update.t` stood still meanwhile."""
    following = reader("motion", seq=4)
    newest = following.update.t + 1.5
    number = {"version": following.update.program.version + 1} if model is Program else {"seq": 5}
    assert following.receive(example(model).model_copy(update={"t": newest, **number})) == "changed"
    assert following.update.t == newest


def test_a_list_replaces_everything_from_its_first_on():
    following = reader("motion", "contact", "steady", seq=4)
    assert following.receive(segments(5, 1, "transport")) == "changed"
    assert kinds(following.update) == ["motion", "transport"]
    assert following.receive(segments(6, 2, "hold", "motion")) == "changed"
    assert kinds(following.update) == ["motion", "transport", "hold", "motion"]
    assert following.receive(segments(7, 0)) == "changed"
    assert kinds(following.update) == []


def test_changepoints_follow_the_same_rule():
    following = reader(seq=4)
    tail = example(Changepoints).model_copy(
        update={"seq": 5, "first": 0, "changepoints": (changepoint(1.5),)}
    )
    assert following.receive(tail) == "changed"
    assert following.update.changepoints == (changepoint(1.5),)


def test_phases_come_with_the_segments_and_replace_the_earlier_ones_from_their_first_on():
    phase = example(Phase)
    following = reader("motion", seq=4)
    known = following.update.phases
    changed = segments(5, 1, "contact", first_phase=len(known), phases=(phase,))
    assert following.receive(changed) == "changed"
    assert following.update.phases == (*known, phase)
    assert following.receive(segments(6, 2, first_phase=0, phases=(phase,))) == "changed"
    assert following.update.phases == (phase,)
    assert kinds(following.update) == ["motion", "contact"]
    assert following.receive(segments(7, 2, first_phase=3, phases=(phase,))) == "hole"


@pytest.mark.parametrize("seq", [0, 3])
def test_what_is_older_changes_nothing(seq):
    following = reader("motion", seq=4)
    assert following.receive(segments(seq, 0, "hold")) == "unchanged"
    assert kinds(following.update) == ["motion"]


def test_a_message_that_comes_twice_does_no_harm():
    following = reader("motion", seq=4)
    assert following.receive(segments(5, 1, "contact")) == "changed"
    assert following.receive(segments(5, 1, "contact")) == "unchanged"
    assert kinds(following.update) == ["motion", "contact"]


@pytest.mark.parametrize("lost", [segments(6, 1, "hold"), segments(5, 2, "hold")], ids=["number", "index"])
def test_a_hole_changes_nothing_and_is_reported(lost):
    following = reader("motion", seq=4)
    assert following.receive(lost) == "hole"
    assert kinds(following.update) == ["motion"]


@pytest.mark.parametrize("model", [SessionStatus, Posterior])
def test_complete_messages_leave_no_hole(model):
    following = reader(seq=4)
    message = example(model).model_copy(update={"seq": 90})
    assert following.receive(message) == "changed"
    assert message in (following.update.status, following.update.posterior)
    assert following.receive(message.model_copy(update={"seq": 89})) == "unchanged"


def test_programs_are_counted_by_version():
    following = reader(seq=4)
    newer = example(Program).model_copy(update={"version": 9})
    assert following.receive(newer) == "changed"
    assert following.receive(newer.model_copy(update={"version": 8, "complete": True})) == "unchanged"
    assert following.update.program == newer


def test_the_highest_epoch_is_right():
    following = reader("motion", seq=4)
    assert following.receive(segments(5, 0, "hold", epoch=1)) == "unchanged"
    assert following.receive(segments(0, 0, "hold", epoch=3, instance="b")) == "hole"
    assert following.restart(snapshot(0, "hold", epoch=3, instance="b")) == "changed"
    assert following.restart(snapshot(9, "motion", epoch=2)) == "unchanged"
    assert following.receive(segments(9, 0, "motion", epoch=2)) == "unchanged"
    assert kinds(following.update) == ["hold"]


def test_a_name_that_is_used_again_is_a_hole():
    following = SessionReader()
    assert following.restart(snapshot(40, "motion", state="closed")) == "changed"
    assert following.receive(snapshot(0, state="open").status) == "hole"


def test_an_answer_that_cannot_be_read_hides_no_other(memory):
    with Answering(memory.transport()) as publishing:
        publishing.answers[session_key("cell-9", "bad", "snapshot")] = Encoded(
            b"\xc1", "application/msgpack;caesura.Snapshot.v1"
        )
        publishing.snapshots = [snapshot(4, "motion")]
        assert kinds(next(follow(memory.transport(), silence_s=0.1))) == ["motion"]


@pytest.fixture
def publisher(network):
    with Answering(network.transport()) as publishing:
        yield publishing


def following(network, *arguments, **options):
    return follow(network.transport(), *arguments, **{"refresh_s": 0.1, "silence_s": 30.0, **options})


def test_a_late_reader_begins_with_what_is_known(network, publisher):
    publisher.snapshots = [snapshot(4, "motion", "contact")]
    assert kinds(next(following(network, "cell-1"))) == ["motion", "contact"]


def test_updates_follow_as_they_are_published(network, publisher):
    publisher.snapshots = [snapshot(4, "motion")]
    updates = following(network, "cell-1")
    next(updates)
    publisher.put(segments(5, 1, "contact"))
    assert kinds(next(updates)) == ["motion", "contact"]
    publisher.program(example(Program).model_copy(update={"version": 4}))
    assert next(updates).program.version == 4


def test_a_lost_message_is_healed_by_the_snapshot(network, publisher):
    publisher.snapshots = [snapshot(4, "motion")]
    updates = following(network, "cell-1", refresh_s=60.0)
    next(updates)
    publisher.snapshots = [snapshot(6, "motion", "contact")]
    publisher.put(segments(7, 2, "hold"))
    assert any(kinds(update) == ["motion", "contact", "hold"] for update in updates)


def test_a_lost_last_message_is_found_in_the_silence(network, publisher):
    publisher.snapshots = [snapshot(4, "motion")]
    updates = following(network, "cell-1", refresh_s=0.05)
    next(updates)
    publisher.snapshots = [snapshot(5, "hold")]
    assert kinds(next(updates)) == ["hold"]


def test_a_lost_last_message_is_found_while_another_station_goes_on(network, publisher):
    # The silence was once that of all sessions together.
    publisher.snapshots = [snapshot(4, "motion"), snapshot(4, "motion", station="cell-2", session="busy")]
    over = threading.Event()

    def go_on() -> None:
        for seq in range(5, 2000):
            publisher.put(segments(seq, 1, *["hold"] * (seq % 3), station="cell-2", session="busy"))
            if over.wait(0.01):
                return

    busy = threading.Thread(target=go_on, daemon=True)
    happening = reported(network)
    assert isinstance(next(happening), Update)  # from the snapshots; now it listens
    busy.start()
    assert any(event == ServiceAvailability("there") for event in happening)
    assert any(isinstance(event, Update) and len(event.segments) == 3 for event in happening)
    publisher.snapshots[0] = snapshot(5, "hold")
    assert any(event.station == "cell-1" and kinds(event) == ["hold"] for event in happening)
    over.set()
    busy.join()


def test_a_question_about_the_silence_that_was_refused_is_asked_again(memory):
    with Answering(memory.transport()) as publishing:
        publishing.snapshots = [snapshot(4, "motion")]
        updates = follow(memory.transport(), "cell-1", refresh_s=0.05, silence_s=20.0)
        next(updates)
        key = session_key("cell-1", "s1", "snapshot")
        publishing.refusals = {key: encode_error(ProtocolError("overloaded", "not now"))}
        publishing.snapshots = []
        before = publishing.refused
        threading.Thread(
            target=lambda: publishing.relent(before + 2, snapshot(5, "hold")), daemon=True
        ).start()
        assert kinds(next(updates)) == ["hold"]


def test_a_session_that_begins_later_is_followed(network, publisher):
    updates = following(network)
    publisher.snapshots = [snapshot(0, station="cell-2", session="later")]
    update = next(updates)
    assert (update.station, update.session) == ("cell-2", "later")


def test_a_service_that_takes_over_is_believed(network, publisher):
    publisher.snapshots = [snapshot(40, "motion")]
    updates = following(network, "cell-1", refresh_s=60.0)
    next(updates)
    publisher.snapshots.append(snapshot(0, "hold", epoch=9, instance="b"))
    with network.transport().declare_token(service_key("b", "alive")):
        assert kinds(next(updates)) == ["hold"]


def reported(network, **options):
    return events(network.transport(), **{"refresh_s": 0.05, "silence_s": 30.0, **options})


def test_a_service_that_goes_and_comes_back_is_reported(network):
    with Answering(network.transport()):
        happening = reported(network)
        assert next(happening) == ServiceAvailability("there")
    assert next(happening) == ServiceAvailability("gone")
    with Answering(network.transport()):
        assert next(happening) == ServiceAvailability("there")


def test_what_a_restarted_service_no_longer_has_is_forgotten(network):
    # It once stayed in view for ever.
    instance = snapshot(0).status.instance
    with Answering(network.transport(), instance) as first:
        first.snapshots = [snapshot(4, "motion", session="old")]
        happening = reported(network)
        assert next(happening).session == "old"
        assert next(happening) == ServiceAvailability("there")
    assert next(happening) == ServiceAvailability("gone")
    with Answering(network.transport(), instance) as second:
        second.snapshots = [snapshot(0, session="new")]
        seen = [next(happening) for _ in range(3)]
    assert ServiceAvailability("there") in seen
    assert SessionRemoved("cell-1", "old") in seen
    assert {event.session for event in seen if isinstance(event, Update)} == {"new"}


class Successor(Answering):
    """Takes a session over after two queries for it."""

    def __init__(self, transport: Transport, taken: Snapshot) -> None:
        super().__init__(transport, "b")
        self.taken, self.queries = taken, 0

    def _answer(self, question: IncomingQuery) -> None:
        self.snapshots = [self.taken] if self.queries >= 2 else []
        self.queries += question.key.endswith("snapshot")
        super()._answer(question)


def test_what_the_next_instance_is_about_to_take_over_is_not_forgotten(memory):
    """A page showed for a moment that nothing had been taught: the owner had just been killed."""
    known = snapshot(4, "motion")
    with Successor(memory.transport(), snapshot(0, "hold", epoch=9, instance="b")) as successor:
        with Answering(memory.transport(), "a") as owner:
            owner.snapshots = [known]
            happening = reported(memory, silence_s=0.5)
            assert kinds(next(happening)) == ["motion"]
        successor.queries = 0
        seen = list(happening)
    assert [kinds(event) for event in seen if isinstance(event, Update)] == [["hold"]]
    assert [event for event in seen if isinstance(event, SessionRemoved)] == []


def test_what_a_busy_instance_has_is_not_forgotten(memory):
    # One instance has no time just then, another one answers for its own.
    others = snapshot(4, "hold", station="cell-2", session="others")
    with Answering(memory.transport()) as publishing:
        publishing.snapshots = [snapshot(4, "motion"), others]
        happening = reported(memory, silence_s=0.5)
        assert {next(happening).station for _ in range(2)} == {"cell-1", "cell-2"}
        publishing.snapshots.remove(others)
        busy = encode_error(ProtocolError("overloaded", "not now"))
        publishing.refusals = {session_key("cell-2", "others", "snapshot"): busy}
        assert [event for event in happening if isinstance(event, SessionRemoved)] == []


def test_while_the_service_is_gone_what_is_known_stays(memory):
    with Answering(memory.transport()) as publishing:
        publishing.snapshots = [snapshot(4, "motion")]
        happening = reported(memory, silence_s=0.3)
        assert next(happening).session == snapshot(4).status.session
        assert next(happening) == ServiceAvailability("there")
    assert list(happening) == [ServiceAvailability("gone")]


def test_a_service_too_busy_to_answer_ends_no_reader(memory):
    # A question that ran into its timeout once ended the watching.
    with Answering(memory.transport()) as publishing:
        publishing.snapshots = [snapshot(4, "motion")]
        updates = follow(memory.transport(), "cell-1", refresh_s=0.02, silence_s=30.0)
        next(updates)
        publishing.snapshots = []
        key = session_key("cell-1", "s1", "snapshot")
        publishing.refusals = {key: encode_error(ProtocolError("overloaded", "not now"))}
        publishing.put(segments(5, 1, "hold"))
        assert kinds(next(updates)) == ["motion", "hold"]


def test_only_the_session_that_was_asked_for_is_followed(memory):
    with Answering(memory.transport()) as publishing:
        updates = follow(memory.transport(), "cell-1", "mine", silence_s=0.05)
        publishing.program(example(Program))
        assert list(updates) == []


def test_rubbish_ends_no_reader_but_a_newer_service_is_named(memory):
    with Answering(memory.transport()) as publishing:
        publishing.snapshots = [snapshot(4, "motion")]
        updates = follow(memory.transport(), "cell-1", refresh_s=60.0)
        next(updates)
        key = session_key("cell-1", "s1", "segments")
        for encoding in ("application/msgpack;caesura.Segments.v1", "zenoh/bytes", "text/plain"):
            memory.transport().put(key, Encoded(b"\xc1", encoding))
        publishing.put(segments(5, 0, "hold"))
        assert kinds(next(updates)) == ["hold"]
        memory.transport().put(key, Encoded(b"\xc1", "application/msgpack;caesura.Segments.v2"))
        with pytest.raises(ProtocolError, match="version 2"):
            next(updates)


def test_silence_ends_the_iteration_and_the_subscriptions(memory):
    assert list(follow(memory.transport(), silence_s=0.02)) == []
    assert memory.subscribers == []


def test_leaving_the_loop_ends_the_subscriptions(memory):
    with Answering(memory.transport()) as publishing:
        publishing.snapshots = [snapshot(4, "motion")]
        for _ in follow(memory.transport()):
            assert len(memory.subscribers) == 6
            break
        assert memory.subscribers == []


def test_another_thread_ends_the_iteration(memory):
    over = threading.Event()
    reported = events(memory.transport(), refresh_s=0.02, over=over)
    following = threading.Thread(target=lambda: list(reported), daemon=True)
    following.start()
    over.set()
    following.join(30.0)
    assert not following.is_alive()
    assert memory.subscribers == []
