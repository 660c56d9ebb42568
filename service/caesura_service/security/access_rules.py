"""Makes Zenoh's access rules from the table of roles.

A router checks every message twice: when it comes in from one peer (ingress) and when it goes out to another
(egress), each time with the rights of that peer. So each verb needs several messages, in two directions;
`MESSAGES` lists them. Deny is the default. A peer without a policy (its certificate is no longer listed) may
connect and do nothing else.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from typing import Any, Literal

from caesura_service.security.roles import Access, Identity

Flow = Literal["ingress", "egress"]

# At the router: ingress is messages from the peer with the right, egress messages to it. `answer`: declare
# a queryable and reply; `asked`: receive queries by a wider expression; `hold`: declare a liveliness token.
MESSAGES: Mapping[str, Mapping[Flow, tuple[str, ...]]] = {
    "put": {"ingress": ("put",)},
    "subscribe": {"ingress": ("declare_subscriber",), "egress": ("put",)},
    "query": {"ingress": ("query",), "egress": ("reply",)},
    "answer": {"ingress": ("declare_queryable", "reply"), "egress": ("query",)},
    # Without "reply": a peer that may reply to the wide expression may reply in the name of every other.
    # A refusal bears the expression of the query, so it is lost, and reads as no answer.
    "asked": {"egress": ("query",)},
    "hold": {"ingress": ("liveliness_token",)},
    "watch": {
        "ingress": ("liveliness_query", "declare_liveliness_subscriber"),
        "egress": ("liveliness_token",),
    },
}

Subject = Literal["cert_common_names", "usernames"]


def access_control(names: Mapping[Identity, str], known_by: Subject) -> dict[str, Any]:
    """Make Zenoh's `access_control`.

    names: the common name or user name of each identity. known_by: which of the two they are.
    """
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for holder in names for rule in _rules(holder)],
        "subjects": [{"id": holder.label, known_by: [name]} for holder, name in names.items()],
        "policies": [
            {"id": holder.label, "rules": [rule["id"] for rule in _rules(holder)], "subjects": [holder.label]}
            for holder in names
        ],
    }


def _rules(holder: Identity) -> Iterator[dict[str, Any]]:
    for verb, keys in granted_rights(holder.access):
        for flow, messages in MESSAGES[verb].items():
            yield {
                "id": f"{holder.label} {verb} {flow}",
                "permission": "allow",
                "flows": [flow],
                "messages": list(messages),
                "key_exprs": list(keys),
            }


def granted_rights(access: Access) -> Iterable[tuple[str, tuple[str, ...]]]:
    """Yield each granted verb with its key expressions."""
    for verb in fields(access):
        keys: tuple[str, ...] = getattr(access, verb.name)
        if keys:
            yield verb.name, keys
