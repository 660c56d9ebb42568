"""The sources of the command line, by name. A source's dependency is imported at its first use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from math import isfinite
from pathlib import Path

from caesura_clients.bridge.sources import Source
from caesura_clients.bridge.sources.file import FileSource
from caesura_protocol.errors import SourceError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import ESTIMATE, HANDS_ON_ROBOT, WRENCH_SOURCES, HandOnRobot, WrenchSource
from caesura_protocol.package_version_and_extras import import_extra
from caesura_protocol.plausibility import WIRE_UNIT
from caesura_protocol.recording import declared_units
from caesura_protocol.robots import GripperDescription, RobotDescription, grippers, robot_description
from caesura_protocol.transport.zenoh_transport import endpoint_of
from caesura_protocol.validation_words import not_one_of

ROBOTIQ_NAMES = tuple(name for name, one in grippers().items() if one.interface == "robotiq")
GROUP = "caesura.sources"  # entry points, each a function of SourceOptions that returns a Source


@dataclass(frozen=True)
class SourceOptions:
    """Options of all kinds of source; each source reads those that apply to it."""

    file: Path | None = None
    pace: float = 1.0
    wrench_source: str | None = None
    length_unit: str | None = None
    scenario: str | None = None
    seed: int = 0
    robot: str | None = None  # which arm it is; that the simulated teacher guides
    mapping: Path | None = None
    host: str | None = None  # of the robot
    gripper: bool = True  # does it have one?
    gripper_name: str | None = None  # which, where the source reads more than one kind
    tcp_offset: str | None = None  # x,y,z,rx,ry,rz [m, rad] of the TCP on the flange
    teach_mode: bool = False  # the source lets go of the arm, so that it can be guided
    ros: str | None = None  # the Zenoh endpoint of ROS 2
    config: Path | None = None  # of Zenoh there
    hand_on_robot: str | None = None
    force_frame: str | None = None  # of a file, or of topics that do not state it
    time_unit: str | None = None
    angle_unit: str | None = None
    force_unit: str | None = None
    up: str | None = None  # of a file


def open_source(name: str, options: SourceOptions) -> Source:
    """Open a source by its name.

    Raises SourceError, which lists the names of all sources, or RecordingError.
    """
    build = SOURCES.get(name)
    if build is None:
        raise SourceError(f"no source {name!r}, expected one of {', '.join(SOURCES)}")
    if options.gripper_name is not None and build is not _ur and build in OWN_SOURCES.values():
        raise SourceError(f"gripper is {options.gripper_name!r}, which the source ur takes, not {name}")
    source = build(options)
    if build is _file:
        return source
    _check_frame(source, options.force_frame)
    return _with_declared_units(source, options)


def _check_frame(source: Source, stated: str | None) -> None:
    """Raise SourceError if the stated force frame differs from the one of a live source."""
    if stated not in {None, source.force_frame}:
        raise SourceError(
            f"force_frame is {stated!r}, expected {source.force_frame!r}, which the source states itself"
        )


def _with_declared_units(source: Source, options: SourceOptions) -> Source:
    """Return a live source with its declared units. Raises SourceError for units that it does not report."""
    declared = declared_units(
        length=options.length_unit,
        time=options.time_unit,
        angle=options.angle_unit,
        force=options.force_unit,
    )
    for quantity, unit in declared.items():
        reported = source.length_unit if quantity == "length" else WIRE_UNIT[quantity]
        if unit != reported:
            raise SourceError(
                f"{quantity}_unit is {unit!r}, expected {reported!r}: a live source is not converted"
            )
    if declared:
        source.declared_units = tuple(declared)  # type: ignore[attr-defined]
    return source


def _file(options: SourceOptions) -> Source:
    if options.file is None:
        raise SourceError("a source that plays a recording needs --file")
    recording = load_recording(
        options.file,
        wrench_source=options.wrench_source,
        hand_on_robot=options.hand_on_robot,
        force_frame=options.force_frame,
        length_unit=options.length_unit,
        time_unit=options.time_unit,
        angle_unit=options.angle_unit,
        force_unit=options.force_unit,
        up=options.up,
        robot=options.robot,
        mapping=options.mapping,
    )
    if recording.has_wrench and recording.wrench_source is None:
        raise SourceError(
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


def _ur(options: SourceOptions) -> Source:
    from caesura_clients.bridge.sources.ur_arm import open_ur  # noqa: PLC0415 - an extra

    robot = _stated_robot(options, "ur", "ur5e", "ur10e")
    return open_ur(
        _host(options, "ur"),
        robot,
        wrench_source=_wrench_source(options, robot),
        hand_on_robot=hand_statement(options),
        tcp_offset=_tcp_offset(options),
        teach_mode=options.teach_mode,
        gripper=_robotiq(options, robot) if options.gripper else None,
    )


def _robotiq(options: SourceOptions, robot: RobotDescription) -> GripperDescription | None:
    """Return the stated Robotiq gripper, or the one of the robot's description. Raises SourceError."""
    if options.gripper_name is not None:
        if options.gripper_name not in ROBOTIQ_NAMES:
            expected = f"expected one of {', '.join(ROBOTIQ_NAMES)}"
            raise SourceError(f"gripper is {options.gripper_name!r}, {expected}")
        return grippers()[options.gripper_name]
    of_robot = robot.gripper
    return of_robot if of_robot is not None and of_robot.interface == "robotiq" else None


