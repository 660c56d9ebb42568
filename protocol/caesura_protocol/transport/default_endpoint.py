"""Endpoints of clients and services, separate from the transports, whose import takes a second."""

from __future__ import annotations

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
ENDPOINT_VARIABLE = "CAESURA_CONNECT"  # of the environment: the endpoint where none is given
WITH_PORT = ("tcp", "tls", "quic", "udp", "ws")  # protocols of Zenoh's Python package
PROTOCOLS = (*WITH_PORT, "unixsock-stream")
MAX_PORT = 65535


def endpoint_error(endpoint: str) -> str | None:
    """Return why Zenoh can neither listen on an endpoint nor connect to it; None if it may.

    Zenoh itself attempts forever to connect to an endpoint with such a port or protocol.

    >>> endpoint_error("tcp/127.0.0.1:99999")
    "endpoint 'tcp/127.0.0.1:99999': port 99999, expected 0 to 65535"
    >>> endpoint_error("tls/[::]:7447#enable_mtls=true") is None
    True
    """
    protocol, _, address = endpoint.partition("#")[0].partition("?")[0].partition("/")
    host, _, port = address.rpartition(":")
    if not protocol or not address or (protocol in WITH_PORT and not (host and port.isdecimal())):
        return f"{endpoint!r} is no endpoint: write it as {DEFAULT_ENDPOINT} or tls/[::]:7447"
    if protocol not in PROTOCOLS:
        return f"endpoint {endpoint!r}: protocol {protocol!r}, expected one of {', '.join(PROTOCOLS)}"
    if protocol in WITH_PORT and int(port) > MAX_PORT:
        return f"endpoint {endpoint!r}: port {port}, expected 0 to {MAX_PORT}"
    return None
