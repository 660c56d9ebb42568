"""Access control of the dashboard, applied before any other handler sees a request.

Rule 1: pages of other sites must not reach the dashboard through an operator's browser. The Host of a request
must be one of the dashboard's names (against DNS rebinding), and a socket or a form must come from its own
pages.

Rule 2: with a password, only the login page is served without the login's cookie.

Rule 3: a wrong password delays only its own address, and no password from there is compared during the delay.
The address is that of the connection, or the one stated by a proxy that the operator has named
(`proxies.py`). The number of wrong passwords compared for all addresses together is limited; addresses that
have logged in before are exempt from this limit.

Rule 4: pages load content only from the dashboard; the browser enforces that by Content-Security-Policy.

The dashboard has no TLS. For access from other machines a reverse proxy must add it, or the password can be
read on the network.
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import math
import secrets
import time
from collections import deque
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, quote, urlencode, urlsplit

from caesura_clients.dashboard.proxies import Proxies, address_of

Scope = MutableMapping[str, Any]
Event = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Event]]
Send = Callable[[Event], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

LOOPBACK = ("127.0.0.1", "localhost", "::1")
COOKIE = "caesura"
LOGINS = 64  # that are remembered; the oldest has to log in again
WRONG_S = 1.0  # after a wrong password its address waits so long
WRONG_AT_ONCE = 100  # wrong passwords of all addresses that are compared
WRONG_PER_S = 4.0  # and how soon further ones may be
PEERS = 1024  # addresses that wait; beyond, the one whose wait ends first is forgotten
IPV6_PREFIX = 64  # what one network gives to one subscriber counts as one address
FORM_BYTES = 4096
BODY_S = 10.0  # for a form to come, which would otherwise hold its connection without an end
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; font-src 'self' data:; frame-ancestors 'none'; form-action 'self'; base-uri 'self'"
)
_HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"same-origin"),  # with none, browsers send no origin with our own form
)
_LOGIN = """<!doctype html><html lang="en"><head><title>Caesura</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>
:root {{ color-scheme: light dark }} body {{ font: 16px/1.5 system-ui; max-width: 20rem; margin: 4rem auto }}
input, button {{ font: inherit; padding: .5rem; width: 100%; box-sizing: border-box; margin: .3rem 0 }}
</style></head><body><main><h1>Caesura</h1><form method="post"><label>Password
<input type="password" name="password" autocomplete="current-password" autofocus required></label>
<button>Log in</button></form><p role="alert">{said}</p></main></body></html>"""


class Attempts:
    """Wrong passwords by address, at most PEERS addresses, and the resulting delays. clock: [s].

    An address waits WRONG_S after a wrong password of its own. Of all addresses, WRONG_AT_ONCE wrong
    passwords are compared at once, then WRONG_PER_S. Beyond that limit all addresses wait, except this
    machine and those that have logged in before.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._until: dict[str, float] = {}  # the earliest first, because every wait is equally long
        self._known: deque[str] = deque(maxlen=LOGINS)
        self._wrong = 0.0  # that count, at
        self._counted = clock()

    def wait_s(self, peer: str) -> float:
        """Return how long [s] the address has to wait before its next attempt; 0 if it need not wait."""
        own = max(0.0, self._until.get(peer, 0.0) - self._clock())
        is_known = peer in LOOPBACK or peer in self._known
        return own if is_known else max(own, self._wait_of_all_s())

    def wrong(self, peer: str) -> None:
        """Record a wrong password of the address."""
        self._until.pop(peer, None)
        self._until[peer] = self._clock() + WRONG_S
        while len(self._until) > PEERS:
            del self._until[next(iter(self._until))]
        self._wrong = self._still_counted() + 1.0
        self._counted = self._clock()

    def right(self, peer: str) -> None:
        """Record a right password of the address: the limit for all addresses no longer applies to it."""
        if peer not in self._known:
            self._known.append(peer)

    def _still_counted(self) -> float:
        return max(0.0, self._wrong - WRONG_PER_S * (self._clock() - self._counted))

    def _wait_of_all_s(self) -> float:
        return max(0.0, self._still_counted() - (WRONG_AT_ONCE - 1)) / WRONG_PER_S


