"""Two instances share the stations of one router. One is killed, comes back, or hangs longer than its lease,
in the middle of demonstrations: nothing is lost, nothing comes twice, and the results are those of an
undisturbed run, field by field. Real processes, real Zenoh.
"""

from __future__ import annotations

import resource
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import pytest

from caesura_clients import Caesura, connect, session_corrections
from caesura_clients.bridge import Bridge
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.query import services
from caesura_protocol.codec import encode
from caesura_protocol.keys import session_key, station_key
from caesura_protocol.messages import (
    Ack,
    Control,
    Edit,
    Insert,
    Relabel,
    SessionStatus,
    Snapshot,
    Undo,
)
from caesura_service.offline_segmentation import batches, opening_of, segment_recording
from caesura_service.ownership.station_assignment import stations_of
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.segmentation.pipeline_interface import PipelineView
from harness.peer import Peer
from harness.processes import (
    DEADLINE_S,
    PACE,
    QUICK,
    RECORDING,
    SAMPLES,
    SESSION,
    Router,
    ServiceProcess,
    assert_equal,
    closed,
    eventually,
    reaches,
    running,
    snapshot,
    teaching,
)

pytestmark = pytest.mark.slow

# The service, which is frozen just before it records an edit of LATE, once: after its look at the epochs.
LATE = "late"
FREEZING = f"""
import signal, threading
from caesura_service.journal import AppliedEdit, SqliteJournal

append = SqliteJournal.append

def freezing(journal, record, *, now=False):
    if isinstance(record.message, AppliedEdit) and record.message.author == {LATE!r}:
        SqliteJournal.append = append
        signal.pthread_kill(threading.get_ident(), signal.SIGSTOP)  # this thread does not go on
    append(journal, record, now=now)

SqliteJournal.append = freezing
from caesura_service.__main__ import app
app()
"""
INSTANCES = ("east", "west")
STATIONS = tuple(f"cell-{number}" for number in range(1, 5))
WESTS = sorted(stations_of("west", INSTANCES, STATIONS))


@pytest.fixture(scope="module")
def undisturbed() -> PipelineView:
    """What the same samples give without a network, a service or a journal."""
    return segment_recording(RECORDING)


class Pair:
    """Two instances on one router and one directory, and somebody who looks at them."""

    def __init__(self, directory: Path, stack: ExitStack, *, apart: bool = False) -> None:
        """apart: each has a directory of its own, as on two machines."""
        self.router = stack.enter_context(running(Router()))
        self.east, self.west = both = [
            ServiceProcess(
                directory / name if apart else directory, "--instance", name, router=self.router.endpoint
            )
            for name in INSTANCES
        ]
        for each in both:
            stack.callback(each.kill)
            each.begin()
        for each in both:
            each.ready()
        self.caesura = stack.enter_context(connect(self.router.endpoint, timeout_s=DEADLINE_S))
        self._stack = stack

    def teach(self, station: str, pace: float = PACE) -> Future[Ack]:
        return self._stack.enter_context(teaching(self.caesura, station, pace=pace))

    def owner(self, station: str) -> str | None:
        found = snapshot(self.caesura, station)
        return found.status.instance if found else None

    def until_served_by(self, instance: str, *stations: str) -> None:
        eventually(lambda: all(self.owner(station) == instance for station in stations))


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[Pair]:
    with ExitStack() as stack:
        yield Pair(tmp_path, stack)


