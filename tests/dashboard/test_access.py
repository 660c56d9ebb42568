"""Who gets in: no page of another site, nobody without the password, and nothing from outside."""

from __future__ import annotations

import asyncio
from typing import Any
from urllib.parse import parse_qs, urlencode

import pytest

from caesura_clients.dashboard import access
from caesura_clients.dashboard.access import LOOPBACK, AccessMiddleware, Attempts
from caesura_clients.dashboard.proxies import Proxies
from caesura_protocol.errors import CaesuraError
from dashboard.conftest import ran
from harness.clock import Clock
from harness.processes import DEADLINE_S

PASSWORD = "correct horse"


async def inner(scope: Any, receive: Any, send: Any) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"inside"})


def ask(guarded, path="/", *, query=b"", method="GET", kind="http", body=b"", peer="127.0.0.1", **headers):
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
        "query_string": query,
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


@pytest.mark.parametrize(
    ("asked", "leads_to"),
    [
        ("/sessions/cell-1/s1", "/sessions/cell-1/s1"),
        ("//elsewhere.example/", "/"),
        ("/\\elsewhere.example", "/"),
        ("https://elsewhere.example", "/"),
        ("/a\r\nset-cookie: b", "/a%0D%0Aset-cookie%3A%20b"),
    ],
)
def test_the_login_leads_to_the_page_that_was_asked_for_and_to_no_other_site(locked, asked, leads_to):
    query = urlencode({"to": asked}).encode()
    login = {"method": "POST", "body": b"password=correct+horse", "query": query}
    assert ask(locked, "/login", **login)[1]["location"] == leads_to


def test_a_page_that_needs_a_login_is_named_in_its_address(locked):
    location = ask(locked, "/compare", query=b"first=a/b&second=c/d")[1]["location"]
    assert ask(locked, location.partition("?")[0])[0] == 200
    assert parse_qs(location.partition("?")[2]) == {"to": ["/compare?first=a/b&second=c/d"]}


def test_a_login_that_does_not_come_to_its_end_is_ended(locked, monkeypatch):
    monkeypatch.setattr(access, "BODY_S", 0.01)
    sent: list[dict[str, Any]] = []

    async def receive():
        await asyncio.Event().wait()

    async def send(event):
        sent.append(event)

    headers = [(b"host", b"127.0.0.1:8080")]
    scope = {"type": "http", "method": "POST", "path": "/login", "client": ("::1", 1), "headers": headers}
    ran(asyncio.wait_for(locked(scope, receive, send), DEADLINE_S))
    assert sent[0]["status"] == 408


@pytest.fixture
def patient():
    """A guard whose wrong passwords cost their time, on a clock of its own."""
    guarded = AccessMiddleware(inner, names=None, password=PASSWORD)
    guarded._attempts = Attempts(Clock(100.0))
    return guarded


def log_in(guarded, password, peer, **headers):
    body = f"password={password}".encode()
    return ask(guarded, "/login", method="POST", body=body, peer=peer, **headers)[0]


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
    attempts = Attempts(Clock(100.0))
    for peer in ("a", "b", "a", "c"):
        attempts.wrong(peer)
    assert [bool(attempts.wait_s(peer)) for peer in "abc"] == [True, False, True]


# --- behind a reverse proxy -------------------------------------------------------------------------------

PROXY = "10.42.3.7"


def behind(proxies, *, names=None):
    guarded = AccessMiddleware(inner, names=names, password=PASSWORD, proxies=Proxies(proxies))
    guarded._attempts = Attempts(Clock(100.0))
    return guarded


@pytest.mark.parametrize("peer", ["127.0.0.1", PROXY, "192.0.2.7"])
def test_forwarded_addresses_are_ignored_unless_the_operator_has_named_the_proxy(patient, peer):
    found = [log_in(patient, "wrong", peer, **{"x-forwarded-for": f"10.0.0.{n}"}) for n in range(10)]
    assert found == [401] + 9 * [429]


def test_what_a_visitor_puts_before_the_entry_of_the_proxy_does_not_count():
    guarded = behind([PROXY])
    found = [
        log_in(guarded, "wrong", PROXY, **{"x-forwarded-for": f"10.0.0.{n}, 192.0.2.7"}) for n in range(5)
    ]
    assert found == [401] + 4 * [429]
    assert log_in(guarded, "correct+horse", PROXY, **{"x-forwarded-for": "192.0.2.7, 192.0.2.8"}) == 303


