"""Who is not let in is told why, and what would do."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from socketserver import BaseRequestHandler, ThreadingTCPServer

import pytest
from typer.testing import CliRunner

from caesura_clients import connect
from caesura_protocol.errors import AccessDenied, Unreachable
from caesura_protocol.transport.diagnosis import diagnose_connection
from caesura_service.security import zenoh_files
from caesura_service.security.certificates import Issued, issue_client, issue_router, new_authority
from caesura_service.security.roles import Identity
from clients.conftest import RouterNetwork, free_port
from harness.commands import application
from service.security.acl_world import opened

HOLDER = Identity("bridge", "cell-1")
AUTHORITY = new_authority()
CLIENT = issue_client(AUTHORITY, HOLDER.label, 5)
LONG_AGO = datetime.now(UTC) - timedelta(days=30)


def router_of(issued: Issued) -> str:
    tls = zenoh_files.server_tls(AUTHORITY.certificate, issued)
    return zenoh_files.router_file(tls, {HOLDER: HOLDER.label}, "tls/127.0.0.1:0")


def client(issued: Issued = CLIENT, authority: Issued = AUTHORITY) -> str:
    return zenoh_files.client_file(authority.certificate, issued, "tls/127.0.0.1:0")


@contextmanager
def routing(text: str, path) -> Iterator[str]:
    """A router with this file; yields the port."""
    port = str(free_port())
    protocol = "tcp" if '"tls"' not in text else "tls"
    (path / "router.json5").write_text(text)
    with opened(path / "router.json5", **{"listen/endpoints": [f"{protocol}/127.0.0.1:{port}"]}):
        yield port


@pytest.fixture(scope="module")
def port(tmp_path_factory) -> Iterator[str]:
    good = issue_router(AUTHORITY, "router", ["127.0.0.1"], 5)
    with routing(router_of(good), tmp_path_factory.mktemp("router")) as number:
        yield number


def with_password(password: str = "guess") -> str:
    return zenoh_files.password_client_file(AUTHORITY.certificate, "me", password, "tls/127.0.0.1:0")


def refused(tmp_path, endpoint: str, text: str | None) -> str:
    file = None
    if text is not None:
        file = tmp_path / "client.json5"
        file.write_text(text)
    with pytest.raises(Unreachable) as error:
        connect(endpoint, config_file=file, timeout_s=0.0)
    assert isinstance(error.value, AccessDenied)
    said = str(error.value)
    assert "\n" not in said
    assert said.startswith(endpoint)
    return said


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (with_password(), "demands a certificate"),
        (
            client(issue_client(new_authority(), "bridge.cell-1", 5)),
            "our certificate is not of its authority",
        ),
        (client(issue_client(AUTHORITY, "bridge.cell-1", 5, now=LONG_AGO)), "our certificate has ended"),
        (client(issue_router(AUTHORITY, "router", ["127.0.0.1"], 5)), "not one for a client"),
        (client(authority=new_authority()), "its certificate is not of our authority"),
        (client(Issued(CLIENT.certificate, AUTHORITY.key)), "cannot be read"),
        (None, "its certificate is not of our authority"),
    ],
    ids=["none", "foreign", "expired", "router's", "other root", "other key", "no file"],
)
def test_a_certificate_that_will_not_do(port, tmp_path, text, words):
    assert words in refused(tmp_path, f"tls/127.0.0.1:{port}", text)


def test_a_router_whose_certificate_names_another_host(port, tmp_path):
    assert "does not name this host" in refused(tmp_path, f"tls/localhost:{port}", client())


def test_a_router_whose_certificate_has_ended(tmp_path):
    old = issue_router(AUTHORITY, "router", ["127.0.0.1"], 5, now=LONG_AGO)
    with routing(router_of(old), tmp_path) as port:
        assert "its certificate has ended" in refused(tmp_path, f"tls/127.0.0.1:{port}", client())


def test_the_wrong_protocol(port, tmp_path):
    assert "it speaks TLS: write tls/" in refused(tmp_path, f"tcp/127.0.0.1:{port}", None)
    with RouterNetwork() as plain:
        endpoint = f"tls/127.0.0.1:{plain.port}"
        assert "it does not speak TLS: write tcp/" in refused(tmp_path, endpoint, client())


def test_a_password_that_will_not_do(tmp_path):
    (tmp_path / "users.txt").write_text("me:secret\n")
    server = issue_router(AUTHORITY, "router", ["127.0.0.1"], 5)
    tls = zenoh_files.server_tls(AUTHORITY.certificate, server)
    text = zenoh_files.password_router_file(tls, [], "tls/127.0.0.1:0", str(tmp_path / "users.txt"))
    with routing(text, tmp_path) as port:
        endpoint = f"tls/127.0.0.1:{port}"
        assert "does not know user 'me'" in refused(tmp_path, endpoint, with_password())
        assert "demands a user and a password" in refused(tmp_path, endpoint, client())


def test_where_nothing_listens_waiting_may_help():
    with pytest.raises(Unreachable, match=r"no router at .* is the service running") as error:
        connect(f"tls/127.0.0.1:{free_port()}", timeout_s=0.0)
    assert not isinstance(error.value, AccessDenied)
    with pytest.raises(Unreachable, match=r"there is no host nowhere\.invalid"):
        connect("tcp/nowhere.invalid:7447", timeout_s=0.0)


@pytest.mark.parametrize("protocol", ["tcp", "tls"])
def test_a_router_that_hangs_is_waited_for(tmp_path, protocol):
    """It was said to demand a user and a password, or to speak no TLS. A bridge that started then ended."""
    (tmp_path / "client.json5").write_text(client())
    file = tmp_path / "client.json5" if protocol == "tls" else None
    with socket.create_server(("127.0.0.1", 0)) as silent:  # the system accepts, and no process reads
        endpoint = f"{protocol}/127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(Unreachable, match="accepts connections and does not answer") as error:
            connect(endpoint, config_file=file, timeout_s=0.0)
    assert not isinstance(error.value, AccessDenied)


class BadRequest(BaseRequestHandler):
    """What a web server says to whatever is no request."""

    def handle(self) -> None:
        if self.request.recv(4096):
            self.request.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")


@contextmanager
def web_server() -> Iterator[int]:
    with ThreadingTCPServer(("127.0.0.1", 0), BadRequest) as server:
        server.daemon_threads = True
        thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        try:
            yield server.server_address[1]
        finally:
            server.shutdown()
            thread.join(30.0)


@pytest.mark.parametrize("protocol", ["tcp", "tls"])
def test_what_answers_and_is_no_router_is_called_so(tmp_path, protocol):
    """A web server was said to demand a user and a password."""
    with web_server() as port:
        text = client() if protocol == "tls" else None
        said = refused(tmp_path, f"{protocol}/127.0.0.1:{port}", text)
    assert "it is no Zenoh router, and answers b'HTTP/1.1" in said


def test_a_router_that_answers_again_is_tried_again():
    with RouterNetwork() as plain:
        found = diagnose_connection(f"tcp/127.0.0.1:{plain.port}", lambda _: None)
    assert not isinstance(found, AccessDenied)
    assert "answers, and opened no session in time; try again" in str(found)


def test_a_bridge_does_not_wait_for_what_waiting_will_not_change(port, tmp_path, monkeypatch):
    monkeypatch.setattr("caesura_clients.cli.options.CONNECT_TIMEOUT_S", 0.1)
    (tmp_path / "client.json5").write_text(client(authority=new_authority()))
    words = ["bridge", "--file", "data/button.npz", "--connect", f"tls/127.0.0.1:{port}"]
    words += ["--zenoh-config", str(tmp_path / "client.json5")]
    with ThreadPoolExecutor(1) as pool:
        done = pool.submit(CliRunner().invoke, application(), words).result(timeout=60.0)
    assert done.exit_code == 1
    assert "its certificate is not of our authority" in done.stderr


def test_a_router_that_closes_every_connection_at_once_has_no_room_and_waiting_helps():
    """It was said to demand a user and a password, and the command ended."""
    with socket.create_server(("127.0.0.1", 0)) as full:
        endpoint = f"tcp/127.0.0.1:{full.getsockname()[1]}"

        def close_at_once() -> None:
            full.accept()[0].close()

        router = threading.Thread(target=close_at_once, daemon=True)
        router.start()
        found = diagnose_connection(endpoint, lambda _: None)
        router.join(30.0)
    assert not isinstance(found, AccessDenied)
    assert "closes every connection at once: more connections wait there" in str(found)
