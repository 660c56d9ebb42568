"""A rosbag2 that rosbags wrote goes in as the same data as npz, from both storages."""

from __future__ import annotations

import itertools
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from caesura_protocol.formats.read import load_recording
from caesura_protocol.formats.ros_types import (
    _DEFINITIONS,
    FRANKA_HASH,
    FRANKA_STATE,
    JOINT_STATE,
    POSE,
    WRENCH,
    typestore,
)
from caesura_protocol.recording import ASSUMED_FRAME, Recording, RecordingError
from caesura_service.offline_segmentation import segment_recording
from harness import ros
from harness.demonstrations import guided

STORAGES = ["mcap", "sqlite3"]
SENSOR = "flange_sensor"


@pytest.fixture(scope="module")
def demonstration() -> Recording:
    made = guided()
    return replace(made, t=ros.in_seconds(made))


def whole(recording: Recording) -> Recording:
    """With everything that a FrankaRobotState tells."""
    n, rng = recording.t.size, np.random.default_rng(3)
    turned = rng.standard_normal((n, 4)) * 0.01 + [1.0, 0.0, 0.0, 0.0]
    signals = {
        "pos": recording.signals["pos"],
        "quat": turned / np.linalg.norm(turned, axis=1, keepdims=True),
        "q": rng.uniform(-1, 1, (n, 7)),
        "force": recording.signals["force"],
        "torque": rng.uniform(-1, 1, (n, 3)),
        "tau": rng.uniform(-1, 1, (n, 7)),
    }
    return replace(recording, signals=signals, wrench_source="joint_torque_estimate")


def assert_same(found: Recording, expected: Recording) -> None:
    assert list(found.signals) == list(expected.signals)
    assert np.array_equal(found.t, expected.t)
    for name, values in expected.signals.items():
        assert np.array_equal(found.signals[name], values), name
    assert (found.wrench_source, found.force_frame) == (expected.wrench_source, expected.force_frame)


@pytest.mark.parametrize("storage", STORAGES)
def test_topics_of_their_own_give_the_segments_of_the_npz(demonstration, tmp_path, storage):
    bag = ros.write_bag(tmp_path / "bag", ros.sensor_topics(demonstration), storage)
    found = load_recording(bag, wrench_source=SENSOR)
    upright = np.tile([0.0, 0.0, 0.0, 1.0], (demonstration.t.size, 1))
    pos, force = demonstration.signals["pos"], demonstration.signals["force"]
    signals = {"pos": pos, "quat": upright, "force": force}
    expected = replace(demonstration, signals=signals)
    expected.save(tmp_path / "same.npz")
    assert_same(found, expected)
    assert found.ignored == ()
    assert found.cautions == ("The torque is 0 in every sample: it is left out.",)
    assert found.assumed == (
        "Topics are taken as those of one robot, by their types: pos, quat from /pose; force, torque from "
        "/ft/wrench. A mapping with [topics] names others.",
    )
    own, npz = segment_recording(found), segment_recording(load_recording(tmp_path / "same.npz"))
    assert own.segments == npz.segments
    assert own.changepoints == npz.changepoints
    (file,) = [path for path in bag.iterdir() if path.suffix in {".mcap", ".db3"}]
    assert_same(load_recording(file, wrench_source=SENSOR), found)


@pytest.mark.slow
@pytest.mark.parametrize("storage", STORAGES)
def test_a_franka_robot_state_has_every_signal(demonstration, tmp_path, storage):
    expected = whole(demonstration)
    bag = ros.write_bag(tmp_path / "bag", ros.franka_topic(expected), storage)
    found = load_recording(bag)
    assert_same(found, expected)
    assert segment_recording(found).segments == segment_recording(expected).segments


def test_a_mapping_states_that_no_hand_is_on_the_robot(demonstration, tmp_path):
    one_second = itertools.islice(ros.franka_topic(whole(demonstration)), 200)
    bag = ros.write_bag(tmp_path / "bag", one_second, STORAGES[0])
    mapping = tmp_path / "hand.toml"
    mapping.write_text('hand_on_robot = "no"\n')
    assert load_recording(bag).hand_on_robot == "unknown"
    assert load_recording(bag, mapping=mapping).hand_on_robot == "no"
    assert load_recording(bag, mapping=mapping, hand_on_robot="yes").hand_on_robot == "yes"
    assert segment_recording(load_recording(bag, mapping=mapping)).wrench.contact_models


