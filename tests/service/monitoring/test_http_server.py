"""Metrics and probes over real HTTP, of a real service."""

from __future__ import annotations

import re
import select
import socket
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from prometheus_client import CollectorRegistry, Metric
from prometheus_client.parser import text_string_to_metric_families

from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.monitoring import http_server
from caesura_service.monitoring.health import STUCK_AFTER_S, liveness
from caesura_service.monitoring.http_server import (
    CONNECTIONS,
    SCRAPES,
    ConnectionSlots,
    Health,
    HttpServer,
    WebError,
    parse_address,
)
from caesura_service.monitoring.metrics import MetricsSource, ServiceCollector
from caesura_service.server import NetworkError
from caesura_service.server.budgets import Budgets
from caesura_service.server.network_interface import Channel, Incoming
from caesura_service.server.rate_limit_settings import RateLimits
from caesura_service.server.router_probe import PAUSE_S, STUCK_S, WHY_STUCK
from caesura_service.server.zenoh_network import ZenohNetwork
from clients.conftest import free_port
from harness.fake_pipeline import make_fake_pipeline
from harness.peer import Peer
from harness.processes import eventually
from harness.sessions import batch, closing, opening

DEADLINE_S = 30.0
OPERATIONS = Path(__file__).parents[3] / "docs" / "operations.md"


@pytest.fixture
def service() -> Iterator[Service]:
    config = ServiceConfig(instance="test-1", listen="tcp/127.0.0.1:0", preset="fake", metrics="127.0.0.1:0")
    with Service(config, pipeline_factory=make_fake_pipeline) as running:
        yield running


def observed_of(service: Service) -> MetricsSource:
    return MetricsSource(service.registry, service.status, lambda: True, Budgets(RateLimits()).budgets_of)


def get(url: str) -> tuple[int, str]:
    try:
        with urllib.request.urlopen(url, timeout=DEADLINE_S) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


def scrape(service: Service) -> dict[tuple[str, str], float]:
    """Every sample as Prometheus reads it, by name and the value of its label."""
    status, text = get(f"{service.web.url}/metrics")
    assert status == 200
    return {
        (sample.name, next(iter(sample.labels.values()), "")): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if not sample.name.startswith("caesura_info")
    }


def test_what_is_taught_shows_in_what_prometheus_reads(service):
    with Peer(service.endpoint) as peer:
        peer.command(opening())
        for seq in (0, 1, 1, 2):
            peer.send(batch(seq))
        peer.put("caesura/v1/station/cell-1/samples", b"rubbish", "text/plain")
        peer.until_service(lambda status: "unsupported_version" in status.refused)
        during = scrape(service)
        peer.command(closing(2))
        after = scrape(service)
    assert during["caesura_batches_total", "cell-1"] == 3
    assert during["caesura_samples_total", "cell-1"] == 60
    assert during["caesura_duplicates_total", "cell-1"] == 1
    assert during["caesura_refused_total", "unsupported_version"] == 1
    assert during["caesura_sessions", "open"] == 1
    assert during["caesura_session_open", "cell-1"] == 1
    assert during["caesura_batch_seconds_count", ""] == 4
    assert during["caesura_ready", ""] == 1
    assert 0 <= during["caesura_last_batch_age_seconds", "cell-1"] < DEADLINE_S
    assert (after["caesura_sessions", "open"], after["caesura_sessions", "closed"]) == (0, 1)
    assert ("caesura_last_batch_age_seconds", "cell-1") not in after, "a station at rest is not stale"
    assert after["process_resident_memory_bytes", ""] > 0


def test_probes_report_what_is(service):
    assert get(f"{service.web.url}/healthz") == (200, "ok\n")
    assert get(f"{service.web.url}/readyz") == (200, "ok\n")
    status, body = get(f"{service.web.url}/../etc/passwd")
    assert (status, body) == (404, "known: /metrics, /healthz, /readyz\n")


def test_it_is_alive_and_not_ready_while_it_waits_for_a_router_and_gone_once_it_left():
    url, stop = f"http://127.0.0.1:{free_port()}", threading.Event()
    config = ServiceConfig(
        connect=f"tcp/127.0.0.1:{free_port()}", preset="fake", metrics=url.removeprefix("http://")
    )

    def wait_for_a_router() -> None:
        service = Service(config, pipeline_factory=make_fake_pipeline, stop=stop)
        with suppress(NetworkError), service:
            pass

    waiting = threading.Thread(target=wait_for_a_router)
    waiting.start()
    try:
        assert eventually_well(url)
        assert get(f"{url}/readyz")[0] == 503
        assert get(f"{url}/metrics")[0] == 200
    finally:
        stop.set()
        waiting.join(DEADLINE_S)
    with pytest.raises(urllib.error.URLError):
        get(f"{url}/healthz")


def test_a_service_whose_router_accepts_no_declaration_is_not_ready(monkeypatch: pytest.MonkeyPatch):
    accepts, declare = threading.Event(), ZenohNetwork.declare_subscriber

    def declared(network: ZenohNetwork, key: str, capacity: int) -> Channel[Incoming]:
        if key.endswith("/watch"):
            accepts.wait()
        return declare(network, key, capacity)

    monkeypatch.setattr(ZenohNetwork, "declare_subscriber", declared)
    config = ServiceConfig(listen="tcp/127.0.0.1:0", preset="fake", metrics="127.0.0.1:0")
    try:
        with Service(config, pipeline_factory=make_fake_pipeline) as service:
            service.check_link(STUCK_S)
            assert get(f"{service.web.url}/readyz")[0] == 200
            service.check_link(PAUSE_S)
            assert get(f"{service.web.url}/readyz") == (503, f"{WHY_STUCK}\n")
            assert scrape(service)["caesura_ready", ""] == 0
            assert get(f"{service.web.url}/healthz")[0] == 200, "stations that are served go on"
            accepts.set()
            eventually(lambda: service.check_link(0.0) or get(f"{service.web.url}/readyz")[0] == 200)
    finally:
        accepts.set()


