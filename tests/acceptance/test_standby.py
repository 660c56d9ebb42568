"""A bridge in standby beside a real router and a real service: every start and stop has a clear outcome."""

from __future__ import annotations

import json
import queue
import re
import subprocess
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from itertools import chain, repeat
from typing import get_args

import numpy as np
import pytest
import typer
from click.testing import Result
from typer.testing import CliRunner

from caesura_clients import Caesura, demonstration_control
from caesura_clients.bridge.bridge import Bridge
from caesura_clients.bridge.sessions_on_demand import Standby
from caesura_clients.bridge.sources import Source
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.cli import start_stop_describe
from caesura_clients.cli.commands import register
from caesura_clients.cli.start_stop_describe import WAITING, what_lasts
from caesura_protocol.errors import CaesuraError, ProtocolError, SourceError, Unreachable
from caesura_protocol.messages import BridgeState, BridgeStatus, Description, SessionStatus
from caesura_protocol.number_words import counted
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from clients.examples import LiveSource, samples
from clients.guided_arms import ARMS, M_PER_STATE, RATE_HZ, GuidedArm
from harness.demonstrations import guided
from harness.processes import (
    CAESURA,
    DEADLINE_S,
    QUICK,
    Router,
    ServiceProcess,
    environment,
    eventually,
    running,
    start,
)

STATION = "cell-1"
WIPE = Description(task="wipe", operator="Ann", tags=("left",))
RECORDING = guided()
SLOW = 0.05  # pace: lasts as long as a test
AT_ONCE = replace(QUICK, close_timeout_s=0.5)


class FedSource(LiveSource):
    """A live source whose samples a test gives; `fail` loses it."""

    def __init__(self) -> None:
        super().__init__()
        self._given: queue.Queue[np.ndarray | None] = queue.Queue()
        self.read = 0  # samples that were taken from it

    def give(self, chunk: np.ndarray) -> None:
        self._given.put(chunk)
        eventually(self._given.empty)

    def fail(self) -> None:
        self._given.put(None)

    def chunks(self) -> Iterator[np.ndarray]:
        while (chunk := self._given.get()) is not None:
            yield chunk
            self.read += len(chunk)
        raise SourceError("robot at 10.0.0.2: lost, the user stop is pressed")


@pytest.fixture(scope="module")
def router() -> Iterator[Router]:
    with running(Router()) as process:
        yield process


@pytest.fixture
def service(router, tmp_path) -> Iterator[ServiceProcess]:
    with running(ServiceProcess(tmp_path / "journal", router=router.endpoint)) as process:
        yield process


@pytest.fixture
def caesura(router) -> Iterator[Caesura]:
    with ZenohTransport(router.endpoint, timeout_s=DEADLINE_S) as transport:
        yield Caesura(transport)


@contextmanager
def standing_by(endpoint: str, *sources: Source, settings=QUICK, released_s=None) -> Iterator[Standby]:
    """A bridge in standby in a thread of its own; each loss of a source opens the next one."""
    rest = chain(sources, repeat(sources[-1]))
    with ExitStack() as stack:
        transport = stack.enter_context(ZenohTransport(endpoint, timeout_s=DEADLINE_S))
        standby = Standby(
            transport, STATION, lambda: nullcontext(next(rest)), settings=settings, released_s=released_s
        )
        thread = threading.Thread(target=standby.run)
        thread.start()
        stack.callback(thread.join, DEADLINE_S)
        stack.callback(standby.end)
        yield standby


@contextmanager
def ready_to_start(caesura: Caesura, endpoint: str, *sources: Source, released_s=None) -> Iterator[Standby]:
    """A bridge in standby, as `standing_by`, that a service answers."""
    with standing_by(endpoint, *sources, released_s=released_s) as standby:
        reaches(standby, "ready")
        eventually(lambda: caesura.services() != [])
        yield standby


def reaches(standby: Standby, state: BridgeState) -> None:
    eventually(lambda: standby.status.state == state)


def known(caesura: Caesura, session: str) -> SessionStatus:
    return caesura.snapshot(STATION, session).status


def refused(command: Callable[[], object]) -> ProtocolError:
    with pytest.raises(ProtocolError) as error:
        command()
    return error.value


