"""What a file is refused for names the file, the sample, the value, the limit and what to do."""

from __future__ import annotations

import os
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from caesura_protocol.formats import read
from caesura_protocol.formats.read import load_recording
from caesura_protocol.formats.write import write_csv
from caesura_protocol.recording import ASSUMED_FLAG, ASSUMED_FRAME, ASSUMED_ORDER, Recording, RecordingError

BEGAN = datetime(2026, 11, 24, 18, 4, 32, tzinfo=UTC)


def arrays(n: int = 200) -> dict[str, np.ndarray]:
    """A second of movement at 200 Hz, with every signal that is checked."""
    rng, t = np.random.default_rng(1), np.arange(n) / 200
    return {
        "t": t,
        "pos": np.column_stack([0.4 + 0.1 * t, 0.0 * t, 0.3 + 0.0 * t]),
        "quat": np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        "force": rng.normal(0.0, 0.1, (n, 3)),
        "torque": rng.normal(0.0, 0.01, (n, 3)),
        "gripper": np.full(n, 0.08),
        "wrench_source": np.array("flange_sensor"),
    }


def saved(path: Path, **changes: np.ndarray) -> Path:
    np.savez(path, **arrays() | changes)
    return path


def replaced(name: str, row: int, value: object) -> np.ndarray:
    values = arrays()[name].copy()
    values[row] = value
    return values


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"force": replaced("force", 12, [0.0, np.nan, 0.0])},
            ("sample 12: fy is nan, expected a finite number", "leave out the samples that have none"),
        ),
        (
            {"quat": replaced("quat", 7, [3.0, 0.0, 0.0, 0.0])},
            ("sample 7: quaternion has norm 3, expected 1 ± 0.1", "divide each quaternion by its norm"),
        ),
        (
            {"quat": replaced("quat", 7, 0.0)},
            ("sample 7: quaternion has norm 0, expected 1 ± 0.1", "leave out the samples that have no"),
        ),
        (
            {"t": np.concatenate([arrays()["t"][:150], arrays()["t"][:50]])},
            (
                "sample 150: time goes back from 0.745 s to 0 s, expected within 0.25 s",
                "divide the file there",
            ),
        ),
        (
            {"t": np.concatenate([arrays()["t"][:150], 1e9 + arrays()["t"][:50]])},
            (
                "sample 150: time leaps from 0.745 s to 1e+09 s, expected within 3600 s",
                "divide the file there",
            ),
        ),
        (
            {"force": arrays()["force"].T},
            ("force has shape (3, 200), expected (200, 3)", "it is transposed, write force.T"),
        ),
        (
            {"force": np.hstack([arrays()["force"], arrays()["torque"]]).T},
            ("force has shape (6, 200), expected (200, 3)", "force = wrench.T[:, :3]"),
        ),
        (
            {"pos": np.hstack([arrays()["pos"], arrays()["quat"]])},
            ("pos has shape (200, 7), expected (200, 3)", "pos = pose[:, :3]"),
        ),
        (
            {"force": arrays()["force"][:100]},
            ("force has shape (100, 3), expected (200, 3)", "one row for each of the 200 times"),
        ),
        (
            {"gripper": 1000.0 * arrays()["gripper"]},
            ("sample 0: gripper is 80, expected an opening [m] or a closed flag within ±1", "are they mm?"),
        ),
        (
            {"gripper": 100.0 * arrays()["gripper"]},
            ("sample 0: gripper is 8, expected an opening", "are they cm? Divide them by 100"),
        ),
        (
            {"gripper": np.linspace(0.63, 1.0, 200)},
            ("sample 0: gripper is 0.63, expected an opening of at most 0.3 m, or a flag", "a share of the"),
        ),
        (
            {"gripper": -arrays()["gripper"]},
            ("sample 0: gripper is -0.08, expected an opening of 0 m or more, or a closed flag",),
        ),
        (
            {"t": np.floor(arrays()["t"])},
            (
                "sample 1: t is 0, as in the sample before, and so it is in 199 of 200 samples",
                "expected a time of its own for each: write the fractions of a second too",
            ),
        ),
        (  # "samples are 1.2 s apart: probably in ms"
            {"t": np.random.default_rng(0).permutation(arrays()["t"])},
            ("samples are earlier than the one before; sort the samples by t", "of 200 samples"),
        ),
        (
            {"gripper": np.full(200, 228.0)},
            ("sample 0: gripper is 228, expected an opening", "counts of a gripper?"),
        ),
        (
            {"pos": arrays()["pos"] * (1.0 + 1.0j)},
            ("pos holds complex128, expected real numbers", "save its real part, pos.real"),
        ),
        ({"pos": arrays()["pos"].astype(str)}, ("pos holds <U", "save pos as float64")),
        (
            {"pos": arrays()["pos"].astype(object)},
            ("pos is an array of Python objects, which are never loaded", "save it as numbers"),
        ),
        ({"t": arrays()["t"][:, None]}, ("t has shape (200, 1), expected (n,)", "write t.ravel()")),
        (
            {"quat": np.tile(np.eye(3), (200, 1, 1))},
            ("quat has shape (200, 3, 3), expected (200, 4)", "Rotation.from_matrix(…).as_quat()"),
        ),
        (
            {"quat": arrays()["pos"]},
            ("quat has shape (200, 3), expected (200, 4)", "Rotation.from_euler or from_rotvec(…).as_quat()"),
        ),
        ({"wrench_source": np.array(["none", "none"])}, ("wrench_source has 2 values, expected one",)),
    ],
    ids=lambda one: ",".join(one) if isinstance(one, dict) else None,
)
@pytest.mark.filterwarnings("error")
def test_a_refusal_names_file_sample_value_limit_and_remedy(tmp_path: Path, changes, words):
    # Some had sample, value and limit, none a remedy; complex positions lost their imaginary part.
    with pytest.raises(RecordingError) as refused:
        load_recording(saved(tmp_path / "a.npz", **changes))
    for word in ("a.npz: ", *words):
        assert word in str(refused.value)


