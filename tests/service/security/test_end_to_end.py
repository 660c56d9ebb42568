"""The service behind generated files, its clients with theirs, and those who try more than they may."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest
from prometheus_client import generate_latest
from typer.testing import CliRunner

from caesura_clients import Caesura, connect
from caesura_clients.bridge import Bridge
from caesura_clients.bridge.control_client import ControlClient
from caesura_clients.cli.bridge import _why_it_waits
from caesura_clients.doctor.endpoint_check import check_certificate
from caesura_protocol.codec import encode
from caesura_protocol.errors import AccessDenied, ProtocolError
from caesura_protocol.keys import service_key, station_key
from caesura_protocol.messages import Ack, Close
from caesura_protocol.transport.zenoh_transport import certificate_end_at
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.monitoring.metrics import metrics_of
from caesura_service.security.certificates import expiry
from clients.bridging import QUICK
from clients.conftest import free_port
from clients.examples import LiveSource, samples
from clients.fake_service import eventually
from harness.commands import application
from harness.fake_pipeline import make_fake_pipeline
from harness.sessions import batch, opening
from service.security.acl_world import certificates, opened


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    path = tmp_path_factory.mktemp("certs")
    certificates(path)
    return path


@pytest.mark.parametrize("holder", ["router", "service.west"])
def test_the_end_of_the_certificate_of_a_service_is_a_metric(directory, holder):
    """Certificates that were made on one day ended in one minute, and nothing said so before."""
    ends = expiry((directory / f"{holder}.crt").read_bytes()).timestamp()
    file, router = directory / f"{holder}.json5", None if holder == "router" else "tls/127.0.0.1:7447"
    config = ServiceConfig(zenoh_config=file, connect=router, preset="fake")
    service = Service(config, pipeline_factory=make_fake_pipeline)
    assert service.certificate_end == ends
    pages = generate_latest(metrics_of(service._observed)).decode()
    (value,) = re.findall(r"^caesura_certificate_end_timestamp_seconds (\S+)$", pages, re.MULTILINE)
    assert float(value) == ends
    assert Service(ServiceConfig(preset="fake"), pipeline_factory=make_fake_pipeline).certificate_end is None


@pytest.mark.parametrize("days", [29.9, 30.1])
def test_the_doctor_warns_of_the_end_of_the_routers_certificate(network, directory, days):
    end = expiry((directory / "router.crt").read_bytes()).timestamp()
    assert certificate_end_at(network.endpoint, directory / "dashboard.wall.json5") == end
    check = check_certificate(end, end - 86400 * days)
    assert (check.grade, "in 29 days" in check.found) == (("warn", True) if days < 30 else ("ok", False))


@contextmanager
def with_its_own_router(directory) -> Iterator[str]:
    config = ServiceConfig(
        instance="west",
        listen="tls/127.0.0.1:0",
        zenoh_config=directory / "router.json5",
        preset="fake",
    )
    with Service(config, pipeline_factory=make_fake_pipeline) as service:
        yield service.endpoint


@contextmanager
def behind_another_router(directory, *instances: str) -> Iterator[str]:
    endpoint = f"tls/127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        router = opened(directory / "router.json5", **{"listen/endpoints": [endpoint]})
        stack.callback(router.close)
        for name in instances or ("west",):
            file = directory / f"service.{name}.json5"
            config = ServiceConfig(instance=name, connect=endpoint, zenoh_config=file, preset="fake")
            stack.enter_context(Service(config, pipeline_factory=make_fake_pipeline))
        yield endpoint


@pytest.fixture(scope="module", params=[with_its_own_router, behind_another_router])
def network(request, directory) -> Iterator[SecuredNetwork]:
    with request.param(directory) as endpoint, SecuredNetwork(directory, endpoint) as opened_network:
        yield opened_network


class SecuredNetwork:
    def __init__(self, directory, endpoint: str) -> None:
        self.endpoint = endpoint
        self._directory = directory
        self._stack = ExitStack()

    def __enter__(self) -> SecuredNetwork:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def as_(self, label: str, **options) -> Caesura:
        file = self._directory / f"{label}.json5"
        return self._stack.enter_context(connect(self.endpoint, config_file=file, **options))


def test_a_bridge_teaches_and_a_dashboard_reads(network):
    robot, wall = network.as_("bridge.cell-1"), network.as_("dashboard.wall")
    with Bridge(robot.transport, "cell-1", LiveSource(), session="taught", settings=QUICK) as bridge:
        bridge.wait_open(30.0)
        for start in range(10):
            bridge.send(samples(100, t0=start / 10))
        assert wall.stations() == ["cell-1"]
        assert bridge.finish().state == "closed"
    snapshot = wall.snapshot("cell-1", "taught")
    assert (snapshot.status.samples, snapshot.status.state) == (1000, "closed")
    assert [one.session for one in wall.sessions("cell-1")] == ["taught"]
    assert wall.program("cell-1").session == "taught"
    assert [status.instance for status in wall.services()] == ["west"]


def test_a_dashboard_follows_what_is_taught(network):
    robot, wall = network.as_("bridge.cell-1"), network.as_("dashboard.wall")
    followed = wall.results("cell-1", "followed", silence_s=30.0)
    with Bridge(robot.transport, "cell-1", LiveSource(), session="followed", settings=QUICK) as bridge:
        bridge.wait_open(30.0)
        bridge.send(samples(1000, t0=0.0))
        bridge.finish()
        assert any(update.closed and update.status.samples == 1000 for update in followed)


def test_samples_that_got_lost_are_asked_for_through_the_rules(network):
    robot, wall = network.as_("bridge.cell-1"), network.as_("dashboard.wall")
    with Bridge(robot.transport, "cell-1", LiveSource(), session="holes", settings=QUICK) as bridge:
        bridge.wait_open(30.0)
        really, dropped = robot.transport.put, []

        def lossy(key, content, **options):
            dropped.append(key)
            if len(dropped) % 3:
                really(key, content, **options)

        robot.transport.put = lossy
        bridge.send(samples(1000, t0=0.0))
        eventually(lambda: wall.snapshot("cell-1", "holes").status.samples == 1000)
        bridge.finish()
    assert wall.snapshot("cell-1", "holes").status.gaps == ()
    assert len(dropped) > 3


@pytest.mark.parametrize(("label", "may"), [("dashboard.wall", False), ("operator.boss", True)])
def test_an_operator_may_send_commands_and_a_dashboard_may_not(network, label, may):
    robot, wall = network.as_("bridge.cell-2"), network.as_("dashboard.wall")
    name = f"left-alone-by-{label.partition('.')[0]}"
    assert isinstance(ControlClient(robot.transport, "cell-2").ask(opening(name)), Ack)
    asked = ControlClient(network.as_(label).transport, "cell-2").ask(Close(session=name, last_seq=-1))
    assert (asked is not None) == may
    assert (wall.snapshot("cell-2", name).status.state == "closed") == may


def test_a_bridge_can_neither_send_for_another_station_nor_command_it(network):
    thief, owner = network.as_("bridge.cell-1"), network.as_("bridge.cell-2")
    line = ControlClient(owner.transport, "cell-2")
    line.ask(opening("theirs"))
    assert ControlClient(thief.transport, "cell-2").ask(Close(session="theirs", last_seq=-1)) is None
    rubbish = encode(batch(0, "theirs"))._replace(payload=b"rubbish")
    for content in (*(encode(batch(number, "theirs")) for number in range(5)), rubbish):
        thief.transport.put(station_key("cell-2", "samples"), content)
    with pytest.raises(ProtocolError, match="unknown_session"):  # behind all that, on the same link
        ControlClient(thief.transport, "cell-1").ask(Close(session="none", last_seq=-1))
    ack = line.ask(opening("theirs"))
    assert (ack.state, ack.next_seq) == ("open", 0)
    status = network.as_("dashboard.wall").snapshot("cell-2", "theirs").status
    assert (status.samples, status.refused) == (0, {})


def test_a_bridge_reads_no_other_station_and_poses_as_no_service(network):
    thief, wall = network.as_("bridge.cell-1"), network.as_("dashboard.wall")
    ControlClient(network.as_("bridge.cell-2").transport, "cell-2").ask(opening("private"))
    assert not thief.transport.query("caesura/v1/session/cell-2/private/snapshot").replies
    assert not thief.transport.query(station_key("*", "program")).replies
    with thief.transport.declare_token(service_key("fake", "alive")):
        assert not thief.transport.query("caesura/v1/session/cell-1/none/snapshot").replies
        assert wall.transport.list_tokens(service_key("*", "alive")) == (service_key("west", "alive"),)


def test_no_client_gets_in_without_a_certificate(network, directory):
    with pytest.raises(AccessDenied, match="it demands a certificate"):
        connect(network.endpoint, config_file=directory / "bridge.cell-1.password.json5", timeout_s=0.0)
    with pytest.raises(AccessDenied):
        connect(network.endpoint, timeout_s=0.0)


def run(network, directory, label: str, *words: str):
    where = ("--connect", network.endpoint, "--zenoh-config", str(directory / f"{label}.json5"))
    return CliRunner().invoke(application(), [*words, *where])


def test_the_command_line_works_with_the_generated_files(network, directory):
    teach = ("bridge", "--file", "data/button.npz", "--pace", "fast", "--session", "typed")
    done = run(network, directory, "bridge.cell-1", *teach, "--station", "cell-1")
    assert (done.exit_code, done.stdout.split(",")[0]) == (0, "cell-1/typed closed"), done.stderr
    seen = run(network, directory, "dashboard.wall", "sessions", "list", "--station", "cell-1", "--json")
    assert "typed" in seen.stdout
    assert run(network, directory, "dashboard.wall", "program", "--station", "cell-1").exit_code == 0
    assert run(network, directory, "dashboard.wall", "watch", "--station", "cell-1", "--once").exit_code == 0


def test_who_may_not_read_is_not_informed_that_there_is_nothing(network, directory):
    done = run(network, directory, "bridge.cell-1", "sessions", "list")
    assert done.exit_code == 1
    assert "is alive, and a query for caesura/v1/session/*/*/snapshot ends without an answer" in done.stderr
    assert "it is forbidden for these credentials" in done.stderr


def test_a_bridge_with_the_credentials_of_another_station_is_reported(network):
    thief = network.as_("bridge.cell-1")
    bridge = Bridge(thief.transport, "cell-2", LiveSource([samples(10)]))
    assert "are these the credentials of bridge.cell-2?" in _why_it_waits(thief, bridge)


def test_instances_share_the_stations_through_the_rules(directory):
    with (
        behind_another_router(directory, "west", "east") as endpoint,
        SecuredNetwork(directory, endpoint) as network,
    ):
        wall = network.as_("dashboard.wall")
        assert {status.instance for status in wall.services()} == {"west", "east"}
        for station in ("cell-1", "cell-2"):
            robot = network.as_(f"bridge.{station}")
            with Bridge(robot.transport, station, LiveSource(), session="s1", settings=QUICK) as bridge:
                bridge.wait_open(30.0)
                bridge.send(samples(1000))
                bridge.finish()
        known = [(one.station, one.state) for one in wall.sessions()]
        assert known == [("cell-1", "closed"), ("cell-2", "closed")]
        assert sum(status.sessions_closed for status in wall.services()) == 2  # one of them has each