@pytest.mark.slow
def test_one_process_teaches_session_after_session_and_nothing_in_between(router, service, caesura):
    with ready_to_start(caesura, router.endpoint, FileSource(RECORDING, pace=20.0)) as standby:
        assert caesura.sessions(STATION) == []
        first = caesura.start(STATION, WIPE)
        assert (first.state, standby.status.description) == ("teaching", WIPE)
        eventually(lambda: known(caesura, first.session).batches > 3)
        assert caesura.stop(STATION, success=True).session == first.session
        status = known(caesura, first.session)
        assert (status.state, status.description) == ("closed", WIPE.model_copy(update={"success": True}))
        assert 0 < status.samples < len(RECORDING.t)

        second = caesura.start(STATION)
        eventually(lambda: standby.status.last_session == second.session)  # the recording ends by itself
        assert standby.status.outcome.endswith("the source has ended")
        for name in (
            None,
            second.session,
        ):  # its success would be lost: the refusal has the command that states it
            late = refused(
                lambda name=name: demonstration_control.stop(
                    caesura.transport, STATION, session=name, success=True
                )
            )
            assert late.message.endswith(f"sessions describe {STATION} {second.session} --success yes"), late
        assert known(caesura, second.session).samples == len(RECORDING.t), "from its beginning, and whole"
        assert standby.status.state == "ready"


def test_commands_that_come_twice_or_collide_begin_and_end_one_session(router, service, caesura):
    with ready_to_start(caesura, router.endpoint, FileSource(RECORDING, pace=SLOW)) as standby:
        first = demonstration_control.start(caesura.transport, STATION, WIPE, name="press-1")
        assert demonstration_control.start(caesura.transport, STATION, WIPE, name="press-1") == first
        late = refused(lambda: caesura.start(STATION))
        assert (late.code, "was started by Ann: stop it first" in late.message) == ("conflict", True)
        other = refused(
            lambda: demonstration_control.stop(caesura.transport, STATION, session="s-of-yesterday")
        )
        assert other.code == "unknown_session"
        assert standby.status.state == "teaching"
        assert caesura.stop(STATION).state == "ready"
        assert (
            demonstration_control.stop(caesura.transport, STATION, session=first.session).session
            == first.session
        )
        assert "no demonstration is being taught" in refused(lambda: caesura.stop(STATION)).message
        taken = refused(
            lambda: demonstration_control.start(caesura.transport, STATION, session=first.session)
        )
        assert taken.code == "conflict", "a name that is taken"
        reaches(standby, "ready")
        assert [one.session for one in caesura.sessions(STATION)] == [first.session]


def test_without_a_service_nothing_starts_and_what_was_taught_waits_for_it(router, tmp_path, caesura):
    service = ServiceProcess(tmp_path / "journal", router=router.endpoint)
    robot = FedSource()
    with standing_by(router.endpoint, robot, settings=AT_ONCE) as standby:
        reaches(standby, "ready")
        eventually(lambda: STATION in caesura.stations())  # what the bridge declares arrives in its order
        assert "no service is there" in refused(lambda: caesura.start(STATION)).message
        with running(service):
            eventually(lambda: caesura.services() != [])
            session = caesura.start(STATION, WIPE).session
            robot.give(samples(200))
            eventually(lambda: known(caesura, session).samples > 0)
        robot.give(samples(400, t0=0.2))  # the service is dead
        eventually(lambda: robot.read == 600)  # what is read after the stop is no part of the session
        stopping = ThreadPoolExecutor(1).submit(caesura.stop, STATION)
        eventually(lambda: "not stored yet" in (standby.status.problem or ""))
        assert standby.status.state == "stopping"
        with running(service):
            eventually(lambda: standby.status.last_session == session)
            status = known(caesura, session)
            assert (status.state, status.samples, status.gaps) == ("closed", 600, ())
            assert status.description == WIPE
        assert stopping.result(DEADLINE_S).session == session, "the answer waits for the service too"


def test_samples_from_before_the_start_are_no_part_of_the_session(router, service, caesura):
    robot = FedSource()
    with ready_to_start(caesura, router.endpoint, robot):
        robot.give(samples(500, t0=100.0))
        session = caesura.start(STATION).session
        robot.give(samples(300, t0=200.0))
        eventually(lambda: robot.read == 800)
        caesura.stop(STATION)
        robot.give(samples(100, t0=200.3))
        assert known(caesura, session).samples == 300
        times = caesura.samples(STATION, session, 0.0, 10.0)["px"][:, 0]
        assert times[0] == 0.0, "its clock begins with it"
        assert times[-1] < 0.3


