"""Checks of the endpoint: whether a process listens at its address, and how long its certificate is valid."""

from __future__ import annotations

import socket
import time
from collections.abc import Mapping

from caesura_clients.doctor.findings import CheckResult, graded
from caesura_protocol.errors import AccessDenied, CaesuraError, Unreachable
from caesura_protocol.number_words import counted
from caesura_protocol.transport.default_endpoint import DEFAULT_ENDPOINT
from caesura_protocol.transport.diagnosis import CERTIFICATE_WARNS_S

TIMEOUT_S = 2.0
CHECK = "endpoint"
_REFUSED = " rejects this client: "
_SOCKETS = ("tcp", "tls")  # what a plain connection can look at
REMEDIES: Mapping[type[Exception], str] = {  # of the first kind that it is
    socket.gaierror: "no such host here: check the name, or use its address",
    ConnectionRefusedError: "nothing listens there: start `caesura serve` or the router, or check the port",
    TimeoutError: "no answer: check the address, the cable and the firewall between",
    Exception: "check the address and the network between",
}


def check_endpoint(endpoint: str) -> CheckResult:
    """Check that a TCP connection to the endpoint's port succeeds."""
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.partition("?")[0].partition("#")[0].rpartition(":")
    if not protocol or not host or not port.isdecimal():
        remedy = f"write it as {DEFAULT_ENDPOINT} or tls/HOST:PORT"
        return CheckResult("bad", CHECK, f"{endpoint!r} is no endpoint", remedy)
    if protocol not in _SOCKETS:
        return graded(CHECK, f"{endpoint}: {protocol} is not checked separately")
    began = time.monotonic()
    try:
        with socket.create_connection((host.strip("[]"), int(port)), TIMEOUT_S):
            took_ms = 1000 * (time.monotonic() - began)
    except (OSError, OverflowError) as error:
        remedy = next(remedy for kind, remedy in REMEDIES.items() if isinstance(error, kind))
        return CheckResult("bad", CHECK, f"{endpoint}: {getattr(error, 'strerror', None) or error}", remedy)
    return graded(CHECK, f"{endpoint} accepts connections, in {took_ms:.1f} ms")


def check_certificate(end: float, now: float) -> CheckResult:
    """Check how long the router's certificate is valid: all links end with it, also in a demonstration."""
    remedy = (
        "`caesura certs DIR` says when the first of all ends; renew between demonstrations, the router's "
        "with `--renew router`: a link ends with its certificate"
    )
    date, days = time.strftime("%Y-%m-%d", time.gmtime(end)), int((end - now) // 86400)
    found = f"the router's ends on {date}, in {counted(days, 'day')}"
    return graded("certificate", found, (end - now < CERTIFICATE_WARNS_S, "warn", remedy))


def no_session(error: CaesuraError) -> CheckResult:
    """Return the failed check of an endpoint that listens and gives no Zenoh session.

    The remedy is the advice in the error.
    """
    where, _, why = str(error).partition(_REFUSED)
    if not isinstance(error, Unreachable):
        return CheckResult("bad", "session", str(error), "correct the file of --zenoh-config, or --connect")
    if not isinstance(error, AccessDenied) or not why:
        found, _, remedy = str(error).partition("; ")
        return CheckResult(
            "bad",
            "session",
            found,
            remedy or "a process listens there: is it the router, and does it run properly?",
        )
    found, _, remedy = why.partition(": ")
    return CheckResult(
        "bad", "session", f"{where}{_REFUSED}{found}", remedy or "is it the router that you mean?"
    )
