"""Diagnoses why a router refuses a connection, because Zenoh states only that it could not connect.

So the connection is repeated with plain sockets: whether a process listens, whether it uses TLS, whether each
side accepts the other's certificate, and whether it answers as a router. This runs after a failed attempt,
and takes up to four seconds. Only an answer shows that waiting will not help, because the system also accepts
connections for a process that hangs.
"""

from __future__ import annotations

import os
import socket
import ssl
from base64 import b64decode
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from caesura_protocol.errors import AccessDenied, Unreachable

Read = Callable[[str], Any]  # of a configuration, by path; None where there is nothing

TIMEOUT_S = 1.0
CERTIFICATE_WARNS_S = 30 * 86400.0  # before the end of a certificate
VERDICT_S = 0.5  # for a router to turn a certificate down, which TLS 1.3 does after the handshake
_CHECKED_PROTOCOLS = ("tcp", "tls")
_NO_TLS = "it does not speak TLS: write tcp/"

# Zenoh's transport messages: two bytes of length, then a byte whose last five bits are the kind.
_INIT, _CLOSE, _KIND_BITS = 0x01, 0x03, 0x1F
_VERSION, _CLIENT_WITH_ID_OF_16 = 0x09, 0xF2
_UNEXPLAINED = 0  # reason of a Close: a router with passwords closes so where none comes

# What is wrong and what would do, by what TLS says.
_FOREIGN_AUTHORITY = "is not of {} authority: take the file from where the router's was made"
_OTHER_HOST = "its certificate does not name this host: `caesura certs DIR --host` where it was made"
_OWN_CERTIFICATE_REMEDIES: Mapping[str, str] = {
    "CERTIFICATE_REQUIRED": "it demands a certificate: --zenoh-config with a file of `caesura certs`",
    "CERTIFICATE_EXPIRED": "our certificate has ended, or a clock is wrong: `caesura certs DIR --renew`",
    "UNKNOWN_CA": f"our certificate {_FOREIGN_AUTHORITY.format('its')}",
    "DECRYPT_ERROR": f"our certificate {_FOREIGN_AUTHORITY.format('its')}",
    "UNSUPPORTED_CERTIFICATE": "our certificate is not one for a client: take that of a station or reader",
    "BAD_CERTIFICATE": "it does not take our certificate: make another with `caesura certs DIR --renew`",
}
_PEER_CERTIFICATE_REMEDIES: tuple[tuple[str, str], ...] = (
    ("expired", "its certificate has ended, or this clock is wrong: `caesura certs DIR --renew router`"),
    ("not yet valid", "its certificate is not valid yet: set this machine's clock"),
    ("mismatch", _OTHER_HOST),
    ("not valid for", _OTHER_HOST),
    ("", f"its certificate {_FOREIGN_AUTHORITY.format('our')}"),
)


class _WaitingHelpsError(Exception):
    """A listener gives no session now, and may do so later.

    what: text on what the listener does; why: text on the possible cause and the remedy.
    """

    def __init__(self, what: str, why: str) -> None:
        super().__init__(what, why)
        self.what, self.why = what, why


def _no_room() -> _WaitingHelpsError:
    """Return the error for connections that close at once: Zenoh does so with one too many."""
    full = ": more connections wait there, or are open, than it takes; try again"
    return _WaitingHelpsError("closes every connection at once", full)


def _silent() -> _WaitingHelpsError:
    why = ": the router hangs or is overloaded, or it is no router; look at its process, or check the port"
    return _WaitingHelpsError("accepts connections and does not answer", why)


def diagnose_connection(endpoint: str, read: Read, *, for_s: float | None = None) -> Unreachable:
    """Return the error to raise after a failed attempt. AccessDenied where waiting will not help.

    read: reads the tried configuration; for_s: duration of the attempt [s].
    """
    protocol, _, address = endpoint.partition("#")[0].partition("?")[0].partition("/")
    host, _, port = address.rpartition(":")
    tried = "" if for_s is None else f" for {for_s:g} s"
    if protocol not in _CHECKED_PROTOCOLS or not port.isdecimal():
        return Unreachable(f"no router at {endpoint}{tried}; is the service running?")
    try:
        said = _check_listener(protocol, host.strip("[]"), int(port), read)
    except ConnectionRefusedError:
        return Unreachable(f"no router at {endpoint}{tried}; is the service running?")
    except socket.gaierror:
        return Unreachable(f"no router at {endpoint}{tried}: there is no host {host}; check the name")
    except _WaitingHelpsError as error:
        return Unreachable(f"{endpoint} {error.what}{tried}{error.why}")
    except OSError as error:
        return Unreachable(f"no router at {endpoint}{tried}: {error.strerror or error}; check the network")
    return AccessDenied(f"{endpoint} rejects this client: {said}")


def listener_certificate_end(endpoint: str, read: Read) -> float | None:
    """Return the time [s since 1970] at which a router's certificate expires; None if it presents none."""
    protocol, _, address = endpoint.partition("#")[0].partition("?")[0].partition("/")
    host, _, port = address.rpartition(":")
    if protocol != "tls":
        return None
    name = host.strip("[]")
    try:
        with (
            socket.create_connection((name, int(port)), TIMEOUT_S) as plain,
            _context(read).wrap_socket(plain, server_hostname=name) as link,
        ):
            shown = link.getpeercert() or {}
    except (OSError, ValueError):
        return None
    end = shown.get("notAfter")
    return ssl.cert_time_to_seconds(end) if isinstance(end, str) else None