@pytest.mark.parametrize("step_s", [0.007, 0.2])
def test_samples_after_a_step_back_are_named(tmp_path: Path, step_s: float):
    # Samples were dropped, and what followed came earlier, without the place.
    t = np.where(np.arange(200) < 100, arrays()["t"], arrays()["t"] - step_s)
    found = load_recording(saved(tmp_path / "a.npz", t=t))
    dropped = int(np.sum(t[100:] <= t[99]))
    one = found.cautions[0]
    assert one.startswith(f"Sample 100: time goes back from 0.495 s to {t[100]:.6g} s. ")
    assert f" {dropped} {'sample is' if dropped == 1 else 'samples are'} left out " in one
    assert one.endswith("If a clock was set there, divide the file.")
    assert load_recording(saved(tmp_path / "b.npz")).cautions == ()


def test_a_step_back_of_a_time_of_day_is_shown_from_the_first_sample_on(tmp_path: Path):
    # It went "from 1.7e+09 s to 1.7e+09 s".
    t = np.where(np.arange(200) < 100, arrays()["t"], arrays()["t"] - 0.2) + 1.7e9
    (one,) = load_recording(saved(tmp_path / "a.npz", t=t)).cautions
    assert "time goes back from 0.495 s to 0.3 s" in one


def test_samples_that_are_written_twice_are_counted_and_not_refused(tmp_path: Path):
    doubled = {
        name: np.repeat(values, 2, axis=0) if values.ndim else values for name, values in arrays().items()
    }
    (one,) = load_recording(saved(tmp_path / "a.npz", **doubled)).cautions
    assert one.startswith("200 of 400 samples have the time of the one before, and are left out.")


def test_of_many_steps_back_some_are_named_and_the_rest_counted(tmp_path: Path):
    t = arrays()["t"].copy()
    t[10::20] -= 0.007
    found = load_recording(saved(tmp_path / "a.npz", t=t)).cautions
    assert [one.split(":")[0] for one in found[:3]] == ["Sample 10", "Sample 30", "Sample 50"]
    assert found[3:] == ("Time goes back 7 more times.",)


def text(**changes: np.ndarray) -> str:
    """The same as csv."""
    made = arrays() | changes
    found = Recording(
        made["t"],
        {name: made[name].reshape(200, -1) for name in ("pos", "quat", "force", "gripper")},
        wrench_source="flange_sensor",
    )
    lines = [f"# {key}: {value}" for key, value in found.stated_options.items()]
    rows = [",".join(map(repr, row)) for row in found.matrix().tolist()]
    return "\n".join([*lines, ",".join(found.columns), *rows]) + "\n"


def test_a_sample_of_a_csv_is_named_with_its_line(tmp_path: Path):
    content = text(quat=replaced("quat", 7, [3.0, 0.0, 0.0, 0.0]))
    (tmp_path / "a.csv").write_text(f"# a day\n\n{content}", encoding="utf-8")
    with pytest.raises(RecordingError, match=r"a\.csv: sample 7 \(line 14\): quaternion has norm 3"):
        load_recording(tmp_path / "a.csv")


def semicolons(content: str) -> str:
    return content.replace(",", ";").replace(".", ",")


