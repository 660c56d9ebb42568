"""The json5 files that Zenoh reads: one for the router, and one for each client.

Each file contains its certificates and keys. So it is the only file to copy to a machine, and no path to them
can be wrong there. A router with passwords names one more file, the dictionary of its users.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from typing import Any

from caesura_protocol.messages import MAX_MESSAGE_BYTES
from caesura_service.security.access_rules import access_control
from caesura_service.security.certificates import Issued
from caesura_service.security.exposure import parse_endpoint
from caesura_service.security.roles import Identity

PORT = 7447
WRITTEN = (
    "Written by `caesura certs`, which writes it anew: --listen and --host change it there.\n"
    "For `caesura serve --zenoh-config` and for `zenohd -c`. It holds the router's private key."
)
# Up to here the service refuses what is too large with a reason; beyond, the router drops it without.
ROUTER_MAX_BYTES = 2 * MAX_MESSAGE_BYTES

# Connections that have not shown their credentials yet. Beyond it Zenoh refuses further ones: with its own
# limit of 100, 150 silent connections kept all others out.
ACCEPT_PENDING = 4096
# How long a TLS handshake may take. After each that fails Zenoh accepts nothing for 100 ms (its issue 2685).
# With its default of 10 s, 150 silent connections fail more often than that, and kept all others out. One
# that is left alone costs a file descriptor and 7 kB.
HANDSHAKE_MS = 3_600_000
# How long a message that may not be dropped, such as an answer, waits for a client that does not read, until
# the client's link is closed. Meanwhile Zenoh may route nothing else: with its default of 5 s a frozen client
# kept the samples of all stations waiting. A client that takes 64 KiB in this time is not cut off.
BLOCKED_US = 500_000
# How many batches of 64 KiB wait for a link, as many as Zenoh allows. An answer with samples has several
# hundred kB. With Zenoh's own two batches a busy machine loses some of them, and their askers wait for 2 s.
QUEUED_BATCHES = 16
_HANDSHAKE = "tls_handshake_timeout_ms"

_Sections = Sequence[tuple[str, Mapping[str, Any]]]  # comment, settings

_QUIET: Mapping[str, Any] = {
    "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
}
_LINK: Mapping[str, Any] = {
    "tx": {
        "lease": 2000,
        "queue": {
            "size": {"data": QUEUED_BATCHES},
            "congestion_control": {"block": {"wait_before_close": BLOCKED_US}},
        },
    },
    "rx": {"max_message_size": ROUTER_MAX_BYTES},
}
_UNICAST: Mapping[str, Any] = {"accept_pending": ACCEPT_PENDING}


def with_handshake_timeout(endpoint: str) -> str:
    """Add the handshake timeout HANDSHAKE_MS to a TLS endpoint without one.

    >>> with_handshake_timeout("tls/[::]:7447")
    'tls/[::]:7447#tls_handshake_timeout_ms=3600000'
    """
    parsed = parse_endpoint(endpoint)
    if parsed.protocol != "tls" or _HANDSHAKE in parsed.settings:
        return endpoint
    return f"{endpoint}{';' if parsed.settings else '#'}{_HANDSHAKE}={HANDSHAKE_MS}"


def server_tls(authority: bytes, server: Issued) -> dict[str, str]:
    """Return the TLS settings of a router, certificates included."""
    return {
        "root_ca_certificate_base64": _text(authority),
        "listen_certificate_base64": _text(server.certificate),
        "listen_private_key_base64": _text(server.key),
    }


def server_tls_in(folder: str) -> dict[str, str]:
    """Return the TLS settings of a router with certificates as files in a folder."""
    return {
        "root_ca_certificate": f"{folder}/ca.crt",
        "listen_certificate": f"{folder}/router.crt",
        "listen_private_key": f"{folder}/router.key",
    }


def router_file(
    tls: Mapping[str, str], names: Mapping[Identity, str], listen: str, remark: str = WRITTEN
) -> str:
    """Make the file of a router that requires client certificates. names: the common name of each."""
    mutual = {**tls, "enable_mtls": True, "close_link_on_expiration": True}
    transport = {
        "unicast": _UNICAST,
        "link": {**_LINK, "tls": mutual},
        "shared_memory": {"enabled": False},
    }
    comment = "Both sides show a certificate of the authority below; a link ends when a certificate does."
    rules = access_control(names, "cert_common_names")
    return _router(remark, listen, (comment, {"transport": transport}), rules)


def password_router_file(
    tls: Mapping[str, str],
    holders: Sequence[Identity],
    listen: str,
    dictionary: str,
    remark: str = WRITTEN,
) -> str:
    """Make the file of a router that requires passwords, on links that its certificate encrypts."""
    transport = {
        "unicast": _UNICAST,
        "link": {**_LINK, "tls": tls},
        "auth": {"usrpwd": {"dictionary_file": dictionary}},
        "shared_memory": {"enabled": False},
    }
    comment = (
        "The router shows a certificate, clients a user and a password. zenohd looks for the dictionary\n"
        "where it is started, caesura serve beside this file. An empty one would admit every client."
    )
    rules = access_control({holder: holder.label for holder in holders}, "usernames")
    return _router(remark, listen, (comment, {"transport": transport}), rules)


def client_file(authority: bytes, client: Issued, endpoint: str) -> str:
    """Make the file of a client with a certificate."""
    tls = {
        "root_ca_certificate_base64": _text(authority),
        "enable_mtls": True,
        "connect_certificate_base64": _text(client.certificate),
        "connect_private_key_base64": _text(client.key),
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }
    return _client(endpoint, {"link": {"tls": tls}})


def password_client_file(authority: bytes, user: str, password: str, endpoint: str) -> str:
    """Make the file of a client with a user and a password."""
    tls = {"root_ca_certificate_base64": _text(authority), "verify_name_on_connect": True}
    auth = {"usrpwd": {"user": user, "password": password}}
    return _client(endpoint, {"link": {"tls": tls}, "auth": auth})


def _router(
    remark: str, listen: str, security: tuple[str, Mapping[str, Any]], rules: Mapping[str, Any]
) -> str:
    limit = {
        "id": "size",
        "flows": ["ingress"],
        "messages": ["put", "query", "reply"],
        "key_exprs": ["**"],
        "size_limit": ROUTER_MAX_BYTES,
    }
    return _json5(
        (remark, {"mode": "router"}),
        (
            "Robots and dashboards connect here. A silent connection stays open for an hour, because Zenoh\n"
            "accepts no connection for 100 ms after each TLS handshake that fails.",
            {"listen": {"endpoints": [with_handshake_timeout(listen)]}},
        ),
        ("No scouting: the routers of a factory network are configured.", _QUIET),
        security,
        (
            "A larger message is dropped without an answer; the service refuses those over half of it.",
            {"low_pass_filter": [limit]},
        ),
        (
            "Access rules, from the table of roles; everything else is denied. Ingress: messages from the\n"
            "peer with the right; egress: messages to it.",
            {"access_control": rules},
        ),
    )


def _client(endpoint: str, transport: Mapping[str, Any]) -> str:
    return _json5(
        (
            "Written by `caesura certs`. It holds a secret: readable by its user alone.",
            {"mode": "client"},
        ),
        ("The router; --connect names another.", {"connect": {"endpoints": [endpoint]}}),
        ("No scouting.", _QUIET),
        ("This client's credentials.", {"transport": {**transport, "shared_memory": {"enabled": False}}}),
    )


def _text(pem: bytes) -> str:
    return b64encode(pem).decode()


def _json5(*sections: tuple[str, Mapping[str, Any]]) -> str:
    """Join the sections to one object, each with a comment."""
    return "{\n" + "\n".join(_section(*section) for section in sections) + "}\n"


def _section(comment: str, settings: Mapping[str, Any]) -> str:
    remarks = "".join(f"  // {line}\n" for line in comment.split("\n"))
    body = json.dumps(settings, indent=2)[2:-2]
    return f"{remarks}{body},\n"
