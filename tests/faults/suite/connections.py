"""Silent connections at every port of a service, for longer than a TLS handshake may take by default."""

from __future__ import annotations

import time
import urllib.error
import urllib.request
from contextlib import ExitStack
from pathlib import Path

from caesura_clients import connect
from caesura_protocol.errors import CaesuraError
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_service.offline_segmentation import segment_recording
from caesura_service.security.credential_store import CredentialStore, IssueRequest, identities
from clients.conftest import free_port
from faults.suite.outcome import Row
from harness.processes import RECORDING, SAMPLES, SESSION, ServiceProcess, running, snapshot, teaching
from harness.silent import Silent

CONNECTIONS = 150  # Zenoh accepts ten a second at most while handshakes fail, each after 10 s by default
CALLERS = 24
FROM = "127.0.0.2"
UNTIL_S = 12.0  # the first handshakes have failed by then, if they ever do
TRIES = 8
TRY_S = 5.0
MOST_S = 1.0  # a holder of a certificate is in by then
PROBES = 18


def silent_connections(directory: Path) -> Row:
    """150 at the router, 24 at the metrics; a dashboard and a bridge come, and probes are made."""
    certificates = directory / "certs"
    holders = [*identities("dashboard", ["wall"]), *identities("bridge", ["cell-1"])]
    CredentialStore(certificates).issue(IssueRequest(holders, hosts=["127.0.0.1"]))
    metrics = free_port()
    options = ("--zenoh-config", str(certificates / "router.json5"), "--metrics", f"127.0.0.1:{metrics}")
    with ExitStack() as stack:
        service = stack.enter_context(
            running(ServiceProcess(directory / "journal", *options, protocol="tls"))
        )
        port = int(service.endpoint.rpartition(":")[2])
        stack.enter_context(Silent(port, CONNECTIONS, source=FROM))
        stack.enter_context(Silent(metrics, CALLERS, source=FROM))
        time.sleep(UNTIL_S)
        took = [_took_s(service.endpoint, certificates / "dashboard.wall.json5") for _ in range(TRIES)]
        well = sum(_is_well(f"http://127.0.0.1:{metrics}/healthz") for _ in range(PROBES))
        lost, doubled, equal = _taught(service.endpoint, certificates)
    note = (
        f"{TRIES} holders of a certificate: in within {max(took):.2f} s; {well} of {PROBES} probes answered"
    )
    met = max(took) < MOST_S and well == PROBES and equal and not lost and not doubled
    return Row(1, SAMPLES, lost, doubled, "yes" if equal else "no", max(took), note, met)


def _taught(endpoint: str, certificates: Path) -> tuple[int, int, bool]:
    """What a bridge that comes now has lost and doubled, and whether the results are those of a file."""
    try:
        with (
            connect(endpoint, config_file=certificates / "bridge.cell-1.json5", timeout_s=TRY_S) as robot,
            connect(endpoint, config_file=certificates / "dashboard.wall.json5", timeout_s=TRY_S) as reader,
            teaching(robot, "cell-1") as end,
        ):
            end.result()
            found = snapshot(reader, "cell-1")
    except CaesuraError:
        found = None
    if found is None:
        return SAMPLES, 0, False
    expected = segment_recording(RECORDING)
    equal = (found.status.session, found.segments.segments) == (SESSION, expected.segments)
    return SAMPLES - found.status.samples, found.status.repeats, equal


def _took_s(endpoint: str, file: Path) -> float:
    """How long it takes to come in [s]; inf where it fails."""
    began = time.monotonic()
    try:
        with ZenohTransport(endpoint, config_file=file, timeout_s=TRY_S):
            return time.monotonic() - began
    except CaesuraError:
        return float("inf")


def _is_well(url: str) -> bool:
    try:
        with urllib.request.urlopen(url, timeout=TRY_S) as answer:
            return bool(answer.status == 200)
    except (urllib.error.URLError, OSError):
        return False