@pytest.mark.parametrize(
    ("forwarded", "status"),
    [
        ("192.0.2.7, 10.42.9.9", 429),  # through two proxies
        ("192.0.2.7:4711", 429),
        ("::ffff:192.0.2.7", 429),
        ("192.0.2.8, 10.42.9.9", 401),
        ("[2001:db8::1]:443", 401),
        ("unknown", 401),
        ("", 401),
    ],
)
def test_the_last_entry_that_is_no_proxy_is_who_asks(forwarded, status):
    guarded = behind(["10.42.0.0/16"])
    assert log_in(guarded, "wrong", PROXY, **{"x-forwarded-for": "192.0.2.7"}) == 401
    assert log_in(guarded, "wrong", PROXY, **{"x-forwarded-for": forwarded}) == status


def test_visitors_within_the_network_of_the_proxies_do_not_choose_their_address():
    guarded = behind(["10.42.0.0/16"])
    found = [
        log_in(guarded, "wrong", PROXY, **{"x-forwarded-for": f"10.42.0.{n}, 10.42.8.8"}) for n in range(5)
    ]
    assert found == [401] + 4 * [429]


def test_several_headers_are_one_list():
    scope = {
        "type": "http",
        "client": (PROXY, 1),
        "headers": [(b"x-forwarded-for", b"1.1.1.1"), (b"x-forwarded-for", b"192.0.2.7")],
    }
    assert Proxies([PROXY]).visited(scope)["client"][0] == "192.0.2.7"


@pytest.mark.parametrize(
    ("kind", "said", "scheme"),
    [
        ("http", "https", "https"),
        ("websocket", "https", "wss"),
        ("http", "http, https", "https"),
        ("http", "x", "http"),
    ],
)
def test_the_scheme_of_the_visitor_is_taken_from_a_named_proxy(kind, said, scheme):
    plain = {"http": "http", "websocket": "ws"}[kind]
    scope = {"type": kind, "scheme": plain, "headers": [(b"x-forwarded-proto", said.encode())]}
    assert Proxies([PROXY]).visited({**scope, "client": (PROXY, 1)})["scheme"] == scheme
    assert Proxies([PROXY]).visited({**scope, "client": ("192.0.2.7", 1)})["scheme"] == plain


@pytest.mark.parametrize("named", ["0.0.0.0/0", "::/0", "*", "ingress", ""])
def test_a_proxy_has_an_address_of_its_own(named):
    with pytest.raises(CaesuraError, match="--proxy"):
        Proxies([named])


# --- many addresses ---------------------------------------------------------------------------------------


def addresses(count):
    return [f"198.51.{number // 250}.{number % 250}" for number in range(count)]


def test_wrong_passwords_of_many_addresses_have_a_limit(patient):
    found = [log_in(patient, "wrong", peer) for peer in addresses(300)]
    assert found == access.WRONG_AT_ONCE * [401] + (300 - access.WRONG_AT_ONCE) * [429]
    patient._attempts._clock.now += 10.0
    found = [log_in(patient, "wrong", peer) for peer in addresses(1000)[300:]]
    assert found.count(401) == 10 * access.WRONG_PER_S


def test_forty_wrong_passwords_of_forty_addresses_do_not_delay_the_right_one(patient):
    assert [log_in(patient, "wrong", peer) for peer in addresses(40)] == 40 * [401]
    assert log_in(patient, "correct+horse", "192.0.2.8") == 303


@pytest.mark.parametrize("peer", ["192.0.2.8", "2001:db8::8", "127.0.0.1", "::1", "::ffff:127.0.0.1"])
def test_addresses_that_have_logged_in_and_this_machine_do_not_wait_for_others(patient, peer):
    for known in ("192.0.2.8", "2001:db8::8"):
        assert log_in(patient, "correct+horse", known) == 303
    assert {log_in(patient, "wrong", address) for address in addresses(300)} == {401, 429}
    assert log_in(patient, "correct+horse", peer) == 303
    assert log_in(patient, "correct+horse", "192.0.2.9") == 429
