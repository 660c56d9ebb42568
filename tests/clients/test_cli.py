"""What is typed and what is shown: results on stdout, one clear line where something is wrong."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from caesura_clients.bridge import BridgeSettings
from caesura_clients.cli.bridge import reporting_pose, reporting_storage, reporting_up
from caesura_clients.cli.commands import register
from caesura_clients.cli.options import reported
from caesura_clients.cli.result_tables import doubtful_apps
from caesura_clients.cli.service_availability_lines import AvailabilityLines
from caesura_clients.cli.standby_loop import _StatusPrinter
from caesura_clients.service_liveliness import watch_services
from caesura_protocol.codec import encode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import service_key, station_key
from caesura_protocol.messages import BridgeStatus, Phase, Program, Refusal, Snapshot
from caesura_protocol.recording import RecordingError
from clients.answering import Answering
from clients.conftest import free_port
from clients.examples import example, recording, snapshot
from clients.fake_service import FakeService, eventually


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


@pytest.mark.usefixtures("full_batches")
def test_bridge_plays_a_file_to_its_acknowledged_end(caesura, router, file):
    with FakeService(router.transport()) as service:
        result = caesura(
            "bridge", "--file", file, "--pace", "fast", "--station", "cell-2", "--session", "mine"
        )
    assert result.exit_code == 0, result.output
    assert result.stdout == "cell-2/mine closed, 5 batches\n"
    assert service.rows() == 100


@pytest.mark.usefixtures("full_batches")
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
        assert_one_line(caesura("bridge", "--file", file), "error: not your station: 'cell-1'")


def test_bridge_says_that_the_service_cannot_store_and_that_it_can_again(monkeypatch, capsys):
    # Of a disk that was full its terminal said nothing for as long as that lasted.
    monkeypatch.setattr("caesura_clients.cli.bridge.LOOK_S", 0.01)

    class StuckBridge:
        settings = BridgeSettings()
        stuck_s = 2.9

    opened, said = StuckBridge(), []

    def printed(words: str) -> bool:
        said.append(capsys.readouterr().err)
        return words in "".join(said)

    with reporting_storage(opened):
        opened.stuck_s = 3.1
        eventually(lambda: printed("cannot store what comes; the newest 600000 samples are kept here"))
        opened.stuck_s = 0.0
        eventually(lambda: printed("the service stores again"))
    assert "".join(said).count("cannot store") == 1


def test_a_list_without_the_sessions_of_a_silent_instance_says_so(caesura, router, monkeypatch):
    """One of two instances hung, and the sessions of its stations were missing without a word."""
    monkeypatch.setattr("caesura_clients.query.RETRY_S", 0.0)
    known = snapshot(0, "motion")
    with Answering(router.transport(), known.status.instance) as service:
        service.snapshots = [known]
        assert caesura("sessions", "list").stderr == ""
        with router.transport().declare_token(service_key("frozen-2", "alive")):
            done = caesura("sessions", "list")
    assert done.exit_code == 0
    assert known.status.session in done.stdout
    assert "not all sessions are listed: frozen-2 is alive and did not answer" in done.stderr


def test_of_a_service_that_is_gone_the_bridge_does_not_say_that_it_stores_again(monkeypatch, capsys):
    # Its disk was full, the router was restarted, and the bridge's certificate was no longer let in.
    monkeypatch.setattr("caesura_clients.cli.bridge.LOOK_S", 0.01)

    class Opened:
        settings = BridgeSettings()
        looks = 0

        @property
        def stuck_s(self) -> float:
            self.looks += 1
            return 3.1 if self.looks == 1 else 0.0  # it no longer asks

    opened, gone = Opened(), [True]
    with reporting_storage(opened, lambda: gone[0]):
        eventually(lambda: opened.looks > 5)
        assert "stores again" not in capsys.readouterr().err
        gone[0] = False
        eventually(lambda: "the service stores again" in capsys.readouterr().err)


@pytest.mark.parametrize(
    ("reporting", "name", "warning"),
    [
        (reporting_pose, "slow_pose", "The pose is read about 7.1 times a second."),
        (reporting_up, "ignored_up", "the service ignores that up is 0,0,-1"),
    ],
)
def test_bridge_says_once_what_it_finds_meanwhile(monkeypatch, capsys, reporting, name, warning):
    monkeypatch.setattr("caesura_clients.cli.bridge.LOOK_S", 0.01)
    opened, said = SimpleNamespace(**{name: None}), []

    def printed(words: str) -> bool:
        said.append(capsys.readouterr().err)
        return words in "".join(said)

    with reporting(opened):
        setattr(opened, name, warning)
        eventually(lambda: printed(f"warning: {warning}"))
    printed("")
    assert "".join(said).count(warning) == 1


def test_a_bridge_in_standby_prints_what_it_warns_of_while_it_teaches(capsys):
    print_status = _StatusPrinter()
    teaching = BridgeStatus(station="cell-1", bridge="b", state="teaching", source="ur", session="s1")
    for problem in (None, "the service ignores that up is 0,0,-1"):
        print_status(teaching.model_copy(update={"problem": problem}))
    print_status(teaching.model_copy(update={"state": "ready", "session": None}))
    assert capsys.readouterr().err.splitlines() == [
        "cell-1 teaching: s1",
        "cell-1 teaching: s1; the service ignores that up is 0,0,-1",
        "cell-1 ready: waits for a start",
    ]


def refusing(**changes):
    """A snapshot of cell-2/mine, with one thing refused where nothing else is said."""
    whole = snapshot(0, station="cell-2", session="mine", state="closed")
    return whole.model_copy(update={"status": whole.status.model_copy(update=changes)})


@pytest.fixture
def played(caesura, router, service, file):
    """Play the file as cell-2/mine, to a service that says this of it."""

    def play(known):
        service.snapshots = [known]
        with FakeService(router.transport(), "fake-2"):
            options = ("--pace", "fast", "--station", "cell-2", "--session", "mine")
            return caesura("bridge", "--file", file, *options)

    return play


@pytest.mark.usefixtures("full_batches")
def test_bridge_reports_what_was_refused(played):
    # It once said "closed, 640 batches" and ended with 0 where every one had been refused.
    why = Refusal(code="malformed", message="malformed: not a map")
    result = played(refusing(refused={"malformed": 640}, lost=640, last_refusal=why, repeats=3, samples=100))
    assert result.exit_code == 1
    assert result.stdout == "cell-2/mine closed, 5 batches\n"
    line = result.stderr.splitlines()[-1]
    gap = "1 gap, 0.25 s (at 5.00–5.25 s)"  # its time was not named
    for word in ("cell-2/mine: 640 refused (last: not a map)", "3 of 100 samples dropped", gap):
        assert word in line


def test_what_came_again_after_a_refusal_is_no_failure(played):
    # A disk was full for a while; or a second bridge published the session, whose batches were refused.
    why = Refusal(code="overloaded", message="overloaded: no room left")
    nothing = {"lost": 0, "waiting_for": None, "repeats": 0, "gaps": ()}
    result = played(refusing(refused={"overloaded": 70}, last_refusal=why, **nothing))
    assert result.exit_code == 0
    assert result.stderr.endswith("cell-2/mine: 70 refused (last: no room left), and nothing is lost\n")


@pytest.mark.parametrize("missing", [{"lost": 640}, {"waiting_for": 3}])
def test_what_is_lost_is_a_failure_though_nothing_was_refused(played, missing):
    nothing = {"refused": {}, "last_refusal": None, "repeats": 0, "gaps": (), "lost": 0, "waiting_for": None}
    assert played(refusing(**nothing | missing)).exit_code == 1


def test_what_was_dropped_as_a_repeat_is_reported_but_is_no_failure(played):
    result = played(refusing(refused={}, last_refusal=None, repeats=3, samples=100, gaps=()))
    assert result.exit_code == 0
    assert result.stderr.endswith("cell-2/mine: 3 of 100 samples dropped: their time did not advance\n")


def test_nothing_is_said_where_all_is_well(played):
    result = played(refusing(refused={}, last_refusal=None, repeats=0, gaps=()))
    assert result.exit_code == 0
    assert len(result.stderr.splitlines()) == 1


def test_bridge_takes_a_session_up_with_an_epoch_and_names_a_preset(caesura, router, file):
    with FakeService(router.transport()) as service:
        options = ("--session", "mine", "--epoch", "2", "--preset", "integrated", "--pace", "fast")
        assert caesura("bridge", "--file", file, *options).exit_code == 0
    assert (service.openings[0].epoch, service.openings[0].preset) == (2, "integrated")


def test_an_epoch_needs_the_name_of_a_session(caesura, file):
    result = caesura("bridge", "--file", file, "--epoch", "1")
    assert result.exit_code == 2
    assert "--session" in result.stderr


def test_bridge_names_what_of_a_file_it_does_not_read(caesura, router, tmp_path):
    arrays = {"t": np.arange(30.0) / 100, "pos": np.zeros((30, 3)), "vel": np.zeros((30, 3))}
    np.savez(tmp_path / "more.npz", **arrays)
    np.savez(tmp_path / "typo.npz", **arrays, length_units="mm")
    with FakeService(router.transport()):
        more = caesura("bridge", "--file", str(tmp_path / "more.npz"), "--pace", "fast")
    with FakeService(router.transport()):
        typo = caesura("bridge", "--file", str(tmp_path / "typo.npz"), "--pace", "fast")
    assert more.exit_code == typo.exit_code == 0
    assert "note: more.npz: ignored vel\n" in more.stderr
    meant = "length_units (did you mean length_unit?)"
    assert f"warning: typo.npz: ignored vel, {meant}\n" in typo.stderr


def test_bridge_says_when_the_service_goes_and_comes_back(router, capsys):
    seen, say = [], AvailabilityLines()

    def note(change):
        say(change)
        seen.append(change)

    with watch_services(router.transport(), note):
        for number in (1, 2):
            with Answering(router.transport()):
                eventually(lambda number=number: len(seen) == 2 * number - 1)
            eventually(lambda number=number: len(seen) == 2 * number)
    assert capsys.readouterr().err.splitlines() == [
        "service gone, waiting",
        "service back",
        "service gone, waiting",
    ]


@pytest.mark.parametrize("command", [("bridge", "--station", "cell-1", "--file"), ("start", "cell-1")])
def test_a_session_that_is_no_name_is_refused_before_a_router_is_looked_for(caesura, file, command):
    """A bridge waited for a router first, for ever."""
    more = (file,) if command[0] == "bridge" else ()
    result = caesura(*command, *more, "--session", "A B", "--connect", "tcp/127.0.0.1:9")
    assert_one_line(result, "error: session is not a valid name: 'A B'; expected 1 to 64 of a to z, ")


@pytest.mark.parametrize("command", ["watch", "program", "sessions", "bridge"])
def test_a_station_that_is_no_name_is_one_line_that_does_not_speak_of_the_wire(caesura, file, command):
    # It once stood behind "waiting for Cell_1" on the same line, and began with "malformed:".
    more = ("--file", file) if command == "bridge" else ()
    result = caesura(command, "--station", "Cell_1", *more)
    assert_one_line(result, "error: station is not a valid name: 'Cell_1'; expected 1 to 64 of a to z, ")
    assert "waiting" not in result.output


@pytest.mark.parametrize(
    ("name", "content", "word"),
    [
        ("a.npz", b"", "not a readable npz"),
        ("a.npz", b"text", "not a readable npz"),
        ("a.csv", b"t,px,py,pz\n0,1,2,3\n0,1\n", "line 3 has 2 values"),
        ("a.csv", b"t,px,py,pz\nnan,1,2,3\n", "t is nan"),
        ("a.txt", b"", "suffix '.txt'"),
    ],
)
def test_a_file_that_is_no_recording_is_one_line(caesura, tmp_path, name, content, word):
    (tmp_path / name).write_bytes(content)
    assert_one_line(caesura("bridge", "--file", str(tmp_path / name)), word)


@pytest.mark.parametrize(("option", "value"), [("--length-unit", "inch"), ("--wrench-source", "guess")])
def test_an_override_that_does_not_exist_is_one_line(caesura, file, option, value):
    assert_one_line(caesura("bridge", "--file", file, option, value), value, "expected one of")


def test_a_recording_error_is_an_error_that_is_reported(capsys):
    # It was none, and `caesura segment missing.npz` printed a traceback.
    with pytest.raises(typer.Exit), reported():
        raise RecordingError("a.npz: no such file")
    assert capsys.readouterr().err == "error: a.npz: no such file\n"


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
    assert "1 gap, 0.25 s" in result.stdout
    assert "1 refused (last: not a map)" in result.stdout


def test_watch_says_that_the_service_is_overloaded_and_what_was_lost(caesura, service):
    whole = snapshot(3, "motion")
    status = whole.status.model_copy(update={"overloaded": True, "dropped": 7, "lost": 2})
    service.snapshots = [whole.model_copy(update={"status": status})]
    shown = " ".join(caesura("watch", "--once").stdout.split())
    assert "the service is overloaded · 7 messages dropped, and batches among them requested again" in shown
    assert "1 gap, 0.25 s (at 5.00–5.25 s), 2 batches lost" in shown
    service.snapshots = [whole]
    assert "overloaded" not in caesura("watch", "--once").stdout


def test_watch_names_the_stations_that_there_are(caesura, service):
    service.snapshots = [snapshot(0, station="cell-7")]
    assert_one_line(caesura("watch", "--once", "--station", "cell-1"), "cell-1", "cell-7")


def test_program_shows_the_apps_of_the_only_station(caesura, service):
    service.snapshots = [snapshot(0)]
    service.answers[station_key("cell-1", "program")] = encode(example(Program))
    result = caesura("program")
    assert result.exit_code == 0, result.output
    for word in (
        "1  carry (transport)",
        "speed: Ann",
        "625 -250 375",
        "0.50±0.06 kg",
        "version 3",
        "being taught",
        "not weighed",
    ):
        assert word in result.stdout


def test_program_as_json_is_the_message(caesura, service):
    service.answers[station_key("cell-1", "program")] = encode(example(Program))
    result = caesura("program", "--station", "cell-1", "--json")
    assert Program.model_validate_json(result.stdout) == example(Program)


def test_program_asks_which_station_where_there_are_several(caesura, service):
    service.snapshots = [snapshot(0, station="cell-1"), snapshot(0, station="cell-2")]
    said = "several stations have sessions: cell-1, cell-2; name one with --station"
    assert_one_line(caesura("program"), said)
    shown = " ".join(caesura("program", "--help").stdout.replace("│", " ").split())
    assert "required if several have sessions" in shown


def test_program_says_where_no_station_has_a_session(caesura, service):
    assert_one_line(caesura("program"), "no station has sessions")


def test_sessions_are_listed(caesura, service):
    service.snapshots = [snapshot(0, "motion", session="s1")]
    assert "s1" in caesura("sessions").stdout
    (info,) = json.loads(caesura("sessions", "--json").stdout)
    assert (info["station"], info["session"], info["segments"]) == ("cell-1", "s1", 1)


def test_sessions_list_is_the_same_list(caesura, service):
    service.snapshots = [snapshot(0, "motion", session="s1")]
    assert caesura("sessions", "list").stdout == caesura("sessions").stdout


def test_a_session_is_shown_with_its_segments_and_its_program(caesura, service):
    service.snapshots = [snapshot(0, "motion", session="s1"), snapshot(0, "steady", session="s2")]
    shown = caesura("sessions", "show", "s1", "--station", "cell-1").stdout
    assert "cell-1 / s1" in shown
    assert "motion" in shown
    assert "version" in shown
    received = caesura("sessions", "show", "s2", "--station", "cell-1", "--json").stdout
    assert Snapshot.model_validate_json(received) == service.snapshots[1]


def test_a_session_is_shown_with_its_phases(caesura, service):
    whole = snapshot(0, "motion", "contact", session="s1")
    phases = tuple(
        example(Phase).model_copy(update={"first_segment": i, "last_segment": i, "name": name})
        for i, name in enumerate(("[/reach]", "wipe the [red] table"))
    )
    shown = whole.segments.model_copy(update={"phases": phases})
    service.snapshots = [whole.model_copy(update={"segments": shown})]
    # A name like [/reach] ended the command, and what looks like a colour was left out.
    words = caesura("sessions", "show", "s1", "--station", "cell-1").stdout
    assert "[/reach]" in words
    assert "wipe the [red] table" in words


def test_a_session_with_a_name_of_its_own_is_shown_without_its_station(caesura, service):
    # Its station had to be named wherever several stations had sessions.
    service.snapshots = [
        snapshot(0, "motion", station=station, session=session)
        for station, session in (("cell-1", "s1"), ("cell-2", "s2"), ("cell-2", "s1"))
    ]
    assert "cell-2 / s2" in caesura("sessions", "show", "s2").stdout
    said = "several stations have a session 's1': cell-1, cell-2; name one with --station"
    assert_one_line(caesura("sessions", "show", "s1"), said)
    assert_one_line(caesura("sessions", "show", "s9"), "no station has a session 's9'")


def test_a_session_that_is_not_there_is_one_line(caesura, service):
    service.snapshots = [snapshot(0, "motion", session="s1")]
    assert_one_line(caesura("sessions", "show", "s9", "--station", "cell-1"), "no session s9")


@pytest.mark.parametrize("option", [("--station", "cell-1"), ("--json",), ("--connect", "tcp/127.0.0.1:1")])
def test_options_that_would_be_ignored_are_refused(caesura, service, option):
    result = caesura("sessions", *option, "list")
    assert result.exit_code == 2
    assert "after the command" in result.stderr


@pytest.mark.parametrize("command", ["sessions", "program"])
def test_without_a_service_one_line_says_so(caesura, command):
    assert_one_line(caesura(command), "no service is alive at tcp/127.0.0.1:")


def test_without_a_router_one_line_says_so(caesura, monkeypatch):
    monkeypatch.setattr("caesura_clients.cli.options.CONNECT_TIMEOUT_S", 0.1)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    assert_one_line(caesura("sessions", "--connect", endpoint), "no router at", endpoint)


def test_an_endpoint_that_makes_no_sense_is_named(caesura):
    assert_one_line(caesura("sessions", "--connect", "nonsense"), "nonsense", "tcp/127.0.0.1:7447")


def test_program_shows_a_session_by_its_name(caesura, service):
    service.snapshots = [
        snapshot(0, station="cell-1", session="old", state="closed"),
        snapshot(1, station="cell-2", session="new"),
    ]
    result = caesura("program", "--session", "new")
    assert result.exit_code == 0, result.output
    assert "cell-2 / new, version 3" in result.stdout
    assert_one_line(caesura("program", "--session", "none"), "no station has a session 'none'")


def test_an_app_that_is_less_sure_than_its_segments_is_explained():
    apps = [example(Program).apps[0].model_copy(update={"confidence": p}) for p in (0.9, 0.02, 0.3)]
    (sentence,) = doubtful_apps(apps)
    assert sentence.endswith("that of its less certain boundary; low: apps 2, 3.")
    assert doubtful_apps(apps[:1]) == ()


def test_what_people_write_in_a_program_is_no_markup(caesura, service):
    named = example(Program)
    app = named.apps[0].model_copy(update={"name": "[/red]", "note": "[bold"})
    named = named.model_copy(update={"name": "[/]", "apps": (app,)})
    service.snapshots = [snapshot(0).model_copy(update={"program": named})]
    shown = caesura("program").stdout
    assert all(words in shown for words in ("[/]:", "[/red] (transport)", "[bold"))
