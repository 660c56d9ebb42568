"""`caesura robots`: lists the known arms and grippers, and their properties."""

from __future__ import annotations

import json

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from caesura_clients.cli.connection_options import Json
from caesura_clients.cli.options import reported
from caesura_protocol.robots import RobotError, grippers, robot_description, robot_names

COLUMNS = ("robot", "arm", "joints", "reach [m]", "payload [kg]", "wrench from", "script")
GRIPPER_COLUMNS = ("gripper", "title", "opening [mm]", "force [N]", "interface")


def list_robots(as_json: Json = False) -> None:
    """List the names of robots for --robot, and of grippers for --gripper.

    Robots come from this package, from other installed packages, and from the folder CAESURA_ROBOTS.
    """
    with reported():
        names = robot_names()
    described = []
    for name in names:
        try:
            described.append(robot_description(name))
        except RobotError as error:
            typer.echo(f"{name}: {error}", err=True)
    if as_json:
        typer.echo(json.dumps([one.model_dump(mode="json") for one in described], indent=1))
        return
    table = Table(*map(escape, COLUMNS))
    for one in described:
        source = one.wrench_source.replace("_", " ")
        figures = (str(len(one.joints)), f"{one.reach_m:g}", f"{one.payload_kg:g}", source)
        table.add_row(one.name, one.title, *figures, one.script or "–")
    Console().print(table)
    table = Table(*map(escape, GRIPPER_COLUMNS))
    for name, gripper in grippers().items():
        opening = "–" if gripper.opening_m is None else f"{1000 * gripper.opening_m:g}"
        force = "–" if gripper.force_n is None else f"{gripper.force_n:g}"
        table.add_row(name, gripper.title, opening, force, gripper.interface or "–")
    Console().print(table)
