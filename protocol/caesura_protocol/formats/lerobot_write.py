"""Episodes as a LeRobot dataset, version 3.0. Needs the extra `lerobot`.

The layout is that of `LeRobotDataset` in lerobot 0.6:

    meta/info.json                              version, rate, features, paths
    meta/stats.json                             statistics of each feature, over all frames
    meta/tasks.parquet, meta/subtasks.parquet   texts and their numbers
    meta/episodes/chunk-000/file-000.parquet    an episode a row: its frames, task and statistics
    meta/caesura.json                           segments and phases with their probabilities, for other tools
    data/chunk-000/file-000.parquet             a frame a row, a row group an episode

Sub-tasks are in `language_persistent`, as rows of the style `subtask` that every frame of an episode repeats,
and in `subtask_index`, a number of `meta/subtasks.parquet`. lerobot 0.4 reads the second alone.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from caesura_protocol.description_texts import DESCRIBED
from caesura_protocol.formats.episode_frames import Episode, EpisodeError, FeatureSpec, subtask_of_frame

VERSION = "v3.0"
FILE_MB, VIDEO_MB, CHUNK_FILES = 100, 200, 1000  # lerobot's own: [MB] of a file, files of a chunk
MAX_LANGUAGE_ROWS = 20_000_000  # frames times sub-tasks of an episode: 1.2 GB of memory
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES_PATH = "meta/episodes/chunk-000/file-000.parquet"
QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
INT = FeatureSpec((), "int64", ())
#: What every dataset has, in the order of its columns.
INDICES: Mapping[str, FeatureSpec] = {
    "timestamp": FeatureSpec((), "float32", (("unit", "s since the episode's first frame"),)),
    "frame_index": INT,
    "episode_index": INT,
    "index": INT,
    "task_index": INT,
    "subtask_index": INT,
}
SUCCESS = FeatureSpec((), "bool", ())  # of the last frame: the demonstration reached its goal
LANGUAGE = {"dtype": "language", "shape": [1], "names": None}
LANGUAGE_ROW = pa.struct(
    [
        pa.field("role", pa.string(), nullable=False),
        pa.field("content", pa.string()),
        pa.field("style", pa.string()),
        pa.field("timestamp", pa.float32(), nullable=False),
        pa.field("camera", pa.string()),
        pa.field("tool_calls", pa.list_(pa.string())),
    ]
)

Values = Mapping[str, NDArray[Any]]
Stats = dict[str, dict[str, list[float] | list[int]]]


class Texts(NamedTuple):
    """Texts with their numbers, in the order of their first use."""

    numbers: dict[str, int]

    def number(self, text: str) -> int:
        """Return the number of a text; add a new text."""
        return self.numbers.setdefault(text, len(self.numbers))


class EpisodeRange(NamedTuple):
    """The data file of an episode, and its frames among all: `first` to before `end`."""

    chunk: int
    file: int
    first: int
    end: int


def write_lerobot(path: Path, episodes: Sequence[Episode], *, language: bool = True) -> int:
    """Write a dataset into a new directory, completely or not at all; return the number of frames.

    language: with `language_persistent`; lerobot 0.4 refuses a dataset that has it. Raises EpisodeError where
    the directory exists or an episode has too many sub-tasks, and OSError.
    """
    if path.exists():
        raise EpisodeError(f"{path} exists: a dataset is written to a new directory")
    tasks, subtasks = Texts({}), Texts({})
    with _whole(path) as root:
        frames = [_frames(number, one, tasks, subtasks) for number, one in enumerate(episodes)]
        places = _write_data(root, episodes, frames, language=language)
        stats = [_statistics(one) for one in frames]
        together = {key: np.concatenate([one[key] for one in frames]) for key in frames[0]}
        _write_texts(root / "meta" / "tasks.parquet", "task", tasks)
        _write_texts(root / "meta" / "subtasks.parquet", "subtask", subtasks)
        _write_table(root / EPISODES_PATH, _episodes_table(episodes, places, stats))
        _write_json(root / "meta" / "stats.json", _statistics(together))
        info = _info(episodes, places[-1].end, len(tasks.numbers), language=language)
        _write_json(root / "meta" / "info.json", info)
        _write_json(root / "meta" / "caesura.json", [_details(one) for one in episodes])
    return places[-1].end


@contextmanager
def _whole(path: Path) -> Iterator[Path]:
    """Yield a temporary directory that is renamed to its final name once it is complete."""
    part = path.with_name(f".{path.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    try:
        (part / "meta").mkdir(parents=True)
        yield part
        part.replace(path)
    finally:
        shutil.rmtree(part, ignore_errors=True)


# --- frames ---------------------------------------------------------------------------------------------


def _specs(episode: Episode) -> dict[str, FeatureSpec]:
    """Return the features with numbers, in the order of their columns."""
    success = {} if episode.source.success is None else {"next.success": SUCCESS}
    return {**episode.specs, **success, **INDICES}


def _frames(number: int, episode: Episode, tasks: Texts, subtasks: Texts) -> dict[str, NDArray[Any]]:
    """Return columns of an episode's frames: (n,) for a single number, else (n, width); `index` from 0."""
    n, one = episode.length, episode.source
    numbers = np.array([subtasks.number(subtask.text) for subtask in episode.subtasks])
    columns: dict[str, NDArray[Any]] = {**episode.values}
    if one.success is not None:
        columns["next.success"] = (np.arange(n) == n - 1) & one.success
    columns |= {
        "timestamp": np.arange(n) / episode.fps,
        "frame_index": np.arange(n),
        "episode_index": np.full(n, number),
        "index": np.arange(n),
        "task_index": np.full(n, tasks.number(one.task)),
        "subtask_index": numbers[subtask_of_frame(episode.subtasks, n)],
    }
    return {key: columns[key].astype(spec.dtype) for key, spec in _specs(episode).items()}


