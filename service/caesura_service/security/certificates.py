"""Certificates for mutual TLS: an authority, a router named by its hosts, clients named by their roles.

A client's certificate cannot serve as a router's, nor the other way round (extended key usage): a stolen
station's certificate does not let its holder pose as the router.
"""

from __future__ import annotations

import ipaddress
import re
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

AUTHORITY_DAYS = 3650
CLOCKS_APART = timedelta(days=1)  # a robot whose clock is behind by less accepts a new certificate
MAX_COMMON_NAME = 64  # RFC 5280, ub-common-name
_HOST_NAME = re.compile(r"(\*\.)?[A-Za-z0-9_]([A-Za-z0-9_.-]*[A-Za-z0-9_])?")


class SecurityError(Exception):
    """A user error; one line with the value that was found and the remedy."""


@dataclass(frozen=True)
class Issued:
    """A certificate and its private key, both PEM."""

    certificate: bytes
    key: bytes

    @property
    def parsed(self) -> x509.Certificate:
        """The certificate, parsed."""
        return x509.load_pem_x509_certificate(self.certificate)


def new_authority(days: int = AUTHORITY_DAYS, *, now: datetime | None = None) -> Issued:
    """Make a self-signed authority whose certificates may sign none."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = _name(f"Caesura authority {secrets.token_hex(4)}")  # the name distinguishes two authorities
    builder = (
        _builder(name, name, key.public_key(), days, now)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs_certificates=True), critical=True)
    )
    return Issued(_pem(builder.sign(key, hashes.SHA256())), _key_pem(key))


def issue_router(
    authority: Issued, common_name: str, hosts: Sequence[str], days: int, *, now: datetime | None = None
) -> Issued:
    """Issue a certificate to listen with, valid for the hosts: names or addresses. Raises SecurityError."""
    alternatives = x509.SubjectAlternativeName([_general_name(host) for host in hosts])
    return _issue(authority, common_name, days, ExtendedKeyUsageOID.SERVER_AUTH, alternatives, now=now)


def issue_client(authority: Issued, common_name: str, days: int, *, now: datetime | None = None) -> Issued:
    """Issue a certificate to connect with. Raises SecurityError."""
    return _issue(authority, common_name, days, ExtendedKeyUsageOID.CLIENT_AUTH, None, now=now)


def common_name(certificate: bytes) -> str:
    """Return the common name in a PEM certificate. Raises SecurityError."""
    return str(_load(certificate).subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value)


def hosts_of(certificate: bytes) -> list[str]:
    """Return the hosts of a router's certificate. Raises SecurityError."""
    extension = _load(certificate).extensions.get_extension_for_class(x509.SubjectAlternativeName)
    return [str(general.value) for general in extension.value]


def normal_host(host: str) -> str:
    """Return a host in the form of `hosts_of`.

    >>> normal_host("FE80::0:1"), normal_host("Cell-Router")
    ('fe80::1', 'cell-router')
    """
    try:
        return str(ipaddress.ip_address(host))
    except ValueError:
        return host.lower()


def expiry(certificate: bytes) -> datetime:
    """Return the end of a PEM certificate, UTC. Raises SecurityError."""
    return _load(certificate).not_valid_after_utc


def _issue(
    authority: Issued,
    name: str,
    days: int,
    purpose: x509.ObjectIdentifier,
    alternatives: x509.SubjectAlternativeName | None,
    *,
    now: datetime | None,
) -> Issued:
    if len(name) > MAX_COMMON_NAME:
        raise SecurityError(f"{name!r} has {len(name)} characters, of at most {MAX_COMMON_NAME}")
    signer, signing_key = authority.parsed, _load_key(authority.key)
    key = ec.generate_private_key(ec.SECP256R1())
    builder = (
        _builder(_name(name), signer.subject, key.public_key(), days, now)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(signing_key.public_key()), critical=False
        )
    )
    if alternatives is not None:
        builder = builder.add_extension(alternatives, critical=False)
    ends = (now or datetime.now(UTC)) + timedelta(days=days)
    if ends > signer.not_valid_after_utc:
        raise SecurityError(
            f"{name} for {days} days would outlive the authority, which ends on "
            f"{signer.not_valid_after_utc:%Y-%m-%d}: fewer --days, or a new directory with a new authority"
        )
    return Issued(_pem(builder.sign(signing_key, hashes.SHA256())), _key_pem(key))


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, days: int, now: datetime | None
) -> x509.CertificateBuilder:
    begins = now or datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(begins - CLOCKS_APART)
        .not_valid_after(begins + timedelta(days=days))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def _name(common: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common)])


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    if _HOST_NAME.fullmatch(host) is None:
        raise SecurityError(
            f"host {host!r} is neither a name in ASCII nor an address: expected one such as router.plant, "
            "192.168.1.10 or ::1, without a port"
        )
    return x509.DNSName(host)


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _key_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


def _load(certificate: bytes) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(certificate)
    except ValueError as error:
        raise SecurityError(f"not a PEM certificate: {certificate[:40]!r}") from error


def _load_key(key: bytes) -> ec.EllipticCurvePrivateKey:
    loaded = serialization.load_pem_private_key(key, password=None)
    if not isinstance(loaded, ec.EllipticCurvePrivateKey):
        raise SecurityError("the authority's key has an unsupported type: expected an elliptic curve")
    return loaded
