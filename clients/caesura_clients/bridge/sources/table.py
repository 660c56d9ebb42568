"""The sources of the command line, by name. A source's dependency is imported at its first use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from caesura_clients.bridge.sources import Source
from caesura_clients.bridge.sources.file import CHUNK_S, FileSource
from caesura_clients.bridge.sources.pacing import PacedSource
from caesura_clients.errors import BadSource
from caesura_clients.recording import declared_units, load_recording, needing
from caesura_clients.transport import endpoint_of
from caesura_protocol.distribution import installing
from caesura_protocol.messages import ESTIMATE, HANDS_ON_ROBOT, WRENCH_SOURCES, HandOnRobot
from caesura_protocol.plausibility import WIRE_UNIT

DEFAULT_SCENARIO = "pick_and_place"


@dataclass(frozen=True)
class SourceOptions:
    """What may be said about a source; each takes what it understands."""

    file: Path | None = None
    pace: float = 1.0
    wrench_source: str | None = None
    length_unit: str | None = None
    scenario: str | None = None
    seed: int = 0
    mapping: Path | None = None
    host: str | None = None  # of the robot
    gripper: bool = True  # does it have one?
    ros: str | None = None  # the Zenoh endpoint of ROS 2
    config: Path | None = None  # of Zenoh there
    hand_on_robot: str | None = None
    time_unit: str | None = None
    angle_unit: str | None = None
    force_unit: str | None = None


def open_source(name: str, options: SourceOptions) -> Source:
    """A source by its name. Raises BadSource, which names what there is, or RecordingError."""
    build = SOURCES.get(name)
    if build is None:
        raise BadSource(f"no source {name!r}, expected one of {', '.join(SOURCES)}")
    source = build(options)
    return source if build is _file else _with_declared_units(source, options)


def _with_declared_units(source: Source, options: SourceOptions) -> Source:
    """A live source whose units were declared. Raises BadSource for units that it does not report."""
    declared = declared_units(
        length=options.length_unit,
        time=options.time_unit,
        angle=options.angle_unit,
        force=options.force_unit,
    )
    for quantity, unit in declared.items():
        reported = source.length_unit if quantity == "length" else WIRE_UNIT[quantity]
        if unit != reported:
            raise BadSource(
                f"{quantity}_unit is {unit!r}, expected {reported!r}: a live source is not converted"
            )
    if declared:
        source.declared_units = tuple(declared)  # type: ignore[attr-defined]
    return source


def _file(options: SourceOptions) -> Source:
    if options.file is None:
        raise BadSource("a source that plays a recording needs --file")
    recording = load_recording(
        options.file,
        wrench_source=options.wrench_source,
        hand_on_robot=options.hand_on_robot,
        length_unit=options.length_unit,
        time_unit=options.time_unit,
        angle_unit=options.angle_unit,
        force_unit=options.force_unit,
        mapping=options.mapping,
    )
    if recording.has_wrench and recording.wrench_source is None:
        raise BadSource(
            f"{recording.name}: where is this wrench measured? State wrench_source in the file or "
            f"--wrench-source: {', '.join(WRENCH_SOURCES)}"
        )
    return FileSource(recording, pace=options.pace)


def _franky(options: SourceOptions) -> Source:
    from caesura_clients.bridge.sources.franky_arm import open_franky  # noqa: PLC0415 - an extra

    hand = _hand_on_estimate(options, "franky")
    return open_franky(_host(options, "franky"), gripper=options.gripper, hand_on_robot=hand)


def _panda(options: SourceOptions) -> Source:
    from caesura_clients.bridge.sources.panda_arm import open_panda  # noqa: PLC0415 - an extra

    hand = _hand_on_estimate(options, "panda")
    return open_panda(_host(options, "panda"), gripper=options.gripper, hand_on_robot=hand)


def _hand_on_estimate(options: SourceOptions, name: str) -> HandOnRobot:
    """The statement of the hand for an arm that estimates its wrench; these arms are guided by hand."""
    if options.wrench_source not in {None, ESTIMATE}:
        raise BadSource(
            f"wrench_source is {options.wrench_source!r}, expected {ESTIMATE}, which the source {name} has"
        )
    return _hand(options)


def _hand(options: SourceOptions) -> HandOnRobot:
    """Raises BadSource for a statement that is none."""
    stated = options.hand_on_robot or "yes"
    if stated not in HANDS_ON_ROBOT:
        raise BadSource(f"hand_on_robot is {stated!r}, expected one of {', '.join(HANDS_ON_ROBOT)}")
    return stated


def _host(options: SourceOptions, name: str) -> str:
    if not options.host:
        raise BadSource(f"the source {name} needs --host, the robot's address")
    return options.host


def _ros2(options: SourceOptions) -> Source:
    from caesura_clients.formats.mapping import load_mapping  # noqa: PLC0415 - not every bridge needs it

    with needing("ros2", "the source ros2"):
        from caesura_clients.bridge.sources.ros2 import open_ros2  # noqa: PLC0415 - an extra
    mapped = None if options.mapping is None else load_mapping(options.mapping)
    endpoint = endpoint_of(options.ros, options.config)
    return open_ros2(
        endpoint, options.config, mapped, options.mapping, options.wrench_source, options.hand_on_robot
    )


def _teacher(options: SourceOptions) -> Source:
    try:
        from caesura_clients.bridge.teacher.teaching import Teaching  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        raise BadSource(f"the source teacher needs {error.name}: {installing('teacher')}") from error
    source = options.wrench_source or "flange_sensor"
    if source not in WRENCH_SOURCES:
        raise BadSource(f"wrench source {source!r}, expected one of {', '.join(WRENCH_SOURCES)}")
    try:
        teaching = Teaching(options.scenario or DEFAULT_SCENARIO, seed=options.seed, wrench_source=source)
    except ValueError as error:
        raise BadSource(str(error)) from error
    return PacedSource(
        lambda: teaching.chunks(CHUNK_S),
        columns=teaching.columns,
        wrench_source=teaching.wrench_source,
        hand_on_robot=_hand(options),
        pace=options.pace,
    )


SOURCES: Mapping[str, Callable[[SourceOptions], Source]] = {
    "file": _file,
    "mcap": _file,
    "rosbag2": _file,
    "teacher": _teacher,
    "franky": _franky,
    "panda": _panda,
    "ros2": _ros2,
}
