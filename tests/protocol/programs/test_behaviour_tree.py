"""The behaviour tree: well formed, and every node uses ports that its model declares."""

from __future__ import annotations

import math
from xml.etree import ElementTree as Xml

import pytest

from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App, AppPath, ViaPoint
from caesura_protocol.programs.apps_by_phase import Group
from caesura_protocol.programs.behaviour_tree import PORTS, action_name, behaviour_tree
from harness.programs import DOWN, app, as_file, move, pick_and_place, press, pressed_harder_before, wiped


def tree(apps: tuple[App, ...]) -> Xml.Element:
    return Xml.fromstring(behaviour_tree(as_file(apps, "a--b")))


@pytest.mark.parametrize("apps", [pick_and_place(), press()])
def test_it_is_one_sequence_of_version_4_with_an_action_an_app(apps: tuple[App, ...]) -> None:
    root = tree(apps)
    assert root.tag == "root"
    assert root.get("BTCPP_format") == "4"
    (behaviour,) = root.findall("BehaviorTree")
    assert root.get("main_tree_to_execute") == behaviour.get("ID")
    (sequence,) = list(behaviour)
    assert sequence.tag == "Sequence"
    actions = [node.tag for node in sequence if node.tag != "Sleep"]
    assert actions == [action_name(app.kind) for app in apps]


@pytest.mark.parametrize("apps", [pick_and_place(), press()])
def test_every_node_has_a_model_and_every_attribute_a_typed_port(apps: tuple[App, ...]) -> None:
    root = tree(apps)
    models = {
        model.get("ID"): {port.get("name"): port.get("type") for port in model.findall("input_port")}
        for model in root.findall("TreeNodesModel/Action")
    }
    models["Sleep"] = {"msec": "double"}  # which the library has
    for node in root.iterfind("BehaviorTree/Sequence/*"):
        ports = models[node.tag]
        for name, value in node.attrib.items():
            if name == "name":
                continue
            numbers = [float(part) for part in value.split(";")]
            assert (ports[name] == "double") == (len(numbers) == 1), (node.tag, name)


def test_what_an_app_does_not_say_is_left_out() -> None:
    (move, _, *_) = tree(press()).iterfind("BehaviorTree/Sequence/*")
    assert "joints" not in move.attrib
    assert move.attrib["target"] == "-0.02;-0.52;0.19"


def test_every_kind_of_app_has_ports() -> None:
    assert {port for facts in APP_KINDS.values() for port in facts.ports} == set(PORTS)


def test_the_limit_and_the_taught_rate_of_a_turn_stand_in_the_tree() -> None:
    half, turned = (-0.38268343, 0.92387953, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)
    start, via = (
        ViaPoint(t=t, position=(0.3, 0.0, 0.3), orientation=q) for t, q in ((0.0, DOWN), (1.0, half))
    )
    path = AppPath(
        start=start, via=(via,), tn=2.0, length_m=0.0, deviation_m=0.0, deviation_rad=0.0,
        tolerance_m=0.002, tolerance_rad=0.02,
    )  # fmt: skip
    moving = app("cartesian_motion", 0.0, 2.0, (0.3, 0.0, 0.3), orientation=turned, path=path)
    (node,) = tree((moving,)).iterfind("BehaviorTree/Sequence/*")
    assert node.attrib["max_turn"] == "2.5"
    rates = [float(one) for one in node.attrib["turning"].split(";")]
    assert rates[:3] == [0.0, 0.0, 0.0]
    assert rates[5] == pytest.approx(-0.785, rel=0.1)  # rad/s about the vertical, half way


def test_a_title_that_xml_cannot_have_is_written_without_it() -> None:
    first, *rest = pick_and_place()
    (node, *_) = tree((first.model_copy(update={"name": "a\ufffeb</Task>\uffff"}), *rest)).iterfind(
        "BehaviorTree/Sequence/*"
    )
    assert node.get("name") == "1 a\N{REPLACEMENT CHARACTER}b</Task>\N{REPLACEMENT CHARACTER}"


