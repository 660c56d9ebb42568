"""How a session of a bridge ends: acknowledged, refused, without an answer, by a source that fails."""

import errno
import threading
from contextlib import ExitStack, contextmanager
from dataclasses import replace

import numpy as np
import pytest

from caesura_clients.bridge import Bridge, BridgeSettings
from caesura_protocol.codec import decode, encode_error
from caesura_protocol.errors import CaesuraError, ProtocolError, SourceError, Unreachable
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import Close, Control, Open
from clients.bridging import QUICK, Losing
from clients.examples import LiveSource, samples
from clients.fake_service import FakeService, eventually

IMPATIENT = BridgeSettings(retry_s=0.01, close_timeout_s=0.1)


@contextmanager
def two_batches_sent(memory, kind):
    """A service of a kind, and a bridge whose two batches it has acknowledged."""
    with kind(memory.transport()) as service, ExitStack() as stack:
        bridge = stack.enter_context(Bridge(memory.transport(), "cell-1", LiveSource(), settings=IMPATIENT))
        bridge.wait_open(30.0)
        bridge.send(samples(40))
        eventually(lambda: service.next_seq == 2)
        yield service, bridge


def test_an_end_that_is_not_acknowledged_says_how_far_it_came(memory):
    with two_batches_sent(memory, FakeService) as (service, bridge):
        service.hold = True
        bridge.send(samples(40, t0=0.04))
        with pytest.raises(Unreachable, match="2 of 4 batches"):
            bridge.finish()
        assert (bridge.acknowledged, bridge.sent) == (2, 4)
    with Bridge(memory.transport(), "cell-1", LiveSource(), settings=IMPATIENT) as bridge:
        bridge.send(samples(40))
        with pytest.raises(Unreachable, match="0 of 2 batches"):
            bridge.finish()


class Ahead(FakeService):
    """Has batches of the session that this bridge never sent."""

    def _close(self, station, close):
        if self.next_seq > close.last_seq + 1:
            return ProtocolError("conflict", "the session has other batches", value=close.last_seq)
        return super()._close(station, close)


def end_unstored(memory, source, folder, station="cell-1", session="mine"):
    """A bridge sends 50 samples, which no service stores, and ends."""
    settings = replace(IMPATIENT, unstored_folder=folder)
    with Bridge(memory.transport(), station, source, session=session, settings=settings) as bridge:
        bridge.send(samples(50))
        bridge.finish()


def test_a_live_demonstration_that_no_service_has_stored_is_kept_as_a_recording(memory, tmp_path, caplog):
    with pytest.raises(Unreachable):
        end_unstored(memory, LiveSource(), tmp_path)
    kept = load_recording(tmp_path / "cell-1.mine.unstored.npz")
    np.testing.assert_array_equal(kept.matrix(), samples(50))
    assert (kept.wrench_source, kept.force_frame) == ("none", "base")
    assert "of 3 batches a service is known to have 0" in caplog.text
    assert f"--station cell-1 --source file --file {tmp_path / 'cell-1.mine.unstored.npz'}" in caplog.text


def test_no_demonstration_replaces_another_one_that_is_kept(memory, tmp_path):
    """Those of two stations had one file, and so had two ends of one session."""
    ends = ("cell-1", "mine"), ("cell-2", "mine"), ("cell-1", "mine"), ("cell-1-a", "b"), ("cell-1", "a-b")
    for station, session in ends:
        with pytest.raises(Unreachable):
            end_unstored(memory, LiveSource(), tmp_path, station, session)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "cell-1-a.b.unstored.npz",
        "cell-1.a-b.unstored.npz",
        "cell-1.mine.2.unstored.npz",
        "cell-1.mine.unstored.npz",
        "cell-2.mine.unstored.npz",
    ]


