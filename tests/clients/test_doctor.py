"""`caesura doctor`: every judgement, real services, wrong endpoints, a bridge that hangs, an empty net."""

from __future__ import annotations

import json
import socket
import threading
import tracemalloc
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from caesura_clients import connect
from caesura_clients.bridge import Bridge
from caesura_clients.cli.commands import register
from caesura_clients.doctor.findings import CheckResult, Grade
from caesura_clients.doctor.probes import ProbeResult, ReceivedStatus, TimedServiceStatus, probe_network
from caesura_clients.doctor.reach import no_session
from caesura_clients.doctor.run_checks import examine_network, examine_recording, judge
from caesura_clients.doctor.signal import cells_at_rest
from caesura_clients.query import snapshots
from caesura_protocol.codec import Encoded, encode
from caesura_protocol.distribution import installed_version
from caesura_protocol.errors import AccessDenied, ProtocolError, Unreachable
from caesura_protocol.keys import service_key, session_key
from caesura_protocol.messages import Gap, Refusal, SampleBatch, ServiceStatus, SessionStatus, WrenchReport
from caesura_protocol.recording import Recording
from caesura_protocol.transport.memory import MemoryNetwork
from clients.answering import Answering
from clients.conftest import free_port
from clients.examples import LiveSource, example, recording, samples, snapshot
from clients.fake_service import eventually
from clients.test_bridge import QUICK
from service.journal.test_sqlite import grow_again, grow_no_more

NOW = 1000.0


def grades(found: list[CheckResult], check: str) -> list[Grade]:
    return [one.grade for one in found if one.check == check]


def said(found: list[CheckResult], check: str) -> str:
    return "\n".join(f"{one.found} → {one.remedy}" for one in found if one.check == check)


def test_a_time_that_lies_far_off_costs_no_memory():
    far = Recording(t=np.append(np.arange(40) * 0.01, 1e12), signals={"pos": np.zeros((41, 3))})
    tracemalloc.start()
    try:
        assert len(cells_at_rest(far)) >= 1
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 1e6


# --- judgements, without a network ----------------------------------------------------------------------


def service(**changes: object) -> TimedServiceStatus:
    held = example(ServiceStatus).budgets[0]
    none = held.model_copy(update={"commands": held.commands.model_copy(update={"refused": 0})})
    well = {"version": installed_version(), "time": NOW + 0.001, "overloaded": False, "budgets": (none,)}
    status = example(ServiceStatus).model_copy(update={**well, **changes})
    return TimedServiceStatus(status, NOW, NOW + 0.002)


def test_a_station_that_was_held_back_is_named_with_its_budget():
    assert "no station was held back" in said(list(judge(well())), "budget")
    held = service(budgets=example(ServiceStatus).budgets)
    found = list(judge(replace(well(), reported=[held])))
    assert grades(found, "budget") == ["warn"]
    assert "commands 1000 of 1000 (500 a second), 17 held back" in said(found, "budget")


def status(**changes: object) -> SessionStatus:
    well = {"gaps": (), "refused": {}, "last_refusal": None, "waiting_for": None, "state": "open"}
    wrench = WrenchReport(
        source="flange_sensor", contact_models=True, transport_models=True, tare=(0.5, 0.0, 1.0), note=""
    )
    return example(SessionStatus).model_copy(update={**well, "wrench": wrench, **changes})


def well(**changes: object) -> ProbeResult:
    """One service, one station that is taught at 1 kHz."""
    first, last = (status(batches=50 * i, samples=1000 * i, t=float(i), seq=i) for i in range(1, 3))
    one = snapshot(3, "motion").model_copy(update={"status": last})
    probed = ProbeResult(
        alive=[example(ServiceStatus).instance],
        reported=[service()],
        bridges=[last.station],
        snapshots=[one],
        statuses={(last.station, last.session): [ReceivedStatus(0.0, first), ReceivedStatus(1.0, last)]},
        listened_s=1.0,
    )
    for name, value in changes.items():
        assert hasattr(probed, name)
        setattr(probed, name, value)
    return probed


def received(probed: ProbeResult, **changes: object) -> ProbeResult:
    """The same, with the station's last status changed."""
    ((key, (first, last)),) = probed.statuses.items()
    changed = ReceivedStatus(last.at, last.status.model_copy(update=changes))
    probed.statuses = {key: [first, changed]}
    return probed