@pytest.mark.parametrize(
    ("encoded", "assumed"),
    [
        (lambda content: content.encode("utf-8-sig"), ()),
        (lambda content: content.encode("utf-16"), ()),
        (lambda content: content.replace("\n", "\r\n").encode(), ()),
        (lambda content: content.replace("\n", ",\n").encode(), ()),
        (lambda content: content.replace(",", "\t").encode(), ()),
        (
            lambda content: semicolons(content).encode(),
            ("Columns are divided by ';', and the comma is the decimal mark.",),
        ),
    ],
    ids=["BOM", "UTF-16", "CRLF", "trailing", "tab", "semicolon"],
)
def test_what_a_table_program_makes_of_a_csv_is_the_same_recording(tmp_path: Path, encoded, assumed):
    (tmp_path / "plain.csv").write_text(text(), encoding="utf-8")
    (tmp_path / "a.csv").write_bytes(encoded(text()))
    plain, found = load_recording(tmp_path / "plain.csv"), load_recording(tmp_path / "a.csv")
    assert found.columns == plain.columns
    assert np.array_equal(found.matrix(), plain.matrix())
    assert found.wrench_source == "flange_sensor"
    assert (found.ignored, found.assumed) == ((), assumed)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"# M\xfcller\n" + text().encode(), ("line 1: byte 0xfc is not utf-8", "iconv -f latin1")),
        (text().encode("utf-16-le"), ("has zero bytes, expected a text", "iconv -f utf-16le")),
        (text().encode()[:-30], ("line 204 has", "still being written")),
        (text().replace(".", ",").encode(), ("values, expected 12", "Divide the columns by semicolons")),
    ],
    ids=["latin1", "UTF-16 without a mark", "cut", "comma and comma"],
)
def test_a_csv_that_is_no_table_is_refused_with_a_remedy(tmp_path: Path, content, words):
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(RecordingError) as refused:
        load_recording(tmp_path / "a.csv")
    for word in ("a.csv", *words):
        assert word in str(refused.value)


def dated(content: str, row: int | None = None, zone: str = "+00:00") -> str:
    """The times as dates; row: of the one that has no zone."""
    lines = content.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("t,")) + 1
    for i in range(first, len(lines)):
        t, _, rest = lines[i].partition(",")
        moment = (BEGAN + timedelta(seconds=float(t))).replace(tzinfo=None).isoformat()
        lines[i] = f"{moment}{'' if i - first == row else zone},{rest}"
    return "\n".join(lines)


@pytest.mark.parametrize("zone", ["Z", "+02:00", ""])
def test_dates_of_a_csv_are_seconds_from_the_first_and_stated(tmp_path: Path, zone: str):
    (tmp_path / "a.csv").write_text(dated(text(), zone=zone), encoding="utf-8")
    found = load_recording(tmp_path / "a.csv")
    np.testing.assert_allclose(found.t, arrays()["t"], atol=1e-9)
    assumed = "" if zone else ", taken as UTC"
    assert found.assumed == (
        f"Times are seconds from the first sample, which is at 2026-11-24T18:04:32{zone}{assumed}.",
    )
    utc = BEGAN.replace(tzinfo=UTC).timestamp() - (7200.0 if zone == "+02:00" else 0.0)
    assert found.began_s == pytest.approx(utc, abs=1e-6)
    with pytest.raises(RecordingError, match="--time-unit ms is for times that are numbers"):
        load_recording(tmp_path / "a.csv", time_unit="ms")


def test_dates_with_and_without_a_zone_are_refused(tmp_path: Path):
    (tmp_path / "a.csv").write_text(dated(text(), row=5), encoding="utf-8")
    with pytest.raises(RecordingError, match=r"line 10: t is '2026.*expected a time zone in all or in none"):
        load_recording(tmp_path / "a.csv")


@pytest.mark.parametrize(
    "values",
    [
        np.datetime64("2026-11-24T18:04:32") + (arrays()["t"] * 1e9).astype("timedelta64[ns]"),
        (arrays()["t"] * 1e6).astype("timedelta64[us]"),
    ],
    ids=["datetime64", "timedelta64"],
)
def test_times_of_numpy_are_seconds_from_the_first(tmp_path: Path, values: np.ndarray):
    # They were read as counts of their unit.
    found = load_recording(saved(tmp_path / "a.npz", t=values))
    np.testing.assert_allclose(found.t, arrays()["t"], atol=2e-9)
    assert any("Times are seconds from the first sample" in one for one in found.assumed)


def test_the_order_of_quaternions_is_stated_or_assumed(tmp_path: Path):
    turned = np.tile([0.1, 0.2, 0.3, np.sqrt(0.86)], (200, 1))
    assert ASSUMED_ORDER in load_recording(saved(tmp_path / "a.npz", quat=turned)).assumed
    swapped = turned[:, [3, 0, 1, 2]]
    stated = load_recording(saved(tmp_path / "b.npz", quat=swapped, quaternion_order=np.array("wxyz")))
    assert np.array_equal(stated.signals["quat"], turned)
    assert ASSUMED_ORDER not in stated.assumed
    stated.save(tmp_path / "c.npz")
    write_csv(tmp_path / "c.csv", stated)
    for copy in ("c.npz", "c.csv"):
        assert ASSUMED_ORDER not in load_recording(tmp_path / copy).assumed, "our own copy states it"
    with pytest.raises(RecordingError, match="quaternion_order is 'zyxw', expected one of xyzw, wxyz"):
        load_recording(saved(tmp_path / "d.npz", quaternion_order=np.array("zyxw")))


