"""Diagnoses why a router refuses a connection, because Zenoh states only that it could not connect.

So the same is tried once more with plain sockets: is there anything, does it speak TLS, what does it say of
our certificate, what do we say of its own. Asked once an attempt has failed; takes up to two seconds.
"""

from __future__ import annotations

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
VERDICT_S = 0.5  # for a router to turn a certificate down, which TLS 1.3 does after the handshake
_CHECKED_PROTOCOLS = ("tcp", "tls")

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


class _NoRoomError(Exception):
    """The router closes the connection before anything is said, as Zenoh does with one too many."""


def diagnose_connection(endpoint: str, read: Read, *, for_s: float | None = None) -> Unreachable:
    """Return the error to raise after a failed attempt. AccessDenied where waiting will not help.

    read: the configuration that was tried; for_s: how long it was.
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
    except _NoRoomError:
        full = "more connections wait there, or are open, than it takes"
        return Unreachable(f"{endpoint} closes every connection at once{tried}: {full}; try again")
    except OSError as error:
        return Unreachable(f"no router at {endpoint}{tried}: {error.strerror or error}; check the network")
    return AccessDenied(f"{endpoint} does not let us in: {said}")


def _check_listener(protocol: str, host: str, port: int, read: Read) -> str:
    """Return why a listening router gives no session. Raises OSError where no process listens."""
    with socket.create_connection((host, port), TIMEOUT_S) as plain:
        if protocol == "tls":
            found = _tls_verdict(plain, host, read)
        else:
            _check_not_closed(plain)
            found = "it speaks TLS: write tls/" if _speaks_tls(plain) else None
    return found or _password_remedy(read)


def _check_not_closed(link: socket.socket) -> None:
    """Raises _NoRoomError where it is closed already; one that is content waits for the first message."""
    link.settimeout(VERDICT_S)
    try:
        if not link.recv(1, socket.MSG_PEEK):
            raise _NoRoomError
    except TimeoutError:
        link.settimeout(TIMEOUT_S)


def _tls_verdict(plain: socket.socket, host: str, read: Read) -> str | None:
    """Return which certificate is refused, and why; None where both are accepted."""
    try:
        context = _context(read)
    except (OSError, ValueError) as error:
        return f"the certificate or key in --zenoh-config cannot be read: {error}"
    try:
        with context.wrap_socket(plain, server_hostname=host) as link:
            return _alert_after_handshake(link)
    except ssl.SSLCertVerificationError as error:
        said = error.verify_message.lower()
        return next(text for word, text in _PEER_CERTIFICATE_REMEDIES if word in said)
    except ssl.SSLError as error:
        return _alert(error)
    except OSError:
        return "it does not speak TLS: write tcp/"


def _alert_after_handshake(link: ssl.SSLSocket) -> str | None:
    """Return the router's alert after the handshake; None where it accepts the certificate."""
    link.settimeout(VERDICT_S)
    try:
        if not link.recv(1):
            raise _NoRoomError
    except ssl.SSLError as error:
        return _alert(error)
    except OSError:
        pass
    return None


def _alert(error: ssl.SSLError) -> str:
    reason = error.reason or ""
    if reason in {"WRONG_VERSION_NUMBER", "UNEXPECTED_EOF_WHILE_READING"}:
        return "it does not speak TLS: write tcp/"
    known = (text for word, text in _OWN_CERTIFICATE_REMEDIES.items() if reason.endswith(word))
    return next(known, f"TLS fails: {reason or error}")


def _context(read: Read) -> ssl.SSLContext:
    """Return the TLS settings of Zenoh's configuration: trusted authority and own certificate."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    authority = _pem(read, "root_ca_certificate")
    if authority:
        context.load_verify_locations(cadata=authority.decode("ascii"))
    else:
        context.load_default_certs()
    certificate, key = _pem(read, "connect_certificate"), _pem(read, "connect_private_key")
    if certificate and key:
        with NamedTemporaryFile() as file:  # for its owner alone
            file.write(certificate + b"\n" + key)
            file.flush()
            context.load_cert_chain(file.name)
    return context


def _pem(read: Read, name: str) -> bytes:
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
        return f"it does not know user {user!r}, or by another password; or it is no Zenoh router"
    return "it demands a user and a password: --zenoh-config with a file of `caesura certs --passwords`"
