"""Which peers could connect to an endpoint, checked before the service listens on it.

An endpoint that other machines reach must require credentials: a certificate (TLS or QUIC with `enable_mtls`
and an authority of its own; without one, Zenoh accepts every public authority) or a password from a
dictionary. The password is not sent (Zenoh uses challenge and response). On a link without encryption all
later messages can be read, and the link can be hijacked: this is allowed, with a warning.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

Read = Callable[[str], Any]  # of a configuration, by path; None where there is nothing
Resolve = Callable[[str], Sequence[str]]  # addresses of a host

ON_THIS_MACHINE = frozenset({"unixsock-stream", "unixpipe"})
ENCRYPTED = frozenset({"tls", "quic"})
_AUTHORITIES = ("root_ca_certificate", "root_ca_certificate_base64", "root_ca_certificate_file")


@dataclass(frozen=True)
class Endpoint:
    """`protocol/address?metadata#settings`, taken apart. Settings win over those of the configuration.

    >>> parse_endpoint("tls/[::]:7447#enable_mtls=true")
    Endpoint(protocol='tls', address='[::]:7447', settings={'enable_mtls': 'true'})
    """

    protocol: str
    address: str
    settings: dict[str, str]

    @property
    def host(self) -> str:
        """The host, without brackets."""
        return self.address.rpartition(":")[0].strip("[]")


def parse_endpoint(endpoint: str) -> Endpoint:
    """Parse an endpoint."""
    place, _, settings = endpoint.partition("#")
    protocol, _, address = place.partition("?")[0].partition("/")
    pairs = (part.partition("=") for part in settings.split(";") if part)
    return Endpoint(protocol.lower(), address, {key: value for key, _, value in pairs})


def resolve_host(host: str) -> Sequence[str]:
    """Return the addresses of a host; none where it does not resolve."""
    try:
        return [str(info[4][0]) for info in socket.getaddrinfo(host, None)]
    except (OSError, UnicodeError):
        return ()


def is_local(endpoint: str, resolve: Resolve = resolve_host) -> bool:
    """Return whether only this machine reaches an endpoint.

    That is so by its protocol, or if each address of its host is a loopback.
    """
    parsed = parse_endpoint(endpoint)
    if parsed.protocol in ON_THIS_MACHINE:
        return True
    found = resolve(parsed.host) if parsed.host else ()
    return bool(found) and all(map(_is_loopback, found))


Credentials = Literal["certificate", "password", "nothing"]


def required_credentials(endpoint: str, read: Read) -> Credentials:
    """Return the credentials that a listener on the endpoint requires of a client."""
    parsed = parse_endpoint(endpoint)
    if parsed.protocol in ENCRYPTED and _mutual(parsed, read):
        return "certificate"
    return "password" if _has_users(read("transport/auth/usrpwd/dictionary_file")) else "nothing"


def presented_credentials(endpoint: str, read: Read) -> Credentials:
    """Return the credentials that a client presents to the endpoint."""
    tls = parse_endpoint(endpoint).protocol in ENCRYPTED
    if tls and any(read(f"transport/link/tls/connect_certificate{end}") for end in ("", "_base64")):
        return "certificate"
    return "password" if read("transport/auth/usrpwd/user") else "nothing"


def exposure_error(endpoint: str) -> str:
    """Return why the service must not listen on an open endpoint, with the remedies."""
    return (
        f"{endpoint} can be reached from other machines, where every client may do anything: "
        "demand credentials (caesura certs DIR makes certificates and a router.json5 for --zenoh-config), "
        "listen on 127.0.0.1, or set --insecure"
    )


def exposure_warnings(endpoint: str, read: Read) -> Iterator[str]:
    """Yield the warnings about an endpoint that other machines reach."""
    credentials = required_credentials(endpoint, read)
    if credentials == "nothing":
        yield f"{endpoint} is open to every client that reaches it: --insecure"
        return
    if parse_endpoint(endpoint).protocol not in ENCRYPTED:
        yield f"{endpoint} is not encrypted: a machine on the way can read everything, and hijack a link"
    if not read("access_control/enabled"):
        yield f"{endpoint} has no access rules: a client with any {credentials} may pose as any station"


def _mutual(parsed: Endpoint, read: Read) -> bool:
    def setting(name: str) -> Any:
        return parsed.settings.get(name) or read(f"transport/link/tls/{name}")

    wanted = setting("enable_mtls")
    return wanted in {True, "true"} and any(setting(name) for name in _AUTHORITIES)


def _has_users(dictionary: str | None) -> bool:
    """Return whether a dictionary has a line; Zenoh admits every client by an empty one."""
    try:
        return bool(dictionary and Path(dictionary).read_text().strip())
    except (OSError, ValueError):
        return False


def _is_loopback(address: str) -> bool:
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return False
    mapped = getattr(parsed, "ipv4_mapped", None)
    return bool((mapped or parsed).is_loopback)