def test_a_lost_source_ends_the_session_with_what_came_and_is_opened_again(
    router, service, caesura, monkeypatch
):
    monkeypatch.setattr("caesura_clients.bridge.sessions_on_demand.RECONNECT_S", 0.05)
    robot, mended = FedSource(), FedSource()
    with ready_to_start(caesura, router.endpoint, robot, mended) as standby:
        session = caesura.start(STATION).session
        robot.give(samples(300))
        robot.fail()
        eventually(lambda: standby.status.last_session == session)
        assert "the user stop is pressed" in standby.status.outcome
        assert (known(caesura, session).state, known(caesura, session).samples) == ("closed", 300)
        reaches(standby, "ready")
        second = caesura.start(STATION).session
        mended.give(samples(200))
        eventually(lambda: mended.read == 200)
        caesura.stop(STATION)
        assert known(caesura, second).samples == 200


def test_a_stop_counts_what_the_service_had_to_refuse(router, service, caesura):
    """The clock of a robot was set while it taught: all the rest was refused, and stop said "is over"."""
    robot, app = FedSource(), typer.Typer()
    register(app)
    with ready_to_start(caesura, router.endpoint, robot) as standby:
        session = caesura.start(STATION).session
        robot.give(samples(300, t0=4000.0))
        robot.give(samples(200, t0=400.0))
        eventually(lambda: robot.read == 500)
        stopped = CliRunner().invoke(app, ["stop", STATION, "--connect", router.endpoint])
        lost = known(caesura, session).lost
        assert lost > 0
        assert re.fullmatch(rf"is stored; {lost} of \d+ batches are lost", standby.status.outcome)
        assert demonstration_control.stop(caesura.transport, STATION, session=session).lost == lost
    assert stopped.exit_code == 0, "a pedal starts the next one where a stop fails"
    assert f"warning: {counted(lost, 'batch')} of it lost: `caesura sessions show {session}" in stopped.stderr


def test_a_source_that_delivers_nothing_does_not_keep_a_session_open(router, service, caesura):
    robot = FedSource()
    with ready_to_start(caesura, router.endpoint, robot):
        session = caesura.start(STATION).session
        robot.give(samples(100))
        eventually(lambda: robot.read == 100)
        caesura.stop(STATION)
        assert known(caesura, session).samples == 100
        robot.fail()  # or its thread waits for ever


def test_a_bridge_that_dies_leaves_a_session_that_the_next_one_closes(router, service, caesura, tmp_path):
    file = tmp_path / "taught.npz"
    RECORDING.save(file)
    command = [
        *CAESURA, "bridge", "--standby", "--connect", router.endpoint, "--station", STATION,
        "--source", "file", "--file", str(file), "--pace", str(SLOW),
    ]  # fmt: skip
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment()}
    with ExitStack() as stack:
        begun = [start(command, **quiet)]
        stack.callback(lambda: [one.kill() for one in begun])
        eventually(lambda: _starts(caesura))
        (session,) = [one.session for one in caesura.sessions(STATION)]
        eventually(lambda: known(caesura, session).samples > 0)
        begun[0].kill()
        begun[0].wait(DEADLINE_S)
        assert known(caesura, session).state == "open"
        begun.append(start(command, **quiet))
        eventually(lambda: known(caesura, session).state == "closed")
        assert known(caesura, session).refused == {}
        eventually(lambda: _starts(caesura))
        begun[1].terminate()
        assert begun[1].wait(DEADLINE_S) == 0
        assert {one.state for one in caesura.sessions(STATION)} == {"closed"}, "SIGTERM stores what is taught"