def _write_data(
    root: Path, episodes: Sequence[Episode], frames: Sequence[dict[str, NDArray[Any]]], *, language: bool
) -> list[EpisodeRange]:
    """Write all frames; complete the column `index`.

    An episode that makes a file larger than FILE_MB is its last; the next one begins a new file.
    """
    places: list[EpisodeRange] = []
    number, first, writer = 0, 0, None
    try:
        for episode, columns in zip(episodes, frames, strict=True):
            columns["index"] += first
            arrays = {key: _column(values) for key, values in columns.items()}
            table = pa.table(arrays | ({"language_persistent": _language(episode)} if language else {}))
            chunk, file = divmod(number, CHUNK_FILES)
            path = root / DATA_PATH.format(chunk_index=chunk, file_index=file)
            if writer is None:
                path.parent.mkdir(parents=True, exist_ok=True)
                writer = pq.ParquetWriter(path, table.schema, compression="snappy")
            writer.write_table(table, row_group_size=len(table))
            places.append(EpisodeRange(chunk, file, first, first + len(table)))
            first += len(table)
            if path.stat().st_size > FILE_MB << 20:
                writer.close()
                number, writer = number + 1, None
    finally:
        if writer is not None:
            writer.close()
    return places


def _column(values: NDArray[Any]) -> pa.Array:
    if values.ndim == 1:
        return pa.array(values)
    return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])


def _language(episode: Episode) -> pa.Array:
    """Return all sub-tasks of the episode, repeated for every frame; each has the time of its first frame."""
    n, width = episode.length, len(episode.subtasks)
    if n * width > MAX_LANGUAGE_ROWS:
        raise EpisodeError(
            f"{episode.source.name}: {n} frames times {width} sub-tasks are {n * width} rows, at most "
            f"{MAX_LANGUAGE_ROWS}: export it with fewer frames a second, or without language_persistent"
        )
    rows = [
        {
            "role": "assistant",
            "content": one.text,
            "style": "subtask",
            "timestamp": float(np.float32(one.first_frame / episode.fps)),
            "camera": None,
            "tool_calls": None,
        }
        for one in episode.subtasks
    ]
    repeated = pa.array(rows, type=LANGUAGE_ROW).take(pa.array(np.tile(np.arange(width), n)))
    return pa.ListArray.from_arrays(pa.array(np.arange(n + 1) * width, type=pa.int32()), repeated)


# --- metadata -------------------------------------------------------------------------------------------