def test_a_file_that_grows_while_it_is_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    file = saved(tmp_path / "a.npz")
    plain = read.read_npz

    def growing(path: Path):
        found = plain(path)
        with path.open("ab") as stream:
            stream.write(b"more")
        return found

    monkeypatch.setattr(read, "read_npz", growing)
    size = os.path.getsize(file)
    with pytest.raises(
        RecordingError, match=f"went from {size} to {size + 4} bytes while it was read: it is being"
    ):
        load_recording(file)


def test_a_directory_names_what_it_has(tmp_path: Path):
    saved(tmp_path / "a.npz")
    with pytest.raises(RecordingError, match=r"without metadata\.yaml.*it has a\.npz: name one of them"):
        load_recording(tmp_path)
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").write_bytes(b"")
    with pytest.raises(
        RecordingError, match=r"without metadata\.yaml; a rosbag2 has it when its recording has ended"
    ):
        load_recording(tmp_path / "bag")


def test_a_pipe_is_refused_without_waiting_for_its_writer(tmp_path: Path):
    os.mkfifo(tmp_path / "a.csv")
    with pytest.raises(RecordingError, match=r"a\.csv: not a regular file: copy"):
        load_recording(tmp_path / "a.csv")


def test_the_frame_of_the_force_is_stated_or_assumed(tmp_path: Path):
    # A sensor's own force in the axes of the flange was read in the base frame without a word.
    assert ASSUMED_FRAME in load_recording(saved(tmp_path / "a.npz")).assumed
    for stated in ({"force_frame": np.array("base")}, {"force_base": np.zeros((200, 3))}):
        assert ASSUMED_FRAME not in load_recording(saved(tmp_path / "b.npz", **stated)).assumed
    load_recording(tmp_path / "a.npz").save(tmp_path / "c.npz")
    assert ASSUMED_FRAME in load_recording(tmp_path / "c.npz").assumed, "a copy states what was stated"
    stated = load_recording(tmp_path / "a.npz", force_frame="base")
    stated.save(tmp_path / "c.npz")
    assert ASSUMED_FRAME not in (*stated.assumed, *load_recording(tmp_path / "c.npz").assumed)


def test_a_frame_on_the_command_line_is_for_a_file_that_states_no_other(tmp_path: Path):
    turned = np.tile([0.0, 0.0, 0.0, 1.0], (200, 1))
    file = saved(tmp_path / "a.npz", quat=turned)
    assert load_recording(file, force_frame="flange").force_frame == "flange"
    stated = saved(tmp_path / "b.npz", quat=turned, force_frame=np.array("flange"))
    assert load_recording(stated, force_frame="flange").force_frame == "flange"
    with pytest.raises(RecordingError, match=r"--force-frame base does not fit b\.npz: it states flange"):
        load_recording(stated, force_frame="base")
    of_base = saved(tmp_path / "c.npz", quat=turned, force_base=np.zeros((200, 3)))
    with pytest.raises(RecordingError, match=r"--force-frame flange does not fit .* force_base is read"):
        load_recording(of_base, force_frame="flange")
    with pytest.raises(RecordingError, match="--force-frame is 'tool', expected one of base, flange"):
        load_recording(file, force_frame="tool")
    csv = tmp_path / "a.csv"
    csv.write_text("t,px,py,pz\n" + "".join(f"{0.01 * i},{0.001 * i},0,0\n" for i in range(200)))
    ignored = load_recording(csv, force_frame="flange").ignored
    assert "--force-frame flange, because there is no force" in ignored


def test_which_value_of_a_flag_is_closed_is_an_assumption(tmp_path: Path):
    # Much software has 1 for open: grasps were releases, and nothing was said of it.
    flag = (arrays()["t"] > 0.5).astype(float)
    assert ASSUMED_FLAG in load_recording(saved(tmp_path / "a.npz", gripper=flag)).assumed
    assert ASSUMED_FLAG not in load_recording(saved(tmp_path / "b.npz")).assumed
    assert ASSUMED_FLAG not in load_recording(saved(tmp_path / "c.npz", gripper=0.0 * flag)).assumed


def test_a_zero_of_an_opening_that_is_a_little_off_is_no_refusal(tmp_path: Path):
    opening = arrays()["gripper"] * (arrays()["t"] < 0.5) - 0.002
    assert load_recording(saved(tmp_path / "a.npz", gripper=opening)).signals["gripper"].min() == -0.002