def test_an_operator_closes_what_a_bridge_that_is_gone_left_open(router, service, caesura, tmp_path):
    """No command did: the alert of a stale station went on for as long as the session was kept."""
    file = tmp_path / "taught.npz"
    RECORDING.save(file)
    app = typer.Typer()
    register(app)

    def stop(*words: str) -> Result:
        return CliRunner().invoke(app, ["stop", STATION, *words, "--connect", router.endpoint])

    source = ["--source", "file", "--file", str(file), "--pace", str(SLOW), "--session", "s1"]
    command = [*CAESURA, "bridge", "--connect", router.endpoint, "--station", STATION, *source]
    bridge = start(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment())
    with ExitStack() as stack:
        stack.callback(bridge.kill)
        eventually(lambda: caesura.sessions(STATION))
        eventually(lambda: known(caesura, "s1").samples > 0)
        refused = stop("--without-bridge")
        assert refused.stderr == f"error: a bridge is connected at {STATION}, which stops its own session\n"
        bridge.kill()
        bridge.wait(DEADLINE_S)
        eventually(lambda: "--without-bridge`" in stop().stderr)
        assert known(caesura, "s1").state == "open"
        assert stop("--without-bridge", "--success", "no").stdout == f"{STATION}/s1 is over\n"
        assert known(caesura, "s1").state == "closed"
        assert known(caesura, "s1").description.success is False
        assert known(caesura, "s1").lost == 0
    again = stop("--without-bridge")
    assert (again.exit_code, again.stderr) == (1, f"error: no session is open at {STATION}\n")


def _starts(caesura: Caesura) -> bool:
    try:
        caesura.start(STATION)
    except (Unreachable, ProtocolError):
        return False  # not ready yet
    return True


def test_a_station_has_one_bridge(router, service, caesura):
    with Bridge(caesura.transport, STATION, FileSource(RECORDING, pace=SLOW), settings=QUICK) as plain:
        plain.wait_open(DEADLINE_S)
        with ZenohTransport(router.endpoint, timeout_s=DEADLINE_S) as transport:
            second = Standby(transport, STATION, lambda: nullcontext(FedSource()), token_s=0.1)
            with pytest.raises(CaesuraError, match="a bridge is connected as cell-1 already"):
                second.run()
        plain.finish()


def test_a_session_of_another_bridge_is_not_disturbed(router, service, caesura):
    robot = FedSource()
    with standing_by(router.endpoint, robot) as standby:
        reaches(standby, "ready")
        eventually(lambda: standby._tidied)
        with Bridge(caesura.transport, STATION, FileSource(RECORDING, pace=SLOW), settings=QUICK) as plain:
            plain.wait_open(DEADLINE_S)
            why = refused(lambda: caesura.start(STATION))
            assert (why.code, why.value) == ("conflict", plain.session)
            assert known(caesura, plain.session).state == "open"
            plain.finish()
        assert _starts(caesura)
        caesura.stop(STATION)
        robot.fail()


def test_a_session_is_described_when_it_is_over(router, service, caesura):
    with ready_to_start(caesura, router.endpoint, FileSource(RECORDING, pace=20.0)) as standby:
        session = caesura.start(STATION, WIPE).session
        eventually(lambda: standby.status.state == "ready")
        caesura.describe(STATION, session, author="Bob", task="wipe the table", success=False)
        expected = Description(task="wipe the table", operator="Ann", tags=("left",), success=False)
        assert known(caesura, session).description == expected
        with pytest.raises(CaesuraError, match="task"):
            caesura.describe(STATION, session, author="Bob", task="x" * 121)
        assert known(caesura, session).description == expected


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        (None, "the bridge has not answered yet"),
        ({"state": "teaching"}, "the bridge has not ended the demonstration yet, it is teaching"),
        ({"state": "stopping"}, "the service has not stored the whole demonstration yet"),
        (
            {"state": "stopping", "problem": "not stored yet: no service answers"},
            "not stored yet: no service answers",
        ),
    ],
)
def test_a_stop_states_what_it_waits_for(stated, words):
    """Whatever it waited for, it stated that the service has not stored everything."""
    known = {"station": STATION, "bridge": "b", "source": "file", "session": "s1"}
    assert what_lasts(None if stated is None else BridgeStatus(**known, **stated)) == words