def test_a_worker_that_does_not_come_round_is_not_alive(service):
    observed = observed_of(service)
    at = service.registry.station_counters.stepped_s
    assert liveness(observed, clock=lambda: at + 0.99 * STUCK_AFTER_S).healthy
    stuck = liveness(observed, clock=lambda: at + 10 * STUCK_AFTER_S)
    assert not stuck.healthy
    assert "has not come round" in stuck.reason


def test_an_address_that_is_taken_or_none_is_said():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        config = ServiceConfig(listen="tcp/127.0.0.1:0", preset="fake", metrics=address)
        service = Service(config, pipeline_factory=make_fake_pipeline)
        with pytest.raises(WebError, match=f"metrics at {address}: Address already in use"), service:
            pass
    for wrong in ("9464", "localhost:", "localhost:http", "localhost:99999"):
        with pytest.raises(WebError, match="expected HOST:PORT"):
            parse_address(wrong)


def test_it_answers_over_ipv6_where_there_is_any():
    web = HttpServer("[::1]:0", CollectorRegistry(), alive=lambda: Health(True), ready=lambda: Health(True))
    try:
        web.__enter__()
    except WebError:
        pytest.skip("no IPv6 loopback here")
    with ExitStack() as stack:
        stack.callback(web.__exit__, None, None, None)
        assert web.url.startswith("http://[::1]:")
        assert get(f"{web.url}/healthz")[0] == 200


def test_callers_that_hold_every_place_do_not_keep_a_probe_out(service):
    """24 silent callers once kept 17 of 18 probes out, also where the probe had an address of its own."""
    host, port = service.web.url.removeprefix("http://").split(":")
    for source in ("127.0.0.1", "127.0.0.2"):  # the probe's own address, and another
        with ExitStack() as stack:
            for _ in range(2 * CONNECTIONS):
                caller = socket.create_connection((host, int(port)), source_address=(source, 0))
                stack.enter_context(caller)
            for path in ("healthz", "readyz") * 9:
                assert get(f"{service.web.url}/{path}") == (200, "ok\n")


def test_the_place_that_is_given_away_is_the_oldest_of_the_address_that_holds_the_most():
    places, ends = ConnectionSlots(3), {}
    try:
        for name, peer in (("probe", "a"), ("old", "b"), ("new", "b"), ("late", "c")):
            ends[name] = socket.socketpair()
            places.admit(ends[name][0], peer)
        far = {name: pair[1] for name, pair in ends.items()}
        closed = [name for name, end in far.items() if select.select([end], [], [], 0)[0]]
        assert closed == ["old"]
    finally:
        for pair in ends.values():
            for end in pair:
                end.close()


def test_a_probe_does_not_wait_for_scrapes_and_those_are_limited():
    begun, go_on = threading.Semaphore(0), threading.Event()

    class SlowCollector:
        def collect(self) -> list[Metric]:
            begun.release()
            assert go_on.wait(DEADLINE_S)
            return []

        def describe(self) -> list[Metric]:
            return []

    registry = CollectorRegistry()
    registry.register(SlowCollector())
    with (
        HttpServer("127.0.0.1:0", registry, alive=lambda: Health(True), ready=lambda: Health(True)) as web,
        ThreadPoolExecutor(SCRAPES + 1) as pool,
    ):
        scrapes = [pool.submit(get, f"{web.url}/metrics") for _ in range(SCRAPES + 1)]
        try:
            assert begun.acquire(timeout=DEADLINE_S)
            refused = next(as_completed(scrapes, DEADLINE_S)).result()
            assert refused[0] == 503
            assert f"{SCRAPES} scrapes are under way" in refused[1]
            assert get(f"{web.url}/healthz")[0] == 200
        finally:
            go_on.set()
        assert sorted(one.result(DEADLINE_S)[0] for one in scrapes) == [200] * SCRAPES + [503]


def test_a_caller_that_speaks_too_slowly_is_hung_up_on(service, monkeypatch):
    monkeypatch.setattr(http_server, "TIMEOUT_S", 0.3)
    host, port = service.web.url.removeprefix("http://").split(":")
    deadline = time.monotonic() + DEADLINE_S
    with socket.create_connection((host, int(port))) as caller:
        caller.sendall(b"GET /healthz HTTP/1.0\r\nX: ")
        while not select.select([caller], [], [], 0.02)[0]:  # readable: an end, for nothing was asked
            assert time.monotonic() < deadline
            with suppress(OSError):
                caller.sendall(b"a")


def eventually_well(url: str) -> bool:
    deadline = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline:
        try:
            return get(f"{url}/healthz")[0] == 200
        except (urllib.error.URLError, ConnectionError):
            time.sleep(0.01)
    return False


def test_every_metric_has_its_line_in_the_docs_and_the_other_way_round(service):
    collector = ServiceCollector(observed_of(service))
    families = {
        family.name + {"counter": "_total", "info": "_info"}.get(family.type, "")
        for family in collector.collect()
    }
    documented = set(re.findall(r"^\| `(caesura_\w+)`", OPERATIONS.read_text(), re.MULTILINE))
    assert families == documented
