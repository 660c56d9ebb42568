"""A LeRobot dataset, read back by a reader written from the format's documentation, and by lerobot itself.

The reader takes every path from `info.json` and every range of frames from `meta/episodes`, as
huggingface.co/docs/lerobot/lerobot-dataset-v3 describes. It shares no code with the writer.
"""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from caesura_protocol.formats import lerobot_write
from caesura_protocol.formats.episode_frames import EpisodeError, EpisodeSource, episodes_of
from caesura_protocol.formats.lerobot_write import write_lerobot
from caesura_protocol.messages import Gap
from caesura_protocol.programs.safety import CellSettings
from caesura_protocol.recording import ASSUMED_FRAME, Recording
from caesura_service.offline_segmentation import segment_recording
from harness.demonstrations import guided

FPS = 100
LEROBOT = "CAESURA_LEROBOT_PYTHON"  # an interpreter that has lerobot 0.6


@dataclass
class Dataset:
    """What a reader of the format finds."""

    info: dict[str, Any]
    stats: dict[str, dict[str, list[float]]]
    episodes: list[dict[str, Any]]
    frames: list[dict[str, Any]]  # by episode: column → values

    def column(self, name: str) -> np.ndarray:
        return np.concatenate([np.asarray(frames[name], dtype=np.float64) for frames in self.frames])