def test_what_is_stored_or_can_be_read_again_is_not_kept(memory, tmp_path):
    with FakeService(memory.transport()):
        end_unstored(memory, LiveSource(), tmp_path)
    patient = LiveSource()
    patient.can_wait = True
    with pytest.raises(Unreachable):
        end_unstored(memory, patient, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_takes_no_file_is_named(memory, tmp_path, caplog):
    with pytest.raises(Unreachable):
        end_unstored(memory, LiveSource(), tmp_path / "missing")
    assert "the rest is lost" in caplog.text
    assert str(tmp_path / "missing") in caplog.text


def test_a_full_disk_leaves_no_half_recording_and_is_named(memory, tmp_path, caplog, monkeypatch):
    def half(path, **_):
        path.write_bytes(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", half)
    with pytest.raises(Unreachable):
        end_unstored(memory, LiveSource(), tmp_path)
    assert list(tmp_path.iterdir()) == []
    assert f"{tmp_path} cannot be written: No space left on device" in caplog.text


def test_an_end_that_the_service_refuses_for_good_says_why(memory):
    with two_batches_sent(memory, Ahead) as (service, bridge):
        service.batches += service.batches
        with pytest.raises(ProtocolError, match="the session has other batches"):
            bridge.finish()


class Forbidding(FakeService):
    """Has every batch, and refuses to end the session."""

    def _close(self, station, close):
        return ProtocolError("forbidden", "this operator may not close", value=station)


def test_a_refused_end_says_why_though_the_service_has_everything(memory):
    refused = pytest.raises(ProtocolError, match="this operator may not close")
    with two_batches_sent(memory, Forbidding) as (_, bridge), refused:
        bridge.finish()


def test_a_close_waits_until_the_service_has_everything(memory):
    with FakeService(memory.transport()) as service, ExitStack() as stack:
        bridge = stack.enter_context(Bridge(memory.transport(), "cell-1", LiveSource(), settings=QUICK))
        bridge.wait_open(30.0)
        service.hold = True
        bridge.send(samples(100))
        acks = []
        thread = threading.Thread(target=lambda: acks.append(bridge.finish()), daemon=True)
        thread.start()
        thread.join(0.1)
        assert not acks
        service.hold = False
        thread.join(30.0)
        assert acks[0].next_seq == 5


class Forgetful(FakeService):
    """Has a session of that name only at another station, once it has forgotten ours."""

    def _close(self, station, close):
        if not self.openings:
            return ProtocolError(
                "forbidden", "only another station has a session of that name", value=close.session
            )
        return super()._close(station, close)


@pytest.mark.parametrize("kind", [FakeService, Forgetful])
def test_a_service_that_lost_the_session_before_the_close_is_sent_it_again(memory, kind):
    with kind(memory.transport()) as service, ExitStack() as stack:
        bridge = stack.enter_context(Bridge(memory.transport(), "cell-1", LiveSource(), settings=QUICK))
        bridge.wait_open(30.0)
        bridge.send(samples(100))
        eventually(lambda: service.next_seq == 5)
        service.batches.clear()
        service.openings.clear()
        assert bridge.finish().next_seq == 5
    assert service.rows() == 100


class Unanswering(FakeService):
    """Closes, and its answer is lost until the bridge has been refused to open the session again."""

    def _command(self, question):
        command = decode(*question.content, Control).command
        if isinstance(command, Open) and self.state == "closed":
            self.refusals.append(ProtocolError("conflict", "the session is closed: it takes no open"))
            question.refuse(encode_error(self.refusals[-1]))
        elif isinstance(command, Close) and not self.refusals:
            self._close("cell-1", command)
        else:
            super()._command(question)


def closed_without_an_answer(memory, kind):
    """The service, after a bridge has closed at it whose keeper was refused on the way."""
    settings = BridgeSettings(heartbeat_s=0.05, retry_s=0.05, reopen_s=0.05, close_timeout_s=30.0)
    with kind(memory.transport()) as service, ExitStack() as stack:
        bridge = stack.enter_context(Bridge(memory.transport(), "cell-1", LiveSource(), settings=settings))
        bridge.wait_open(30.0)
        bridge.send(samples(100))
        assert bridge.finish().state == "closed"
    return service


def test_a_bridge_whose_close_was_carried_out_without_an_answer_closes_all_the_same(memory):
    assert closed_without_an_answer(memory, Unanswering).refusals


class Overloaded(Unanswering):
    """The same, and the first close after that refusal finds no room in the service."""

    turned_away = False

    def _command(self, question):
        is_close = isinstance(decode(*question.content, Control).command, Close)
        if is_close and self.refusals and not self.turned_away:
            self.turned_away = True
            question.refuse(encode_error(ProtocolError("overloaded", "64 commands are waiting: try again")))
        else:
            super()._command(question)


def test_a_bridge_whose_close_was_carried_out_asks_again_where_the_service_is_overloaded(memory):
    assert closed_without_an_answer(memory, Overloaded).turned_away


def test_what_is_missing_at_the_close_is_sent_again_without_being_asked(memory):
    memory.lose = Losing(1, 4)
    with (
        FakeService(memory.transport()) as service,
        Bridge(memory.transport(), "cell-1", LiveSource(), settings=QUICK) as bridge,
    ):
        service.asks = False
        bridge.wait_open(30.0)
        bridge.send(samples(100))
        assert bridge.finish().next_seq == 5


class FailingSource(LiveSource):
    """Delivers its chunks, and then fails."""

    def __init__(self, chunks, failure):
        super().__init__(chunks)
        self.failure = failure

    def chunks(self):
        yield from super().chunks()
        raise self.failure


@pytest.mark.parametrize("failure", [SourceError("the cable is off"), OSError("the cable is off")])
def test_a_source_that_fails_ends_the_session_with_what_it_had_sent(memory, failure):
    # Its session once stayed open for ever, and was taken for the station's current one.
    source = FailingSource([samples(50)], failure)
    with (
        FakeService(memory.transport()) as service,
        Bridge(memory.transport(), "cell-1", source, settings=QUICK) as bridge,
    ):
        bridge.wait_open(30.0)
        with pytest.raises(type(failure), match="the cable is off"):
            bridge.run()
        assert (service.state, service.rows()) == ("closed", 50)


def test_a_value_that_is_not_finite_ends_the_session_with_what_came_before(memory):
    broken = samples(20, t0=0.02)
    broken[7, 2] = np.nan
    source = LiveSource([samples(20), broken, samples(20, t0=0.04)])
    with (
        FakeService(memory.transport()) as service,
        Bridge(memory.transport(), "cell-1", source, settings=QUICK) as bridge,
    ):
        bridge.wait_open(30.0)
        with pytest.raises(SourceError, match="sample 27: py is nan"):
            bridge.run()
        assert (service.state, service.rows()) == ("closed", 20)


def test_what_is_closed_takes_no_samples(network):
    with FakeService(network.transport()), ExitStack() as stack:
        bridge = stack.enter_context(Bridge(network.transport(), "cell-1", LiveSource(), settings=QUICK))
        bridge.send(samples(20))
        bridge.finish()
        with pytest.raises(CaesuraError, match="is closed: it takes no samples"):
            bridge.send(samples(20))
        assert bridge.finish().state == "closed"