def test_where_all_is_well_nothing_is_to_be_done():
    found = list(judge(well()))
    assert {one.grade for one in found} == {"ok"}
    assert {one.remedy for one in found} == {""}
    assert "50.0 batches/s, 1000 samples/s" in said(found, "samples")


@pytest.mark.parametrize(
    ("changes", "check", "grade", "words"),
    [
        ({"version": "9.9"}, "service", "warn", "is version 9.9"),
        ({"time": NOW + 0.2}, "clock", "warn", "ahead of this machine"),
        ({"time": NOW - 7.0}, "clock", "warn", "7.0 s behind"),
        ({"time": NOW + 0.04}, "clock", "ok", "39.0 ms ahead"),
        ({"time": None}, "clock", "warn", "does not state its time"),
        ({"queue": 3000, "queue_capacity": 4096}, "queue", "bad", "3000 of 4096"),
        ({"overloaded": True}, "queue", "bad", "it is behind"),
        ({"dropped": 3}, "queue", "warn", "3 dropped"),
        ({"journal": None}, "journal", "warn", "does not report it"),
    ],
)
def test_what_a_service_reports_is_judged(changes, check, grade, words):
    found = list(judge(well(reported=[service(**changes)])))
    assert grades(found, check) == [grade]
    assert words in said(found, check)


def test_a_journal_in_trouble_in_memory_or_full_is_said():
    whole = service().status.journal
    for update, grade, words in (
        ({"trouble": "no space left on /var"}, "bad", "no space left on /var"),
        ({"kind": "memory"}, "warn", "--journal DIR"),
        ({"size": 95, "size_limit": 100}, "warn", "--journal-gb"),
    ):
        found = list(judge(well(reported=[service(journal=whole.model_copy(update=update))])))
        assert grades(found, "journal") == [grade]
        assert words in said(found, "journal")


FULL = "/var/caesura.sqlite cannot be written, there is no room left"


def test_a_journal_that_cannot_be_written_is_the_cause_of_refusals_and_missing_batches_named_once():
    kept = service().status.journal.model_copy(update={"trouble": FULL})
    refused = {"overloaded": 6883}
    last = Refusal(code="overloaded", message=FULL)
    probed = received(
        well(reported=[service(journal=kept)]), waiting_for=133, refused=refused, last_refusal=last
    )
    found = list(judge(probed))
    text = "\n".join(f"{one.found} → {one.remedy}" for one in found)
    assert grades(found, "journal") == ["bad"]
    assert grades(found, "gaps") == []  # neither none nor some: the bridge still has them
    (one,) = [one for one in found if one.check == "refused"]
    assert (one.grade, one.found) == (
        "warn",
        f"6883 overloaded, batch 133 is missing: {probed.alive[0]} cannot write its journal",
    )
    assert one.remedy == "make room soon: the bridge has the newest two minutes, and is asked for them again"
    assert text.count("no room left") == 1
    assert "the bridge sends what" not in text
    assert "whether the bridge answers" not in text


def test_beside_a_full_journal_what_the_bridge_sends_wrongly_is_still_its_own():
    kept = service().status.journal.model_copy(update={"trouble": FULL})
    probed = received(well(reported=[service(journal=kept)]), refused={"overloaded": 5, "malformed": 2})
    found = [one for one in judge(probed) if one.check == "refused"]
    assert [one.found.partition(":")[0] for one in found] == ["5 overloaded", "2 malformed"]
    assert found[1].remedy == "the bridge sends what the service cannot take: see docs/operations.md"


def test_refusals_of_a_service_without_room_are_not_the_bridges():
    last = Refusal(code="overloaded", message=FULL)
    found = list(judge(received(well(), refused={"overloaded": 7}, last_refusal=last)))
    (one,) = [one for one in found if one.check == "refused"]
    assert one.found == f"7 overloaded; the last: {FULL}"
    assert one.remedy == "the service had no room for them and asked for them again: see journal and queue"


def test_a_batch_that_is_missing_is_not_said_beside_no_gaps():
    found = list(judge(received(well(), waiting_for=7)))
    assert grades(found, "gaps") == ["warn"]


