"""`caesura certs`: what it writes, what it leaves alone, and what comes of running it again."""

from __future__ import annotations

import re
import stat
from datetime import UTC, datetime, timedelta

import pytest
import zenoh
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID
from typer.testing import CliRunner

from caesura_service.security.certificates import (
    SecurityError,
    common_name,
    issue_client,
    issue_router,
    new_authority,
)
from caesura_service.security.credential_store import CredentialStore, IssueRequest, identities
from harness.commands import application


def certs(*arguments: object):
    return CliRunner().invoke(application(), ["certs", *map(str, arguments)])


def content(directory) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in directory.iterdir() if file.is_file()}


@pytest.fixture
def made(tmp_path):
    done = certs(tmp_path / "d", "--station", "cell-1", "--dashboard", "wall", "--passwords")
    assert done.exit_code == 0, done.output
    return tmp_path / "d"


def test_it_says_what_to_copy_where_and_what_to_run(made):
    said = certs(made).stdout
    assert f"caesura serve --zenoh-config {made}/router.json5" in said
    assert "caesura bridge --station cell-1 --zenoh-config bridge.cell-1.json5" in said
    assert '"tls/127.0.0.1:7447"' in (made / "bridge.cell-1.json5").read_text()
    assert "caesura watch" in said
    assert f"{made}/ca.key stays here" in said


def test_keys_and_what_holds_keys_or_passwords_are_for_their_owner_alone(made):
    public = {"ca.crt", "router.crt", "bridge.cell-1.crt", "dashboard.wall.crt"}
    modes = {file.name: stat.S_IMODE(file.stat().st_mode) for file in made.iterdir()}
    assert {name for name, mode in modes.items() if mode != 0o600} == public
    assert stat.S_IMODE(made.stat().st_mode) == 0o700


def test_every_file_is_read_by_zenoh(made):
    files = list(made.glob("*.json5"))
    assert len(files) == 6
    for file in files:
        zenoh.Config.from_file(file)


def test_running_it_again_changes_nothing(made):
    before = content(made)
    assert "nothing to do" in certs(made, "--station", "cell-1").stdout
    assert content(made) == before


def test_a_station_that_is_added_changes_the_routers_files_alone(made):
    before = content(made)
    certs(made, "--station", "cell-2")
    after = content(made)
    changed = {name for name in before if before[name] != after[name]}
    assert changed == {"router.json5", "router.password.json5", "users.txt"}
    assert after["router.json5.old"] == before["router.json5"]
    assert b"bridge.cell-2" in after["router.json5"]
    assert set(before["users.txt"].splitlines()) < set(after["users.txt"].splitlines())
    assert {"bridge.cell-2.json5", "bridge.cell-2.password.json5"} <= set(after)


def test_a_routers_file_of_an_earlier_release_is_written_anew_and_the_command_says_so(made):
    file, before = made / "router.json5", content(made)
    setting = r',\s*"queue": \{.*?\}(?=\s*\},\s*"rx")'
    earlier = re.sub(setting, "", file.read_text(), flags=re.DOTALL)
    assert "wait_before_close" not in earlier
    file.write_text(earlier)
    zenoh.Config.from_file(file)
    assert f"wrote {file}\n" in certs(made).stdout
    assert file.read_bytes() == before["router.json5"]


def test_where_to_listen_and_the_hosts_are_remembered(tmp_path):
    certs(tmp_path, "--host", "10.0.0.1", "--host", "router.plant", "--listen", "tls/0.0.0.0:7500")
    said = certs(tmp_path, "--station", "cell-1").stdout
    assert "caesura bridge --station cell-1 --zenoh-config" in said
    assert '"tls/10.0.0.1:7500"' in (tmp_path / "bridge.cell-1.json5").read_text()
    certs(tmp_path, "--host", "router.new", "--renew", "router")
    certificate = x509.load_pem_x509_certificate((tmp_path / "router.crt").read_bytes())
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert {str(name.value) for name in names} == {
        *("router.new", "router.plant", "10.0.0.1"),
        *("127.0.0.1", "localhost", "::1"),
    }


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--listen", "foo"), "error: --listen: 'foo' is no endpoint: write it as tcp/"),
        (
            ("--listen", "tls/0.0.0.0:99999"),
            "error: --listen: endpoint 'tls/0.0.0.0:99999': port 99999, expected 0",
        ),
        (("--host", ""), "error: host '' is neither a name in ASCII nor an address: expected one such as"),
        (("--host", "router.plant:7447"), "error: host 'router.plant:7447' is neither"),
        (("--host", "rœuter"), "error: host 'rœuter' is neither"),
    ],
)
def test_what_no_router_can_use_is_refused_and_its_files_stay(made, words, said):
    """`--listen foo` was written into router.json5, with which no router started. A wrong host deleted the
    router's certificate.
    """
    before = content(made)
    done = certs(made, *words)
    assert done.exit_code == 1
    assert done.stderr.startswith(said)
    assert content(made) == before


