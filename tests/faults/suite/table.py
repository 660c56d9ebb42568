"""Every fault, by name."""

from __future__ import annotations

from functools import partial

from faults.suite import (
    bridges,
    clocks,
    connections,
    disks,
    edited,
    fuzz,
    histories,
    hostile,
    io_errors,
    killed,
    lines,
    losses,
    neighbours,
    readers,
    reference,
    rings,
    waits,
)
from faults.suite.outcome import Fault
from faults.suite.relay import Line

FAULTS: tuple[Fault, ...] = (
    Fault("none", reference.reference),
    Fault("service-killed", killed.service_killed),
    Fault("power-loss", losses.power_loss),
    Fault("io-errors", io_errors.io_errors),
    Fault("histories", histories.histories),
    Fault("edited-restart", edited.edited_restart),
    Fault("router-killed", killed.router_killed),
    Fault("service-frozen", partial(killed.frozen, "service")),
    Fault("router-frozen", partial(killed.frozen, "router")),
    Fault("bridges-killed", bridges.bridges_killed),
    Fault("ring-too-small", rings.ring_too_small),
    Fault("slow-dashboards", readers.slow_dashboards),
    Fault("disk-full", disks.disk_full),
    Fault("disk-unwritable", disks.disk_unwritable),
    Fault("journal-log-damaged", disks.log_damaged),
    Fault("journal-file-damaged", disks.file_damaged),
    Fault("journal-file-torn", disks.file_torn),
    Fault("robot-clocks-jump", clocks.robot_clocks),
    Fault("wall-clock-jumps", clocks.wall_clock),
    Fault("bad-line", lines.bad_line),
    Fault("messages-lost", partial(lines.bad_messages, Line(lost=0.05))),
    Fault("messages-doubled-and-late", partial(lines.bad_messages, Line(doubled=0.05, late=0.05))),
    Fault("messages-all-at-once", partial(lines.bad_messages, Line(lost=0.05, doubled=0.05, late=0.05))),
    *(Fault(f"robot-waits/{way}", partial(waits.robot_waits, way)) for way in waits.WAYS),
    Fault("silent-connections", connections.silent_connections),
    Fault("dense-station", partial(neighbours.hostile_station, "dense")),
    Fault("edit-storm", partial(neighbours.hostile_station, "edits")),
    Fault("message-flood", partial(neighbours.hostile_station, "messages")),
    Fault("message-flood-routed", partial(neighbours.hostile_station, "messages", behind_router=True)),
    Fault("command-flood", partial(neighbours.hostile_station, "commands")),
    Fault("command-flood-routed", partial(neighbours.hostile_station, "commands", behind_router=True)),
    Fault("query-flood", partial(neighbours.hostile_station, "queries")),
    Fault("query-flood-routed", partial(neighbours.hostile_station, "queries", behind_router=True)),
    Fault("token-flood", partial(neighbours.hostile_station, "tokens")),
    Fault("token-flood-routed", partial(neighbours.hostile_station, "tokens", behind_router=True)),
    Fault("hostile-inputs", fuzz.fuzz),
    Fault("hostile-columns", partial(hostile.hostile, "columns")),
    Fault("deep-nesting", partial(hostile.hostile, "nesting")),
)
