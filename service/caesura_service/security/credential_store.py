"""The directory that `caesura certs` keeps: an authority, the router's certificate, one for each client.

No existing file is overwritten, except the router's file, which is derived from the others. So the command
may be run again to add a station. Zenoh reads no revocation list, so a certificate is revoked by leaving its
name out of the router's rules. Therefore a certificate that replaces another has a new common name
(`bridge.cell-1.2`), and `revoked/` lists the used ones.
"""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from caesura_protocol.errors import ProtocolError
from caesura_service.security import zenoh_files
from caesura_service.security.certificates import (
    AUTHORITY_DAYS,
    Issued,
    SecurityError,
    common_name,
    expiry,
    hosts_of,
    issue_client,
    issue_router,
    new_authority,
    normal_host,
)
from caesura_service.security.exposure import parse_endpoint
from caesura_service.security.roles import Identity, parse_identity

AUTHORITY, ROUTER = "ca", "router"
USERS = "users.txt"
THIS_MACHINE = ("127.0.0.1", "localhost", "::1")
PASSWORD_BYTES = 24  # of randomness
_LISTEN = re.compile(r'"listen": \{\s*"endpoints": \[\s*"([^"]+)"')


@dataclass(frozen=True)
class IssueRequest:
    """The certificates to issue. hosts: the names of the router, the first of them in the clients' files."""

    holders: Sequence[Identity] = ()
    renew: Sequence[str] = ()  # labels, or `router`
    hosts: Sequence[str] = ()
    listen: str | None = None  # endpoint of the router
    days: int = 730
    passwords: bool = False  # files with user and password as well


