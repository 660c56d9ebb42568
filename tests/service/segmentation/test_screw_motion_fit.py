"""A turn's axis, advance and torque, against derivations of their own: matrix logarithm, forces at points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import logm
from scipy.spatial.transform import Rotation

from caesura_protocol.recording import Recording
from caesura_protocol.screw_torque_and_text import exerted, torque_about_axis
from caesura_service.changepoint.preset import STEP_S
from caesura_service.segmentation.screw_motion_fit import Course, repeats, screw_of
from harness.segmentations import segmented

Array = NDArray[np.float64]
NEWTONS = np.array([3.0, -2.0, 12.0])


@dataclass(frozen=True)
class Helix:
    """A turn about an axis through a point, with its advance [m/rad]."""

    axis: Array
    point: Array
    advance: float
    angles: Array

    @property
    def turns(self) -> Rotation:
        """Of the base, since the start."""
        return Rotation.from_rotvec(np.outer(self.angles, self.axis))

    def course(self, start: Array, frame: Rotation, torques: Array | None = None) -> Course:
        """Its observations by a flange that starts at a place with a frame."""
        along = np.outer(self.advance * self.angles, self.axis)
        positions = self.point + self.turns.apply(start - self.point) + along
        orientations = (self.turns * frame).as_quat()
        forces = np.tile(NEWTONS, (len(positions), 1))
        return Course(positions, orientations, np.outer(self.angles, self.axis), forces, torques)


def helix(seed: int, *, most_rad: float) -> tuple[Helix, Array, Rotation]:
    """Draw a helix, and a flange's place and frame at its start."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    angles = np.linspace(0.0, most_rad, 31)
    one = Helix(axis / np.linalg.norm(axis), rng.normal(size=3), 1e-3 * rng.normal(), angles)
    return one, one.point + 0.1 * rng.normal(size=3), Rotation.random(rng=rng)


def moved(course: Course, base: Rotation, shift: Array, tool: Rotation) -> Course:
    """The same turn seen from another base, by a frame that is turned otherwise in the tool."""
    torques = None if course.torques is None else base.apply(course.torques)
    return Course(
        base.apply(course.positions) + shift,
        (base * Rotation.from_quat(course.orientations) * tool).as_quat(),
        base.apply(course.turned),
        base.apply(course.forces),
        torques,
    )


@pytest.mark.parametrize("seed", range(5))
def test_axis_point_and_advance_are_those_of_the_logarithm_of_the_pose(seed: int) -> None:
    one, start, frame = helix(seed, most_rad=2.4)
    course = one.course(start, frame)
    found = screw_of(course, pressed=False)
    assert found is not None

    poses = []
    for i in (0, -1):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_quat(course.orientations[i]).as_matrix()
        pose[:3, 3] = course.positions[i]
        poses.append(pose)
    twist = np.real(logm(poses[1] @ np.linalg.inv(poses[0])))
    w, v = np.array([twist[2, 1], twist[0, 2], twist[1, 0]]), twist[:3, 3]
    angle = np.linalg.norm(w)
    foot = np.cross(w, v) / angle**2  # of the axis, nearest to the base's origin
    axis = w / angle
    assert found.axis == pytest.approx(axis, abs=1e-9)
    assert found.angle == pytest.approx(angle, abs=1e-9)
    assert found.pitch_m == pytest.approx(2.0 * np.pi * (w @ v) / angle**2, abs=1e-9)
    assert np.cross(found.point - foot, axis) == pytest.approx(np.zeros(3), abs=1e-9)
    assert (start - found.point) @ axis == pytest.approx(0.0, abs=1e-9)


def test_more_than_a_whole_turn_is_counted() -> None:
    one, start, frame = helix(7, most_rad=9.0)
    found = screw_of(one.course(start, frame), pressed=False)
    assert found is not None
    assert found.angle == pytest.approx(9.0, abs=1e-9)
    assert found.pitch_m == pytest.approx(2.0 * np.pi * one.advance, abs=1e-9)


@pytest.mark.parametrize("pressed", [False, True])
def test_a_turn_with_noise_is_the_same_in_every_base_and_tool_frame(*, pressed: bool) -> None:
    one, start, frame = helix(3, most_rad=2.0)
    rng = np.random.default_rng(3)
    course = one.course(start, frame, rng.normal(size=(31, 3)))
    lean = Rotation.from_rotvec(0.02 * rng.normal(size=(31, 3)))
    course = course._replace(
        positions=course.positions + 1e-4 * rng.normal(size=(31, 3)),
        orientations=(lean * Rotation.from_quat(course.orientations)).as_quat(),
        forces=course.forces + rng.normal(size=(31, 3)),
    )
    base, shift, tool = Rotation.random(rng=rng), rng.normal(size=3), Rotation.random(rng=rng)
    here, there = (screw_of(seen, pressed=pressed) for seen in (course, moved(course, base, shift, tool)))
    assert here is not None
    assert there is not None
    assert there.axis == pytest.approx(base.apply(here.axis), abs=1e-9)
    assert there.point == pytest.approx(base.apply(here.point) + shift, abs=1e-9)
    assert there.torque == pytest.approx(base.apply(here.torque), abs=1e-9)
    assert (there.angle, there.pitch_m, there.pitch_sd_m) == pytest.approx(
        (here.angle, here.pitch_m, here.pitch_sd_m), abs=1e-9
    )