def read(root: Path) -> Dataset:
    info = json.loads((root / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    rows = [
        row
        for file in sorted(root.glob("meta/episodes/*/*.parquet"))
        for row in pq.read_table(file).to_pylist()
    ]
    tasks = texts(root / "meta/tasks.parquet", "task")
    subtasks = texts(root / "meta/subtasks.parquet", "subtask")
    frames = []
    for number, row in enumerate(rows):
        path = info["data_path"].format(
            chunk_index=row["data/chunk_index"], file_index=row["data/file_index"]
        )
        table = pq.read_table(root / path)
        assert set(table.column_names) == set(info["features"])
        mine = table.filter(np.asarray(table["episode_index"]) == number).to_pydict()
        assert mine["index"] == list(range(row["dataset_from_index"], row["dataset_to_index"]))
        assert mine["frame_index"] == list(range(row["length"]))
        assert row["tasks"] == [tasks[mine["task_index"][0]]]
        frames.append(mine | {"subtask": [subtasks[index] for index in mine["subtask_index"]]})
    stats = json.loads((root / "meta/stats.json").read_text())
    assert info["total_frames"] == sum(row["length"] for row in rows)
    assert (info["total_episodes"], info["total_tasks"]) == (len(rows), len(tasks))
    return Dataset(info, stats, rows, frames)


def texts(path: Path, name: str) -> dict[int, str]:
    table = pq.read_table(path)
    assert json.loads(table.schema.metadata[b"pandas"])["index_columns"] == [name]
    return dict(zip(table[f"{name}_index"].to_pylist(), table[name].to_pylist(), strict=True))


def source(seed: int, session: str, **fields: Any) -> EpisodeSource:
    view = segment_recording(guided(seed))
    return EpisodeSource(
        station="cell-1",
        session=session,
        task=session,
        recording=with_gripper(seed),
        segments=tuple(view.segments),
        phases=tuple(view.phases),
        gaps=view.gaps,
        **fields,
    )


def with_gripper(seed: int) -> Recording:
    """Guided, with orientation, torque and a gripper that closes in the middle."""
    made = guided(seed)
    rng = np.random.default_rng(seed)
    turned = np.tile([0.0, 1.0, 0.0, 0.0], (made.t.size, 1)) + 0.01 * rng.standard_normal((made.t.size, 4))
    closed = np.where(made.t < made.t[-1] / 2, 0.04, 0.0)[:, None]
    torque = rng.standard_normal((made.t.size, 3))
    return replace(made, signals={**made.signals, "quat": turned, "gripper": closed, "torque": torque})


@pytest.fixture(scope="module")
def sources() -> list[EpisodeSource]:
    return [
        source(0, "press", success=True),
        source(1, "press again", success=False),
        source(2, "press", success=True),
    ]


@pytest.fixture(scope="module")
def root(sources: list[EpisodeSource], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("lerobot") / "demos"
    count = write_lerobot(path, episodes_of(sources))
    assert count == 3 * 540
    assert [one.name for one in path.parent.iterdir()] == ["demos"]
    return path


@pytest.fixture(scope="module")
def dataset(root: Path) -> Dataset:
    return read(root)


def test_every_frame_is_the_sample_of_its_time(sources, dataset):
    assert dataset.info["fps"] == FPS
    for one, frames in zip(sources, dataset.frames, strict=True):
        signals = {name: values[::2] for name, values in one.recording.signals.items()}  # 200 Hz
        signals["quat"] = signals["quat"] / np.linalg.norm(signals["quat"], axis=1, keepdims=True)
        state = np.hstack([signals[name] for name in ("pos", "quat", "gripper")])
        wrench = np.hstack([signals["force"], signals["torque"]])
        np.testing.assert_allclose(frames["observation.wrench"], wrench, rtol=0, atol=1e-6)
        np.testing.assert_allclose(frames["observation.state"], state, rtol=0, atol=1e-6)
        np.testing.assert_array_equal(frames["action"][:-1], frames["observation.state"][1:])
        assert frames["action"][-1] == frames["observation.state"][-1]
        np.testing.assert_allclose(frames["timestamp"], np.arange(540) / FPS, rtol=1e-6)
    assert dataset.info["features"]["observation.state"]["names"] == [
        "px",
        "py",
        "pz",
        "qx",
        "qy",
        "qz",
        "qw",
        "gripper",
    ]
    wrench = dataset.info["features"]["observation.wrench"]
    assert wrench["names"] == ["fx", "fy", "fz", "mx", "my", "mz"]
    assert wrench["info"]["source"] == "flange_sensor"


def test_sub_tasks_begin_within_half_a_frame_of_their_segments(sources, dataset):
    for one, frames in zip(sources, dataset.frames, strict=True):
        persistent = frames["language_persistent"]
        assert persistent.count(persistent[0]) == len(persistent)  # the same at every frame
        rows = persistent[0]
        assert {row["style"] for row in rows} == {"subtask"}
        starts = [0.0, *(segment.t0 - one.recording.t[0] for segment in one.segments[1:])]
        assert len(rows) == len(starts) >= 5
        np.testing.assert_allclose([row["timestamp"] for row in rows], starts, rtol=0, atol=0.5 / FPS + 1e-6)
        for t, text in zip(frames["timestamp"], frames["subtask"], strict=True):
            active = [row for row in rows if row["timestamp"] <= t][-1]
            assert text == active["content"]
    assert {"move", "press", "rest"} <= {text for frames in dataset.frames for text in frames["subtask"]}


def test_at_a_rate_that_meets_no_boundary_sub_tasks_begin_at_the_nearest_frame(sources):
    for one, episode in zip(sources, episodes_of(sources, fps=7), strict=True):
        starts = [0.0, *(segment.t0 - one.recording.t[0] for segment in one.segments[1:])]
        begun = [subtask.first_frame / 7 for subtask in episode.subtasks]
        np.testing.assert_allclose(begun, starts, rtol=0, atol=0.5 / 7 + 1e-9)


def test_a_segment_shorter_than_a_frame_is_named_as_no_sub_task(sources):
    first, second, *rest = sources[0].segments
    middle_s = second.t0 + 0.001
    divided = second.model_copy(update={"tn": middle_s}), second.model_copy(update={"t0": middle_s})
    short = replace(sources[0], segments=(first, *divided, *rest))
    whole, lost = (episodes_of([one], fps=10)[0] for one in (sources[0], short))
    assert len(lost.subtasks) == len(whole.subtasks) == len(short.segments) - 1
    assert whole.left_out == ()
    assert lost.left_out == (
        "cell-1/press: 1 segment without a frame at 10 a second, and so without a sub-task: "
        "meta/caesura.json has them.",
    )


def test_statistics_are_numpys(dataset):
    features = [name for name in dataset.info["features"] if name != "language_persistent"]
    assert set(dataset.stats) == set(features)
    for name in features:
        check_statistics(dataset.stats[name], dataset.column(name))
        for row, frames in zip(dataset.episodes, dataset.frames, strict=True):
            mine = {key.rpartition("/")[2]: row[key] for key in row if key.startswith(f"stats/{name}/")}
            check_statistics(mine, np.asarray(frames[name], dtype=np.float64))


def check_statistics(found: dict[str, list[float]], values: np.ndarray) -> None:
    wide = values.reshape(len(values), -1)
    expected = {"min": wide.min(0), "max": wide.max(0), "mean": wide.mean(0), "std": wide.std(0)}
    expected |= {f"q{q:02d}": np.percentile(wide, q, axis=0) for q in (1, 10, 50, 90, 99)}
    assert found.pop("count") == [len(values)]
    assert set(found) == set(expected)
    for name, value in expected.items():
        np.testing.assert_allclose(found[name], value, rtol=1e-5, atol=1e-5, err_msg=name)


def test_success_is_at_the_last_frame_and_absent_where_it_is_not_stated(sources, dataset, tmp_path):
    assert [row["success"] for row in dataset.episodes] == [True, False, True]
    for row, frames in zip(dataset.episodes, dataset.frames, strict=True):
        assert frames["next.success"] == [False] * 539 + [row["success"]]
    silent = replace(sources[0], success=None)
    write_lerobot(tmp_path / "demos", episodes_of([silent]))
    assert "next.success" not in read(tmp_path / "demos").info["features"]
    with pytest.raises(
        EpisodeError, match=r"success is stated for cell-1/press again and not for cell-1/press"
    ):
        episodes_of([silent, sources[1]])


@pytest.mark.parametrize("stated", [None, "none"])
def test_a_wrench_of_unknown_source_is_absent(tmp_path, sources, stated):
    unknown = replace(sources[0], recording=replace(sources[0].recording, wrench_source=stated))
    write_lerobot(tmp_path / "demos", episodes_of([unknown]))
    features = read(tmp_path / "demos").info["features"]
    assert "observation.state" in features
    assert not [name for name in features if "wrench" in name or "torque" in name]
    with pytest.raises(EpisodeError, match=r"observation.wrench is fx, .* in cell-1/press and absent in"):
        episodes_of([sources[0], unknown])


def test_frames_between_samples_are_interpolated_and_a_gripper_is_not(sources):
    """A signal that is linear in time is reproduced at any rate, from samples at irregular times."""
    rng = np.random.default_rng(3)
    t = 5.0 + np.sort(rng.uniform(0.0, 5.0, 1500))
    line = t[:, None] * [0.1, -0.2, 0.05]
    flag = (np.floor(t) % 2)[:, None]
    made = Recording(
        t, {"pos": 1000 * line, "force": 9 * line, "gripper": flag}, "flange_sensor", length_unit="mm"
    )
    (episode,) = episodes_of([replace(sources[0], recording=made)], fps=30)
    frames_t = t[0] + np.arange(episode.length) / 30
    expected = frames_t[:, None] * [0.1, -0.2, 0.05]
    state = episode.values["observation.state"]
    np.testing.assert_allclose(state[:, :3], expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(episode.values["observation.wrench"], 9 * expected, rtol=0, atol=1e-6)
    assert set(state[:, 3]) == {0.0, 1.0}


def test_a_flag_and_an_opening_of_a_gripper_make_no_dataset(sources):
    # Both were columns of one name: 1 is shut in one episode, and 40 mm are open in the next.
    def with_column(number: int, column: np.ndarray) -> EpisodeSource:
        recording = sources[number].recording
        signals = recording.signals | {"gripper": column[:, None]}
        return replace(sources[number], recording=replace(recording, signals=signals))

    width = sources[1]
    half = width.recording.signals["gripper"][:, 0] > 0.0
    flag, never = with_column(0, (~half).astype(float)), with_column(2, np.zeros(half.size))
    with pytest.raises(EpisodeError, match=r"a flag, 1 is closed in cell-1/press and an opening in m in"):
        episodes_of([flag, width])
    for one, meaning in ((flag, "a flag, 1 is closed"), (width, "an opening in m")):
        for episode in episodes_of([one, never]):
            assert episode.specs["observation.state"].info[0][1].endswith(f"gripper {meaning}")
    assert episodes_of([never])[0].specs["observation.state"].info[0][1].endswith("gripper as sent")


def test_a_frame_of_the_force_that_was_assumed_is_named_so(sources):
    recording = replace(sources[0].recording, assumed=(ASSUMED_FRAME,))
    assumed = replace(sources[0], recording=recording)
    for one, frame in ((assumed, "base, assumed"), (sources[0], "base")):
        (episode,) = episodes_of([one])
        assert dict(episode.specs["observation.wrench"].info)["frame"] == frame
    with pytest.raises(EpisodeError, match=r"observation.wrench is .*frame: base, assumed"):
        episodes_of([assumed, sources[1]])


def test_what_makes_no_episode_is_refused_by_name(sources, tmp_path, monkeypatch):
    one = sources[0]
    for broken, words in (
        (replace(one, gaps=(Gap(t0=1.0, tn=2.005, reason="source"),)), r"recorded from 1.000 to 2.005 s"),
        (replace(one, segments=()), r"cell-1/press: has no segment"),
    ):
        with pytest.raises(EpisodeError, match=words):
            episodes_of([broken])
    rare = replace(one, recording=Recording(np.arange(4.0) * 3.0, {"pos": np.zeros((4, 3))}, "none"))
    with pytest.raises(EpisodeError, match=r"1 frames a second, and its samples come at 0.3333 Hz"):
        episodes_of([rare])
    with pytest.raises(EpisodeError, match=r"250 frames a second, and its samples come at 200 Hz"):
        episodes_of([one], fps=250)
    episodes = episodes_of([one])
    monkeypatch.setattr(lerobot_write, "MAX_LANGUAGE_ROWS", 1000)
    with pytest.raises(EpisodeError, match=r"540 frames times \d sub-tasks are \d+ rows, at most 1000"):
        write_lerobot(tmp_path / "demos", episodes)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "demos").mkdir()
    with pytest.raises(EpisodeError, match="demos exists"):
        write_lerobot(tmp_path / "demos", episodes)


def test_a_full_file_is_followed_by_another(sources, tmp_path, monkeypatch):
    monkeypatch.setattr(lerobot_write, "FILE_MB", 0)
    write_lerobot(tmp_path / "demos", episodes_of(sources))
    assert [row["data/file_index"] for row in read(tmp_path / "demos").episodes] == [0, 1, 2]


LOADED_BY_LEROBOT = """
import json, sys
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.datasets.language_render import active_at
from lerobot.utils.collate import lerobot_collate_fn
from torch.utils.data import DataLoader
data = LeRobotDataset("local/demos", root=sys.argv[1], delta_timestamps={"action": [0.0, 0.01]})
item = data[700]
active = active_at(item["timestamp"].item(), persistent=item["language_persistent"], style="subtask")
batch = next(iter(DataLoader(data, batch_size=4, shuffle=True, collate_fn=lerobot_collate_fn)))
print("found", json.dumps({
    "frames": len(data), "episodes": data.num_episodes, "task": item["task"], "subtask": active["content"],
    "wrench": item["observation.wrench"].tolist(), "action": list(item["action"].shape),
    "succeeded": data.meta.filter_episodes(lambda one: one["success"]),
    "mean": data.meta.stats["observation.wrench"]["mean"].tolist(),
    "batch": list(batch["action"].shape),
}))
"""


@pytest.mark.skipif(LEROBOT not in os.environ, reason=f"{LEROBOT} names no interpreter with lerobot 0.6")
def test_lerobots_own_loader_reads_it(root, dataset, tmp_path):
    environment = os.environ | {"HF_HOME": str(tmp_path), "HF_HUB_OFFLINE": "1"}
    done = subprocess.run(
        [os.environ[LEROBOT], "-c", LOADED_BY_LEROBOT, str(root)],
        capture_output=True,
        text=True,
        timeout=200,
        env=environment,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.partition("found ")[2])
    frames = dataset.frames[1]
    assert (found["frames"], found["episodes"], found["action"]) == (3 * 540, 3, [2, 8])
    assert (found["task"], found["subtask"]) == ("press again", frames["subtask"][160])
    assert (found["succeeded"], found["batch"]) == ([0, 2], [4, 2, 8])
    np.testing.assert_allclose(found["wrench"], frames["observation.wrench"][160], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found["mean"], dataset.column("observation.wrench").mean(0), rtol=1e-5)


@pytest.mark.parametrize(
    ("robots", "expected"),
    [(("panda", "panda"), "panda"), (("panda", "ur5e"), None), (("panda", None), None), ((None, None), None)],
)
def test_the_robot_is_that_of_all_sessions(sources, tmp_path, robots, expected):
    """Sessions state it, and the dataset had none."""
    stated = [
        replace(one, recording=replace(one.recording, setting=CellSettings(robot=robot)))
        for one, robot in zip(sources, robots, strict=False)
    ]
    write_lerobot(tmp_path / "demos", episodes_of(stated))
    info = json.loads((tmp_path / "demos/meta/info.json").read_text())
    assert info["robot_type"] == expected