def test_the_definition_of_franka_is_the_one_that_is_named():
    assert typestore().hash_rihs01(FRANKA_STATE) == FRANKA_HASH
    joint_state = typestore().hash_rihs01(JOINT_STATE)  # as rmw_zenoh's keys have it
    assert joint_state == "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"


def test_a_bag_with_another_version_of_franka_is_read_by_its_own_definition(demonstration, tmp_path):
    """Accelerometers beside the rest: bytes that the definition here cannot read."""
    text = _DEFINITIONS[FRANKA_STATE].replace("Elbow elbow", "float64[6] accelerometer_top\nElbow elbow")
    other = typestore([(FRANKA_STATE, text)])
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection("/state", FRANKA_STATE, typestore=other)
        for _, _, stamp, message in itertools.islice(ros.franka_topic(whole(demonstration)), 30):
            fields = {name: getattr(message, name, None) for name, _ in other.fielddefs[FRANKA_STATE][1]}
            newer = other.types[FRANKA_STATE](**{**fields, "accelerometer_top": np.arange(6.0)})
            bag.write(connection, stamp, other.serialize_cdr(newer, FRANKA_STATE))
    found = load_recording(tmp_path / "bag")
    assert np.array_equal(found.signals["pos"], demonstration.signals["pos"][:30])


def test_the_flange_is_where_the_effector_is_less_where_that_is_on_the_flange(tmp_path):
    """The hand as Franka's desk sets it: 0.1034 m along z, turned by −45° about it."""
    half = np.deg2rad(-45.0) / 2
    messages = []
    for i in range(3):
        message = ros.franka(
            ros.BEGAN_NS + i * 10**6, (0.5, 0.1, 0.2), (1, 0, 0, 0), [0] * 7, (12, 0, 0), (0, 0, 0.5), [0] * 7
        )
        ros.put_xyz(message.f_t_ee.pose.position, (0.0, 0.0, 0.1034))
        ros.put_xyz(message.f_t_ee.pose.orientation, (0.0, 0.0, np.sin(half), np.cos(half)))
        ros.put_xyz(message.ee_t_k.pose.position, (0.0, 0.0, 0.05))
        messages.append(("/state", FRANKA_STATE, 0, message))
    found = load_recording(ros.write_bag(tmp_path / "bag", messages, "mcap"))
    np.testing.assert_allclose(found.signals["pos"][0], [0.5, 0.1, 0.2 + 0.1034])  # the tool points down
    x, y, z, w = found.signals["quat"][0]
    np.testing.assert_allclose(abs(x * np.cos(half) - y * -np.sin(half)), 1.0, atol=1e-12)
    assert (z, w) == (0.0, 0.0)
    # The torque, which is reported about the stiffness frame, is moved to the flange: 0.1534 m above it.
    np.testing.assert_allclose(found.signals["torque"][0], [0.0, -12 * 0.1534, 0.5], atol=1e-12)


def mixed(demonstration: Recording, arm: tuple[str, ...] = ros.ARM) -> list[ros.Message]:
    """Joints at 200 Hz in another order with the fingers between them, and a wrench at half the rate."""
    found: list[ros.Message] = []
    for i, stamp in enumerate(ros.stamps(demonstration)[:200]):
        values = {arm[j]: i + j / 10 for j in (3, 1, 0, 2, 6, 5, 4)}
        fingers = dict.fromkeys(ros.FINGERS, 0.02)
        found.append(("/joint_states", JOINT_STATE, stamp, ros.joints(stamp, {**fingers, **values})))
        if i % 2 == 0:
            reported = ros.wrench(stamp, (i, 0, 0), frame="ft_link")
            found.append(("/wrench", WRENCH, stamp, reported))
    return found