def test_another_point_of_the_tool_gives_the_same_turn_and_torque() -> None:
    one, start, frame = helix(11, most_rad=1.5)
    elsewhere = start + np.array([0.02, -0.07, 0.05])
    found = []
    for place in (start, elsewhere):
        bare = one.course(place, frame)
        found.append(screw_of(bare._replace(torques=torques_of(bare, one)), pressed=False))
    here, there = found
    assert here is not None
    assert there is not None
    across = np.eye(3) - np.outer(one.axis, one.axis)
    assert there.axis == pytest.approx(here.axis, abs=1e-9)
    assert there.pitch_m == pytest.approx(here.pitch_m, abs=1e-9)
    assert across @ there.point == pytest.approx(across @ here.point, abs=1e-9)
    assert torque_about_axis(there) == pytest.approx(torque_about_axis(here), abs=1e-9)


def torques_of(course: Course, one: Helix) -> Array:
    """About the flange, of three forces that turn with the tool; together they are `NEWTONS` in the base."""
    arms = one.point + np.array([[0.05, 0.0, 0.01], [-0.02, 0.04, 0.0], [0.0, -0.03, 0.02]])
    pulls = np.array([[4.0, 1.0, 0.0], [-3.0, 2.0, 5.0]])
    pulls = np.vstack([pulls, NEWTONS - pulls.sum(axis=0)])
    return np.array([np.cross(arms - place, pulls).sum(axis=0) for place in course.positions])


def test_the_torque_is_that_of_the_forces_about_a_point_of_the_axis() -> None:
    one, start, frame = helix(5, most_rad=2.0)
    bare = one.course(start, frame)
    found = screw_of(bare._replace(torques=torques_of(bare, one)), pressed=False)
    assert found is not None
    about_point = torques_of(bare._replace(positions=np.array([found.point])), one)[0]
    assert found.torque == pytest.approx(about_point, abs=1e-9)
    given = exerted(found)
    assert given is not None
    assert given.torque == pytest.approx(-about_point, abs=1e-9)


def test_a_torque_before_the_tool_turns_is_not_that_of_the_turn() -> None:
    """The rest before a turn may still hold the torque of the stroke before it."""
    one, start, frame = helix(6, most_rad=2.0)
    angles = np.concatenate([np.zeros(30), one.angles])
    course = Helix(one.axis, one.point, one.advance, angles).course(start, frame)
    held = np.where(np.arange(len(angles)) < 30, 1.4, -0.2)[:, None] * one.axis
    found = screw_of(course._replace(forces=np.zeros_like(course.forces), torques=held), pressed=False)
    assert found is not None
    assert found.torque == pytest.approx(-0.2 * one.axis, abs=1e-9)


def test_a_press_that_grows_during_the_turn_is_no_advance() -> None:
    """A screw of 1.5 mm on a spring of 50 kN/m: 9 N more are 0.18 mm, a third of what 120° lead."""
    angles = np.radians(np.linspace(0.0, 120.0, 31))
    axis = np.array([0.0, 0.0, -1.0])
    one = Helix(axis, np.array([0.4, 0.1, 0.1]), 0.0015 / (2.0 * np.pi), angles)
    course = one.course(np.array([0.4, 0.1, 0.2]), Rotation.identity())
    newtons = 6.0 + 9.0 * np.minimum(np.linspace(0.0, 3.0, 31), 1.0)
    pressed = course._replace(
        positions=course.positions + np.outer(newtons / 5e4, axis), forces=np.outer(newtons, -axis)
    )
    found = screw_of(pressed, pressed=True)
    assert found is not None
    assert found.pitch_m == pytest.approx(0.0015, rel=0.01)
    assert found.torque is None


def leaning_screw(seed: int) -> Course:
    """A screw of 1.5 mm driven by 120°, with a tool that leans by 1° and slips by 0.3 mm a radian.

    The lean wanders within half a radian, and so does what the tip's height is off, by 5 µm.
    """
    rng = np.random.default_rng(seed)
    angles = np.radians(np.linspace(0.0, 120.0, 33))
    lasting = np.exp(-np.abs(np.subtract.outer(angles, angles)) / 0.5)
    wander = np.linalg.cholesky(lasting + 1e-9 * np.eye(33)) @ rng.normal(size=(33, 3))
    lean = np.radians(1.0) * wander[:, :2]
    turns = Rotation.from_rotvec(np.column_stack([lean, 0.0 * angles])) * Rotation.from_rotvec(
        np.outer(angles, (0.0, 0.0, -1.0))
    )
    slip = np.outer(angles, 3e-4 * rng.normal(size=2))
    height = -0.0015 / (2.0 * np.pi) * angles + 5e-6 * wander[:, 2]
    positions = np.column_stack([slip, height]) + turns.apply((0.002, 0.001, 0.1034))
    steps = (turns[1:] * turns[:-1].inv()).as_rotvec()
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return Course(positions, turns.as_quat(), turned, np.tile((0.0, 0.0, 12.0), (33, 1)), None)


