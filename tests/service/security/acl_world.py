"""A router that keeps the generated rules, somebody of each role, and the other end of everything.

The other end is the router's own session: rules apply to links, so it may do anything. Nothing here sleeps.
`Outsider.barrier` asks a question that the router ends at once; messages of one link keep their order, so
whatever was let through before has arrived on both ends when it returns.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, get_args

import zenoh

from caesura_protocol.keys import ROOT, ServicePart, SessionPart, StationPart
from caesura_protocol.transport.zenoh_transport import direct
from caesura_service.security.credential_store import CredentialStore, IssueRequest, identities
from caesura_service.server.network_join import SETTINGS
from clients.conftest import free_port

DEADLINE_S = 30.0
BARRIER = "barrier"  # in nobody's rules, and answered by nobody
OUTSIDE = (f"{ROOT}/other/cell-1/samples", "caesura/v2/station/cell-1/samples", "demo/example", "caesura")
KEYS: tuple[str, ...] = (
    *(f"{ROOT}/station/{name}/{part}" for name in ("cell-1", "cell-2") for part in get_args(StationPart)),
    *(f"{ROOT}/session/{name}/s1/{part}" for name in ("cell-1", "cell-2") for part in get_args(SessionPart)),
    *(f"{ROOT}/service/{name}/{part}" for name in ("west", "east") for part in get_args(ServicePart)),
    *OUTSIDE,
)
ROLES = ("service.west", "bridge.cell-1", "dashboard.wall", "operator.boss")
STRANGER = "outsider"  # may connect, and stands in no rule


def opened(file: Path, **settings: Any) -> zenoh.Session:
    """A session from a generated file."""
    config = zenoh.Config.from_file(file)
    for key, value in {**SETTINGS, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def certificates(directory: Path) -> CredentialStore:
    """Everybody's files, with passwords; `outsider` has both and no rule."""
    kept = CredentialStore(directory)
    holders = [
        *identities("service", ["west", "east"]),
        *identities("bridge", ["cell-1", "cell-2"]),
        *identities("dashboard", ["wall", STRANGER]),
        *identities("operator", ["boss"]),
    ]
    kept.issue(IssueRequest(holders, hosts=["127.0.0.1"], passwords=True))
    for suffix in ("json5", "password.json5"):
        (directory / f"dashboard.{STRANGER}.{suffix}").rename(directory / f"{STRANGER}.{suffix}")
    users = (directory / "users.txt").read_text()
    kept.revoke(f"dashboard.{STRANGER}")
    kept.issue(IssueRequest())
    (directory / "users.txt").write_text(users)
    return kept


class World:
    """The router, and one connection of each role. mode: `certificates` or `passwords`."""

    def __init__(self, directory: Path, mode: str, *, rules: bool = True) -> None:
        self.endpoint = f"tls/127.0.0.1:{free_port()}"
        self._directory = directory
        self._suffix = {"certificates": "json5", "passwords": "password.json5"}[mode]
        self._rules = rules
        self._stack = ExitStack()
        self._outsider: dict[str, Outsider] = {}

    def __enter__(self) -> World:
        own: dict[str, Any] = {"listen/endpoints": [self.endpoint]}
        if self._suffix.startswith("password"):
            own["transport/auth/usrpwd/dictionary_file"] = str(self._directory / "users.txt")
        if not self._rules:
            own["access_control/enabled"] = False
        self.router = opened(self._directory / f"router.{self._suffix}", **own)
        self._stack.callback(self.router.close)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def outsider(self, label: str) -> Outsider:
        """Its connection, which is kept."""
        if label not in self._outsider:
            self._outsider[label] = Outsider(self.connect(label), self.connect(label))
        return self._outsider[label]

    def connect(self, label: str) -> zenoh.Session:
        """Another connection of a role."""
        file = self._directory / f"{label}.{self._suffix}"
        session = opened(file, **{"connect/endpoints": [self.endpoint], "connect/timeout_ms": 5000})
        self._stack.callback(session.close)
        return session


