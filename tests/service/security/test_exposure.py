"""Which endpoints other machines reach, and what they demand of who connects."""

from __future__ import annotations

import json
import logging
import threading
from pathlib import Path

import pytest

from caesura_service.security import exposure
from caesura_service.security.credential_store import CredentialStore, IssueRequest, identities
from caesura_service.server.network_join import DEFAULT_ENDPOINT, NetworkError, NetworkSettings, join
from clients.conftest import free_port

HOSTS = {
    "localhost": ("127.0.0.1", "::1"),
    "robot": ("10.1.2.3",),
    "both": ("127.0.0.1", "10.1.2.3"),
}


def resolve(host: str) -> tuple[str, ...]:
    literal = host.replace(".", "").isdigit() or ":" in host
    return (host,) if literal else HOSTS.get(host, ())


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:7447",
        "tcp/127.9.9.9:7447",
        "tcp/[::1]:7447",
        "tcp/[::ffff:127.0.0.1]:7447",
        "tcp/localhost:7447",
        "TCP/127.0.0.1:7447",
        "tls/127.0.0.1:7447#enable_mtls=false",
        "udp/127.0.0.1:7447?rel=0",
        "ws/localhost:80",
        "unixsock-stream//tmp/caesura.sock",
        "unixpipe/caesura",
    ],
)
def test_what_this_machine_alone_reaches(endpoint):
    assert exposure.is_local(endpoint, resolve)


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/0.0.0.0:7447",
        "tcp/[::]:7447",
        "tcp/10.1.2.3:7447",
        "tcp/[fe80::1%eth0]:7447",
        "tcp/robot:7447",
        "tcp/both:7447",  # one of its addresses is not a loopback
        "tcp/nobody-knows:7447",
        "tcp/:7447",
        "tcp/0.0.0.0:7447#iface=lo",
        "udp/224.0.0.1:7447",
        "vsock/-1:7447",
        "serial//dev/ttyUSB0#baudrate=115200",
        "127.0.0.1:7447",
        "",
    ],
)
def test_what_other_machines_may_reach(endpoint):
    assert not exposure.is_local(endpoint, resolve)


AUTHORITY = {"transport/link/tls/root_ca_certificate": "ca.crt"}
MUTUAL = {"transport/link/tls/enable_mtls": True}
PASSWORDS = {"transport/auth/usrpwd/dictionary_file": "me:secret\n"}
EMPTY = {"transport/auth/usrpwd/dictionary_file": "\n"}


@pytest.mark.parametrize(
    ("endpoint", "settings", "demanded"),
    [
        ("tls/0.0.0.0:1", {}, "nothing"),  # TLS alone proves the router, not who connects
        ("tls/0.0.0.0:1", MUTUAL, "nothing"),  # zenoh would take any public authority's word
        ("tls/0.0.0.0:1", AUTHORITY, "nothing"),
        ("tls/0.0.0.0:1", MUTUAL | AUTHORITY, "certificate"),
        ("tls/0.0.0.0:1", MUTUAL | {"transport/link/tls/root_ca_certificate_base64": "LS0"}, "certificate"),
        ("quic/0.0.0.0:1", MUTUAL | AUTHORITY, "certificate"),
        ("tcp/0.0.0.0:1", MUTUAL | AUTHORITY, "nothing"),
        ("tls/0.0.0.0:1#enable_mtls=false", MUTUAL | AUTHORITY, "nothing"),
        ("tls/0.0.0.0:1#enable_mtls=true", AUTHORITY, "certificate"),
        ("tls/0.0.0.0:1#enable_mtls=true;root_ca_certificate_file=ca.crt", {}, "certificate"),
        ("tcp/0.0.0.0:1", PASSWORDS, "password"),
        ("tls/0.0.0.0:1", PASSWORDS, "password"),
        ("tls/0.0.0.0:1", PASSWORDS | MUTUAL | AUTHORITY, "certificate"),
        ("tls/0.0.0.0:1", EMPTY, "nothing"),  # zenoh lets everybody in
        ("tcp/0.0.0.0:1", {"transport/auth/usrpwd/user": "me"}, "nothing"),  # what it would show, as a client
    ],
)
def test_what_an_endpoint_demands(endpoint, settings, demanded, tmp_path):
    settings = dict(settings)
    if content := settings.get("transport/auth/usrpwd/dictionary_file"):
        (tmp_path / "users.txt").write_text(content)
        settings["transport/auth/usrpwd/dictionary_file"] = str(tmp_path / "users.txt")
    assert exposure.required_credentials(endpoint, settings.get) == demanded


def test_a_dictionary_that_cannot_be_read_is_no_credential():
    assert exposure.required_credentials("tls/0.0.0.0:1", {**PASSWORDS}.get) == "nothing"