def test_the_deviation_of_the_advance_is_what_it_is_off_by() -> None:
    found = [screw_of(leaning_screw(seed), pressed=True) for seed in range(60)]
    off = np.array([(one.pitch_m - 0.0015) / one.pitch_sd_m for one in found if one is not None])
    assert len(off) == 60
    assert 0.7 < np.sqrt(np.mean(off**2)) < 1.4
    assert (np.abs(off) < 2.0).mean() > 0.9


def test_errors_that_last_count_as_fewer() -> None:
    assert repeats(np.array([1.0, -1.0, 1.0, -1.0])) == 1.0
    noise = np.random.default_rng(1).normal(size=4001)
    lasting = np.empty(4000)
    lasting[0] = noise[0]
    for i in range(1, 4000):
        lasting[i] = 0.6 * lasting[i - 1] + noise[i]
    assert repeats(lasting) == pytest.approx(1.6 / 0.4, rel=0.1)


def test_without_torques_there_is_none_and_a_small_turn_has_no_axis() -> None:
    one, start, frame = helix(2, most_rad=2.0)
    found = screw_of(one.course(start, frame), pressed=True)
    assert found is not None
    assert found.torque is None
    small, start, frame = helix(2, most_rad=0.05)
    assert screw_of(small.course(start, frame), pressed=False) is None


def screwing(*, torque: bool) -> Recording:
    """Touch a screw with 15 N, drive it by 120° against 0.9 Nm with 1.5 mm a turn, let go.

    100 Hz; the sensor has static 180 N and 2 Nm.
    """
    t = np.arange(0.0, 9.0, 0.01)
    rise, drive, off = (np.clip((t - at) / lasts, 0, 1) for at, lasts in ((2.5, 0.2), (3.5, 2.5), (7.0, 0.2)))
    share = 10 * drive**3 - 15 * drive**4 + 6 * drive**5
    way = np.clip((t - 1.0) / 1.5, 0, 1)
    down = 0.15 * (10 * way**3 - 15 * way**4 + 6 * way**5)
    up = np.clip((t - 7.0) / 1.5, 0, 1)
    lifted = 0.15 * (10 * up**3 - 15 * up**4 + 6 * up**5)
    angle = np.radians(120.0) * share
    position = np.column_stack([0.4 + 0 * t, 0 * t, 0.4 - down + lifted - 0.0015 * angle / (2 * np.pi)])
    rng = np.random.default_rng(1)
    newtons = 15.0 * (rise - off)
    turning = 0.9 * (newtons > 0) * np.clip(share / 0.05, 0, 1)
    turns = Rotation.from_rotvec(np.outer(-angle, [0, 0, 1.0])) * Rotation.from_rotvec([np.pi, 0, 0])
    force = np.column_stack([0 * t, 0 * t, newtons - 180.0]) + rng.normal(0, 0.1, (len(t), 3))
    signals = {"pos": position + rng.normal(0, 5e-6, (len(t), 3)), "quat": turns.as_quat(), "force": force}
    if torque:
        own = turns.apply([0.3, -2.0, 0.5])
        signals["torque"] = np.column_stack([0 * t, 0 * t, turning]) + own + rng.normal(0, 0.01, (len(t), 3))
    return Recording(t, signals, wrench_source="flange_sensor", hand_on_robot="yes")


def test_a_screw_that_is_driven_is_a_turning_with_axis_pitch_and_torque_and_so_is_its_app() -> None:
    view = segmented(screwing(torque=True))
    (turning,) = (one for one in view.segments if one.kind == "turning")
    assert turning.contact == "contact"
    screw = turning.screw
    assert screw is not None
    assert np.degrees(np.arccos(np.dot(screw.axis, (0.0, 0.0, -1.0)))) < 1.0
    assert screw.pitch_m == pytest.approx(0.0015, rel=0.03)
    assert screw.point[:2] == pytest.approx((0.4, 0.0), abs=1e-3)
    assert torque_about_axis(screw) == pytest.approx(-0.9, abs=0.03)

    (app,) = (one for one in view.apps if one.screw is not None)
    assert app.kind == "apply_force"
    assert torque_about_axis(app.screw) == pytest.approx(0.9, abs=0.03)
    assert app.path is not None


def test_without_torque_columns_segments_are_the_same_and_no_torque_is_shown() -> None:
    """A torque that sets in after the turn is evidence too: it may move a boundary by one observation."""
    with_torque, without = (segmented(screwing(torque=torque)) for torque in (True, False))
    assert [one.kind for one in without.segments] == [one.kind for one in with_torque.segments]
    begins = [one.t0 for one in without.segments]
    assert begins == pytest.approx([one.t0 for one in with_torque.segments], abs=STEP_S + 1e-9)
    screws = [one.screw for one in without.segments if one.screw is not None]
    assert screws
    assert {screw.torque for screw in screws} == {None}
    assert {one.screw.torque for one in without.apps if one.screw is not None} == {None}
