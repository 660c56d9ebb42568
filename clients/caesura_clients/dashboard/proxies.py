"""The address of a visitor, if reverse proxies stand in front of the dashboard.

Every client can write `X-Forwarded-For`. The header counts only where the operator has named the proxies by
address or network, and then from the right: each proxy appends the address that connected to it. So the last
entry that is not a named proxy is the visitor, and all entries before it may be forged.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Iterable, MutableMapping
from typing import Any

from caesura_protocol.errors import CaesuraError

Scope = MutableMapping[str, Any]
IpAddress = ipaddress.IPv4Address | ipaddress.IPv6Address
IpNetwork = ipaddress.IPv4Network | ipaddress.IPv6Network

_SCHEMES = {"http": ("http", "https"), "websocket": ("ws", "wss")}


class Proxies:
    """The reverse proxies that an operator has named."""

    def __init__(self, named: Iterable[str] = ()) -> None:
        """Raise CaesuraError for an invalid address or network, and for a network of all addresses."""
        self._networks = tuple(map(_network, named))

    def __contains__(self, host: str) -> bool:
        address = address_of(host)
        return address is not None and any(address in network for network in self._networks)

    def visited(self, scope: Scope) -> Scope:
        """Return the scope of a request with the client and scheme that the first proxy received."""
        host = str((scope.get("client") or ("",))[0])
        if host not in self:
            return scope
        return {**scope, "client": (self._visitor(scope, host), 0), "scheme": _scheme(scope)}

    def _visitor(self, scope: Scope, proxy: str) -> str:
        hops = [_host(hop) for hop in ",".join(_values(scope, b"x-forwarded-for")).split(",") if hop.strip()]
        for hop in reversed(hops):
            if hop not in self:
                return hop
        return hops[-1] if hops else proxy  # all are proxies: what the nearest one wrote


def address_of(host: str) -> IpAddress | None:
    """Return the address in a text; None for an invalid one. An IPv4 address mapped to IPv6 becomes IPv4."""
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return None
    return getattr(address, "ipv4_mapped", None) or address


def _network(named: str) -> IpNetwork:
    try:
        network = ipaddress.ip_network(named, strict=False)
    except ValueError as error:
        raise CaesuraError(f"--proxy {named}: {error}; expected as 10.0.0.7 or 10.42.0.0/16") from None
    if not network.prefixlen:
        raise CaesuraError(f"--proxy {named}: every visitor could claim any address")
    return network


def _host(hop: str) -> str:
    """Return an entry without the port that some proxies append: `192.0.2.1:80`, `[2001:db8::1]:80`."""
    host = hop.strip()
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0] if host.count(":") == 1 else host


def _scheme(scope: Scope) -> str:
    """Return the scheme that the nearest proxy stated, of several values: TLS ends at the proxy."""
    plain, secure = _SCHEMES[scope["type"]]
    values = ",".join(_values(scope, b"x-forwarded-proto")).split(",")
    said = values[-1].strip().lower()
    known = {"http": plain, "ws": plain, "https": secure, "wss": secure}
    return known.get(said, str(scope.get("scheme", plain)))


def _values(scope: Scope, name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in scope["headers"] if key == name]
