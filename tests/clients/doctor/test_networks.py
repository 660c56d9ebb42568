"""`caesura doctor` on real networks: services, wrong endpoints, a bridge that hangs, nothing at all."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack

import pytest
import typer
from typer.testing import CliRunner

from caesura_clients import connect
from caesura_clients.bridge import Bridge
from caesura_clients.cli.commands import register
from caesura_clients.doctor.endpoint_check import no_session
from caesura_clients.doctor.probes import probe_network
from caesura_clients.doctor.run_checks import examine_network, judge
from caesura_clients.query import snapshots
from caesura_protocol.codec import Encoded, encode
from caesura_protocol.errors import AccessDenied, Unreachable
from caesura_protocol.keys import service_key, session_key, station_key
from caesura_protocol.messages import BridgeStatus, ServiceStatus
from caesura_protocol.package_version_and_extras import installed_version
from caesura_protocol.transport.memory import MemoryNetwork
from clients.answering import Answering
from clients.bridging import QUICK
from clients.conftest import free_port
from clients.doctor.judged import grades, said, status
from clients.examples import LiveSource, example, recording, samples, snapshot
from clients.fake_service import eventually
from service.journal.journal_files import grow_again, grow_no_more


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


def test_what_a_bridge_in_standby_says_is_listened_to():
    memory, over = MemoryNetwork(), threading.Event()
    waits = BridgeStatus(station="cell-1", bridge="host-1", state="ready", source="franky")

    def publish() -> None:
        while not over.wait(0.005):
            memory.transport().put(station_key("cell-1", "bridge_status"), encode(waits))

    publishing = threading.Thread(target=publish, daemon=True)
    publishing.start()
    try:
        probed = probe_network(memory.transport(), seconds=0.1)
    finally:
        over.set()
        publishing.join()
    assert (probed.standby, probed.refusals) == ({"cell-1": waits}, [])


@pytest.fixture
def served() -> Iterator[str]:
    """A real service on a free port, with the fake pipeline."""
    pytest.importorskip("caesura_service.app")
    from caesura_service.app import Service  # noqa: PLC0415
    from caesura_service.config import ServiceConfig  # noqa: PLC0415
    from harness.fake_pipeline import make_fake_pipeline  # noqa: PLC0415

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
    from harness.fake_pipeline import make_fake_pipeline  # noqa: PLC0415

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
        AccessDenied("tls/x:1 rejects this client: it demands a certificate: --zenoh-config FILE")
    )
    assert found.found == "tls/x:1 rejects this client: it demands a certificate"
    assert found.remedy == "--zenoh-config FILE"
    assert no_session(Unreachable("no router at tcp/x:1 for 3 s")).remedy


def test_a_recording_is_looked_at_without_a_network(tmp_path):
    recording(3000).save(tmp_path / "demo.npz")
    code, text = run("--file", str(tmp_path / "demo.npz"))
    assert code == 0
    assert "✓ rate         1000 Hz" in text
    code, _ = run("--file", str(tmp_path / "none.npz"))
    assert code == 1


def test_the_stations_that_are_there_are_asked_for(router):
    with Answering(router.transport()) as service, router.transport() as transport:
        service.snapshots = [snapshot(0, "motion", station="cell-7")]
        service.answers[service_key("fake-1", "status")] = encode(example(ServiceStatus))
        assert probe_network(transport, "cell-9", seconds=0.1).others == ["cell-7"]
        assert probe_network(transport, "cell-7", seconds=0.1).others == []
