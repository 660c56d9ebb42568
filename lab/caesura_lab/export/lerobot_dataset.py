"""Writes sessions as a LeRobot dataset (`formats.lerobot_write`), one episode each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from caesura_lab.export.session_from_journal import SessionExport
from caesura_protocol.formats.episode_frames import Episode, EpisodeSource, episodes_of
from caesura_protocol.formats.lerobot_write import write_lerobot


def write_sessions(
    path: Path,
    sessions: Sequence[SessionExport],
    *,
    fps: int | None = None,
    task: str | None = None,
    success: Mapping[str, bool] | None = None,
    language: bool = True,
) -> list[Episode]:
    """Write a dataset into a new directory, completely or not at all; return its episodes.

    fps: frames a second, by default the rate of the samples. task: of all sessions, by default that of each
    session's description, or its name. success: by the session's name, by default that of its description.
    language: as for `write_lerobot`.

    Raises EpisodeError where the sessions make no dataset, and OSError.
    """
    stated = success or {}
    sources = [
        EpisodeSource(
            station=one.station,
            session=one.opening.session,
            task=task or one.recording.description.task or one.opening.session,
            recording=one.recording,
            segments=tuple(one.view.segments),
            phases=tuple(one.view.phases),
            gaps=tuple(one.view.gaps),
            began_s=one.began_s,
            success=stated.get(one.opening.session, one.recording.description.success),
        )
        for one in sessions
    ]
    episodes = episodes_of(sources, fps)
    write_lerobot(path, episodes, language=language)
    return episodes