class AccessMiddleware:
    """ASGI middleware that enforces the rules of this module.

    names: accepted hosts, None for any; password: None for none; proxies: trusted to state the visitor's
    address.
    """

    def __init__(
        self, app: App, *, names: Iterable[str] | None, password: str | None, proxies: Proxies | None = None
    ) -> None:
        self._app = app
        self._names = None if names is None else frozenset(name.lower() for name in names)
        self._password = password
        self._proxies = proxies or Proxies()
        self._logins: deque[str] = deque(maxlen=LOGINS)
        self._attempts = Attempts()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer or refuse a request, or pass it on to the application."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        scope = self._proxies.visited(scope)
        headers = {key.decode("latin-1"): value.decode("latin-1") for key, value in scope["headers"]}
        try:
            why = self._refused(scope, headers)
        except ValueError:  # as of `[`
            await _answer(scope, send, 400, "Host or Origin is not an address\n")
            return
        if why:
            await _answer(scope, send, 403, f"{why}\n")
        elif self._password is not None and scope["path"] == "/login" and scope["type"] == "http":
            await self._log_in(scope, receive, send)
        elif self._password is not None and _cookie(headers) not in self._logins:
            await _answer(scope, send, 303, "log in first\n", (b"location", _login_for(scope)))
        else:
            await self._app(scope, receive, _with_headers(send))

    def _refused(self, scope: Scope, headers: dict[str, str]) -> str:
        """Return why a request is refused; empty if it is not. Raises ValueError for a malformed host."""
        host = headers.get("host", "")
        name = urlsplit(f"//{host}").hostname or ""
        if self._names is not None and name not in self._names:
            return f"asked as {name!r}, known as {', '.join(sorted(self._names))}: see --name"
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return f"asked by a page of {origin}"
        return ""

    async def _log_in(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["method"] != "POST":
            await _answer(scope, send, 200, _LOGIN.format(said=""), html=True)
            return
        try:
            body = await asyncio.wait_for(_body(receive), BODY_S)
        except TimeoutError:
            said = "The password did not come in time."
            await _answer(scope, send, 408, _LOGIN.format(said=said), (b"connection", b"close"), html=True)
            return
        given = parse_qs(body.decode("utf-8", "replace")).get("password", [""])[0]
        peer = _peer(scope)
        wait_s = self._attempts.wait_s(peer)
        if wait_s:
            said = f"A wrong password was given. Wait {math.ceil(wait_s)} s, then try again."
            again = f"{math.ceil(wait_s)}".encode()
            await _answer(scope, send, 429, _LOGIN.format(said=said), (b"retry-after", again), html=True)
            return
        if not hmac.compare_digest(given.encode(), (self._password or "").encode()):
            self._attempts.wrong(peer)
            await _answer(scope, send, 401, _LOGIN.format(said="That is not the password."), html=True)
            return
        self._attempts.right(peer)
        token = secrets.token_urlsafe(32)
        self._logins.append(token)
        cookie = f"{COOKIE}={token}; HttpOnly; SameSite=Strict; Path=/".encode()
        await _answer(scope, send, 303, "", (b"location", _wanted(scope)), (b"set-cookie", cookie))


def _login_for(scope: Scope) -> bytes:
    """Return the path of the login that leads to the page which was asked for."""
    query = scope.get("query_string", b"").decode("latin-1")
    asked = f"{scope['path']}?{query}" if query else scope["path"]
    return b"/login" if asked == "/" else f"/login?{urlencode({'to': asked})}".encode()


def _wanted(scope: Scope) -> bytes:
    """Return the page of this server that was asked for before the login; / without one."""
    to = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("to", ["/"])[0]
    is_own = to.startswith("/") and not to.startswith(("//", "/\\"))
    return quote(to if is_own else "/", safe="/?=&%").encode()


def _peer(scope: Scope) -> str:
    """Return the address of a visitor without its port; of IPv6 its network."""
    host = (scope.get("client") or ("",))[0]
    address = address_of(host)
    if address is None:
        return str(host)
    if address.version == 4 or address.is_loopback:
        return str(address)
    return str(ipaddress.ip_network((address, IPV6_PREFIX), strict=False))


def _cookie(headers: dict[str, str]) -> str | None:
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return None
    return None if found is None else found.value


async def _body(receive: Receive) -> bytes:
    body = b""
    while len(body) <= FORM_BYTES:
        event = await receive()
        body += event.get("body", b"")
        if not event.get("more_body"):
            break
    return body[:FORM_BYTES]


async def _answer(
    scope: Scope, send: Send, status: int, text: str, *more: tuple[bytes, bytes], html: bool = False
) -> None:
    """Send a response of the middleware; a WebSocket is closed, which the browser sees as refused."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})
        return
    kind = b"text/html; charset=utf-8" if html else b"text/plain; charset=utf-8"
    headers = [(b"content-type", kind), (b"cache-control", b"no-store"), *_HEADERS, *more]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": text.encode()})


def _with_headers(send: Send) -> Send:
    async def sending(event: Event) -> None:
        if event["type"] == "http.response.start":
            event = {**event, "headers": [*event.get("headers", ()), *_HEADERS]}
        await send(event)

    return sending
