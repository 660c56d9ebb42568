"""What compose, Kubernetes and systemd start are commands of caesura, with files that its certs makes."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer

from caesura_clients.cli import build
from caesura_service.commands.certs import certs
from caesura_service.observing.web import parse_address
from caesura_service.security.directory import Directory

yaml = pytest.importorskip("yaml")

DEPLOY = Path(__file__).parents[2] / "deploy"
COMPOSE = yaml.safe_load((DEPLOY / "compose.yaml").read_text())["services"]
POD = next(
    one["spec"]["template"]["spec"]
    for one in yaml.safe_load_all((DEPLOY / "kubernetes" / "segmenter.yaml").read_text())
    if one["kind"] == "StatefulSet"
)


def unit_command(name: str) -> list[str]:
    text = (DEPLOY / "systemd" / name).read_text().replace("\\\n", " ")
    (line,) = re.findall(r"^ExecStart=(.*)$", text, re.MULTILINE)
    return shlex.split(line)


def docker_command() -> list[str]:
    text = (DEPLOY / "Dockerfile").read_text()
    return yaml.safe_load(re.findall(r"^CMD (\[\"serve.*\])$", text, re.MULTILINE)[0])


def environment(name: str, variable: str) -> list[str]:
    found = re.findall(rf"^{variable}=(.*)$", (DEPLOY / "systemd" / name).read_text(), re.MULTILINE)
    return shlex.split(found[0])


STARTED = {
    **{f"compose {name}": one["command"] for name, one in COMPOSE.items() if name != "router"},
    "pod": POD["containers"][0]["args"],
    "image": docker_command(),
    "unit": [
        word
        for part in unit_command("caesura.service")[1:]
        for word in (environment("caesura.env", "CAESURA_SERVE") if part == "$CAESURA_SERVE" else [part])
    ],
    "bridge unit": ["bridge", "--station", "cell-1", *environment("bridge.cell-1.env", "CAESURA_BRIDGE")],
}


def parsed(words: list[str], file: Path) -> dict[str, Any]:
    """The options of a command, as caesura reads them; every certificate is a file that there is."""
    words = [
        re.sub(r"(--zenoh-config=|\$\{CREDENTIALS_DIRECTORY\}).*", rf"\g<1>{file}", word) for word in words
    ]
    words = [
        word.removeprefix("${CREDENTIALS_DIRECTORY}").replace("$(INSTANCE)", "segmenter-0") for word in words
    ]
    command = typer.main.get_command(build()).commands[words[0]]  # type: ignore[attr-defined]
    return dict(command.make_context(words[0], words[1:]).params)


@pytest.mark.parametrize("name", STARTED)
def test_it_is_a_command_with_options_that_there_are(name, tmp_path):
    file = tmp_path / "some.json5"
    file.write_text("{}")
    options = parsed(STARTED[name], file)
    if options.get("metrics"):
        assert parse_address(options["metrics"])[1] == 9464, "where the probes look"


def test_compose_uses_the_files_that_its_certs_make(tmp_path):
    words = [word.replace("/certs", str(tmp_path)) for word in COMPOSE["certs"]["command"]]
    options = parsed(words, tmp_path)
    certs(**{name: value for name, value in options.items() if name != "help"})
    used = {
        word.rpartition("/")[2] for one in COMPOSE.values() for word in one["command"] if ".json5" in word
    }
    assert {name for name in used if not (tmp_path / name).exists()} == set()
    assert {holder.label for holder in Directory(tmp_path).holders()} == {
        name.removesuffix(".json5") for name in used - {"router.json5"}
    }


def test_probes_and_ports_fit_together():
    container = POD["containers"][0]
    (port,) = container["ports"]
    for probe in ("startupProbe", "livenessProbe", "readinessProbe"):
        assert container[probe]["httpGet"]["port"] == port["name"]
        assert container[probe]["httpGet"]["path"] in {"/healthz", "/readyz"}
    assert f"--metrics=0.0.0.0:{port['containerPort']}" in container["args"]