def test_a_title_names_the_position_too() -> None:
    first, *rest = pick_and_place()
    named = first.model_copy(update={"target_name": "above the tray"})
    (node, *_) = tree((named, *rest)).iterfind("BehaviorTree/Sequence/*")
    assert node.get("name") == "1 move to contact: above the tray"


def test_the_force_of_a_rest_beside_a_way_is_a_port() -> None:
    _, stroke = tree(pressed_harder_before()).iterfind("BehaviorTree/Sequence/*")
    assert (stroke.attrib["force_before"], stroke.attrib["force_after"]) == ("12", "5")
    _, even = tree(wiped()).iterfind("BehaviorTree/Sequence/*")
    assert "force_before" not in even.attrib


def test_an_app_that_goes_on_has_the_velocities_at_its_target() -> None:
    """Its action would have stopped there: nothing in the tree named them."""
    first = move(0.0, (0.4, 0.0, 0.3), (0.4, 0.1, 0.3))
    assert first.path is not None
    onward = {"end_velocity": (0.0, 0.1, 0.0), "end_angular_velocity": (0.0, 0.0, 0.2)}
    first = first.model_copy(update={"path": first.path.model_copy(update=onward)})
    one, two = tree((first, move(1.0, (0.4, 0.1, 0.3), (0.4, 0.2, 0.3)))).iterfind("BehaviorTree/Sequence/*")
    assert (one.attrib["end_velocity"], one.attrib["end_turning"]) == ("0;0.1;0", "0;0;0.2")
    assert "end_velocity" not in two.attrib


def test_velocities_at_a_target_are_left_out_where_no_app_goes_on_from_there() -> None:
    # After an edit the tree had them at the target of its last app: its action would have passed it.
    first = move(0.0, (0.4, 0.0, 0.3), (0.4, 0.1, 0.3))
    assert first.path is not None
    passed = first.path.model_copy(
        update={"end_velocity": (0.0, 0.1, 0.0), "end_angular_velocity": (0.0, 0.0, 0.2)}
    )
    first = first.model_copy(update={"path": passed})
    for later in ((), (move(2.0, (0.4, 0.1, 0.3), (0.4, 0.2, 0.3)),), (press()[0],)):
        node, *_ = tree((first, *later)).iterfind("BehaviorTree/Sequence/*")
        assert not {"end_velocity", "end_turning"} & set(node.attrib)


def test_a_path_has_its_tolerance() -> None:
    (node,) = tree((move(0.0, (0.4, 0.0, 0.3), (0.4, 0.1, 0.3)),)).iterfind("BehaviorTree/Sequence/*")
    assert (node.attrib["tolerance"], node.attrib["tolerance_turn"]) == ("0.002", "0.02")
    bare, *_ = tree(press()).iterfind("BehaviorTree/Sequence/*")
    assert "tolerance" not in bare.attrib


def test_places_are_stated_to_a_micrometre() -> None:
    place = (1.2345678, -1.0000015, 0.3)
    (node,) = tree((move(0.0, (0.4, 0.0, 0.3), place),)).iterfind("BehaviorTree/Sequence/*")
    assert [float(one) for one in node.attrib["target"].split(";")] == pytest.approx(place, abs=1e-6)


def test_a_program_without_an_app_is_refused() -> None:
    # BehaviorTree.CPP: "A Control node must have at least 1 child".
    with pytest.raises(ValueError, match="it has no app"):
        tree(())


def test_a_carry_that_sets_down_and_no_other_one_has_the_limits_of_a_search() -> None:
    touch, _, lift, carry, *_ = (
        one for one in tree(pick_and_place()).iterfind("BehaviorTree/Sequence/*") if one.tag != "Sleep"
    )
    for node in (touch, carry):
        limits = [node.attrib[name] for name in ("contact_force", "contact_speed", "search")]
        assert limits == ["4", "0.03", "0.04"]
    assert not {"contact_force", "contact_speed", "search"} & set(lift.attrib)