def test_a_file_in_place_of_the_directory_is_named(tmp_path):
    (tmp_path / "file").touch()
    done = certs(tmp_path / "file")
    assert (done.exit_code, done.stderr) == (
        1,
        f"error: {tmp_path / 'file'} is a file, expected a directory\n",
    )


def test_what_is_renewed_has_another_name_and_the_old_one_no_rights(made):
    before = content(made)
    certs(made, "--renew", "bridge.cell-1")
    after = content(made)
    assert common_name(after["bridge.cell-1.crt"]) == "bridge.cell-1.2"
    assert b'"bridge.cell-1.2"' in after["router.json5"]
    assert b'cert_common_names": [\n          "bridge.cell-1"\n' not in after["router.json5"]
    assert after["users.txt"] != before["users.txt"]
    assert after["bridge.cell-1.password.json5"] != before["bridge.cell-1.password.json5"]
    certs(made, "--renew", "bridge.cell-1")
    assert common_name((made / "bridge.cell-1.crt").read_bytes()) == "bridge.cell-1.3"


def test_who_is_revoked_has_no_rule_and_no_password_and_never_the_same_name_again(made):
    certs(made, "--revoke", "bridge.cell-1")
    after = content(made)
    assert b"bridge.cell-1" not in after["router.json5"] + after["users.txt"]
    assert not any("cell-1" in name for name in after)
    certs(made, "--station", "cell-1")
    assert common_name((made / "bridge.cell-1.crt").read_bytes()) == "bridge.cell-1.2"


def test_the_dictionary_is_never_empty_because_zenoh_would_let_every_client_in(made):
    certs(made, "--revoke", "bridge.cell-1", "--revoke", "dashboard.wall")
    (line,) = (made / "users.txt").read_text().splitlines()
    assert line.startswith("router:")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--station", "../../etc/cron.d/x"), "'../../etc/cron.d/x'"),
        (("--station", "Cell"), "not a valid name: 'Cell'; expected 1 to 64 of a to z, "),
        (("--station", "c" * 60), "of at most 64"),
        (("--revoke", "bridge.nobody"), "it has bridge.cell-1, dashboard.wall"),
        (("--renew", "robot.cell-1"), "'robot.cell-1'; expected service.NAME, bridge.NAME, "),
        (("--renew", "bridge.../x"), "'../x'"),
        (("--host", "bücher.example"), "bücher"),
    ],
)
def test_what_makes_no_sense_is_one_line(made, arguments, words):
    done = certs(made, *arguments)
    assert done.exit_code == 1
    assert done.stderr.startswith("error: ")
    assert words in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_clients_file_that_was_deleted_is_made_again_for_the_router_as_it_is_reached_now(made):
    before = content(made)["bridge.cell-1.crt"]
    (made / "bridge.cell-1.json5").unlink()
    certs(made, "--host", "router.plant", "--station", "cell-1")
    assert "tls/router.plant:7447" in (made / "bridge.cell-1.json5").read_text()
    assert content(made)["bridge.cell-1.crt"] == before


def test_a_key_that_went_missing_is_not_made_anew(made):
    (made / "ca.key").unlink()
    done = certs(made, "--station", "cell-2")
    assert done.exit_code == 1
    assert f"{made}/ca.key is missing" in done.stderr


def test_a_file_of_another_program_is_not_written_over(tmp_path):
    (tmp_path / "bridge.cell-1.json5").write_text("mine")
    done = certs(tmp_path, "--station", "cell-1")
    assert done.exit_code == 1
    assert "is not written over" in done.stderr
    assert (tmp_path / "bridge.cell-1.json5").read_text() == "mine"


def test_a_certificate_does_not_outlive_its_authority():
    authority = new_authority(days=10)
    with pytest.raises(SecurityError, match="would outlive"):
        issue_client(authority, "bridge.cell-1", days=11)


def test_certificates_are_good_for_one_purpose_and_signed_by_the_authority():
    authority = new_authority(days=40, now=datetime.now(UTC) - timedelta(days=1))
    router = issue_router(authority, "router", ["10.0.0.1"], days=5).parsed
    client = issue_client(authority, "bridge.cell-1", days=5).parsed
    purposes = {router: ExtendedKeyUsageOID.SERVER_AUTH, client: ExtendedKeyUsageOID.CLIENT_AUTH}
    for certificate, purpose in purposes.items():
        certificate.verify_directly_issued_by(authority.parsed)
        usage = certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
        assert list(usage) == [purpose]
        constraints = certificate.extensions.get_extension_for_class(x509.BasicConstraints).value
        assert not constraints.ca
        assert isinstance(certificate.public_key(), ec.EllipticCurvePublicKey)


def test_the_library_does_as_the_command(tmp_path):
    kept = CredentialStore(tmp_path)
    kept.issue(IssueRequest(identities("bridge", ["cell-1"])))
    assert [holder.label for holder in kept.holders()] == ["bridge.cell-1"]
