"""What compose, Kubernetes and systemd start are commands of caesura, with files that its certs makes."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer

from caesura_clients.dashboard.dashboard_command import PASSWORD_LENGTH
from caesura_service.monitoring.http_server import parse_address
from harness.commands import application

yaml = pytest.importorskip("yaml")

DEPLOY = Path(__file__).parents[2] / "deploy"
COMPOSE = yaml.safe_load((DEPLOY / "compose.yaml").read_text())["services"]
KEPT = {one for one in yaml.safe_load((DEPLOY / "compose.yaml").read_text())["volumes"] if one != "journal"}
OWN_PACKAGES = {"caesura", "caesura-dashboard"}


def pod(name: str) -> dict[str, Any]:
    documents = yaml.safe_load_all((DEPLOY / "kubernetes" / f"{name}.yaml").read_text())
    (spec,) = [one["spec"]["template"]["spec"] for one in documents if "template" in one.get("spec", {})]
    return spec


POD, DASHBOARD_POD = pod("segmenter"), pod("dashboard")


def unit_command(name: str) -> list[str]:
    text = (DEPLOY / "systemd" / name).read_text().replace("\\\n", " ")
    (line,) = re.findall(r"^ExecStart=(.*)$", text, re.MULTILINE)
    return shlex.split(line)


def image_commands() -> list[list[str]]:
    text = (DEPLOY / "Dockerfile").read_text()
    return [yaml.safe_load(words) for words in re.findall(r"^CMD (\[\".*\])$", text, re.MULTILINE)]


def environment(name: str, variable: str) -> list[str]:
    found = re.findall(rf"^{variable}=(.*)$", (DEPLOY / "systemd" / name).read_text(), re.MULTILINE)
    return shlex.split(found[0])


def with_environment(unit: str, file: str, variable: str) -> list[str]:
    return [
        word
        for part in unit_command(unit)[1:]
        for word in (environment(file, variable) if part == f"${variable}" else [part])
    ]


STARTED = {
    **{
        f"compose {name}": ["certs", "/authority", *one["command"]] if name == "certs" else one["command"]
        for name, one in COMPOSE.items()
        if one["image"] in OWN_PACKAGES
    },
    "pod": POD["containers"][0]["args"],
    "dashboard pod": DASHBOARD_POD["containers"][0]["args"],
    **{f"image {words[0]}": words for words in image_commands()},
    "unit": with_environment("caesura.service", "caesura.env", "CAESURA_SERVE"),
    "dashboard unit": with_environment("caesura-dashboard.service", "dashboard.env", "CAESURA_DASHBOARD"),
    "bridge unit": [
        *("bridge", "--station", "cell-1", "--standby"),
        *environment("bridge.cell-1.env", "CAESURA_BRIDGE"),
    ],
}


def parsed(words: list[str], file: Path) -> dict[str, Any]:
    """The options of a command, as caesura reads them; every certificate is a file that there is."""
    words = [re.sub(r"(/certs|\$\{CREDENTIALS_DIRECTORY\})/.*", str(file), word) for word in words]
    words = [word.replace("$(INSTANCE)", "segmenter-0") for word in words]
    command = typer.main.get_command(application()).commands[words[0]]  # type: ignore[attr-defined]
    return dict(command.make_context(words[0], words[1:]).params)


@pytest.mark.parametrize("name", STARTED)
def test_it_is_a_command_with_options_that_there_are(name, tmp_path):
    file = tmp_path / "some.json5"
    file.write_text("{}")
    options = parsed(STARTED[name], file)
    if options.get("metrics"):
        assert parse_address(options["metrics"])[1] == 9464, "where the probes look"


def mounted(service: dict[str, Any]) -> dict[str, str]:
    """Where each volume of a service is found in it."""
    return {volume: place for volume, place, *_ in (one.split(":") for one in service.get("volumes", ()))}


def test_each_container_has_its_own_certificate_and_none_has_the_authority():
    """They once shared a volume with the authority's key and the operator's certificate, as one user."""
    certs = {name: set(mounted(one)) & KEPT for name, one in COMPOSE.items()}
    assert certs.pop("certs") == KEPT
    assert "authority" not in set().union(*certs.values())
    assert {name for name, volumes in certs.items() if len(volumes) != 1} == {"front"}
    running = {name: volumes for name, volumes in certs.items() if "profiles" not in COMPOSE[name]}
    assert len(set().union(*running.values())) == len(running) - 1, "no two have the same"
    assert (
        len({COMPOSE[name]["user"] for name in ("front", "router", "caesura-1", "cell-1", "dashboard")}) == 5
    )
    assert COMPOSE["certs"]["profiles"] == ["tools"]
    assert "operator.boss" not in certs["watch"] | certs["doctor"]


def test_whatever_can_correct_asks_for_a_password():
    for name in ("compose dashboard", "dashboard pod", "image dashboard", "dashboard unit"):
        words = " ".join(STARTED[name])
        assert "--password-file" in words
        assert "--insecure" not in words


@pytest.mark.slow
@pytest.mark.skipif(os.geteuid() != 0, reason="files are given to other users")
def test_what_is_handed_out_is_what_each_container_reads(tmp_path):
    out, authority = tmp_path / "out", tmp_path / "authority"
    for volume in KEPT - {"authority"}:
        (out / volume).mkdir(parents=True)
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    script = ["sh", str(DEPLOY / "compose" / "hand-out.sh"), str(authority), str(out)]
    passwords = set()
    for _ in range(2):
        subprocess.run(
            [*script, *COMPOSE["certs"]["command"]],
            env=environment,
            check=True,
            capture_output=True,
            timeout=60,
        )
        passwords.add((out / "operator.boss" / "password").read_text())
    assert len(passwords) == 1, "the second run keeps what is there"
    assert len(passwords.pop()) > PASSWORD_LENGTH
    assert not list(out.rglob("*.key"))
    for name, service in COMPOSE.items():
        for volume in set(mounted(service)) & KEPT if name != "certs" else ():
            file = out / volume / "zenoh.json5"
            assert file.read_text() == (authority / f"{volume}.json5").read_text()
            assert (oct(file.stat().st_mode)[-3:], str(file.stat().st_uid)) == (
                "400",
                service["user"].partition(":")[0],
            )


def test_a_pod_sees_its_own_certificate_alone():
    (mount,) = [one for one in POD["containers"][0]["volumeMounts"] if one["name"] == "certs"]
    assert mount["subPathExpr"] == "service.$(INSTANCE).json5"
    assert f"--zenoh-config={mount['mountPath']}" in POD["containers"][0]["args"]


def test_probes_and_ports_fit_together():
    container = POD["containers"][0]
    (port,) = container["ports"]
    for probe in ("startupProbe", "livenessProbe", "readinessProbe"):
        assert container[probe]["httpGet"]["port"] == port["name"]
        assert container[probe]["httpGet"]["path"] in {"/healthz", "/readyz"}
    assert f"--metrics=0.0.0.0:{port['containerPort']}" in container["args"]