def test_where_no_session_opens_on_a_full_journal_it_is_the_cause():
    kept = service().status.journal.model_copy(update={"trouble": FULL})
    probed = received(well(reported=[service(journal=kept)]), state="closed")
    ((station, _),) = probed.statuses
    probed.batches = {(station, "other"): [batch_of("other")]}
    found = list(judge(probed))
    assert grades(found, "bridge") == ["bad"]
    assert "cannot write its journal, so no session opens → make room" in said(found, "bridge")


@pytest.mark.parametrize(
    ("changes", "check", "grade", "words"),
    [
        ({"gaps": (Gap(t0=1.0, tn=1.5, reason="evicted"),)}, "gaps", "warn", "1 of 0.50 s in all (evicted)"),
        ({"waiting_for": 7}, "gaps", "warn", "batch 7 is missing"),
        ({"duplicates": 3}, "duplicates", "ok", "came again"),
        ({"refused": {"malformed": 2}}, "refused", "warn", "2 malformed"),
    ],
)
def test_what_a_session_reports_is_judged(changes, check, grade, words):
    found = list(judge(received(well(), **changes)))
    assert grade in grades(found, check)
    assert words in said(found, check)


def test_a_source_that_is_not_stated_is_asked_for():
    off = {"stated": False, "contact_models": False, "transport_models": False}
    found = list(judge(received(well(), wrench=status().wrench.model_copy(update=off))))
    (one,) = [one for one in found if one.check == "wrench"]
    assert one.grade == "warn"
    assert "flange_sensor, flange_sensor_with_hand, joint_torque_estimate, none" in one.remedy


@pytest.mark.parametrize(
    ("changes", "check", "words"),
    [
        ({"tare": (0.0, 0.0, -9.0)}, "wrench bias", "9.0 N in all"),
        ({"tare": None}, "wrench", "start in free space"),
        ({"contact_models": False, "transport_models": False}, "wrench", "neither contact nor load"),
    ],
)
def test_a_wrench_that_says_little_is_warned_of(changes, check, words):
    wrench = status().wrench.model_copy(update=changes)
    found = list(judge(received(well(), wrench=wrench)))
    assert grades(found, check) == ["warn"]
    assert words in said(found, check)


def test_a_service_that_says_nothing_to_us_is_a_matter_of_credentials():
    found = list(judge(well(reported=[], snapshots=[], statuses={}, bridges=[])))
    assert grades(found, "credentials") == ["warn"]
    assert "certificate or password of a dashboard" in said(found, "credentials")
    found = list(judge(well(snapshots=[])))
    assert "sessions are known and none was shown" in said(found, "credentials")


def test_a_peer_of_another_protocol_is_named():
    found = list(judge(well(other_versions=["caesura/v2/service/new/alive"])))
    assert grades(found, "service") == ["bad", "ok"]
    assert "speaks caesura/v2, we speak caesura/v1" in said(found, "service")


def test_two_owners_of_one_session_and_who_has_what_are_reported():
    one = well().snapshots[0]
    other = one.model_copy(
        update={"status": one.status.model_copy(update={"instance": "other", "epoch": 99})}
    )
    found = list(judge(well(alive=[one.status.instance, "other"], snapshots=[one, other])))
    assert grades(found, "owner") == ["warn", "ok"]
    assert "both have" in said(found, "owner")
    assert f"{one.status.instance}: none" in said(found, "owner")
    assert f"other: {one.status.station}" in said(found, "owner")
    assert "other is alive and does not answer" in said(found, "service")


def test_an_open_session_whose_bridge_is_gone_is_bad():
    found = list(judge(well(bridges=[])))
    assert grades(found, "bridge") == ["bad"]
    assert "--epoch N" in said(found, "bridge")


def test_a_bridge_that_is_connected_and_sends_nothing_is_bad():
    found = list(judge(received(well(), batches=50, samples=1000, t=1.0)))
    assert grades(found, "samples") == ["bad"]
    assert "the bridge hangs, or its source gives nothing" in said(found, "samples")


def test_batches_of_another_session_are_not_counted_as_sent_for_this_one():
    probed = received(well(), batches=50, samples=1000, t=1.0)
    ((station, _),) = probed.statuses
    probed.batches = {(station, "other"): [batch_of("other")]}
    assert said(list(judge(probed)), "samples").startswith("none in 1.0 s")


