"""`caesura demo`: service, bridge and watcher on this machine; a simulated person teaches the robot."""

from __future__ import annotations

import math
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Annotated

import typer
from rich.console import Console
from rich.live import Live

from caesura_clients import Caesura, Update, connect
from caesura_clients.bridge.sources.registry import SourceOptions, open_source
from caesura_clients.cli.options import reported
from caesura_clients.cli.result_tables import program_view, segments_view
from caesura_lab.commands.segment import announce_compilation
from caesura_protocol.errors import NotFound
from caesura_protocol.messages import Ack
from caesura_service.app import Service
from caesura_service.config import ServiceConfig

STATION = "demo"
SESSION = "demo"
SILENCE_S = 30.0  # without any result, something is wrong


def demo(
    fast: Annotated[
        bool, typer.Option("--fast", help="Run as fast as possible instead of in real time.")
    ] = False,
    scenario: Annotated[
        str, typer.Option(help="Name of a scenario (`caesura teach --list`).")
    ] = "pick_and_place",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated person.")] = 0,
    robot: Annotated[
        str, typer.Option(help="The arm: a name listed by `caesura robots`, or the path of a robot.json.")
    ] = "panda",
) -> None:
    """Teach a simulated robot and watch segments and the task program appear."""
    console = Console()
    announce_compilation()
    source = SourceOptions(pace=math.inf if fast else 1.0, scenario=scenario, seed=seed, robot=robot)
    with (
        reported(),
        Service(ServiceConfig(listen="tcp/127.0.0.1:0")) as service,
        connect(service.endpoint) as reader,
        connect(service.endpoint) as robot_side,
        robot_side.bridge(STATION, open_source("teacher", source), session=SESSION) as bridge,
        ThreadPoolExecutor(1, "robot") as pool,
    ):
        console.print(
            f"service at {service.endpoint}; a simulated person teaches {scenario} at station {STATION}"
        )
        bridge_result = pool.submit(bridge.run)
        _watch(reader, bridge_result, console)
        bridge_result.result()
        console.print()
        console.print(program_view(reader.program(STATION)))


def _watch(reader: Caesura, bridge_result: Future[Ack], console: Console) -> None:
    """Show the session until it is closed; a bridge that fails ends the watching."""
    with Live("waiting for the first segment", console=console, refresh_per_second=10) as live:
        for update in reader.results(STATION, silence_s=SILENCE_S):
            live.update(segments_view(update.status, update.segments))
            if _is_over(update, bridge_result):
                return
    raise NotFound(f"no result for {SILENCE_S:g} s")


def _is_over(update: Update, bridge_result: Future[Ack]) -> bool:
    return update.closed or (bridge_result.done() and bridge_result.exception() is not None)