@dataclass
class CredentialStore:
    """The files of one authority. Raises SecurityError, and OSError if they cannot be written."""

    path: Path
    written: list[Path] = field(default_factory=list)
    endpoint: str = ""  # by which clients reach the router, once issued

    def issue(self, wanted: IssueRequest) -> None:
        """Issue the missing certificates and rewrite the router's files."""
        self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
        authority = self._load_or_create_authority()
        server = self._load_or_issue_router(authority, wanted)
        listen = self._listen(wanted)
        self.endpoint = (
            f"tls/{_bracketed(self._hosts(wanted)[0])}:{parse_endpoint(listen).address.rpartition(':')[2]}"
        )
        for holder in self._revoke_all(wanted.renew) + list(wanted.holders):
            self._issue_client(authority, holder, wanted.days)
        if wanted.passwords or self._users_file.exists():
            self._issue_passwords(authority.certificate)
        self._write_router_files(authority, server, listen)

    def revoke(self, label: str) -> None:
        """Revoke a certificate and a password, from the router's next start on.

        Raises SecurityError, which lists the certificates, for an unknown one.
        """
        holder = _identity(label)
        certificate = self._file(holder.label, "crt")
        if not certificate.exists():
            known = ", ".join(one.label for one in self.holders())
            raise SecurityError(f"{self.path} has no {label}; it has {known or 'no certificate'}")
        away = self.path / "revoked"
        away.mkdir(mode=0o700, exist_ok=True)
        certificate.rename(away / f"{common_name(certificate.read_bytes())}.crt")
        for suffix in ("key", "json5", "password.json5"):
            self._file(holder.label, suffix).unlink(missing_ok=True)
        if self._users_file.exists():
            left = {user: word for user, word in self._passwords().items() if user != holder.label}
            self._write_users(left)

    def _revoke_all(self, labels: Iterable[str]) -> list[Identity]:
        """Revoke the certificates of these labels and return their identities, for a renewal."""
        holders = [_identity(label) for label in labels if label != ROUTER]
        for holder in holders:
            self.revoke(holder.label)
        return holders

    def holders(self) -> list[Identity]:
        """Return the identities that have a certificate."""
        stems = sorted(file.stem for file in self.path.glob("*.crt"))
        return [_identity(stem) for stem in stems if stem not in {AUTHORITY, ROUTER}]

    def first_expiry(self) -> str:
        """Return the date on which the first certificate expires."""
        return f"{min(expiry(file.read_bytes()) for file in self.path.glob('*.crt')):%Y-%m-%d}"

    def _load_or_create_authority(self) -> Issued:
        return self._load(AUTHORITY) or self._store(AUTHORITY, new_authority(AUTHORITY_DAYS))

    def _load_or_issue_router(self, authority: Issued, wanted: IssueRequest) -> Issued:
        """Return the router's certificate; issue one where a host is missing, or for a renewal."""
        kept, hosts = self._load(ROUTER), self._hosts(wanted)
        complete = kept is not None and set(hosts) <= set(hosts_of(kept.certificate))
        if kept is not None and complete and ROUTER not in wanted.renew:
            return kept
        issued = issue_router(authority, ROUTER, hosts, wanted.days)
        for suffix in ("crt", "key"):  # no right depends on it
            self._file(ROUTER, suffix).unlink(missing_ok=True)
        return self._store(ROUTER, issued)

    def _hosts(self, wanted: IssueRequest) -> list[str]:
        """Return the requested hosts, those of the current certificate, and this machine."""
        kept = self._load(ROUTER)
        known = [] if kept is None else hosts_of(kept.certificate)
        return list(dict.fromkeys([*map(normal_host, wanted.hosts), *known, *THIS_MACHINE]))

    def _listen(self, wanted: IssueRequest) -> str:
        """Return the requested endpoint, else that in the router's file."""
        file = self._file(ROUTER, "json5")
        found = _LISTEN.search(file.read_text()) if file.exists() else None
        return wanted.listen or (found[1] if found else f"tls/[::]:{zenoh_files.PORT}")

    def _issue_client(self, authority: Issued, holder: Identity, days: int) -> None:
        issued, file = self._load(holder.label), self._file(holder.label, "json5")
        if issued is None:
            issued = issue_client(authority, self._next_common_name(holder), days)
            self._store(holder.label, issued)
        elif file.exists():
            return
        text = zenoh_files.client_file(authority.certificate, issued, self.endpoint)
        self._create(file, text.encode(), secret=True)

    def _next_common_name(self, holder: Identity) -> str:
        used = {file.stem for file in (self.path / "revoked").glob(f"{holder.label}*.crt")}
        return next(name for name in _common_names(holder.label) if name not in used)

    def _write_router_files(self, authority: Issued, server: Issued, listen: str) -> None:
        names = {
            holder: common_name(self._file(holder.label, "crt").read_bytes()) for holder in self.holders()
        }
        tls = zenoh_files.server_tls(authority.certificate, server)
        self._replace(self._file(ROUTER, "json5"), zenoh_files.router_file(tls, names, listen))
        if self._users_file.exists():
            text = zenoh_files.password_router_file(tls, list(names), listen, USERS)
            self._replace(self._file(ROUTER, "password.json5"), text)

    def _issue_passwords(self, authority: bytes) -> None:
        """Issue a password to each identity without one."""
        known = self._passwords()
        if not known:  # Zenoh admits every client by an empty dictionary: no client gets this password
            known[ROUTER] = secrets.token_urlsafe(PASSWORD_BYTES)
        new = [holder for holder in self.holders() if holder.label not in known]
        for holder in new:
            known[holder.label] = secrets.token_urlsafe(PASSWORD_BYTES)
            text = zenoh_files.password_client_file(
                authority, holder.label, known[holder.label], self.endpoint
            )
            self._create(self._file(holder.label, "password.json5"), text.encode(), secret=True)
        self._write_users(known)

    def _passwords(self) -> dict[str, str]:
        if not self._users_file.exists():
            return {}
        lines = self._users_file.read_text().splitlines()
        return dict(line.split(":", 1) for line in lines if ":" in line)

    def _write_users(self, known: dict[str, str]) -> None:
        text = "".join(f"{user}:{word}\n" for user, word in sorted(known.items()))
        if self._users_file.exists() and self._users_file.read_text() != text:
            self._users_file.unlink()  # a password that was taken out of use is not kept anywhere
        self._replace(self._users_file, text)

    @property
    def _users_file(self) -> Path:
        return self.path / USERS

    def _file(self, stem: str, suffix: str) -> Path:
        return self.path / f"{stem}.{suffix}"

    def _load(self, stem: str) -> Issued | None:
        certificate, key = self._file(stem, "crt"), self._file(stem, "key")
        if not certificate.exists() and not key.exists():
            return None
        missing = [str(file) for file in (certificate, key) if not file.exists()]
        if missing:
            raise SecurityError(f"{missing[0]} is missing: put it back, or start with an empty directory")
        return Issued(certificate.read_bytes(), key.read_bytes())

    def _store(self, stem: str, issued: Issued) -> Issued:
        self._create(self._file(stem, "key"), issued.key, secret=True)
        self._create(self._file(stem, "crt"), issued.certificate, secret=False)
        return issued

    def _create(self, file: Path, content: bytes, *, secret: bool) -> None:
        """Create a file. Raises SecurityError where it exists."""
        try:
            number = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600 if secret else 0o644)
        except FileExistsError as error:
            raise SecurityError(f"{file} is there already and is not written over: move it away") from error
        with os.fdopen(number, "wb") as stream:
            stream.write(content)
        self.written.append(file)

    def _replace(self, file: Path, text: str) -> None:
        """Write a secret file that is derived from others; the previous one is renamed to `.old`."""
        if file.exists():
            if file.read_text() == text:
                return
            file.replace(file.with_name(f"{file.name}.old"))
        self._create(file, text.encode(), secret=True)


def _identity(label: str) -> Identity:
    try:
        return parse_identity(label)
    except ProtocolError as error:
        known = error.expected if isinstance(error.expected, str) else ", ".join(error.expected)
        raise SecurityError(f"{error.message}: {error.value!r}; expected {known}") from error


def _common_names(label: str) -> Iterator[str]:
    yield label
    number = 2
    while True:
        yield f"{label}.{number}"
        number += 1


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def identities(role: str, names: Iterable[str]) -> list[Identity]:
    """Return the identities of one role. Raises SecurityError for an invalid name."""
    return [_identity(f"{role}.{name}") for name in names]