@pytest.mark.parametrize(
    ("first_at", "grade", "words"),
    [(0.0, "bad", "none in 3.0 s"), (1.5, "bad", "none in 1.5 s"), (2.8, "warn", "for 0.2 s only")],
)
def test_a_session_that_has_just_begun_does_not_hang(first_at, grade, words):
    begun = status(batches=1, samples=20, t=0.02)
    probed = well(
        statuses={(begun.station, begun.session): [ReceivedStatus(first_at, begun)]}, listened_s=3.0
    )
    found = list(judge(probed))
    assert grades(found, "samples") == [grade]
    assert words in said(found, "samples")


def test_a_refusal_of_the_doctors_queries_is_reported():
    found = list(judge(well(refusals=[ProtocolError("overloaded", "too many questions are waiting")] * 2)))
    assert "2 questions refused: overloaded: too many questions are waiting" in said(found, "credentials")


# --- samples --------------------------------------------------------------------------------------------


def hand(t: np.ndarray, **changes: object) -> Recording:
    """Rests for a second, then moves along x."""
    x = np.clip(t - t[0] - 1.0, 0.0, None) * 0.2
    pos = np.column_stack([x, 0 * x, 0 * x + 0.3])
    force = 0.1 * np.random.default_rng(0).standard_normal((len(t), 3))
    return Recording(
        t, {"pos": pos, "force": force, "gripper": 0 * x[:, None], **changes}, wrench_source="flange_sensor"
    )


EVEN = np.arange(2000) / 1000.0


