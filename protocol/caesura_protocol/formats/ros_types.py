"""The types of the ROS 2 messages that are read, including those that rosbags lacks.

`franka_msgs` is that of version 1.0.0 (2025-01-22), as docs.ros.org has it for Humble and as the repository
frankaemika/franka_ros2 has it; its type hash is `FRANKA_HASH`. Later ones of Franka's add fields (the
accelerometers of Jazzy's), and a message of another version cannot be recognised by its bytes. A rosbag2 that
carries its own definitions is read by those, and a mapping may name the .msg file of another version.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

FRANKA_STATE = "franka_msgs/msg/FrankaRobotState"
JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
POSE = "geometry_msgs/msg/PoseStamped"
FRANKA_HASH = "RIHS01_fd225b337bab54d06047858c866442b98e3a882a4717cefc6ddd783fcbf17332"
READ = (FRANKA_STATE, WRENCH, JOINT_STATE, POSE)

_STATE = """
std_msgs/Header header
CollisionIndicators collision_indicators
sensor_msgs/JointState measured_joint_state
sensor_msgs/JointState desired_joint_state
sensor_msgs/JointState measured_joint_motor_state
float64[7] ddq_d
float64[7] dtau_j
sensor_msgs/JointState tau_ext_hat_filtered
Elbow elbow
geometry_msgs/WrenchStamped k_f_ext_hat_k
geometry_msgs/WrenchStamped o_f_ext_hat_k
geometry_msgs/InertiaStamped inertia_ee
geometry_msgs/InertiaStamped inertia_load
geometry_msgs/InertiaStamped inertia_total
geometry_msgs/PoseStamped o_t_ee
geometry_msgs/PoseStamped o_t_ee_d
geometry_msgs/PoseStamped o_t_ee_c
geometry_msgs/PoseStamped f_t_ee
geometry_msgs/PoseStamped ee_t_k
geometry_msgs/TwistStamped o_dp_ee_d
geometry_msgs/TwistStamped o_dp_ee_c
geometry_msgs/AccelStamped o_ddp_ee_c
float64 time
float64 control_command_success_rate
uint8 robot_mode
Errors current_errors
Errors last_motion_errors
"""
_COLLISIONS = "\n".join(
    [
        *(
            f"geometry_msgs/Vector3 is_cartesian_{kind}_{what}"
            for what in ("collision", "contact")
            for kind in ("linear", "angular")
        ),
        "float64[7] is_joint_collision",
        "float64[7] is_joint_contact",
    ]
)
_ELBOW = "\n".join(
    f"float64[2] {name}"
    for name in (
        "position",
        "desired_position",
        "commanded_position",
        "commanded_velocity",
        "commanded_acceleration",
    )
)
# In the order of the wire: a flag each.
_ERRORS = """
joint_position_limits_violation cartesian_position_limits_violation self_collision_avoidance_violation
joint_velocity_violation cartesian_velocity_violation force_control_safety_violation joint_reflex
cartesian_reflex max_goal_pose_deviation_violation max_path_pose_deviation_violation
cartesian_velocity_profile_safety_violation joint_position_motion_generator_start_pose_invalid
joint_motion_generator_position_limits_violation joint_motion_generator_velocity_limits_violation
joint_motion_generator_velocity_discontinuity joint_motion_generator_acceleration_discontinuity
cartesian_position_motion_generator_start_pose_invalid cartesian_motion_generator_elbow_limit_violation
cartesian_motion_generator_velocity_limits_violation cartesian_motion_generator_velocity_discontinuity
cartesian_motion_generator_acceleration_discontinuity cartesian_motion_generator_elbow_sign_inconsistent
cartesian_motion_generator_start_elbow_invalid cartesian_motion_generator_joint_position_limits_violation
cartesian_motion_generator_joint_velocity_limits_violation
cartesian_motion_generator_joint_velocity_discontinuity
cartesian_motion_generator_joint_acceleration_discontinuity cartesian_position_motion_generator_invalid_frame
force_controller_desired_force_tolerance_violation controller_torque_discontinuity
start_elbow_sign_inconsistent communication_constraints_violation power_limit_violation
joint_p2p_insufficient_torque_for_planning tau_j_range_violation instability_detected
"""
_DEFINITIONS = {
    FRANKA_STATE: _STATE,
    "franka_msgs/msg/CollisionIndicators": _COLLISIONS,
    "franka_msgs/msg/Elbow": _ELBOW,
    "franka_msgs/msg/Errors": "\n".join(f"bool {name}" for name in _ERRORS.split()),
}


def typestore(definitions: Iterable[tuple[str, str]] = ()) -> Typestore:
    """Return ROS 2's types and Franka's; definitions: (type, .msg text) that replace the built-in ones."""
    others = tuple(definitions)
    return _store(others) if others else _common()


@lru_cache(maxsize=1)
def _common() -> Typestore:
    return _store(())


def _store(others: tuple[tuple[str, str], ...]) -> Typestore:
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in ({**_DEFINITIONS, **dict(others)}).items():
        store.register(get_types_from_msg(text, name))
    return store


class CannotDecode(ValueError):  # noqa: N818 - reads better where it is caught
    """A payload does not match its type; the message states the difference."""


class Decoder:
    """Decodes CDR to messages."""

    def __init__(self, store: Typestore) -> None:
        self._store = store

    def read(self, name: str, payload: bytes, type_hash: str | None = None) -> Any:
        """Return a message. type_hash: the sender's hash of its definition, if known. Raises CannotDecode."""
        own = self._hash(name)
        if type_hash is not None and type_hash.startswith("RIHS01_") and type_hash != own:
            raise CannotDecode(
                f"{name} has another definition there ({type_hash}) than here ({own}): "
                "name its .msg file as definition in a mapping"
            )
        try:
            return self._store.deserialize_cdr(payload, name)
        except (SerdeError, ValueError, IndexError, AssertionError, UnicodeDecodeError) as error:
            raise CannotDecode(f"no CDR of {name} in {len(payload)} bytes ({error})") from error

    @lru_cache(maxsize=64)  # noqa: B019 - a decoder lives as long as its source
    def _hash(self, name: str) -> str:
        return self._store.hash_rihs01(name)


def decoder(definitions: Iterable[tuple[str, str]] = ()) -> Decoder:
    """Return a decoder for the types of `typestore`. Raises CannotDecode for an invalid definition."""
    try:
        return Decoder(typestore(definitions))
    except TypesysError as error:
        raise CannotDecode(f"no definition of a message: {error}") from error