class Outsider:
    """One role on the network. What each verb lets through is told as a set of keys."""

    def __init__(self, session: zenoh.Session, looker: zenoh.Session) -> None:
        self.session = session
        self._looker = looker  # asks for tokens: a session that also watches them gets partial answers

    def barrier(self) -> None:
        """Everything before this, in either direction, has arrived or never will."""
        replies = list(self.session.get(BARRIER, timeout=DEADLINE_S, priority=zenoh.Priority.DATA))
        assert not replies, "the barrier timed out"

    def put(self, router: zenoh.Session, keys: tuple[str, ...] = KEYS) -> set[str]:
        return self._sent(router, zenoh.SampleKind.PUT, keys)

    def delete(self, router: zenoh.Session) -> set[str]:
        return self._sent(router, zenoh.SampleKind.DELETE)

    def _sent(self, router: zenoh.Session, kind: zenoh.SampleKind, keys: tuple[str, ...] = KEYS) -> set[str]:
        """The keys that arrive at a subscriber to everything."""
        received: list[zenoh.Sample] = []
        with _declared(router.declare_subscriber("**", direct(received.append))):
            for key in keys:
                if kind == zenoh.SampleKind.PUT:
                    self.session.put(key, b"x", congestion_control=zenoh.CongestionControl.BLOCK)
                else:
                    self.session.delete(key, congestion_control=zenoh.CongestionControl.BLOCK)
            self.barrier()
        assert all(sample.kind == kind for sample in received)
        return {str(sample.key_expr) for sample in received}

    def subscribe(self, router: zenoh.Session) -> set[str]:
        """The keys whose subscriber, one for each key, hears of what everybody else puts."""
        received: set[str] = set()
        with ExitStack() as stack:
            for key in KEYS:
                listen = direct(lambda sample, key=key: received.add(key))
                stack.enter_context(_declared(self.session.declare_subscriber(key, listen)))
            self.barrier()
            for key in KEYS:
                router.put(key, b"x", congestion_control=zenoh.CongestionControl.BLOCK)
            self.barrier()
        return received

    def subscribe_to(self, wide: str, router: zenoh.Session) -> set[str]:
        """The keys of which a subscriber to a wide expression hears."""
        received: set[str] = set()
        listen = direct(lambda sample: received.add(str(sample.key_expr)))
        with _declared(self.session.declare_subscriber(wide, listen)):
            self.barrier()
            for key in KEYS:
                router.put(key, b"x", congestion_control=zenoh.CongestionControl.BLOCK)
            self.barrier()
        return received

    def query(self, router: zenoh.Session, keys: tuple[str, ...] = KEYS) -> set[str]:
        """The keys that answer; one that is asked but not answered is an error."""
        asked: set[str] = set()

        def reply(query: zenoh.Query) -> None:
            with query:
                asked.add(str(query.key_expr))
                key = str(query.key_expr)
                query.reply(key.replace("**", "cell-1").replace("*", "cell-1"), b"x")

        with _declared(router.declare_queryable("**", direct(reply))):
            answered = {key for key in keys if self._answered(key)}
        assert asked - {BARRIER} == answered
        return answered

    def _answered(self, key: str) -> bool:
        replies = list(self.session.get(key, timeout=DEADLINE_S))
        assert all(reply.ok is not None for reply in replies), f"{key}: no answer in time"
        return bool(replies)

    def answer(self, router: zenoh.Session) -> set[str]:
        """The keys on which a queryable of this role is asked, and heard."""
        asked: set[str] = set()

        def reply(query: zenoh.Query) -> None:
            with query:
                asked.add(str(query.key_expr))
                query.reply(query.key_expr, b"x")

        with ExitStack() as stack:
            for key in KEYS:
                stack.enter_context(_declared(self.session.declare_queryable(key, direct(reply))))
            self.barrier()
            received = {key for key in KEYS if any(one.ok for one in router.get(key, timeout=DEADLINE_S))}
        assert asked == received
        return received

    def answer_to(self, wide: str, router: zenoh.Session) -> tuple[set[str], bool]:
        """The keys on which queryables of this role answer a wide question, and whether a refusal arrives."""
        refuse = False

        def reply(query: zenoh.Query, key: str) -> None:
            with query:
                if refuse:
                    query.reply_err(b"no")
                else:
                    query.reply(key, b"x")

        def ask() -> list[zenoh.Reply]:
            none = zenoh.ConsolidationMode.NONE
            return list(
                router.get(wide, timeout=DEADLINE_S, consolidation=none, target=zenoh.QueryTarget.ALL)
            )

        with ExitStack() as stack:
            for key in KEYS:
                callback = direct(lambda query, key=key: reply(query, key))
                stack.enter_context(_declared(self.session.declare_queryable(key, callback)))
            self.barrier()
            answered = {str(one.ok.key_expr) for one in ask() if one.ok}
            refuse = True
            return answered, any(one.err and one.err.payload.to_bytes() == b"no" for one in ask())

    def hold(self, router: zenoh.Session) -> set[str]:
        """The keys whose token is seen."""
        with ExitStack() as stack:
            for key in KEYS:
                stack.enter_context(_declared(self.session.liveliness().declare_token(key)))
            self.barrier()
            found = router.liveliness().get("**", timeout=DEADLINE_S)
            return {str(reply.ok.key_expr) for reply in found if reply.ok}

    def watch(self, router: zenoh.Session) -> set[str]:
        """The keys whose token a liveliness subscriber sees come and go, and a liveliness query finds."""
        events: list[tuple[str, bool]] = []

        def see(sample: zenoh.Sample) -> None:
            events.append((str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT))

        with ExitStack() as stack:
            for key in KEYS:
                watcher = self.session.liveliness().declare_subscriber(key, direct(see), history=True)
                stack.enter_context(_declared(watcher))
            self.barrier()
            with ExitStack() as tokens:
                for key in KEYS:
                    tokens.enter_context(_declared(router.liveliness().declare_token(key)))
                found = {key for key in KEYS if any(one.ok for one in self._tokens(key))}
            self.barrier()
        came, went = ({key for key, there in events if there is kind} for kind in (True, False))
        assert came == went == found
        return found

    def _tokens(self, key: str) -> list[zenoh.Reply]:
        return list(self._looker.liveliness().get(key, timeout=DEADLINE_S))


@contextmanager
def _declared(entity: Any) -> Iterator[Any]:
    try:
        yield entity
    finally:
        entity.undeclare()
