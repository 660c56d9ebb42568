"""Who gets in: no page of another site, nobody without the password, and nothing from outside."""

from __future__ import annotations

from typing import Any

import pytest

from caesura_clients.dashboard import access
from caesura_clients.dashboard.access import LOOPBACK, AccessMiddleware, Attempts
from dashboard.conftest import ran

PASSWORD = "correct horse"


async def inner(scope: Any, receive: Any, send: Any) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"inside"})


def ask(guarded, path="/", *, method="GET", kind="http", body=b"", peer="127.0.0.1", **headers):
    """Status (or close code), headers and body of an answer."""
    sent: list[dict[str, Any]] = []

    async def receive():
        return {"type": "http.request", "body": body, "more_body": False}

    async def send(event):
        sent.append(event)

    named = {"host": "127.0.0.1:8080", **headers}
    scope = {
        "type": kind,
        "method": method,
        "path": path,
        "client": (peer, 50000),
        "headers": [(name.encode(), value.encode()) for name, value in named.items()],
    }
    ran(guarded(scope, receive, send))
    first = sent[0]
    if kind == "websocket":
        return first.get("code", first.get("status")), {}, b""
    answered = {name.decode(): value.decode() for name, value in first["headers"]}
    return first["status"], answered, b"".join(event.get("body", b"") for event in sent[1:])


@pytest.fixture
def local():
    return AccessMiddleware(inner, names=LOOPBACK, password=None)


@pytest.fixture
def locked(monkeypatch):
    monkeypatch.setattr(access, "WRONG_S", 0.0)
    return AccessMiddleware(inner, names=None, password=PASSWORD)


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "[::1]:8080"])
def test_it_is_asked_by_its_own_names(local, host):
    assert ask(local, host=host)[0] == 200


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example:8080", "", "192.168.1.10:8080"])
def test_another_name_is_refused_because_dns_can_be_bent(local, host):
    assert ask(local, host=host)[0] == 403


@pytest.mark.parametrize("headers", [{"host": "["}, {"host": "[::1"}, {"origin": "http://["}], ids=str)
@pytest.mark.parametrize(("kind", "answer"), [("http", 400), ("websocket", 1008)])
@pytest.mark.parametrize("names", [LOOPBACK, None])
def test_what_is_no_address_is_refused(headers, kind, answer, names):
    assert ask(AccessMiddleware(inner, names=names, password=None), kind=kind, **headers)[0] == answer


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_a_page_of_another_site_is_refused(local, kind):
    status, _, _ = ask(local, kind=kind, origin="http://evil.example")
    assert status in {403, 1008}


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_its_own_page_is_not(local, kind):
    assert ask(local, kind=kind, origin="http://127.0.0.1:8080")[0] == 200


def test_a_browser_is_instructed_to_load_nothing_from_outside(local):
    policy = ask(local)[1]["content-security-policy"]
    assert "default-src 'self'" in policy
    assert "http" not in policy


@pytest.mark.parametrize(("kind", "answer"), [("http", 303), ("websocket", 1008)])
@pytest.mark.parametrize("cookie", ["", "caesura=guess", "caesura=", "no cookie at all;;="])
def test_without_its_cookie_nothing_is_answered(locked, kind, answer, cookie):
    assert ask(locked, "/system", kind=kind, cookie=cookie)[0] == answer


def test_the_password_opens_it_and_another_does_not(locked):
    assert ask(locked, "/login")[0] == 200
    assert ask(locked, "/login", method="POST", body=b"password=wrong")[0] == 401
    assert ask(locked, "/login", method="POST", body=b"")[0] == 401
    status, headers, _ = ask(locked, "/login", method="POST", body=b"password=correct+horse")
    assert (status, headers["location"]) == (303, "/")
    assert "HttpOnly; SameSite=Strict" in headers["set-cookie"]
    assert ask(locked, "/system", cookie=headers["set-cookie"].partition(";")[0])[2] == b"inside"


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def patient():
    """A guard whose wrong passwords cost their time, on a clock of its own."""
    guarded = AccessMiddleware(inner, names=None, password=PASSWORD)
    guarded._attempts = Attempts(Clock())
    return guarded


def log_in(guarded, password, peer):
    return ask(guarded, "/login", method="POST", body=f"password={password}".encode(), peer=peer)[0]


def test_wrong_passwords_of_one_address_do_not_delay_another(patient):
    """40 wrong passwords once delayed the right one by 39 s, whoever gave it."""
    assert [log_in(patient, "wrong", "192.0.2.7") for _ in range(40)] == [401] + 39 * [429]
    assert log_in(patient, "correct+horse", "192.0.2.8") == 303


def test_an_address_that_waits_learns_nothing_and_comes_in_afterwards(patient):
    assert log_in(patient, "wrong", "192.0.2.7") == 401
    assert log_in(patient, "correct+horse", "192.0.2.7") == 429
    patient._attempts._clock.now += access.WRONG_S
    assert log_in(patient, "correct+horse", "192.0.2.7") == 303


@pytest.mark.parametrize(
    ("other", "status"), [("2001:db8::2", 429), ("2001:db8:0:1::1", 401), ("fe80::1%eth0", 401), ("", 401)]
)
def test_a_network_of_ipv6_counts_as_one_address(patient, other, status):
    assert log_in(patient, "wrong", "2001:db8::1") == 401
    assert log_in(patient, "wrong", other) == status


def test_addresses_that_wait_are_bounded_and_the_first_that_may_again_is_forgotten(monkeypatch):
    monkeypatch.setattr(access, "PEERS", 2)
    attempts = Attempts(Clock())
    for peer in ("a", "b", "a", "c"):
        attempts.wrong(peer)
    assert [bool(attempts.wait_s(peer)) for peer in "abc"] == [True, False, True]