def test_the_command_line_starts_stops_describes_and_shows(router, service, caesura, monkeypatch):
    monkeypatch.setattr(start_stop_describe, "PATIENCE_S", 0.0)
    app = typer.Typer()
    register(app)

    def run(*words: str) -> Result:
        return CliRunner().invoke(app, [*words, "--connect", router.endpoint])

    with ready_to_start(caesura, router.endpoint, FileSource(RECORDING, pace=SLOW)) as standby:
        begun = run("start", STATION, "--task", "wipe", "--operator", "Ann", "--tag", "left")
        assert begun.exit_code == 0, begun.output
        session = standby.status.session
        assert begun.stdout == f"{STATION}/{session} is being taught\n"
        again = run("start", STATION)
        why = f"{STATION} has demonstration {session}, which was started by Ann: stop it first"
        assert (again.exit_code, again.stderr) == (1, f"error: {why}\n")
        other = run("stop", STATION, "--session", "s9")
        assert (
            other.stderr.splitlines()[-1] == f"error: {STATION} has no demonstration s9; there is {session}"
        )
        stopped = run("stop", STATION, "--success", "yes")
        assert stopped.stdout == f"{STATION}/{session} is over\n"
        known = [standby.status.model_copy(update={"state": state}) for state in get_args(BridgeState)]
        assert stopped.stderr in [f"{what_lasts(status)}: {WAITING}\n" for status in (None, *known)]
        assert run("stop", STATION).exit_code == 1, "so that a pedal starts then"
        changed = run("sessions", "describe", STATION, session, "--task", "wipe it", "--author", "Ann")
        assert changed.stdout == f"{STATION}/{session}: task changed\n"
        shown = run("sessions", "show", session, "--station", STATION)
        assert "task wipe it · operator Ann · success yes · tags left" in shown.stdout
        listed = json.loads(run("sessions", "list", "--station", STATION, "--json").stdout)
        assert [(one["task"], one["success"]) for one in listed] == [("wipe it", True)]
    nowhere = run("start", "cell-9")
    assert (nowhere.exit_code, "no bridge is connected at cell-9" in nowhere.stderr) == (1, True)


@pytest.mark.parametrize("words", [["--session", "s1"], ["--task", "wipe"], ["--marker"], ["--source", "x"]])
def test_a_bridge_in_standby_takes_no_options_of_one_session(words):
    app = typer.Typer()
    register(app)
    refusal = CliRunner().invoke(app, ["bridge", "--standby", *words])
    assert (refusal.exit_code, words[0] in refusal.output) == (2, True)


# --- the hand-guiding button -----------------------------------------------------------------------------


class ArmWithButton(FedSource):
    """A live source whose samples and button a test gives."""

    def __init__(self) -> None:
        super().__init__()
        self.button_pressed = False

    def guide(self, chunk: np.ndarray, *, pressed: bool) -> None:
        """Give a chunk, with the button as it is then; returns once it was taken."""
        self._pressed = pressed
        until = self.read + len(chunk)
        self.give(chunk)
        eventually(lambda: self.read == until)

    def chunks(self) -> Iterator[np.ndarray]:
        while (chunk := self._given.get()) is not None:
            self.button_pressed = self._pressed
            yield chunk
            self.read += len(chunk)


def positions(caesura: Caesura, session: str) -> np.ndarray:
    return caesura.samples(STATION, session, 0.0, 60.0)["px"][:, -1]


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_a_press_begins_a_demonstration_that_a_regrip_goes_on_with_and_a_release_ends(
    router, service, caesura, monkeypatch, name
):
    go, over = threading.Event(), threading.Event()
    phases = [(1.0, True), (1.0, False), (0.6, True), (0.8, False), (0.6, True), (3.0, False)]
    arm = GuidedArm(monkeypatch, name, phases, go, over)
    with ready_to_start(caesura, router.endpoint, arm, released_s=1.0) as standby, released(go, over):
        go.set()
        eventually(lambda: standby.status.last_session is not None)
        (session,) = [one.session for one in caesura.sessions(STATION)]
        status = known(caesura, session)
        assert (status.state, status.gaps, status.description) == ("closed", (), Description())
        assert standby.status.outcome.endswith("the button was released for 1 s, which are left out")
        assert standby.status.state == "ready"
    chunk = 0.02 * RATE_HZ[name]
    taught_s = (positions(caesura, session) - 0.4) / M_PER_STATE / RATE_HZ[name]
    lead, release = 2.0 - 0.5, 2.0 + 0.6 + 0.8 + 0.6
    assert taught_s[0] == pytest.approx(lead, abs=0.04), "the arm rests before the press"
    assert taught_s[-1] == pytest.approx(release, abs=0.04), "what comes after the release is left out"
    assert status.samples == pytest.approx((release - lead) * RATE_HZ[name], abs=2 * chunk)


@contextmanager
def released(*events: threading.Event) -> Iterator[None]:
    """Let the arm go at the end, whatever came before."""
    try:
        yield
    finally:
        for event in events:
            event.set()