def test_joints_come_in_their_order_and_a_slower_wrench_is_held(demonstration, tmp_path):
    mapping = tmp_path / "map.toml"
    mapping.write_text(
        'wrench_source = "flange_sensor"\nforce_frame = "flange"\nup = [0, 1, 0]\n'
        '[topics."/joint_states"]\n[topics."/wrench"]\nforce_of = "robot"\nsignals = ["force"]\n'
    )
    bag = ros.write_bag(tmp_path / "bag", mixed(demonstration), "mcap")
    found = load_recording(bag, mapping=mapping, angle_unit="rad")  # joints that count the samples
    assert list(found.signals) == ["q", "force", "gripper"]
    np.testing.assert_allclose(found.signals["q"][5], 5 + np.arange(7) / 10)
    assert found.signals["gripper"][:, 0].tolist() == [0.04] * 200
    assert found.signals["force"][4:8, 0].tolist() == [-4.0, -4.0, -6.0, -6.0]
    assert (found.wrench_source, found.force_frame) == ("flange_sensor", "flange")
    assert found.up == (0.0, 1.0, 0.0)
    with pytest.raises(
        RecordingError, match="State force_frame in a mapping or --force-frame: base or flange"
    ):
        load_recording(bag, wrench_source=SENSOR, angle_unit="rad")
    stated = load_recording(bag, wrench_source=SENSOR, angle_unit="rad", force_frame="flange")
    assert stated.force_frame == "flange"
    assert ASSUMED_FRAME not in stated.assumed


def test_a_signal_that_pauses_leaves_a_gap_and_is_not_made_up(demonstration, tmp_path):
    messages = [
        (topic, kind, stamp, message)
        for topic, kind, stamp, message in ros.sensor_topics(demonstration)
        if topic == "/pose" or not 1.0 < (stamp - ros.BEGAN_NS) / 1e9 < 3.0
    ]
    found = load_recording(ros.write_bag(tmp_path / "bag", messages, "mcap"), wrench_source=SENSOR)
    steps = np.diff(found.t)
    assert steps.max() == pytest.approx(1.5, abs=0.02)
    assert found.t[np.argmax(steps)] == pytest.approx(1.5, abs=0.01)


def two_arms(demonstration: Recording) -> list[ros.Message]:
    left, right = (tuple(f"{side}_joint{i}" for i in range(1, 8)) for side in ("left", "right"))
    stamp = ros.BEGAN_NS
    values = dict.fromkeys((*left, *right), 0.0)
    return [("/joint_states", JOINT_STATE, stamp, ros.joints(stamp, values))]


def twice(demonstration: Recording) -> list[ros.Message]:
    first = list(itertools.islice(ros.sensor_topics(demonstration), 8))
    return first + [(f"/left{topic}", kind, stamp, message) for topic, kind, stamp, message in first]


def without_stamps(demonstration: Recording) -> list[ros.Message]:
    return [("/pose", POSE, 0, ros.pose(0, (0, 0, 0)))]


def never_together(demonstration: Recording) -> list[ros.Message]:
    later = ros.BEGAN_NS + 10**10
    return [
        ("/pose", POSE, 0, ros.pose(ros.BEGAN_NS, (0, 0, 0))),
        ("/ft/wrench", WRENCH, 0, ros.wrench(later, (0, 0, 0))),
    ]


def in_a_frame_of_its_own(demonstration: Recording) -> list[ros.Message]:
    return [
        ("/pose", POSE, 0, ros.pose(ros.BEGAN_NS, (0, 0, 0))),
        ("/ft", WRENCH, 0, ros.wrench(ros.BEGAN_NS, (0, 0, 0), frame="ft_link")),
    ]


def an_arm_of_ur(_: Recording) -> list[ros.Message]:
    by_name = dict.fromkeys(("elbow_joint", "shoulder_lift_joint", "shoulder_pan_joint"), 0.5)
    return [("/joint_states", JOINT_STATE, 0, ros.joints(ros.BEGAN_NS, by_name))]


@pytest.mark.parametrize(
    ("messages", "source", "mapping", "message"),
    [
        (an_arm_of_ur, None, None, r"has elbow_joint, shoulder_lift_joint.*from the base on, as joints"),
        (ros.sensor_topics, None, None, r"/ft/wrench: where is this wrench measured\? State wrench_source"),
        (in_a_frame_of_its_own, SENSOR, None, r"is the frame 'ft_link' that of the flange"),
        (two_arms, SENSOR, None, r"not one arm's 1 to 7; it has left_joint1.*right_joint7.*as joints in a"),
        (twice, SENSOR, None, r"/ft/wrench and /left/ft/wrench both carry force"),
        (without_stamps, SENSOR, None, "/pose: its header has no time stamp"),
        (never_together, SENSOR, None, "no time at which all of .* have a value"),
        (ros.sensor_topics, SENSOR, '[topics."/ft"]', r"no topic '/ft'.*it has .*/pose \(geometry_msgs"),
        (
            ros.sensor_topics,
            SENSOR,
            '[topics."/ft/wrench"]',
            "no topic carries the pose or the joints of the robot",
        ),
        (ros.sensor_topics, SENSOR, '[topics."/pose"]\nforce = 1', r"unknown 'force', known: type, signals"),
        (
            two_arms,
            SENSOR,
            f'[topics."/joint_states"]\njoints = {[*"abcdefghi"]}',
            "joints has 9 names, expected 1 to 8",
        ),
    ],
)
def test_an_error_names_the_topic_and_what_there_is(
    demonstration, tmp_path, messages, source, mapping, message
):
    bag = ros.write_bag(tmp_path / "bag", messages(demonstration), "mcap")
    how = None
    if mapping is not None:
        how = tmp_path / "map.toml"
        how.write_text(mapping)
    with pytest.raises(RecordingError, match=message) as caught:
        load_recording(bag, wrench_source=source, mapping=how)
    assert "\n" not in str(caught.value)


