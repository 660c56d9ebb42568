"""The source `teacher`: a simulated person teaches a robot at the pace of a clock."""

from __future__ import annotations

from caesura_clients.bridge.sources import Source
from caesura_clients.bridge.sources.file import CHUNK_S
from caesura_clients.bridge.sources.paced_source import PacedSource
from caesura_clients.bridge.sources.registry import SourceOptions, hand_statement
from caesura_lab.teacher.simulated_teaching import SimulatedTeaching
from caesura_protocol.errors import SourceError
from caesura_protocol.messages import WRENCH_SOURCES

DEFAULT_SCENARIO = "pick_and_place"


def open_teacher(options: SourceOptions) -> Source:
    """Build the source from the options of the command line. Raises SourceError for a wrong value."""
    source = options.wrench_source or "flange_sensor"
    if source not in WRENCH_SOURCES:
        raise SourceError(f"wrench source {source!r}, expected one of {', '.join(WRENCH_SOURCES)}")
    try:
        teaching = SimulatedTeaching(
            options.scenario or DEFAULT_SCENARIO,
            seed=options.seed,
            wrench_source=source,
            robot=options.robot,
        )
    except ValueError as error:
        raise SourceError(str(error)) from error
    return PacedSource(
        lambda: teaching.chunks(CHUNK_S),
        columns=teaching.columns,
        wrench_source=teaching.wrench_source,
        hand_on_robot=hand_statement(options),
        pace=options.pace,
        setting=teaching.setting,
    )
