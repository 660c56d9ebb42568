"""What a watched registry counts and tells, against the fake pipeline."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Heartbeat, Open, SessionStatus
from caesura_protocol.token_bucket import SENDERS
from caesura_service.journal import MemoryJournal
from caesura_service.monitoring.instrumented_registry import InstrumentedRegistry
from caesura_service.monitoring.registry_call_effects import Change
from caesura_service.monitoring.station_counters import StationCounters, StationCounterSet
from caesura_service.publishing.events import PipelineFactory, ReplayEnded
from caesura_service.publishing.session_state import status_of
from caesura_service.segmentation.pipeline_interface import Pipeline
from caesura_service.sessions.limits import Limits
from harness.clock import Clock
from harness.fake_pipeline import FakePipeline, make_fake_pipeline
from harness.sessions import NAME, OWNER, STATION, batch, batches, closing, heartbeat, opening, published


def watched(
    watch: Callable[[], float] | None = None,
    journal: MemoryJournal | None = None,
    factory: PipelineFactory = make_fake_pipeline,
    **limits: Any,
) -> InstrumentedRegistry:
    return InstrumentedRegistry(
        monotonic=watch or Clock(100.0),
        owner=OWNER,
        pipeline_factory=factory,
        default_preset="fake",
        journal=journal or MemoryJournal(),
        limits=Limits(**limits),
    )


class Seldom(FakePipeline):
    """Has news at every fifth push."""

    pushes = 0

    def push(self, samples: NDArray[np.float64]) -> bool:
        self.pushes += 1
        super().push(samples)
        return self.pushes % 5 == 0


def taught(registry: InstrumentedRegistry, count: int) -> InstrumentedRegistry:
    registry.handle_command(STATION, opening(), 0.0)
    for one in batches(count):
        registry.handle_samples(STATION, one, 0.0)
    return registry


def send(registry: InstrumentedRegistry, *sent: tuple[str, str, int]) -> None:
    """Batches, each of a session, a bridge and a number."""
    for session, bridge, seq in sent:
        named = batch(seq, session).model_copy(update={"bridge": bridge})
        registry.handle_samples(STATION, named, 0.0)


def lines(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records]


@pytest.fixture(autouse=True)
def _log_level(caplog):
    caplog.set_level(logging.INFO, logger="caesura_service.monitoring")


def test_what_was_processed_is_counted_by_station():
    registry = taught(watched(), 3)
    registry.handle_samples(STATION, batch(1), 0.0)
    counted = registry.station_counters.of_station[STATION]
    assert (counted.batches, counted.samples, counted.duplicates, counted.gaps) == (3, 60, 1, 0)
    assert counted.observations == registry.index.newest_states()[0].view.observations > 0


@pytest.mark.parametrize("count", [7, 10])
def test_what_changes_nothing_else_is_counted_once_whatever_is_read_meanwhile(count):
    def seldom(opening: Open, preset: str) -> Pipeline:
        fake = make_fake_pipeline(opening, preset)
        assert isinstance(fake, FakePipeline)
        return Seldom(fake.preset, fake.wrench)

    registry = watched(factory=seldom)
    registry.handle_command(STATION, opening(), 0.0)
    for number, one in enumerate(batches(count), start=1):
        registry.handle_samples(STATION, one, 0.0)
        (standing,) = registry.index.newest_states()
        assert (standing.counters.batches, standing.view.samples) == (number, 20 * number)
        for ask in (registry.republish_status, lambda station: registry.report_dropped(station, 0)):
            (reported,) = published(ask(STATION), SessionStatus) or [status_of(standing)]
            assert (reported.batches, reported.samples) == (number, 20 * number)
        registry.tick(float(number))
        registry.handle_command(STATION, opening(), 0.0)
    counted = registry.station_counters.of_station[STATION]
    registry.handle_command(STATION, closing(count - 1), 0.0)
    assert (counted.batches, counted.samples) == (count, 20 * count)


def test_a_hole_is_a_question_then_a_gap(caplog):
    registry = taught(watched(), 3)
    registry.handle_samples(STATION, batch(9), 1.0)
    counted = registry.station_counters.of_station[STATION]
    assert (counted.replays, counted.gaps) == (1, 0)
    registry.handle_samples(STATION, ReplayEnded(NAME, 3, answered=False, evicted=True, oldest=9), 2.0)
    counted = registry.station_counters.of_station[STATION]
    assert counted.gaps == 1
    assert counted.gap_s == pytest.approx(6 * 0.2, abs=0.11)
    assert lines(caplog)[-2] == "cell-1/s1 asks for batches 3 to 8"
    assert lines(caplog)[-1].startswith("cell-1/s1 gap from 0.")
    assert "(evicted): the samples were refused, or no bridge has them" in lines(caplog)[-1]
    assert caplog.records[-1].levelno == logging.WARNING
    assert vars(caplog.records[-1])["station"] == STATION
    assert vars(caplog.records[-1])["session"] == NAME


def test_a_session_is_logged_from_opening_to_close(caplog):
    registry = taught(watched(), 5)
    registry.handle_command(STATION, closing(4), 1.0)
    registry.handle_command(STATION, closing(4), 1.1)  # its acknowledgement was lost
    first, last = lines(caplog)
    assert first == "cell-1/s1 opened, preset fake, wrench flange_sensor"
    assert last.startswith("cell-1/s1 closed: ")
    assert last.endswith("100 samples in 5 batches")


def test_an_unstated_wrench_source_is_logged_as_assumed(caplog):
    watched().handle_command(STATION, opening(wrench_source=None), 0.0)
    assert lines(caplog) == ["cell-1/s1 opened, preset fake, wrench none (assumed)"]


def test_a_station_that_opens_too_many_sessions_has_the_closed_ones_logged(caplog):
    registry = watched(open_sessions=1)
    registry.handle_command(STATION, opening("first"), 0.0)
    registry.handle_command(STATION, opening("second"), 0.0)
    assert [line.partition(":")[0] for line in lines(caplog)] == [
        "cell-1/first opened, preset fake, wrench flange_sensor",
        "cell-1/first closed",
        "cell-1/second opened, preset fake, wrench flange_sensor",
    ]


def test_a_hostile_sender_is_logged_once_and_then_by_number(caplog):
    clock = Clock(100.0)
    registry = watched(clock)
    for _ in range(100):
        registry.reject(STATION, ProtocolError("malformed", "rubbish"))
    registry.reject(STATION, ProtocolError("too_large", "much"))
    clock.now += 60.0
    registry.reject(STATION, ProtocolError("malformed", "rubbish"))
    assert lines(caplog) == [
        "cell-1 refused: malformed: rubbish",
        "cell-1 refused: too_large: much",
        "cell-1 refused: malformed: rubbish (and 99 more like it)",
    ]


def test_a_refusal_while_another_call_gives_way_is_its_own_stations(caplog):
    """A log said that an honest station was refused, with the words of another."""

    class RejectingPipeline(FakePipeline):
        def push(self, samples: NDArray[np.float64]) -> bool:
            registry.reject("hostile", ProtocolError("malformed", "rubbish"))
            return super().push(samples)

    def make(opening: Open, default_preset: str) -> Pipeline:
        fake = make_fake_pipeline(opening, default_preset)
        return RejectingPipeline(fake.preset, fake.wrench)

    clock = Clock(100.0)
    registry = watched(clock, factory=make)
    registry.handle_command(STATION, opening(), 0.0)
    clock.now += 5.0
    registry.handle_samples(STATION, batch(0), 0.0)
    assert [line for line in lines(caplog) if "refused" in line] == ["hostile refused: malformed: rubbish"]
    assert registry.station_counters.of_station[STATION].received_s == 105.0


def test_a_bridge_that_does_not_answer_is_logged(caplog):
    registry = taught(watched(), 3)
    registry.handle_samples(STATION, heartbeat(5), 1.0)
    registry.handle_samples(STATION, ReplayEnded(NAME, 3, answered=False), 2.0)
    assert lines(caplog)[-1] == "cell-1/s1 its bridge did not answer for batches from 3 on"


def test_what_the_queue_had_no_room_for_is_counted():
    registry = taught(watched(), 1)
    registry.report_dropped(STATION, 7)
    assert registry.station_counters.of_station[STATION].dropped == 7


def test_a_batch_whose_content_is_refused_is_lost():
    registry = taught(watched(), 1)
    registry.handle_samples(STATION, batch(1, n=7), 0.0)
    registry.handle_samples(STATION, batch(2), 0.0)
    counted = registry.station_counters.of_station[STATION]
    assert (counted.batches, counted.lost) == (2, 1)


def test_names_that_are_unknown_take_no_room():
    registry = taught(watched(), 1)
    for number in range(1000):
        registry.handle_samples(f"nobody-{number}", Heartbeat(session="x", epoch=0, seq=1), 0.0)
    assert list(registry.station_counters.of_station) == [STATION]


def test_when_a_batch_last_came_is_known_and_a_heartbeat_is_none():
    clock = Clock(100.0)
    registry = taught(watched(clock), 1)
    clock.now += 7.0
    registry.handle_samples(STATION, heartbeat(0), 0.0)
    assert registry.station_counters.of_station[STATION].received_s == 100.0
    registry.handle_samples(STATION, batch(1), 0.0)
    assert registry.station_counters.of_station[STATION].received_s == 107.0


def test_what_a_restart_replays_is_not_counted_again():
    journal = MemoryJournal()
    taught(watched(journal=journal), 5)
    after = watched(journal=journal)
    assert after.restore() == []
    assert after.station_counters.of_station == {}
    after.handle_samples(STATION, batch(5), 0.0)
    assert after.station_counters.of_station[STATION].batches == 1


def test_durations_are_a_cumulative_histogram():
    durations = StationCounterSet(0.0).durations
    for took_s in (0.0001, 0.001, 0.03, 99.0):
        durations.observe(took_s)
    (family,) = durations.collect()
    found = {sample.labels.get("le", sample.name): sample.value for sample in family.samples}
    assert (found["0.001"], found["0.025"], found["0.05"], found["+Inf"]) == (2, 2, 3, 4)
    assert found["caesura_batch_seconds_sum"] == pytest.approx(99.0311)


def test_a_change_without_a_before_adds_nothing():
    standing = taught(watched(), 2).index.newest_states()[0]
    counted = StationCounters()
    counted.add(Change(None, standing))
    assert counted == StationCounters()


def test_suppressed_lines_take_bounded_room_and_a_new_sender_is_logged_again(caplog):
    clock = Clock(100.0)
    registry = watched(clock)
    for number in range(3 * SENDERS):
        registry.reject(f"cell-{number}", ProtocolError("malformed", "rubbish"))
    assert len(lines(caplog)) == SENDERS
    assert len(registry._event_logger._suppressed) == SENDERS
    clock.now += 20.0
    registry.reject("new", ProtocolError("malformed", "rubbish"))
    assert lines(caplog)[-1] == "new refused: malformed: rubbish"


def test_two_bridges_that_teach_at_one_station_are_logged_once(caplog):
    registry = watched()
    for session, bridge in (("s1", "east"), ("s2", "west")):
        opened = opening().model_copy(update={"session": session, "bridge": bridge})
        registry.handle_command(STATION, opened, 0.0)
    send(
        registry,
        *((session, bridge, i) for i in range(9) for session, bridge in (("s1", "east"), ("s2", "west"))),
    )
    warned = [record for record in caplog.records if record.levelno == logging.WARNING]
    assert [record.getMessage() for record in warned] == [
        f"{STATION} is taught by two bridges at once, s2 of bridge west and s1 of bridge east: "
        "give one of them another --station"
    ]


@pytest.mark.parametrize("successor", ["west", "east"])
def test_a_bridge_that_takes_the_place_of_another_is_no_second_one(caplog, successor):
    registry = watched()
    for session, bridge in (("s1", "east"), ("s2", successor)):
        opened = opening().model_copy(update={"session": session, "bridge": bridge})
        registry.handle_command(STATION, opened, 0.0)
        send(registry, *((session, bridge, i) for i in range(9)))
    if successor == "east":  # replayed, of a bridge that has begun the next one
        send(registry, ("s1", "east", 9))
    assert not [record for record in caplog.records if record.levelno == logging.WARNING]