def _xarm(options: SourceOptions) -> Source:
    from caesura_clients.bridge.sources.xarm_arm import open_xarm  # noqa: PLC0415 - an extra

    robot = _stated_robot(options, "xarm", "xarm7")
    return open_xarm(
        _host(options, "xarm"),
        robot,
        wrench_source=None if options.wrench_source is None else _wrench_source(options, robot),
        hand_on_robot=hand_statement(options),
        tcp_offset=_tcp_offset(options),
        teach_mode=options.teach_mode,
    )


def _stated_robot(options: SourceOptions, name: str, *examples: str) -> RobotDescription:
    if options.robot is None:
        raise SourceError(f"the source {name} needs --robot, such as {' or '.join(examples)}")
    return robot_description(options.robot)


def _wrench_source(options: SourceOptions, robot: RobotDescription) -> WrenchSource:
    """Return the wrench source that the options state, or else the one of the robot's description.

    A description's `flange_sensor_with_hand` becomes `flange_sensor` if the options state that no hand is on
    the robot. Raises SourceError for an unknown wrench source.
    """
    stated = options.wrench_source or robot.wrench_source
    if stated not in WRENCH_SOURCES:
        raise SourceError(not_one_of("wrench_source", stated, WRENCH_SOURCES))
    if (options.wrench_source, stated, options.hand_on_robot) == (None, "flange_sensor_with_hand", "no"):
        return "flange_sensor"
    return stated


def _tcp_offset(options: SourceOptions) -> tuple[float, ...] | None:
    if options.tcp_offset is None:
        return None
    try:
        values = tuple(float(part) for part in options.tcp_offset.split(","))
    except ValueError:
        values = ()
    if len(values) != 6 or not all(map(isfinite, values)):
        expected = "six numbers x,y,z,rx,ry,rz [m, rad], such as 0,0,0.1,0,0,0"
        raise SourceError(f"tcp_offset is {options.tcp_offset!r}, expected {expected}")
    return values


def _hand_on_estimate(options: SourceOptions, name: str) -> HandOnRobot:
    """Return the stated `hand_on_robot` of an arm that estimates its wrench; by default `yes`.

    Raises SourceError for an invalid value, and for a stated wrench source other than the estimate.
    """
    if options.wrench_source not in {None, ESTIMATE}:
        raise SourceError(
            f"wrench_source is {options.wrench_source!r}, expected {ESTIMATE}, which the source {name} has"
        )
    return hand_statement(options)


def hand_statement(options: SourceOptions) -> HandOnRobot:
    """Return the option `hand_on_robot`, by default `yes`. Raises SourceError for an invalid value."""
    stated = options.hand_on_robot or "yes"
    if stated not in HANDS_ON_ROBOT:
        raise SourceError(not_one_of("hand_on_robot", stated, HANDS_ON_ROBOT))
    return stated


def _host(options: SourceOptions, name: str) -> str:
    if not options.host:
        raise SourceError(f"the source {name} needs --host, the robot's address")
    return options.host


def _ros2(options: SourceOptions) -> Source:
    from caesura_protocol.formats.mapping_file_read import load_mapping  # noqa: PLC0415 - not every bridge needs it

    with import_extra("ros2", "the source ros2"):
        from caesura_clients.bridge.sources.ros2 import open_ros2  # noqa: PLC0415 - an extra
    mapped = None if options.mapping is None else load_mapping(options.mapping)
    endpoint = endpoint_of(options.ros, options.config)
    return open_ros2(
        endpoint,
        options.config,
        mapped,
        options.mapping,
        options.wrench_source,
        options.hand_on_robot,
        options.force_frame,
        options.robot,
    )


def _of_entry_point(entry_point: EntryPoint) -> Callable[[SourceOptions], Source]:
    """Return the opener of a source that another package registers; calling it imports the module."""

    def build(options: SourceOptions) -> Source:
        with import_extra(entry_point.name, f"the source {entry_point.name}"):
            opener: Callable[[SourceOptions], Source] = entry_point.load()
        return opener(options)

    return build


OWN_SOURCES: Mapping[str, Callable[[SourceOptions], Source]] = {
    "file": _file,
    "mcap": _file,
    "rosbag2": _file,
    "franky": _franky,
    "panda": _panda,
    "ur": _ur,
    "xarm": _xarm,
    "ros2": _ros2,
}
SOURCES: Mapping[str, Callable[[SourceOptions], Source]] = {
    **OWN_SOURCES,
    **{found.name: _of_entry_point(found) for found in entry_points(group=GROUP)},
}
