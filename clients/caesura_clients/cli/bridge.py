"""`caesura bridge`: sends the samples of a robot or a file to the service, for one session or in standby."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Annotated, Literal

import typer

from caesura_clients.bridge import Bridge, BridgeSettings, Source
from caesura_clients.bridge.guiding_button import RELEASED_S
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.bridge.sources.paced_source import parse_pace
from caesura_clients.bridge.sources.registry import ROBOTIQ_NAMES, SOURCES, SourceOptions, open_source
from caesura_clients.cli.connection_options import Config, Connect
from caesura_clients.cli.options import (
    ProgramOptions,
    Reading,
    connected,
    ended_by_sigterm,
    grouped,
    named,
    reported,
)
from caesura_clients.cli.preset_and_scenario_names import PRESET_NAMES, SCENARIO_NAMES
from caesura_clients.cli.result_tables import ignored_line, outcome_line, stored_whole
from caesura_clients.cli.service_availability_lines import AvailabilityLines
from caesura_clients.cli.standby_loop import stand_by
from caesura_clients.cli.start_stop_describe import DescriptionOptions
from caesura_clients.cli.stdin_markers import marking
from caesura_clients.client import Caesura
from caesura_clients.query import services, snapshots
from caesura_clients.service_liveliness import watch_services
from caesura_protocol.command_line_advice import at_command_line
from caesura_protocol.errors import CaesuraError, ProtocolError, Unreachable
from caesura_protocol.messages import Ack, SessionStatus
from caesura_protocol.number_words import counted
from caesura_protocol.session_time_display import SessionClock, clock_of
from caesura_protocol.transport.zenoh_transport import endpoint_of
from caesura_protocol.up_direction import APART_RAD, UP, tilt_between

DEFAULT_STATION = "cell-1"
MAX_EPOCH = (1 << 53) - 1
PATIENCE_S = 2.0  # until the command line says what it waits for
STUCK_S = 3.0  # in which the service asks for the same batch again, before the command line says so
LOOK_S = 0.5  # between two looks at that


@grouped
def bridge(
    *,
    station: Annotated[str, typer.Option(help="Teaching station.")] = DEFAULT_STATION,
    source: Annotated[str, typer.Option(help=f"Where samples come from: {', '.join(SOURCES)}.")] = "file",
    file: Annotated[
        Path | None, typer.Option(help="Recording to play: npz, csv, MCAP, or a rosbag2.")
    ] = None,
    mapping: Annotated[
        Path | None,
        typer.Option(help="Names and units of csv columns or topics of other software (docs/recordings.md)."),
    ] = None,
    host: Annotated[
        str | None, typer.Option(help="The robot's address, for franky, panda, ur and xarm.")
    ] = None,
    gripper: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help=f"Gripper with Robotiq's URCap, for ur: {', '.join(ROBOTIQ_NAMES)}."
        ),
    ] = None,
    no_gripper: Annotated[
        bool, typer.Option("--no-gripper", help="Do not read the gripper (Franka hand; Robotiq, for ur).")
    ] = False,
    tcp_offset: Annotated[
        str | None,
        typer.Option(
            metavar="POSE",
            help="Pose X,Y,Z,RX,RY,RZ of the TCP in the flange frame, for ur and xarm \\[m, rad].",
        ),
    ] = None,
    teach_mode: Annotated[
        bool,
        typer.Option(
            "--teach-mode",
            help="Switch the arm to hand guiding for the whole demonstration, for ur and xarm.",
        ),
    ] = False,
    ros: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Endpoint of the Zenoh router of ROS 2.")
    ] = None,
    session: Annotated[str | None, typer.Option(help="Session name; by default made from the time.")] = None,
    pace: Annotated[str, typer.Option(help="real, fast, or a multiple of real time.")] = "real",
    reading: Reading,
    scenario: Annotated[
        str | None, typer.Option(help=f"Scenario of the simulated teacher: {', '.join(SCENARIO_NAMES)}.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated teacher.")] = 0,
    preset: Annotated[
        str | None,
        typer.Option(help=f"Model, by default the service's preset: {', '.join(PRESET_NAMES)}."),
    ] = None,
    asked: ProgramOptions,
    epoch: Annotated[
        int,
        typer.Option(
            min=0,
            metavar="N",
            help="Continue --session after a restart: a number above that of the run before.",
        ),
    ] = 0,
    batch: Annotated[int, typer.Option(min=1, max=1000, metavar="N", help="Samples in a message.")] = 20,
    marker: Annotated[
        bool,
        typer.Option(
            "--marker", help="Each press of Enter, or of a pedal that types it, sets a changepoint."
        ),
    ] = False,
    standby: Annotated[
        bool, typer.Option("--standby", help="Wait for `caesura start` and `stop`, or the dashboard.")
    ] = False,
    start_by: Annotated[
        Literal["button"] | None,
        typer.Option(
            help="In standby a press of the robot's hand-guiding button starts a demonstration, too."
        ),
    ] = None,
    released_s: Annotated[
        float | None,
        typer.Option(
            min=0.2,
            max=30.0,
            metavar="S",
            help=f"Seconds after the release at which the demonstration ends. By default {RELEASED_S:g}.",
        ),
    ] = None,
    stated: DescriptionOptions,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Send one robot's samples to the service until Ctrl-C or SIGTERM ends the demonstration.

    The exit code is 1 if samples are lost.

    In standby it sends nothing until a demonstration is started, and waits for the next one after it.

    With --start-by button, a press of the robot's hand-guiding button starts a demonstration. It ends at
    Stop, or --released-s after the button was released. A press before that continues it.
    """
    options = SourceOptions(
        file=file,
        pace=_pace(pace),
        **reading._asdict(),
        scenario=scenario,
        seed=seed,
        robot=asked.robot,
        up=asked.up,
        mapping=mapping,
        host=host,
        gripper=not no_gripper,
        gripper_name=gripper,
        tcp_offset=tcp_offset,
        teach_mode=teach_mode,
        ros=ros or endpoint,
        config=config if ros is None else None,
    )
    if gripper and no_gripper:
        raise typer.BadParameter("state --gripper or --no-gripper", param_hint="--gripper")
    if epoch > MAX_EPOCH:
        raise typer.BadParameter(f"{epoch}, at most {MAX_EPOCH}", param_hint="--epoch")
    if epoch and session is None:
        raise typer.BadParameter("a session is continued by its name: add --session", param_hint="--epoch")
    if standby:
        _check_standby(source, session, marker, stated)
    if start_by and not standby:
        raise typer.BadParameter("it starts a bridge in standby: add --standby", param_hint="--start-by")
    if released_s is not None and not start_by:
        raise typer.BadParameter("of the button only: add --start-by button", param_hint="--released-s")
    with reported():
        named(station)
        named(session, "session")
        folder = Path(os.environ.get("STATE_DIRECTORY", "."))  # which systemd sets
        settings = BridgeSettings(batch_samples=batch, setting=asked.setting(), unstored_folder=folder)
        if source == "teacher" and tilt_between(settings.setting.up, UP) > APART_RAD:
            raise CaesuraError(f"--up is {asked.up}, and the simulated teacher's robot stands upright")
        if standby:
            with connected(endpoint, config, patient=True) as caesura:
                stand_by(
                    caesura,
                    station,
                    lambda: _opened_source(source, options),
                    source=source,
                    preset=preset,
                    settings=settings,
                    released_s=(RELEASED_S if released_s is None else released_s) if start_by else None,
                )
            return
        with (
            _opened_source(source, options) as samples,
            connected(endpoint, config, patient=True) as caesura,
            caesura.bridge(
                station,
                samples,
                session=session,
                epoch=epoch,
                preset=preset,
                settings=settings,
                description=stated.description(),
            ) as opened,
        ):
            typer.echo(f"{station}/{opened.session} through {endpoint_of(endpoint, config)}", err=True)
            service = AvailabilityLines(lambda: caesura.transport.has_router)
            with (
                watch_services(caesura.transport, service),
                reporting_storage(opened, lambda: service.is_gone),
                nullcontext() if samples.can_wait else reporting_pose(opened),  # a file names it at once
                reporting_up(opened),
                marking(opened) if marker else nullcontext(),
                ended_by_sigterm(),
            ):
                ack = _run(opened, caesura)
            for unmade in opened.unmarked:
                typer.echo(f"no {unmade}", err=True)
            typer.echo(f"{station}/{opened.session} closed, {counted(ack.next_seq, 'batch')}")
            _show_outcome(caesura, station, opened.session)