def joined(**settings) -> str:
    session, endpoint = join(NetworkSettings(**settings), threading.Event())
    session.close()
    return endpoint


def written(tmp_path: Path, settings: dict) -> Path:
    file = tmp_path / "zenoh.json5"
    file.write_text(json.dumps(settings))
    return file


@pytest.mark.parametrize("host", ["0.0.0.0", "[::]"])
def test_an_open_endpoint_is_not_listened_on(host):
    endpoint = f"tcp/{host}:{free_port()}"
    with pytest.raises(NetworkError, match="--insecure") as refused:
        joined(listen=endpoint)
    assert str(refused.value).startswith(endpoint)
    assert "caesura certs" in str(refused.value)
    assert "127.0.0.1" in str(refused.value)


def test_insecure_listens_all_the_same_and_says_so(caplog):
    endpoint = f"tcp/0.0.0.0:{free_port()}"
    assert joined(listen=endpoint, insecure=True) == endpoint
    assert f"{endpoint} is open to every client" in caplog.text


def test_one_open_endpoint_among_several_in_a_file_is_enough(tmp_path):
    endpoints = [f"tcp/127.0.0.1:{free_port()}", f"tcp/0.0.0.0:{free_port()}"]
    for listen in (endpoints, {"router": endpoints}):
        file = written(tmp_path, {"listen": {"endpoints": listen}})
        with pytest.raises(NetworkError, match=endpoints[1]):
            joined(config_file=file)


def test_a_file_says_where_to_listen_unless_an_option_does(tmp_path):
    in_file, in_option = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    file = written(tmp_path, {"listen": {"endpoints": [in_file]}})
    assert joined(config_file=file) == in_file
    assert joined(config_file=file, listen=in_option) == in_option


def test_a_file_that_says_nothing_of_it_listens_here_alone(tmp_path, monkeypatch):
    here = f"tcp/127.0.0.1:{free_port()}"
    monkeypatch.setattr("caesura_service.server.network_join.DEFAULT_ENDPOINT", here)
    assert DEFAULT_ENDPOINT.startswith("tcp/127.0.0.1:")
    assert joined(config_file=written(tmp_path, {"mode": "router"})) == here


def test_the_generated_files_are_listened_with_and_no_warning(tmp_path, caplog):
    listen = f"tls/0.0.0.0:{free_port()}"
    CredentialStore(tmp_path).issue(IssueRequest(listen=listen, passwords=True))
    for file in ("router.json5", "router.password.json5"):
        assert joined(config_file=tmp_path / file) == listen
    assert not caplog.records


def test_passwords_without_tls_and_rules_are_allowed_with_a_warning(tmp_path, caplog):
    (tmp_path / "users.txt").write_text("me:secret\n")
    file = written(tmp_path, {"transport": {"auth": {"usrpwd": {"dictionary_file": "users.txt"}}}})
    joined(config_file=file, listen=f"tcp/0.0.0.0:{free_port()}")
    assert "is not encrypted" in caplog.text
    assert "has no access rules" in caplog.text


def test_a_client_that_shows_nothing_to_another_machine_is_warned(caplog):
    caplog.set_level(logging.WARNING)
    stop = threading.Event()
    stop.set()
    with pytest.raises(NetworkError):
        join(NetworkSettings(connect="tcp/nowhere.invalid:7447"), stop)
    assert "no certificate or password is presented" in caplog.text


@pytest.mark.parametrize("where", ["connect", "listen"])
def test_an_endpoint_that_is_none_is_named_with_one_that_is(where):
    """`caesura serve --connect x` printed a traceback."""
    with pytest.raises(NetworkError, match=r"^'x' is no endpoint: write it as tcp/127") as no:
        join(NetworkSettings(**{where: "x"}, insecure=True), threading.Event())
    assert "\n" not in str(no.value)


def test_the_file_of_a_client_is_not_served_with(tmp_path):
    CredentialStore(tmp_path).issue(IssueRequest(identities("service", ["west"]), hosts=["10.0.0.1"]))
    with pytest.raises(NetworkError, match=r"add --connect tls/10\.0\.0\.1:7447"):
        joined(config_file=tmp_path / "service.west.json5")


@pytest.mark.parametrize(
    "endpoint", ["127.0.0.1:7447", "nonsense", "tcp/localhost", "tcp/:7447", "tcp/[::]:http"]
)
def test_what_is_no_endpoint_is_not_said_to_be_reached_from_other_machines(endpoint):
    with pytest.raises(NetworkError, match=r"is no endpoint: write it as tcp/127"):
        join(NetworkSettings(listen=endpoint), threading.Event())
    assert exposure.exposure_error("tcp/0.0.0.0:7447").startswith("tcp/0.0.0.0:7447 can be reached")