def test_one_of_two_arms_is_named_by_its_joints(demonstration, tmp_path):
    how = tmp_path / "map.toml"
    names = [f"right_joint{i}" for i in range(1, 8)]
    how.write_text(f'[topics."/joint_states"]\njoints = {names}\n')
    bag = ros.write_bag(tmp_path / "bag", two_arms(demonstration), "sqlite3")
    found = load_recording(bag, mapping=how)
    assert list(found.signals) == ["q"]
    assert found.wrench_source == "none"


@pytest.mark.parametrize("storage", STORAGES)
def test_a_damaged_bag_is_one_line(demonstration, tmp_path, storage):
    bag = ros.write_bag(tmp_path / "bag", ros.sensor_topics(demonstration), storage)
    (file,) = [path for path in bag.iterdir() if path.suffix in {".mcap", ".db3"}]
    file.write_bytes(file.read_bytes()[:300])
    with pytest.raises(RecordingError, match="not a readable") as caught:
        load_recording(bag, wrench_source=SENSOR)
    assert "\n" not in str(caught.value)


def test_a_directory_that_is_no_bag_says_what_is_expected(tmp_path: Path):
    with pytest.raises(RecordingError, match=r"a directory without metadata.yaml, expected one of \.npz"):
        load_recording(tmp_path)


def test_a_gripper_is_read_beside_the_joints_of_two_arms_and_of_other_nodes(demonstration, tmp_path):
    how = tmp_path / "map.toml"
    how.write_text('[topics."/pose"]\n[topics."/joint_states"]\nsignals = ["gripper"]\n')
    (topic, kind, _, both) = two_arms(demonstration)[0]
    alone = ros.joints(ros.BEGAN_NS, dict.fromkeys(ros.FINGERS, 0.01))
    messages = [
        (topic, kind, 0, both),
        (topic, kind, 0, alone),
        ("/pose", POSE, 0, ros.pose(ros.BEGAN_NS, (0.1, 0.2, 0.3))),
    ]
    found = load_recording(ros.write_bag(tmp_path / "bag", messages, "mcap"), mapping=how)
    assert found.signals["gripper"].tolist() == [[0.02]]