def test_a_stop_ends_what_the_button_began_and_a_button_that_is_held_begins_nothing(router, service, caesura):
    arm = ArmWithButton()
    with ready_to_start(caesura, router.endpoint, arm, released_s=1.0) as standby:
        arm.guide(samples(100, t0=50.0), pressed=True)  # held before the bridge was there
        arm.guide(samples(700, t0=50.1), pressed=False)
        assert standby.status.state == "ready"
        arm.guide(samples(100, t0=50.8), pressed=True)
        reaches(standby, "teaching")
        first = standby.status.session
        arm.guide(samples(200, t0=50.9), pressed=False)
        assert caesura.stop(STATION, success=True).session == first
        status = known(caesura, first)
        assert (status.state, status.description.success) == ("closed", True)
        assert status.samples == 700 + 100 + 200, "a stop keeps what came since the release"
        arm.guide(samples(100, t0=51.1), pressed=True)
        reaches(standby, "teaching")
        second = standby.status.session
        caesura.stop(STATION)
        arm.guide(samples(100, t0=51.2), pressed=True)
        arm.guide(samples(100, t0=51.3), pressed=True)
        assert standby.status.state == "ready"
        assert {one.session for one in caesura.sessions(STATION)} == {first, second}
        arm.fail()


def test_a_stop_while_a_demonstration_is_opened_waits_and_ends_it(router, service, caesura):
    arm = ArmWithButton()
    with ready_to_start(caesura, router.endpoint, arm, released_s=1.0) as standby:
        for part in range(5):
            t = float(part)
            arm.guide(samples(100, t0=t), pressed=False)
            arm.guide(samples(100, t0=t + 0.1), pressed=True)
            eventually(lambda: standby.status.session)  # it is starting
            session = caesura.stop(STATION).session
            assert known(caesura, session).state == "closed"
        assert len(caesura.sessions(STATION)) == 5
        arm.fail()


def test_what_start_began_is_not_ended_by_the_button(router, service, caesura):
    arm = ArmWithButton()
    with ready_to_start(caesura, router.endpoint, arm, released_s=0.2) as standby:
        session = caesura.start(STATION, WIPE).session
        for part, pressed in enumerate((False, True, False)):
            arm.guide(samples(500, t0=0.5 * part), pressed=pressed)
        assert standby.status.state == "teaching"
        caesura.stop(STATION)
        assert known(caesura, session).samples == 1500
        arm.fail()


def test_a_press_without_a_service_begins_nothing_and_the_status_has_the_reason(router, tmp_path, caesura):
    arm = ArmWithButton()
    with standing_by(router.endpoint, arm, released_s=1.0) as standby:
        reaches(standby, "ready")
        arm.guide(samples(100, t0=0.0), pressed=False)
        arm.guide(samples(100, t0=0.1), pressed=True)
        eventually(lambda: "no service is there" in (standby.status.problem or ""))
        assert standby.status.problem.startswith("the button was pressed, and nothing began: ")
        assert (standby.status.state, standby.status.session) == ("ready", None)
        with running(ServiceProcess(tmp_path / "journal", router=router.endpoint)):
            eventually(lambda: caesura.services() != [])
            arm.guide(samples(600, t0=0.2), pressed=False)
            arm.guide(samples(100, t0=0.8), pressed=True)
            reaches(standby, "teaching")
            assert standby.status.problem is None
            session = standby.status.session
            caesura.stop(STATION)
            assert known(caesura, session).samples == 700
        arm.fail()


def test_a_source_without_a_button_is_refused_in_words(router, tmp_path):
    file = tmp_path / "taught.npz"
    RECORDING.save(file)
    app = typer.Typer()
    register(app)
    words = ["bridge", "--standby", "--start-by", "button", "--file", str(file), "--connect", router.endpoint]
    refusal = CliRunner().invoke(app, words)
    assert refusal.exit_code == 1
    assert "the source file reports no hand-guiding button; these do: franky, panda, ur" in refusal.output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--start-by", "button"], "add --standby"),
        (["--standby", "--released-s", "3"], "add --start-by button"),
    ],
)
def test_options_of_the_button_need_each_other(words, said):
    app = typer.Typer()
    register(app)
    refusal = CliRunner().invoke(app, ["bridge", *words])
    assert (refusal.exit_code, said in " ".join(refusal.output.split())) == (2, True)
