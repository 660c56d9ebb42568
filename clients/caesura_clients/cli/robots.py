"""`caesura robots`: which arms are known, and what is known of them."""

from __future__ import annotations

import json

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from caesura_clients.cli.connection_options import Json
from caesura_clients.cli.options import reported
from caesura_protocol.robots import RobotError, robot_description, robot_names

COLUMNS = ("robot", "arm", "joints", "reach [m]", "payload [kg]", "wrench from", "script")


def list_robots(as_json: Json = False) -> None:
    """List the robots that --robot takes, of this package, of others, and of the folder CAESURA_ROBOTS."""
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