def _statistics(columns: Values) -> Stats:
    """Return the statistics of each feature over all its frames, one number per component."""
    found: Stats = {}
    for key, values in columns.items():
        wide = values.reshape(len(values), -1).astype(np.float64)
        numbers = {
            "min": wide.min(axis=0),
            "max": wide.max(axis=0),
            "mean": wide.mean(axis=0),
            "std": wide.std(axis=0),
            **dict(zip(QUANTILES, np.quantile(wide, [*QUANTILES.values()], axis=0), strict=True)),
        }
        found[key] = {name: value.tolist() for name, value in numbers.items()} | {"count": [len(values)]}
    return found


def _episodes_table(
    episodes: Sequence[Episode], places: Sequence[EpisodeRange], stats: Sequence[Stats]
) -> pa.Table:
    rows = [
        {
            "episode_index": number,
            "tasks": [episode.source.task],
            "length": episode.length,
            "data/chunk_index": place.chunk,
            "data/file_index": place.file,
            "dataset_from_index": place.first,
            "dataset_to_index": place.end,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
            "station": episode.source.station,
            "session": episode.source.session,
            "began_s": episode.source.began_s,
            **({} if episode.source.success is None else {"success": episode.source.success}),
            **{f"stats/{key}/{name}": value for key, of in one.items() for name, value in of.items()},
        }
        for number, (episode, place, one) in enumerate(zip(episodes, places, stats, strict=True))
    ]
    return pa.Table.from_pylist(rows)


def _info(episodes: Sequence[Episode], frames: int, tasks: int, *, language: bool) -> dict[str, Any]:
    first = episodes[0]
    features = {key: _feature(spec) for key, spec in _specs(first).items()}
    features |= {"language_persistent": LANGUAGE} if language else {}
    return {
        "codebase_version": VERSION,
        "robot_type": _robot_type(episodes),
        "total_episodes": len(episodes),
        "total_frames": frames,
        "total_tasks": tasks,
        "chunks_size": CHUNK_FILES,
        "data_files_size_in_mb": FILE_MB,
        "video_files_size_in_mb": VIDEO_MB,
        "fps": first.fps,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": DATA_PATH,
        "video_path": None,
        "features": features,
    }


def _robot_type(episodes: Sequence[Episode]) -> str | None:
    """Return the robot of all episodes; None if one states none, or another."""
    stated = {episode.source.recording.setting.robot for episode in episodes}
    return stated.pop() if len(stated) == 1 else None


def _feature(spec: FeatureSpec) -> dict[str, Any]:
    info = {"info": dict(spec.info)} if spec.info else {}
    names = list(spec.names) or None
    return {"dtype": spec.dtype, "shape": [len(spec.names) or 1], "names": names, **info}


def _details(episode: Episode) -> dict[str, Any]:
    """Return the facts of an episode for which the dataset has no columns of its own."""
    one = episode.source
    return {
        "station": one.station,
        "session": one.session,
        "began_s": one.began_s,
        "first_frame_s": float(one.recording.t.min()),  # session clock
        **one.recording.stated_options,
        "assumed": [*one.recording.assumed],
        "left_out": [*episode.left_out],
        "description": one.recording.description.model_dump(
            mode="json", exclude_defaults=True, include=set(DESCRIBED)
        ),
        "segments": [segment.model_dump(mode="json", exclude_none=True) for segment in one.segments],
        "phases": [phase.model_dump(mode="json", exclude_none=True) for phase in one.phases],
        "gaps": [
            gap.model_dump(mode="json") for gap in one.gaps
        ],  # before the first or after the last sample
    }


def _write_texts(path: Path, name: str, texts: Texts) -> None:
    """Write texts in the form that pandas uses for the index of a table."""
    index = f"{name}_index"
    types = ((index, "int64", "int64"), (name, "unicode", "object"))
    described = {
        "index_columns": [name],
        "column_indexes": [],
        "columns": [
            {"name": one, "field_name": one, "pandas_type": pandas, "numpy_type": numpy, "metadata": None}
            for one, pandas, numpy in types
        ],
        "pandas_version": "2.3.3",
    }
    table = pa.table({index: pa.array([*texts.numbers.values()], pa.int64()), name: [*texts.numbers]})
    _write_table(path, table.replace_schema_metadata({"pandas": json.dumps(described)}))


def _write_table(path: Path, table: pa.Table) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, path)


def _write_json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=4, allow_nan=False, ensure_ascii=False), encoding="utf-8")