def test_fingers_have_the_force_and_the_speed_of_the_cell_within_those_of_the_gripper() -> None:
    def fingers(gripper: str | None) -> list[dict[str, str]]:
        program = as_file(pick_and_place()).model_copy(update={"gripper": gripper})
        root = Xml.fromstring(behaviour_tree(program))
        return [dict(node.attrib) for tag in ("Grasp", "GripperMove") for node in root.iterfind(f".//{tag}")]

    grasp, let_go = fingers(None)
    assert (grasp["grip_force"], grasp["grip_speed"], let_go["grip_speed"]) == ("20", "0.05", "0.05")
    assert "grip_force" not in let_go
    assert [one["grip_speed"] for one in fingers("robotiq_hand_e")] == ["0.05", "0.05"]
    assert not any("grip_speed" in one for one in fingers("suction"))
    assert fingers("unheard-of") == [grasp, let_go]  # a finding names it
    text = behaviour_tree(as_file(pick_and_place()).model_copy(update={"gripper": "robotiq_hand_e"}))
    assert "<!-- for the gripper Robotiq Hand-E -->" in text


def test_a_pause_that_was_taught_between_two_apps_is_kept_up_to_its_limit() -> None:
    # It was lost: the next action began at once, and nothing said so.
    apps = (move(0.0, (0.4, 0.0, 0.3), (0.4, 0.1, 0.3)), move(2.6, (0.4, 0.1, 0.3), (0.4, 0.0, 0.3)))
    assert [node.get("msec") for node in tree(apps).iterfind("BehaviorTree/Sequence/Sleep")] == ["1600"]
    later = (apps[0], move(50.0, (0.4, 0.1, 0.3), (0.4, 0.0, 0.3)))
    assert [node.get("msec") for node in tree(later).iterfind("BehaviorTree/Sequence/Sleep")] == ["10000"]


def test_the_robot_and_what_a_check_finds_are_comments() -> None:
    # A tree did not name the arm whose poses it has, nor what of the demonstration it leaves out.
    note = "Not observed: 1.00–1.20 s --- samples were lost."
    program = as_file(pick_and_place()).model_copy(update={"robot": "panda", "notes": (note,)})
    text = behaviour_tree(program)
    Xml.fromstring(text)
    assert "<!-- taught on the robot panda -->" in text
    assert "<!-- warning: Not observed: 1.00–1.20 s - - - samples were lost. -->" in text
    assert "no app opens the fingers before" in text.split("<Grasp")[0]
    assert "sets down" not in text, "that is how a script does it"


def test_a_group_is_a_sequence_of_its_apps_with_its_name() -> None:
    # The tree was one flat sequence: nothing in it said that three of its apps are one skill.
    name = 'wipe"/><Evil name="\ufffe--'
    groups = (Group(first=1, last=3, name=name, strokes=2), Group(first=5, last=5, name="retract"))
    program = as_file(pick_and_place()).model_copy(update={"groups": groups})
    root = Xml.fromstring(behaviour_tree(program))
    (sequence,) = root.iterfind("BehaviorTree/Sequence")
    found = [node for node in sequence if node.tag != "Sleep"]
    assert [node.tag for node in found] == ["MoveToContact", "Sequence", "GripperMove", "Sequence"]
    names = [node.get("name") for node in sequence.iterfind("Sequence")]
    shown = name.replace("\ufffe", "\N{REPLACEMENT CHARACTER}")
    assert names == [f"{shown}, 2 strokes taught: apps 2–4", "retract: app 6"]
    inside = [node.tag for node in found[1] if node.tag != "Sleep"]
    assert inside == ["Grasp", "Transport", "Transport"]
    assert not list(root.iter("Evil"))
    apps = [node.get("name") for node in sequence.iter() if node.tag not in {"Sequence", "Sleep"}]
    assert [title.split()[0] for title in apps if title is not None] == ["1", "2", "3", "4", "5", "6"]


def test_a_number_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ValueError, match=r"app 1 \(move\): target\.0 is nan"):
        tree((move(0.0, (0.4, 0.0, 0.3), (math.nan, 0.1, 0.3)),))