def half_way(caesura: Caesura, *stations: str) -> list[Snapshot]:
    return [reaches(caesura, station, SAMPLES // 2) for station in stations]


def assert_all_equal(pair: Pair, ends: list[Future[Ack]], undisturbed: PipelineView) -> None:
    assert all(end.result(DEADLINE_S).state == "closed" for end in ends)
    for station in STATIONS:
        assert_equal(closed(pair.caesura, station), undisturbed)


def test_the_sample_has_stations_for_both():
    assert 0 < len(WESTS) < len(STATIONS)


def test_two_instances_share_the_stations_and_the_survivor_of_a_kill_takes_them_all(pair, undisturbed):
    ends = [pair.teach(station) for station in STATIONS]
    owners = {
        reported.status.station: reported.status.instance for reported in half_way(pair.caesura, *STATIONS)
    }
    assert sorted(station for station, owner in owners.items() if owner == "west") == WESTS
    pair.west.kill()
    assert_all_equal(pair, ends, undisturbed)
    pair.until_served_by("east", *STATIONS)


def test_a_bridge_teaches_on_where_the_survivor_of_a_kill_has_no_room_for_its_session(tmp_path, undisturbed):
    """The survivor has no copy of the session. Its disk is full: the limit on the size of its files is 0."""
    station = WESTS[0]
    with ExitStack() as stack:
        pair = Pair(tmp_path, stack, apart=True)
        bridge = stack.enter_context(
            Bridge(
                pair.caesura.transport,
                station,
                FileSource(RECORDING, pace=PACE),
                session=SESSION,
                settings=QUICK,
            )
        )
        end = stack.enter_context(ThreadPoolExecutor(1)).submit(bridge.run)
        reaches(pair.caesura, station, SAMPLES // 4)
        resource.prlimit(pair.east.pid, resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
        pair.west.kill()
        eventually(lambda: end.done() or "cannot be" in (bridge.postponed or ""))
        assert "east.sqlite" in (bridge.postponed or ""), end.exception()
        resource.prlimit(pair.east.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
        assert end.result(DEADLINE_S).state == "closed"
        found = closed(pair.caesura, station)
        assert found.status.samples == SAMPLES, "the bridge's ring has them all"
        assert found.segments.segments == undisturbed.segments


def test_one_that_comes_back_takes_its_stations_in_the_middle_of_their_demonstrations(pair, undisturbed):
    pair.west.kill()
    eventually(lambda: services(pair.caesura.transport) == ["east"])
    ends = [pair.teach(station) for station in STATIONS]
    before = half_way(pair.caesura, *WESTS)
    assert {reported.status.instance for reported in before} == {"east"}
    pair.west.start()
    pair.until_served_by("west", *WESTS)
    assert_all_equal(pair, ends, undisturbed)
    for reported in before:
        found = closed(pair.caesura, reported.status.station)
        assert (found.status.instance, found.status.epoch > reported.status.epoch) == ("west", True)


@pytest.mark.parametrize(
    "pace", [1.0, PACE]
)  # it goes on in the middle of the demonstration, or after its end
def test_one_that_hangs_loses_its_stations_and_takes_them_up_where_the_other_has_come(
    pair, undisturbed, pace
):
    keys = [session_key(station, SESSION, "status") for station in WESTS]
    with Peer(pair.router.endpoint) as peer, peer.listening(*keys) as received:
        ends = [pair.teach(station, pace) for station in STATIONS]
        begun = [reaches(pair.caesura, station, SAMPLES // 8) for station in WESTS]
        pair.west.freeze()
        pair.until_served_by("east", *WESTS)
        pair.west.thaw()
        pair.until_served_by("west", *WESTS)
        assert_all_equal(pair, ends, undisturbed)
        for reported in begun:
            last = closed(pair.caesura, reported.status.station).status
            assert last.epoch > reported.status.epoch
            received.until(SessionStatus, partial(_is_from, last))  # no subscriber is left behind


def _is_from(last: SessionStatus, status: SessionStatus) -> bool:
    return (status.station, status.epoch, status.state) == (last.station, last.epoch, "closed")


def test_what_was_closed_just_before_the_kill_is_answered_by_the_survivor(pair, undisturbed):
    ends = {station: pair.teach(station) for station in STATIONS}
    for station in WESTS:
        assert ends[station].result(DEADLINE_S).state == "closed"
    pair.west.kill()
    assert_all_equal(pair, list(ends.values()), undisturbed)
    pair.until_served_by("east", *STATIONS)


def test_corrections_outlive_the_instance_that_took_them(pair):
    (station, *_) = WESTS
    insert, label = Insert(t=0.8), Relabel(t=0.3, kind="steady")
    end = pair.teach(station, 2.0)
    reaches(pair.caesura, station, SAMPLES // 2)
    edit = partial(session_corrections.edit, pair.caesura.transport, station, SESSION, author="Ann")
    assert edit(insert).revision == 1
    pair.west.kill()
    assert edit(label, revision=1).revision == 2
    assert end.result(DEADLINE_S).revision == 2
    pair.until_served_by("east", station)
    expected = make_pipeline(opening_of(RECORDING, "default"), "default")
    for samples in batches(RECORDING):
        expected.push(samples)
    expected.finish()
    inserted = expected.resolve(insert)
    expected = expected.corrected([inserted])
    expected = expected.corrected([inserted, expected.resolve(label)])
    found = closed(pair.caesura, station)
    assert [one for one in found.changepoints.changepoints if one.corrected]
    assert_equal(found, expected.view)
    pair.west.start()
    pair.until_served_by("west", station)
    assert edit(Undo(), revision=2).revision == 3  # rebuilt from the other's journal


def test_an_edit_that_is_refused_after_a_freeze_takes_no_acknowledged_one_away(pair):
    """An instance stopped between its look at the epochs and its record, which counted from then on."""
    (station, *_) = WESTS
    pair.west.kill()
    pair.west.command[1:3] = ["-c", FREEZING]
    pair.west.start()
    assert pair.teach(station).result(DEADLINE_S).state == "closed"
    pair.until_served_by("west", station)
    late, kept, next_one = Insert(t=0.8), Insert(t=0.5), Relabel(t=0.3, kind="steady")
    edit = partial(session_corrections.edit, pair.caesura.transport, station, SESSION)
    content = encode(Control(command=Edit(session=SESSION, revision=0, author=LATE, action=late)))
    pair.caesura.transport.query(station_key(station, "control"), content, timeout_s=5.0)
    eventually(lambda: " T " in Path(f"/proc/{pair.west.pid}/stat").read_text())
    pair.until_served_by("east", station)
    assert edit(kept, revision=0, author="Ann").revision == 1
    expected = snapshot(pair.caesura, station).changepoints
    pair.west.thaw()
    pair.until_served_by("west", station)
    found = snapshot(pair.caesura, station)
    assert (found.status.revision, found.program.author) == (1, "Ann")
    assert found.changepoints.changepoints == expected.changepoints
    assert edit(next_one, revision=1, author="Bo").revision == 2
