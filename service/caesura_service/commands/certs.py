"""`caesura certs`: writes certificates and access rules for Zenoh into one directory."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from caesura_protocol.transport.default_endpoint import endpoint_error
from caesura_service.security.certificates import SecurityError
from caesura_service.security.credential_store import CredentialStore, IssueRequest, identities
from caesura_service.security.roles import Identity, Role

_Names = list[str] | None


def certs(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Directory of the files.")],
    station: Annotated[
        _Names, typer.Option(help="Name of a station, for its bridge; may be repeated, like every name here.")
    ] = None,
    dashboard: Annotated[
        _Names, typer.Option(help="Name of a viewer, which reads the results of every station.")
    ] = None,
    operator: Annotated[_Names, typer.Option(help="Name of a dashboard that may also send commands.")] = None,
    instance: Annotated[
        _Names, typer.Option(help="Name of an instance of the service whose router is a separate process.")
    ] = None,
    host: Annotated[
        _Names,
        typer.Option(help="Host name or address of the router for clients; their files use the first."),
    ] = None,
    listen: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Endpoint of the router; by default tls/[::]:7447.")
    ] = None,
    days: Annotated[
        int, typer.Option(min=1, max=3650, help="Days for which new certificates are valid.")
    ] = 730,
    passwords: Annotated[
        bool, typer.Option("--passwords", help="Also make a user with a random password for each name.")
    ] = False,
    renew: Annotated[
        _Names,
        typer.Option(
            metavar="ROLE.NAME", help="Replace a certificate and its password; router: that of the router."
        ),
    ] = None,
    revoke: Annotated[
        _Names, typer.Option(metavar="ROLE.NAME", help="Revoke a certificate and its password.")
    ] = None,
) -> None:
    """Make certificates for mutual TLS, and the access rules for every role.

    Existing files stay. Run it again to add a station.
    """
    asked: dict[Role, _Names] = {
        "service": instance,
        "bridge": station,
        "dashboard": dashboard,
        "operator": operator,
    }
    kept = CredentialStore(directory)
    try:
        _check(directory, listen)
        for label in revoke or ():
            kept.revoke(label)
        kept.issue(IssueRequest(list(_holders(asked)), renew or (), host or (), listen, days, passwords))
    except (SecurityError, OSError) as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(1) from error
    _print_summary(kept)


def _check(directory: Path, listen: str | None) -> None:
    """Raise SecurityError for a file in place of a directory, and for what is no endpoint."""
    if directory.exists() and not directory.is_dir():
        raise SecurityError(f"{directory} is a file, expected a directory")
    if listen is not None and (wrong := endpoint_error(listen)) is not None:
        raise SecurityError(f"--listen: {wrong}")


def _holders(asked: dict[Role, _Names]) -> Iterable[Identity]:
    for role, names in asked.items():
        yield from identities(role, names or ())


def _print_summary(kept: CredentialStore) -> None:
    """Print the files that were written, and the steps to take with them."""
    for file in kept.written:
        typer.echo(f"wrote {file}")
    if not kept.written:
        typer.echo(f"{kept.path}: nothing to do")
    holders = kept.holders()
    typer.echo(
        f"\nThe first certificate ends on {kept.first_expiry()}. {kept.path}/ca.key stays here and secret."
    )
    typer.echo(f"Router and service, here:  caesura serve --zenoh-config {kept.path}/router.json5")
    if not holders:
        typer.echo("No client may connect yet: add --station NAME and --dashboard NAME.")
    for holder in holders:
        typer.echo(
            f"Copy {kept.path}/{holder.label}.json5 to its machine:  {_command(holder, kept.endpoint)}"
        )
    typer.echo("Restart what listens with router.json5 whenever it was written anew.")


def _command(holder: Identity, endpoint: str) -> str:
    """Return the command that a certificate's holder runs with its configuration file.

    A client's file names the router. A service needs `--connect`, because without it it would be a router
    itself.
    """
    words = {
        "service": f"serve --instance {holder.name} --connect {endpoint}",
        "bridge": f"bridge --station {holder.name}",
        "dashboard": "watch",
        "operator": "watch",
    }
    return f"caesura {words[holder.role]} --zenoh-config {holder.label}.json5"