@pytest.mark.parametrize(
    ("taught", "check", "grade", "words"),
    [
        (hand(EVEN), "rate", "ok", "1000 Hz"),
        (hand(EVEN), "regularity", "ok", "0.0 %"),
        (hand(EVEN), "wrench noise", "ok", "0.10 N"),
        (hand(EVEN[::50]), "rate", "warn", "20 Hz"),
        (hand(EVEN * 1e3), "units", "bad", "probably in ms"),
        (hand(EVEN * 1e9), "units", "bad", "State --time-unit ns"),
        (hand(np.delete(EVEN, slice(500, 900))), "regularity", "warn", "longest 401 ms"),
        (hand(EVEN + np.tile([0, 9e-4], 1000)), "regularity", "warn", "off by more than half"),
        (hand(np.repeat(EVEN, 2)), "repeats", "warn", "2000 of 4000 samples"),
        (hand(np.where(EVEN < 1.5, EVEN, EVEN - 0.2)), "repeats", "warn", "200 of 2000 samples"),
        (hand(EVEN[::-1]), "clock", "bad", "time goes back from 1.999 s to 1.748 s"),
        (hand(EVEN // 1 + 1.7e9), "clock", "bad", "write the fractions of a second too: the file is refused"),
        (replace(hand(EVEN), t=EVEN + 86400 * (EVEN >= 1.5)), "clock", "bad", "time leaps from 1.499 s to"),
        (hand(EVEN, pos=np.tile(200.0 * EVEN[:, None], 3)), "units", "bad", "State --length-unit mm"),
        (
            hand(np.where(EVEN < 1.5, EVEN, EVEN - 0.7)),
            "clock",
            "bad",
            "sample 1500: time goes back from 1.499 s to 0.8 s, expected within 0.25 s",
        ),
        (hand(EVEN), "signals", "warn", "without quat apps have no orientation"),
        (hand(EVEN, force=np.tile([0.0, 3.0, 6.0], (2000, 1))), "wrench bias", "warn", "6.7 N in all"),
        (
            hand(EVEN, force=5 * np.random.default_rng(1).standard_normal((2000, 3))),
            "wrench noise",
            "warn",
            "loose cable",
        ),
    ],
)
def test_samples_are_judged(taught, check, grade, words):
    found = list(examine_recording(taught))
    assert grades(found, check) == [grade]
    assert words in said(found, check)


def test_a_robot_that_never_rests_says_nothing_of_noise():
    moving = hand(EVEN, pos=np.column_stack([EVEN / 2, EVEN / 2, EVEN / 2]))
    assert grades(list(examine_recording(moving)), "wrench noise") == []


def test_the_unit_of_length_is_heeded():
    metres = hand(EVEN)
    signals = {**metres.signals, "pos": 1000 * metres.signals["pos"]}
    millimetres = replace(metres, signals=signals, length_unit="mm")
    assert list(examine_recording(millimetres)) == list(examine_recording(metres))


# --- networks -------------------------------------------------------------------------------------------


def test_an_empty_network_has_no_service():
    found = list(examine_network(MemoryNetwork().transport(), seconds=0.05))
    assert [(one.check, one.grade) for one in found] == [("service", "bad")]
    assert "start `caesura serve`" in said(found, "service")


def test_an_unknown_station_is_named():
    memory = MemoryNetwork()
    with Answering(memory.transport()) as service:
        reported = example(ServiceStatus).model_copy(
            update={"instance": "fake-1", "version": installed_version()}
        )
        service.answers[service_key("fake-1", "status")] = encode(reported)
        found = list(examine_network(memory.transport(), "cell-9", seconds=0.05))
    assert [(one.station, one.grade) for one in found if one.check == "bridge"] == [("cell-9", "bad")]


def test_rubbish_that_a_peer_publishes_is_reported_and_not_fatal():
    memory = MemoryNetwork()
    over = threading.Event()

    def publish_rubbish() -> None:
        while not over.wait(0.005):
            memory.transport().put("caesura/v1/station/cell-1/samples", Encoded(b"rubbish", "text/plain"))

    shouting = threading.Thread(target=publish_rubbish, daemon=True)
    shouting.start()
    probed = probe_network(memory.transport(), seconds=0.1)
    over.set()
    shouting.join()
    assert probed.refusals
    assert probed.batches == {}


@pytest.fixture
def served() -> Iterator[str]:
    """A real service on a free port, with the fake pipeline."""
    pytest.importorskip("caesura_service.app")
    from caesura_service.app import Service  # noqa: PLC0415
    from caesura_service.config import ServiceConfig  # noqa: PLC0415
    from caesura_service.segmentation.fake_pipeline import make_fake_pipeline  # noqa: PLC0415

    config = ServiceConfig(instance="west", listen="tcp/127.0.0.1:0", preset="fake")
    with Service(config, pipeline_factory=make_fake_pipeline) as service:
        yield service.endpoint


def run(*options: str) -> tuple[int, str]:
    app = typer.Typer()
    register(app)
    result = CliRunner().invoke(app, ["doctor", *options])
    return result.exit_code, result.stdout


def test_a_real_service_without_stations(served):
    code, text = run("--connect", served, "--seconds", "1")
    assert code == 0
    assert "✓ service      west is alive" in text
    assert "✓ clock        west is " in text
    assert "✓ stations     none yet" in text


def test_a_bridge_that_teaches_and_one_that_hangs(served):
    with ExitStack() as stack:
        caesura = stack.enter_context(connect(served))
        hanging = stack.enter_context(Bridge(caesura.transport, "cell-2", LiveSource(), settings=QUICK))
        teaching = stack.enter_context(Bridge(caesura.transport, "cell-1", LiveSource(), settings=QUICK))
        for bridge in (hanging, teaching):
            bridge.wait_open(30.0)
        over = threading.Event()
        stack.callback(over.set)

        def teach() -> None:
            for number in range(2000):
                teaching.send(samples(50, t0=number * 0.05))
                if over.wait(0.05):
                    return

        stack.enter_context(_thread(teach))
        stack.callback(over.set)
        eventually(lambda: {"cell-1", "cell-2"} <= set(caesura.stations()))
        code, text = run("--connect", served, "--seconds", "1.5", "--json")
    found = {(one["station"], one["check"]): one for one in json.loads(text)}
    assert code == 1
    assert found["cell-1", "rate"]["found"] == "1000 Hz"
    assert found["cell-1", "regularity"]["grade"] == "ok"
    assert found["cell-1", "samples"]["grade"] == "ok"
    assert found["cell-1", "signals"]["grade"] == "warn"
    assert found["cell-2", "bridge"]["grade"] == "ok"
    assert found["cell-2", "samples"]["grade"] == "bad"
    assert "the bridge hangs" in found["cell-2", "samples"]["remedy"]


def test_two_bridges_that_teach_at_one_station_are_named_with_their_sessions(served):
    with ExitStack() as stack:
        caesura = stack.enter_context(connect(served))
        both = [
            stack.enter_context(Bridge(caesura.transport, "dup", LiveSource(), session=name, settings=QUICK))
            for name in ("s1", "s2")
        ]
        over = threading.Event()
        stack.callback(over.set)

        def teach() -> None:
            for number in range(2000):
                for bridge in both:
                    bridge.send(samples(50, t0=number * 0.05))
                if over.wait(0.01):
                    return

        for bridge in both:
            bridge.wait_open(30.0)
        stack.enter_context(_thread(teach))
        stack.callback(over.set)
        eventually(lambda: len([one for one in caesura.sessions("dup") if one.t > 0.0]) == 2)
        probed = probe_network(caesura.transport, "dup", seconds=1.0)
    found = [one for one in judge(probed, "dup") if one.check == "bridge"]
    assert [(one.grade, one.found, one.remedy) for one in found] == [
        ("bad", "two bridges teach at dup: s1 and s2", "give one of them another --station")
    ]


def test_two_bridges_are_found_by_the_statuses_where_samples_are_forbidden():
    memory = MemoryNetwork()
    over = threading.Event()

    def publish_statuses() -> None:
        for number in range(100_000):
            for session in ("s1", "s2"):
                one = status(session=session, station="dup", t=0.1 * number, samples=number, seq=number)
                memory.transport().put(session_key("dup", session, "status"), encode(one))
            if over.wait(0.005):
                return

    with _thread(publish_statuses):
        probed = probe_network(memory.transport(), "dup", seconds=0.2)
        over.set()
    assert probed.batches == {}
    assert "two bridges teach at dup: s1 and s2" in said(list(judge(probed, "dup")), "bridge")


def test_a_bridge_that_teaches_on_a_full_disk_is_not_blamed(tmp_path):
    pytest.importorskip("caesura_service.app")
    from caesura_service.app import Service  # noqa: PLC0415
    from caesura_service.config import ServiceConfig  # noqa: PLC0415
    from caesura_service.segmentation.fake_pipeline import make_fake_pipeline  # noqa: PLC0415

    config = ServiceConfig(instance="west", listen="tcp/127.0.0.1:0", preset="fake", journal=tmp_path)
    with ExitStack() as stack:
        service = stack.enter_context(Service(config, pipeline_factory=make_fake_pipeline))
        caesura = stack.enter_context(connect(service.endpoint))
        bridge = stack.enter_context(Bridge(caesura.transport, "cell-1", LiveSource(), settings=QUICK))
        bridge.wait_open(30.0)
        grow_no_more(service._file)
        over = threading.Event()

        def teach() -> None:
            for number in range(2000):
                bridge.send(samples(50, t0=number * 0.05))
                if over.wait(0.01):
                    return

        with _thread(teach):
            eventually(lambda: any(one.status.refused for one in snapshots(caesura.transport, "cell-1")))
            found = list(examine_network(caesura.transport, "cell-1", seconds=1.0))
            over.set()
        grow_again(service._file)
    assert "no room left" in said(found, "journal")
    assert grades(found, "gaps") in ([], ["ok"])
    assert "overloaded" in said(found, "refused")
    assert "west cannot write its journal → make room soon" in said(found, "refused")
    assert not [one for one in found if "the bridge sends" in one.remedy or "bridge answers" in one.remedy]


def test_only_the_station_that_is_named_is_looked_at(served):
    with connect(served) as caesura, ExitStack() as stack:
        for station in ("cell-1", "cell-2"):
            bridge = Bridge(caesura.transport, station, LiveSource(), settings=QUICK)
            stack.enter_context(bridge).wait_open(30.0)
        _, text = run("--connect", served, "--seconds", "1", "--station", "cell-2", "--json")
    assert {one["station"] for one in json.loads(text)} == {None, "cell-2"}


class _thread:  # noqa: N801 - used as a function
    """A thread that ends before what it uses does."""

    def __init__(self, target) -> None:
        self._thread = threading.Thread(target=target, daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._thread.join(10.0)


@pytest.mark.parametrize(
    ("endpoint", "words"),
    [
        ("tcp/127.0.0.1:{closed}", "Connection refused"),
        ("tcp/no-such-host.invalid:7447", "no such host"),
        ("localhost", "is no endpoint"),
        ("tcp/localhost:http", "is no endpoint"),
    ],
)
def test_a_wrong_endpoint_ends_the_examination(endpoint, words):
    code, text = run("--connect", endpoint.format(closed=free_port()))
    assert code == 1
    assert words in text
    assert text.count("✗") == 1


def test_something_that_is_no_router_is_distinguished_from_nothing():
    with socket.create_server(("127.0.0.1", 0)) as mute:
        code, text = run("--connect", f"tcp/127.0.0.1:{mute.getsockname()[1]}")
    assert code == 1
    assert "✓ endpoint" in text
    assert "✗ session " in text
    assert "accepts connections and does not answer" in text
    assert "→ look at its process, or check the port" in text


def test_a_file_that_cannot_be_read_is_what_has_to_be_corrected(tmp_path):
    """Something listens there, and the router was suspected."""
    (tmp_path / "client.json5").write_text("{bad")
    with socket.create_server(("127.0.0.1", 0)) as mute:
        endpoint = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        code, text = run("--connect", endpoint, "--zenoh-config", str(tmp_path / "client.json5"))
    assert code == 1
    assert "→ correct the file of --zenoh-config" in text


def test_what_stands_between_us_and_a_router_is_reported_with_its_remedy():
    found = no_session(
        AccessDenied("tls/x:1 does not let us in: it demands a certificate: --zenoh-config FILE")
    )
    assert found.found == "tls/x:1 does not let us in: it demands a certificate"
    assert found.remedy == "--zenoh-config FILE"
    assert no_session(Unreachable("no router at tcp/x:1 for 3 s")).remedy


def batch_of(session: str) -> SampleBatch:
    return SampleBatch(session=session, epoch=0, seq=0, n=1, columns=("t", "px"), t0=0.0, samples=bytes(8))


def test_samples_of_a_session_that_was_never_opened_are_bad_and_those_of_one_that_just_ended_are_not():
    probed = received(well(), state="closed")
    ((station, session),) = probed.statuses
    probed.batches = {(station, session): [batch_of(session)]}
    assert grades(list(judge(probed)), "bridge") == ["warn"]
    probed.batches = {(station, "other"): [batch_of("other")]}
    assert grades(list(judge(probed)), "bridge") == ["bad"]
    probed = well(batches={(station, "other"): [batch_of("other")]})
    assert grades(list(judge(probed)), "bridge") == ["ok", "warn"]


def test_samples_of_an_open_session_are_not_said_to_be_of_one_that_is_over():
    probed = well()
    (((station, session), _),) = probed.statuses.items()
    left = status(session="a-left", batches=50, samples=1000, t=1.0)
    assert left.session < session  # so that the other one is current
    probed.statuses[station, left.session] = [ReceivedStatus(0.0, left)]
    probed.batches = {(station, left.session): [batch_of(left.session)]}
    assert grades(list(judge(probed)), "bridge") == ["ok"]


def test_two_bridges_of_one_session_are_named_and_nothing_is_said_to_be_over():
    probed = well()
    ((station, session),) = probed.statuses
    sent = [batch_of(session).model_copy(update={"bridge": name}) for name in ("east-1", "west-2", "east-1")]
    probed.batches = {(station, session): sent}
    found = list(judge(probed))
    (rivals,) = [one for one in found if one.check == "bridge" and one.grade == "bad"]
    assert rivals.found == f"2 bridges publish {session}: east-1 (2 batches), west-2 (1 batches)"
    assert not [one for one in found if "over" in f"{one.found} {one.remedy}"]


def test_a_recording_is_looked_at_without_a_network(tmp_path):
    recording(3000).save(tmp_path / "demo.npz")
    code, text = run("--file", str(tmp_path / "demo.npz"))
    assert code == 0
    assert "✓ rate         1000 Hz" in text
    code, _ = run("--file", str(tmp_path / "none.npz"))
    assert code == 1


def test_a_station_that_is_not_there_is_no_matter_of_credentials():
    found = list(judge(well(snapshots=[], statuses={}, bridges=[], others=["cell-1", "cell-7"]), "cell-9"))
    assert grades(found, "credentials") == ["ok"]
    assert "stations that are: cell-1, cell-7" in said(found, "bridge")


def test_the_stations_that_are_there_are_asked_for(router):
    with Answering(router.transport()) as service, router.transport() as transport:
        service.snapshots = [snapshot(0, "motion", station="cell-7")]
        service.answers[service_key("fake-1", "status")] = encode(example(ServiceStatus))
        assert probe_network(transport, "cell-9", seconds=0.1).others == ["cell-7"]
        assert probe_network(transport, "cell-7", seconds=0.1).others == []
