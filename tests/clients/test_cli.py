"""What is typed and what is shown: results on stdout, one clear line where something is wrong."""

import json
from importlib.metadata import EntryPoint

import pytest
import typer
from typer.testing import CliRunner

from caesura_clients.cli import build
from caesura_clients.cli.commands import register
from caesura_protocol.codec import encode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import station_key
from caesura_protocol.messages import Program
from clients.answering import Answering
from clients.conftest import free_port
from clients.examples import example, recording, snapshot
from clients.fake_service import FakeService


@pytest.fixture
def caesura(router, monkeypatch):
    """The command line, connected with the test's router."""
    app = typer.Typer()
    register(app)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("CAESURA_CONNECT", router.endpoint)

    def run(*arguments):
        return CliRunner().invoke(app, list(arguments))

    return run


@pytest.fixture
def service(router):
    with Answering(router.transport()) as answering:
        yield answering


@pytest.fixture
def file(tmp_path):
    recording(100).save(tmp_path / "demo.npz")
    return str(tmp_path / "demo.npz")


def assert_one_line(result, *words):
    assert result.exit_code == 1
    assert result.stdout == ""
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    for word in words:
        assert word in line


def test_bridge_plays_a_file_to_its_acknowledged_end(caesura, router, file):
    with FakeService(router.transport()) as service:
        result = caesura(
            "bridge", "--file", file, "--pace", "fast", "--station", "cell-2", "--session", "mine"
        )
    assert result.exit_code == 0, result.output
    assert result.stdout == "cell-2/mine closed, 5 batches\n"
    assert service.rows() == 100


def test_bridge_declares_what_the_options_say(caesura, router, file):
    with FakeService(router.transport()) as service:
        options = ("--wrench-source", "joint_torque_estimate", "--unit", "mm", "--batch", "50")
        assert caesura("bridge", "--file", file, "--pace", "20", *options).exit_code == 0
    opening = service.openings[0]
    assert (opening.wrench_source, opening.length_unit) == ("joint_torque_estimate", "mm")
    assert [batch.n for batch in service.batches] == [50, 50]


def test_bridge_says_why_it_was_refused(caesura, router, file):
    service = FakeService(router.transport())
    service.refuse = ProtocolError("forbidden", "not your station", value="cell-1")
    with service:
        assert_one_line(caesura("bridge", "--file", file), "forbidden", "not your station", "cell-1")


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--file", "missing.npz"], "no such file"),
        ([], "--file"),
        (["--source", "kuka"], "expected one of file"),
        (["--source", "teacher", "--scenario", "juggling"], "juggling"),
        (["--station", "Cell 1"], "not a valid name"),
    ],
)
def test_bridge_says_what_is_wrong_with_its_arguments(caesura, file, arguments, word):
    assert_one_line(
        caesura("bridge", *(["--file", file] if "--station" in arguments else []), *arguments), word
    )


def test_a_pace_that_is_none_is_a_wrong_use(caesura, file):
    result = caesura("bridge", "--file", file, "--pace", "slow")
    assert result.exit_code == 2
    assert "expected real, fast or a number" in result.stderr


def test_watch_marks_what_may_still_change(caesura, service):
    whole = snapshot(3, "motion", "contact")
    first, second = whole.segments.segments
    provisional = second.model_copy(update={"certainty": "provisional", "load_kg": None})
    listed = whole.segments.model_copy(update={"segments": (first, provisional)})
    service.snapshots = [whole.model_copy(update={"segments": listed})]
    result = caesura("watch", "--once")
    assert result.exit_code == 0, result.output
    assert "from [s]" in result.stdout
    assert "~contact" in result.stdout
    assert "~motion" not in result.stdout
    assert "0.50 kg ± 0.06" in result.stdout
    assert "5.0 N" in result.stdout
    assert "12500 samples in 625 batches" in result.stdout
    assert "1 gaps, 0.25 s" in result.stdout
    assert "1 refused, last: not a map" in result.stdout


def test_watch_names_the_stations_that_there_are(caesura, service):
    service.snapshots = [snapshot(0, station="cell-7")]
    assert_one_line(caesura("watch", "--once", "--station", "cell-1"), "cell-1", "cell-7")


def test_program_shows_the_apps_of_the_only_station(caesura, service):
    service.snapshots = [snapshot(0)]
    service.answers[station_key("cell-1", "program")] = encode(example(Program))
    result = caesura("program")
    assert result.exit_code == 0, result.output
    for word in ("Transport", "625 -250  375", "0.50 kg", "version 3", "being taught", "not weighed"):
        assert word in result.stdout


def test_program_as_json_is_the_message(caesura, service):
    service.answers[station_key("cell-1", "program")] = encode(example(Program))
    result = caesura("program", "--station", "cell-1", "--json")
    assert Program.model_validate_json(result.stdout) == example(Program)


def test_program_asks_which_station_where_there_are_several(caesura, service):
    service.snapshots = [snapshot(0, station="cell-1"), snapshot(0, station="cell-2")]
    assert_one_line(caesura("program"), "--station", "cell-1, cell-2")


def test_sessions_are_listed(caesura, service):
    service.snapshots = [snapshot(0, "motion", session="s1")]
    assert "s1" in caesura("sessions").stdout
    (info,) = json.loads(caesura("sessions", "--json").stdout)
    assert (info["station"], info["session"], info["segments"]) == ("cell-1", "s1", 1)


@pytest.mark.parametrize("command", ["sessions", "program"])
def test_without_a_service_one_line_says_so(caesura, command):
    assert_one_line(caesura(command), "no service is alive at tcp/127.0.0.1:")


def test_without_a_router_one_line_says_so(caesura, monkeypatch):
    monkeypatch.setattr("caesura_clients.cli.options.CONNECT_TIMEOUT_S", 0.1)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    assert_one_line(caesura("sessions", "--connect", endpoint), "no router at", endpoint)


def test_an_endpoint_that_makes_no_sense_is_named(caesura):
    assert_one_line(caesura("sessions", "--connect", "nonsense"), "nonsense", "tcp/127.0.0.1:7447")


def entry(value):
    return EntryPoint(name="x", value=value, group="caesura.commands")


def test_the_command_line_assembles_itself_from_what_is_installed():
    app = build([entry("caesura_clients.cli.commands:register")])
    result = CliRunner().invoke(app, ["--help"])
    for command in ("bridge", "watch", "program", "sessions"):
        assert command in result.stdout


def test_commands_whose_extra_is_missing_are_left_out_in_silence(monkeypatch, tmp_path, capsys):
    (tmp_path / "needs_an_extra.py").write_text("import a_library_that_is_not_installed\n")
    (tmp_path / "broken.py").write_text("import caesura_clients.a_module_that_is_not_there\n")
    monkeypatch.syspath_prepend(tmp_path)
    app = build([entry("needs_an_extra:register"), entry("caesura_clients.cli.commands:register")])
    assert len(app.registered_commands) == 4
    assert capsys.readouterr() == ("", "")
    with pytest.raises(ModuleNotFoundError, match="a_module_that_is_not_there"):
        build([entry("broken:register")])