UR_JOINTS = (
    "elbow_joint",
    "shoulder_lift_joint",
    "shoulder_pan_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)  # in the order in which UR's driver publishes them


@pytest.mark.parametrize("mapped", [False, True])
def test_joints_named_as_those_of_the_stated_robot_need_no_mapping(tmp_path, mapped):
    # `--robot ur5e` still asked for the joints, which its description names.
    arm = ros.joints(ros.BEGAN_NS, {name: (i + 1) / 10 for i, name in enumerate(UR_JOINTS)})
    alone = ros.joints(ros.BEGAN_NS, dict.fromkeys(ros.FINGERS, 0.01))
    messages = [("/joint_states", JOINT_STATE, 0, message) for message in (alone, arm)]
    bag = ros.write_bag(tmp_path / "bag", messages, "mcap")
    how = tmp_path / "map.toml"
    how.write_text('robot = "ur5e"\n')
    stated = {"mapping": how} if mapped else {"robot": "ur5e"}
    found = load_recording(bag, **stated)
    assert found.signals["q"].tolist() == [[0.3, 0.2, 0.1, 0.4, 0.5, 0.6]]
    assert found.setting.robot == "ur5e"


def test_joints_with_other_names_than_the_stated_robot_are_asked_for(tmp_path):
    messages = [("/joint_states", JOINT_STATE, 0, ros.joints(ros.BEGAN_NS, dict.fromkeys(UR_JOINTS, 0.5)))]
    bag = ros.write_bag(tmp_path / "bag", messages, "mcap")
    with pytest.raises(RecordingError, match="if its description has other names, name all of the arm"):
        load_recording(bag, robot="iiwa14")


def test_joints_that_are_named_may_come_between_those_of_other_nodes(tmp_path):
    how = tmp_path / "map.toml"
    how.write_text(f'[topics."/joint_states"]\njoints = {list(ros.ARM)}\n')
    arm = ros.joints(ros.BEGAN_NS, dict.fromkeys(ros.ARM, 0.5))
    alone = ros.joints(ros.BEGAN_NS, dict.fromkeys(ros.FINGERS, 0.01))
    messages = [("/joint_states", JOINT_STATE, 0, message) for message in (alone, arm)]
    found = load_recording(ros.write_bag(tmp_path / "bag", messages, "mcap"), mapping=how)
    assert found.signals["q"].tolist() == [[0.5] * 7]


def test_a_type_that_is_no_name_is_refused_before_anything_is_made_of_it(demonstration, tmp_path):
    """rosbags makes classes of what a bag calls its types, by compiling them."""
    bag = ros.write_bag(tmp_path / "bag", ros.sensor_topics(demonstration), "sqlite3")
    (file,) = bag.glob("*.db3")
    hostile = "a/msg/B:\n    import pathlib; pathlib.Path('taken').touch()\nclass C"
    with closing(sqlite3.connect(file)) as database, database:
        database.execute("UPDATE topics SET type = ?", (hostile,))
        database.execute("UPDATE message_definitions SET topic_type = ?", (hostile,))
    with pytest.raises(RecordingError, match=r"has the type .a/msg/B:.*expected package/msg/Name"):
        load_recording(file, wrench_source=SENSOR)


def test_a_simulator_of_the_other_sign_is_named_in_a_mapping(demonstration, tmp_path):
    messages = list(itertools.islice(ros.franka_topic(whole(demonstration)), 20))
    bag = ros.write_bag(tmp_path / "bag", messages, "mcap")
    how = tmp_path / "map.toml"
    how.write_text(f'[topics."{messages[0][0]}"]\nforce_of = "environment"\n')
    real, simulated = load_recording(bag), load_recording(bag, mapping=how)
    for name in ("force", "tau"):
        assert np.array_equal(real.signals[name], -simulated.signals[name])
        assert np.any(real.signals[name] != 0.0)


def test_two_robots_in_one_bag_are_combined_only_with_a_statement(demonstration, tmp_path):
    # The sensor of the right arm passed for the left arm's in silence.
    arms = {POSE: "/left", WRENCH: "/right"}
    messages = [(arms[kind] + topic, kind, *rest) for topic, kind, *rest in ros.sensor_topics(demonstration)]
    bag = ros.write_bag(tmp_path / "bag", messages, "mcap")
    (stated,) = load_recording(bag, wrench_source=SENSOR).assumed
    assert "pos, quat from /left/pose; force, torque from /right/ft/wrench" in stated
    mapping = tmp_path / "map.toml"
    mapping.write_text('[topics."/left/pose"]\n[topics."/right/ft/wrench"]\n', encoding="utf-8")
    assert load_recording(bag, wrench_source=SENSOR, mapping=mapping).assumed == ()


def test_a_slower_wrench_and_rows_without_one_are_stated(demonstration, tmp_path):
    slow, count = [], 0
    for message in ros.sensor_topics(demonstration):
        count += message[1] == WRENCH
        silent = message[1] == WRENCH and 300 < count < 500
        if message[1] == POSE or (count % 10 == 1 and not silent):
            slow.append(message)
    found = load_recording(ros.write_bag(tmp_path / "bag", slow, "mcap"), wrench_source=SENSOR)
    rows, poses = found.t.size, demonstration.t.size
    wrenches = sum(message[1] == WRENCH for message in slow)
    assert found.assumed[1:] == (
        f"force, torque of /ft/wrench have {wrenches} values where pos has {poses}: each is held until the "
        "next.",
        f"{poses - rows} of {poses} values of pos are left out: another signal has no value within 0.5 s "
        "before them.",
    )
    assert 0 < poses - rows < poses