def _show_outcome(caesura: Caesura, station: str, session: str) -> None:
    """Print the outcome of a stored session; if the service does not answer, print the reason to stderr."""
    try:
        for one in snapshots(caesura.transport, station, session):
            _print_outcome(one.status, clock_of(one.segments.segments))
    except (Unreachable, ProtocolError) as error:
        typer.echo(f"its segments are not shown: {error}", err=True)


def _check_standby(source: str, session: str | None, marker: bool, stated: DescriptionOptions) -> None:
    """Refuse options of one session. Raises BadParameter."""
    if source not in SOURCES:
        raise typer.BadParameter(f"{source!r}, expected one of {', '.join(SOURCES)}", param_hint="--source")
    for name, given in (("session", session), ("marker", marker), *stated._asdict().items()):
        if given:
            why = (
                "in standby each start states it" if name != "marker" else "a bridge in standby reads no keys"
            )
            raise typer.BadParameter(why, param_hint=f"--{name}")


def _pace(text: str) -> float:
    try:
        return parse_pace(text)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--pace") from error


@contextmanager
def _opened_source(name: str, options: SourceOptions) -> Iterator[Source]:
    """Open a source for the duration of the context.

    Prints names of a file that are not read, assumptions and warnings on it, and dropped messages of a live
    source.
    """
    source = open_source(name, options)
    if isinstance(source, FileSource):
        recording = source.recording
        said = (
            ignored_line(recording),
            *(f"note: {one}" for one in recording.assumed),
            *(f"warning: {one}" for one in (*recording.cautions, *recording.doubts)),
        )
        for line in filter(None, said):
            typer.echo(at_command_line(line), err=True)
    with ExitStack() as stack:
        if (close := getattr(source, "close", None)) is not None:
            stack.callback(close)
        yield source
    if dropped := getattr(source, "dropped", 0):
        when = getattr(source, "lost_words", "")
        typer.echo(f"{name}: {counted(dropped, 'message')} came faster than they were taken{when}", err=True)


