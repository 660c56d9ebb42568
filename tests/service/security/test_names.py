"""Nothing from the network is run, unpickled, or becomes a path; names are checked wherever they come in."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

import caesura_clients
import caesura_protocol
import caesura_service
from caesura_protocol.codec import decode, encode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import (
    ROOT,
    parse_service_key,
    parse_session_key,
    parse_station_key,
    service_key,
    session_key,
    station_key,
)
from caesura_protocol.messages import Ack, Close, Control, Heartbeat, Open, SampleBatch
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.security.certificates import SecurityError
from caesura_service.security.credential_store import identities
from harness.fake_pipeline import make_fake_pipeline
from harness.peer import DEADLINE_S, Peer
from harness.sessions import batch, heartbeat, opening

HOSTILE = (
    "../x",
    "..",
    ".",
    "a/b",
    "/etc/passwd",
    "",
    "x" * 65,
    "A",
    "a b",
    "a\0b",
    "a\nb",
    "*",
    "a$*",
    "é",
    "-a",
)
MESSAGES = {
    Open: opening("s1"),
    Close: Close(session="s1", last_seq=0),
    Heartbeat: heartbeat(0, "s1"),
    SampleBatch: batch(0, "s1"),
}

ENTRIES: dict[str, Callable[[str], object]] = {
    "station key": lambda name: parse_station_key(f"{ROOT}/station/{name}/samples"),
    "session key, station": lambda name: parse_session_key(f"{ROOT}/session/{name}/s1/status"),
    "session key, session": lambda name: parse_session_key(f"{ROOT}/session/cell-1/{name}/status"),
    "service key": lambda name: parse_service_key(f"{ROOT}/service/{name}/alive"),
    "instance": lambda name: ServiceConfig(instance=name),
    "preset of the service": lambda name: ServiceConfig(preset=name),
    "certificate": lambda name: identities("bridge", [name]),
}


@pytest.mark.parametrize("entry", ENTRIES)
def test_what_is_no_name_is_refused_at_every_entry(entry):
    taken = []
    for name in HOSTILE:
        with suppress(ProtocolError, SecurityError):
            ENTRIES[entry](name)
            taken.append(name)
    assert taken == []


@pytest.mark.parametrize("name", [name for name in HOSTILE if name != "*"])
def test_keys_are_not_built_from_what_is_no_name(name):
    for build in (
        lambda: station_key(name, "samples"),
        lambda: session_key(name, "s1", "status"),
        lambda: session_key("cell-1", name, "status"),
        lambda: service_key(name, "alive"),
    ):
        with pytest.raises(ProtocolError):
            build()


@pytest.mark.parametrize(
    ("kind", "field"), [*((kind, "session") for kind in MESSAGES), (Open, "preset")], ids=str
)
def test_a_message_with_such_a_name_is_refused(kind, field):
    taken = []
    for name in HOSTILE:
        content = encode(MESSAGES[kind].model_copy(update={field: name}))
        try:
            taken.append(decode(content.payload, content.encoding, kind))
        except ProtocolError as error:
            if error.code != "malformed":
                taken.append(error)
    assert taken == []


@pytest.fixture
def directory(tmp_path) -> Path:
    return tmp_path / "journal"


@pytest.fixture
def peer(directory) -> Iterator[Peer]:
    config = ServiceConfig(instance="test-1", listen="tcp/127.0.0.1:0", preset="fake", journal=directory)
    with Service(config, pipeline_factory=make_fake_pipeline) as service, Peer(service.endpoint) as connected:
        yield connected


def files_below(folder):
    """All but the room that a journal keeps for itself, whenever it has the time."""
    return {path for path in folder.rglob("*") if path.suffix != ".reserve"}


def test_no_name_from_the_network_makes_a_file(peer, directory):
    peer.command(opening("good"))
    files = files_below(directory.parent)
    for name in ("..", "A", "a b", "x" * 65, "é"):
        for part in ("samples", "alive"):
            peer.network.put(f"{ROOT}/station/{name}/{part}", b"x")
        for content in (encode(Control(command=opening("s1"))), (b"rubbish", "zenoh/bytes")):
            for reply in peer.network.get(
                f"{ROOT}/station/{name}/control", payload=content[0], encoding=content[1], timeout=DEADLINE_S
            ):
                assert reply.ok is None
    for name in HOSTILE:
        forged = Control(command=opening("s1").model_copy(update={"session": name}))
        with pytest.raises(ProtocolError):
            peer.control(*encode(forged))
    assert files_below(directory.parent) == files
    assert isinstance(peer.command(opening("good")), Ack)
    assert peer.service_status().sessions_open == 1


@pytest.mark.parametrize(
    "wide", ["**", "caesura/**", f"{ROOT}/**", f"{ROOT}/station/*/*", f"{ROOT}/station/*/control"]
)
def test_a_command_to_all_stations_belongs_to_none(peer, wide, caplog):
    peer.command(opening("good"))
    content = encode(Control(command=Close(session="good", last_seq=-1)))
    options = {"payload": content.payload, "encoding": content.encoding, "timeout": DEADLINE_S}
    replies = list(peer.network.get(wide, **options))
    assert not any(decoded for decoded in replies if decoded.ok and "Ack" in str(decoded.ok.encoding))
    assert peer.snapshot("good").status.state == "open"
    assert not [record for record in caplog.records if record.levelname == "ERROR"]


FORBIDDEN_MODULES = {"pickle", "marshal", "shelve", "dill", "yaml", "subprocess", "ctypes"}
FORBIDDEN_CALLS = {"eval", "exec", "compile", "__import__"}
# The rooms that handle what comes from the network, on either side.
READS_NOTHING_SENT = (
    "changepoint",
    "numba_support",
    "commands",
    "prepare.py",
    "malloc_threshold.py",
)  # of the service
# Modules that start a process. Nothing that came over the network is its command or an argument:
# `hints --exec` runs a person's command, with the hint in variables;
# `recording_playback_process` plays uploads;
# `program_simulation` runs a program from a file of its own, at one of two speeds.
STARTS_A_PROCESS = ("hints.py", "recordings.py", "program_simulation.py")
ROOMS = [
    file
    for package in (caesura_protocol, caesura_clients, caesura_service)
    for file in Path(package.__file__).parent.rglob("*.py")
    if not set(file.parts) & set(READS_NOTHING_SENT)
]


@pytest.fixture(scope="module")
def nodes() -> dict[Path, list[ast.AST]]:
    """What each module of those rooms is made of."""
    return {file: list(ast.walk(ast.parse(file.read_text()))) for file in ROOMS}


def test_no_code_runs_or_unpickles_what_it_reads(nodes):
    for file in ROOMS:
        runs_and_unpickles_nothing(file, nodes[file])


def test_a_process_is_started_without_a_shell(nodes):
    """A command is a list: nothing that came over the network is read by a shell."""
    started = []
    for file in ROOMS:
        for node in nodes[file]:
            if isinstance(node, ast.Call) and of_subprocess(node.func):
                started.append(file.name)
                assert "shell=True" not in ast.unparse(node)
    assert set(started) == set(STARTS_A_PROCESS)


def of_subprocess(called: ast.expr) -> bool:
    return isinstance(called, ast.Attribute) and getattr(called.value, "id", "") == "subprocess"


def runs_and_unpickles_nothing(file: Path, nodes: list[ast.AST]) -> None:
    for node in nodes:
        if isinstance(node, ast.Import):
            named = {alias.name.partition(".")[0] for alias in node.names}
            assert not named & FORBIDDEN_MODULES - (
                {"subprocess"} if file.name in STARTS_A_PROCESS else set()
            )
        if isinstance(node, ast.ImportFrom):
            assert (node.module or "").partition(".")[0] not in FORBIDDEN_MODULES
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in FORBIDDEN_CALLS
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "load":
            said = ast.unparse(node)
            assert not said.startswith("np.load") or "allow_pickle=False" in said
