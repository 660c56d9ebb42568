"""Every fault, by name."""

from __future__ import annotations

from functools import partial

from faults.suite import killed, lines
from faults.suite.outcome import Fault
from faults.suite.relay import Line

FAULTS: tuple[Fault, ...] = (
    Fault("service-killed", killed.service_killed),
    Fault("router-killed", killed.router_killed),
    Fault("service-frozen", partial(killed.frozen, "service")),
    Fault("router-frozen", partial(killed.frozen, "router")),
    Fault("bad-line", lines.bad_line),
    Fault("messages-lost", partial(lines.bad_messages, Line(lost=0.05))),
    Fault("messages-doubled-and-late", partial(lines.bad_messages, Line(doubled=0.05, late=0.05))),
    Fault("messages-all-at-once", partial(lines.bad_messages, Line(lost=0.05, doubled=0.05, late=0.05))),
)
