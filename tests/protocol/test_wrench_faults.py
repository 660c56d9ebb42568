"""A wrench that is frozen, all zero or without a zero is not used, and the reason is stated."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from caesura_protocol.formats.read import load_recording
from caesura_protocol.wrench_faults import FROZEN_S, CheckedMotion, read_wrench

Change = Callable[[np.ndarray], np.ndarray]

DATA = Path(__file__).resolve().parents[2] / "data"
PICK_AND_PLACE = DATA / "pick_and_place.npz"


def changed(path: Path, **changes: object) -> Path:
    """The recording with other arrays; a function makes one of the array that is there."""
    with np.load(PICK_AND_PLACE) as file:
        arrays = {name: file[name] for name in file.files}
    made = {name: change(arrays[name]) if callable(change) else change for name, change in changes.items()}
    np.savez(path, **arrays | made)
    return path


def frozen_from(row: int):
    return lambda values: np.concatenate([values[:row], np.tile(values[row], (len(values) - row, 1))])


def test_no_recording_of_the_repository_is_touched():
    for file in sorted(DATA.glob("*.npz")):
        found, stated = load_recording(file), load_recording(file, as_stated=True)
        assert found.cautions == (), file.name
        assert found.wrench_source == stated.wrench_source


def kept(values: np.ndarray) -> np.ndarray:
    return values


@pytest.mark.parametrize("torque", [frozen_from(4300), kept, np.zeros_like])
def test_a_force_that_freezes_is_named_and_not_used(tmp_path: Path, torque: Change):
    # A dead driver's last force was a load of 125 g, carried for 8 s.
    file = changed(tmp_path / "a.npz", force=frozen_from(4300), torque=torque)
    found = load_recording(file)
    assert found.wrench_source == "none"
    (caution,) = found.cautions
    for word in ("from 4.30 s to 12.80 s", "at most 0.5 s are plausible", "not used", "divide the recording"):
        assert word in caution
    assert load_recording(file, as_stated=True).wrench_source == "flange_sensor"
    believed = load_recording(file, force_unit="N")
    assert believed.wrench_source == "flange_sensor"
    assert "it is used as it is, because its unit is declared" in believed.cautions[0]


@pytest.mark.parametrize("axis", [0, 2])
def test_an_axis_that_freezes_is_named_and_the_force_is_not_used(tmp_path: Path, axis: int):
    def axis_frozen(force: np.ndarray) -> np.ndarray:
        force[6000:, axis] = force[6000, axis]
        return force

    found = load_recording(changed(tmp_path / "a.npz", force=axis_frozen))
    assert found.wrench_source == "none"
    (caution,) = found.cautions
    assert caution.startswith(f"Axis {'xyz'[axis]} of the force is exactly ")
    assert "from 6.00 s to 12.80 s" in caution
    believed = load_recording(tmp_path / "a.npz", force_unit="N")
    assert believed.wrench_source == "flange_sensor"
    assert "it is used as it is, because its unit is declared" in believed.cautions[0]


def stepped_and_noisy(step: float, noise: float) -> Change:
    """A sensor with steps, and with noise of its own before them."""
    rng = np.random.default_rng(0)
    return lambda force: step * np.round((force + noise * rng.standard_normal(force.shape)) / step)


def test_a_sensor_with_coarse_steps_that_freezes_is_not_used(tmp_path: Path):
    def freezes(force: np.ndarray) -> np.ndarray:
        return frozen_from(3000)(stepped_and_noisy(1.0, 0.5)(force))

    assert load_recording(changed(tmp_path / "a.npz", force=freezes)).wrench_source == "none"


@pytest.mark.parametrize("step", [0.2, 0.4])
def test_steps_that_recur_are_no_dead_driver(tmp_path: Path, step: float):
    found = load_recording(changed(tmp_path / "a.npz", force=stepped_and_noisy(step, 0.02)))
    assert found.wrench_source == "flange_sensor"


def test_a_gap_is_no_time_in_which_a_force_is_frozen():
    rng, t = np.random.default_rng(0), np.arange(2000) / 200.0
    t[1000:] += 3.0
    force = 0.2 * np.round(rng.normal(scale=0.05, size=(2000, 3)) / 0.2) + 1.0
    force[995:1005] = [1.2, 1.0, 2.0]
    signals = {"pos": np.column_stack([0.1 * t, 0 * t, 0 * t]), "force": force}
    assert read_wrench(t, signals, "flange_sensor").found == ()


def test_a_dead_axis_of_a_sensor_that_is_slower_than_the_file_is_found(tmp_path: Path):
    def slower(force: np.ndarray) -> np.ndarray:
        held = np.repeat(force[::10], 10, axis=0)[: len(force)]
        held[:, 2] = -1.5
        return held

    found = load_recording(changed(tmp_path / "a.npz", force=slower))
    assert found.wrench_source == "none"
    assert found.cautions[0].startswith("Axis z of the force is exactly -1.5 N")


def test_an_axis_that_a_sensor_does_not_have_is_named(tmp_path: Path):
    found = load_recording(changed(tmp_path / "a.npz", force=lambda force: force * [1.0, 0.0, 1.0]))
    assert found.wrench_source == "flange_sensor"
    assert found.cautions[0].startswith("Axis y of the force is exactly 0 N from 0.00 s to 12.80 s")
    assert found.cautions[0].endswith("contacts and loads along it are not seen.")


@pytest.mark.parametrize(
    ("torque", "word"),
    [(np.zeros_like, "The torque is 0 in every sample"), (frozen_from(1), "The torque is exactly (")],
)
def test_a_torque_that_does_not_change_is_left_out(tmp_path: Path, torque: Change, word: str):
    file = changed(tmp_path / "a.npz", torque=torque)
    found = load_recording(file)
    assert found.wrench_source == "flange_sensor"
    assert "torque" not in found.signals
    (caution,) = found.cautions
    assert caution.startswith(word)
    assert caution.endswith("it is left out.")
    assert "torque" in load_recording(file, as_stated=True).signals


@pytest.mark.parametrize("step", [0.05, 0.2])
def test_a_sensor_with_the_steps_of_real_ones_is_used_in_silence(tmp_path: Path, step: float):
    found = load_recording(changed(tmp_path / "a.npz", force=lambda force: step * np.round(force / step)))
    assert (found.wrench_source, found.cautions) == ("flange_sensor", ())


@pytest.mark.parametrize("step", [0.5, 1.0, 2.0])
def test_a_sensor_with_coarse_steps_is_used_and_they_are_named(tmp_path: Path, step: float):
    def stepped(values: np.ndarray) -> np.ndarray:
        return step * np.round(values / step) + 0.01

    found = load_recording(changed(tmp_path / "a.npz", force=stepped, torque=stepped))
    assert found.wrench_source == "flange_sensor"
    assert found.cautions[0].startswith(f"The force comes in steps of {step:g} N: a load is known to ")
    if step == 2.0:
        changes = np.flatnonzero(np.diff(found.signals["force"], axis=0).any(axis=1))
        assert np.diff(found.t[changes]).max() > FROZEN_S, "a value lasts as long as a dead driver's"


def test_a_dropout_is_named_and_the_rest_of_the_force_is_used(tmp_path: Path):
    def dropout(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values[:5000], np.tile(values[5000], (1000, 1)), values[6000:]])

    found = load_recording(changed(tmp_path / "a.npz", force=dropout, torque=dropout))
    assert found.wrench_source == "flange_sensor"
    (caution,) = found.cautions
    assert "from 5.00 s to 6.00 s" in caution
    assert "contacts and loads of that time may be wrong" in caution


def test_a_driver_that_dies_at_once_is_found_in_a_recording_of_two_forces(tmp_path: Path):
    file = changed(tmp_path / "a.npz", force=frozen_from(1), torque=frozen_from(1))
    assert load_recording(file).wrench_source == "none"


@pytest.mark.parametrize("torque", [np.zeros_like, kept])
def test_a_force_of_zeros_is_no_force(tmp_path: Path, torque: Change):
    found = load_recording(changed(tmp_path / "a.npz", force=np.zeros_like, torque=torque))
    assert found.wrench_source == "none"
    assert found.cautions == (
        "The force is 0 in every sample: it is read as no force; contact and load are off.",
    )


def test_zeros_in_free_space_are_those_of_a_simulation_and_named(tmp_path: Path):
    def noise_free(force: np.ndarray) -> np.ndarray:
        return np.where(np.linalg.norm(force, axis=1, keepdims=True) > 4.0, force, 0.0)

    found = load_recording(changed(tmp_path / "a.npz", force=noise_free))
    assert found.wrench_source == "flange_sensor"
    assert found.cautions[0].endswith("0 is taken as free space, as in a simulation without noise.")


def test_a_dead_band_is_named_with_what_it_hides(tmp_path: Path):
    def dead_band(force: np.ndarray) -> np.ndarray:
        return np.where(np.abs(force) < 1.0, 0.0, force)

    found = load_recording(changed(tmp_path / "a.npz", force=dead_band))
    assert found.wrench_source == "flange_sensor"
    assert (
        "the least that is not 0 is 1 N, and contacts and loads below that are not seen" in found.cautions[0]
    )


def test_a_recording_without_time_for_the_tare_has_no_contact(tmp_path: Path):
    # 0.3 s with the bias of a sensor, 15 N, were a contact with probability 0.99.
    with np.load(PICK_AND_PLACE) as file:
        short = {name: file[name][:300] if file[name].ndim else file[name] for name in file.files}
    np.savez(tmp_path / "a.npz", **short | {"force": short["force"] + [0.0, 0.0, 15.0]})
    found = load_recording(tmp_path / "a.npz")
    assert found.wrench_source == "none"
    assert found.cautions[0].startswith(
        "The force is not zeroed, so contact and free space are not distinguished"
    )
    assert "lasts 0.299 s, and its first 0.4 s are needed" in found.cautions[0]


@pytest.mark.parametrize(
    ("moved", "held_s", "found"), [(0.02, 0.6, True), (0.005, 0.6, False), (0.02, 0.4, False)]
)
def test_a_run_is_frozen_by_its_length_and_the_movement_in_it(moved: float, held_s: float, found: bool):
    rng, t = np.random.default_rng(0), np.arange(400) / 200
    share = np.clip((t - 0.5) / held_s, 0.0, 1.0)
    force = rng.normal(size=(400, 3))
    inside = (t >= 0.5) & (t <= 0.5 + held_s + 1e-9)
    force[inside] = [1.0, 2.0, 3.0]
    signals = {"pos": np.column_stack([moved * share, 0 * t, 0 * t])}
    assert bool(CheckedMotion.of(t, signals, "m").frozen(force)) == found
    millimetres = {"pos": 1000.0 * signals["pos"]}
    assert bool(CheckedMotion.of(t, millimetres, "mm").frozen(force)) == found
    assert held_s > FROZEN_S or not found


def test_joint_torques_are_read_alike():
    t = np.arange(400) / 200
    signals = {"q": np.column_stack([0.2 * t, *6 * [0 * t]]), "tau": np.ones((400, 7))}
    reading = read_wrench(t, signals, "joint_torque_estimate")
    assert reading.source == "none"
    assert "The joint torques are exactly (1, 1, 1, 1, 1, 1, 1) Nm from 0.00 s to 2.00 s" in reading.found[0]
    assert read_wrench(t, signals, "none").found == ()