def _check_listener(protocol: str, host: str, port: int, read: Read) -> str:
    """Return why a listening process gives no session. Raises OSError where none listens."""
    with socket.create_connection((host, port), TIMEOUT_S) as plain:
        if protocol == "tls":
            found = _tls_verdict(plain, host, read)
        else:
            _check_not_closed(plain)
            found = "it speaks TLS: write tls/" if _speaks_tls(plain) else None
    if found not in {None, _NO_TLS}:
        return found
    with socket.create_connection((host, port), TIMEOUT_S) as plain:
        verdict = _greeting_verdict(plain, read, is_right_protocol=found is None)
    return verdict or _NO_TLS


def _greeting_verdict(link: socket.socket, read: Read, *, is_right_protocol: bool = True) -> str | None:
    """Greet as a Zenoh client; return why there is no session, None for a router of another protocol.

    Raises _WaitingHelpsError without an answer, and if the router begins a session.
    """
    name = os.urandom(12) + b"\r\n\r\n"  # a server that reads lines answers as well
    greeting = bytes((_INIT, _VERSION, _CLIENT_WITH_ID_OF_16)) + name
    link.settimeout(TIMEOUT_S)
    try:
        link.sendall(len(greeting).to_bytes(2, "little") + greeting)
        answer = link.recv(64)
    except ssl.SSLError as error:
        if not isinstance(error, ssl.SSLEOFError):
            raise
        answer = b""
    except OSError:
        answer = b""
    if not answer:
        raise _silent()
    kind = answer[2] & _KIND_BITS if len(answer) > 3 else None
    if kind not in {_INIT, _CLOSE}:
        return f"it is no Zenoh router, and answers {answer[:16]!r}: check the port"
    if not is_right_protocol:
        return None
    if kind == _INIT:
        raise _WaitingHelpsError("answers, and opened no session in time", "; try again")
    if answer[3] != _UNEXPLAINED:
        return f"it closes Zenoh's greeting with reason {answer[3]}: is its Zenoh of another version?"
    return _password_remedy(read)


def _check_not_closed(link: socket.socket) -> None:
    """Raise _WaitingHelpsError if the link is already closed; a router would wait for the first message."""
    link.settimeout(VERDICT_S)
    try:
        if not link.recv(1, socket.MSG_PEEK):
            raise _no_room()
    except TimeoutError:
        link.settimeout(TIMEOUT_S)


def _tls_verdict(plain: socket.socket, host: str, read: Read) -> str | None:
    """Return which certificate is rejected, and why; else the router's answer to a greeting."""
    try:
        context = _context(read)
    except (OSError, ValueError) as error:
        return f"the certificate or key in --zenoh-config cannot be read: {error}"
    try:
        with context.wrap_socket(plain, server_hostname=host) as link:
            return _alert_after_handshake(link) or _greeting_verdict(link, read)
    except ssl.SSLCertVerificationError as error:
        said = error.verify_message.lower()
        return next(text for word, text in _PEER_CERTIFICATE_REMEDIES if word in said)
    except ssl.SSLError as error:
        return _alert(error)
    except OSError:  # silence too: a router that hangs, or one that waits for the rest of a long message
        return _NO_TLS


def _alert_after_handshake(link: ssl.SSLSocket) -> str | None:
    """Return the router's alert after the handshake; None where it accepts the certificate."""
    link.settimeout(VERDICT_S)
    try:
        if not link.recv(1):
            raise _no_room()
    except ssl.SSLError as error:
        return _alert(error)
    except OSError:
        pass
    return None


def _alert(error: ssl.SSLError) -> str:
    reason = error.reason or ""
    if reason in {"WRONG_VERSION_NUMBER", "UNEXPECTED_EOF_WHILE_READING"}:
        return _NO_TLS
    known = (text for word, text in _OWN_CERTIFICATE_REMEDIES.items() if reason.endswith(word))
    return next(known, f"TLS fails: {reason or error}")


def _context(read: Read) -> ssl.SSLContext:
    """Return the TLS settings of Zenoh's configuration: trusted authority and own certificate."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    authority = pem_of(read, "root_ca_certificate")
    if authority:
        context.load_verify_locations(cadata=authority.decode("ascii"))
    else:
        context.load_default_certs()
    certificate, key = pem_of(read, "connect_certificate"), pem_of(read, "connect_private_key")
    if certificate and key:
        with NamedTemporaryFile() as file:  # for its owner alone
            file.write(certificate + b"\n" + key)
            file.flush()
            context.load_cert_chain(file.name)
    return context


def pem_of(read: Read, name: str) -> bytes:
    """Return a certificate or key of a configuration; empty without one. Raises OSError or ValueError."""
    if coded := read(f"transport/link/tls/{name}_base64"):
        return b64decode(coded)
    path = read(f"transport/link/tls/{name}")
    return Path(path).read_bytes() if path else b""


def _speaks_tls(plain: socket.socket) -> bool:
    """Return whether a listener answers a TLS greeting with any bytes."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    try:
        context.wrap_socket(plain).close()
    except ssl.SSLError as error:
        return "ALERT" in (error.reason or "")
    except OSError:
        return False
    return True


def _password_remedy(read: Read) -> str:
    user = read("transport/auth/usrpwd/user")
    if user:
        return f"it does not know user {user!r}, or by another password: check --zenoh-config"
    return "it demands a user and a password: --zenoh-config with a file of `caesura certs --passwords`"