def _print_outcome(status: SessionStatus, clock: SessionClock) -> None:
    """Print a line on refusals, repeats and gaps of a session, if any; exit with 1 if batches are lost."""
    line = outcome_line(status, clock)
    if line:
        since = f"; {clock.words}" if status.gaps and clock.words else ""
        typer.echo(f"{status.station}/{status.session}: {line}{since}", err=True)
    if not stored_whole(status):
        raise typer.Exit(1)


@contextmanager
def reporting_storage(opened: Bridge, is_gone: Callable[[], bool] = lambda: False) -> Iterator[None]:
    """Print while the context lasts that the service cannot store samples, and when it can again.

    is_gone: returns whether no service is live; a recovery is then not printed.
    """
    over, is_stuck = threading.Event(), False
    kept = f"the newest {opened.settings.ring_samples} samples are kept here"

    def look() -> None:
        nonlocal is_stuck
        while not over.wait(LOOK_S):
            if not is_stuck and opened.stuck_s > STUCK_S:
                is_stuck = True
                typer.echo(
                    f"the service cannot store what comes; {kept}. `caesura doctor` says why", err=True
                )
            elif is_stuck and not opened.stuck_s and not is_gone():
                is_stuck = False
                typer.echo("the service stores again", err=True)

    with _beside(look, over, "storage"):
        yield


def reporting_pose(opened: Bridge) -> AbstractContextManager[None]:
    """Print once, while the context lasts, that the source reads its pose too seldom."""
    return _reporting(lambda: opened.slow_pose, "pose")


def reporting_up(opened: Bridge) -> AbstractContextManager[None]:
    """Print once, while the context lasts, that the service ignores which way is up."""
    return _reporting(lambda: opened.ignored_up, "up")


@contextmanager
def _reporting(warning: Callable[[], str | None], name: str) -> Iterator[None]:
    """Print a warning once, as soon as the function `warning` returns one, while the context lasts."""
    over = threading.Event()

    def look() -> None:
        while warning() is None and not over.wait(LOOK_S):
            pass
        if (words := warning()) is not None:
            typer.echo(f"warning: {words}", err=True)

    with _beside(look, over, name):
        yield


@contextmanager
def _beside(look: Callable[[], None], over: threading.Event, name: str) -> Iterator[None]:
    """Run `look` in a thread called `name` while the context lasts; re-raise its exception at the end.

    over: set at the end of the context, so that `look` returns.
    """
    with ThreadPoolExecutor(1, thread_name_prefix=name) as pool:
        looking = pool.submit(look)
        try:
            yield
        finally:
            over.set()
            looking.result()


def _run(opened: Bridge, caesura: Caesura) -> Ack:
    try:
        with suppress(Unreachable):
            opened.wait_open(PATIENCE_S)
        if not opened.is_open:
            typer.echo(_why_it_waits(caesura, opened), err=True)
        return opened.run()
    except KeyboardInterrupt:
        if not opened.sent:
            raise typer.Abort from None
        return opened.finish()


def _why_it_waits(caesura: Caesura, opened: Bridge) -> str:
    if opened.postponed is not None:
        return f"the service does not open {opened.station}/{opened.session} yet: {opened.postponed}"
    if services(caesura.transport):
        whose = f"are these the credentials of bridge.{opened.station}?"
        return f"a service is there, but answers nothing about {opened.station}: {whose} Trying on"
    return "no service answers yet, waiting for one"
