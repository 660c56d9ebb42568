"""Writes sessions as a LeRobot dataset in a zip file, with samples from the journal of the service."""

from __future__ import annotations

import io
import threading
import zipfile
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from caesura_clients.dashboard.network_follower import NetworkFollower
from caesura_clients.full_samples import read_recording
from caesura_protocol.errors import NotFound
from caesura_protocol.formats.episode_frames import EpisodeSource, episodes_of
from caesura_protocol.package_version_and_extras import import_extra

FOLDER = "dataset"  # in the zip file
MOST_SESSIONS = 50
_ONE_AT_A_TIME = threading.Lock()  # each holds its samples in memory


def zipped_dataset(gateway: NetworkFollower, named: Sequence[tuple[str, str]]) -> bytes:
    """Return a dataset with an episode for each session.

    named: station and session of each episode. Raises ProtocolError, or CaesuraError, which names a session
    that cannot be an episode.
    """
    with import_extra("lerobot", "a LeRobot dataset"):
        from caesura_protocol.formats.lerobot_write import write_lerobot  # noqa: PLC0415 - needs pyarrow
    with _ONE_AT_A_TIME, TemporaryDirectory() as folder:
        path = Path(folder) / FOLDER
        write_lerobot(path, episodes_of([_source(gateway, *one) for one in named]))
        return _zipped(path)


def _source(gateway: NetworkFollower, station: str, session: str) -> EpisodeSource:
    update = gateway.world.update(station, session)
    if update is None:
        raise NotFound(f"no session {station}/{session} is known")
    return EpisodeSource(
        station=station,
        session=session,
        task=update.status.description.task or session,
        recording=read_recording(gateway.transport, update),
        segments=tuple(update.segments),
        phases=tuple(update.phases),
        gaps=tuple(update.status.gaps),
        began_s=update.status.opened or 0.0,
        success=update.status.description.success,
    )


def _zipped(path: Path) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:  # parquet is compressed already
        for file in sorted(path.rglob("*")):
            archive.write(file, file.relative_to(path.parent))
    return content.getvalue()
