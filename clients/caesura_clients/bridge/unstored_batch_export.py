"""Saves the batches that a bridge still has and that no service has stored as a recording."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, count
from pathlib import Path

import numpy as np

from caesura_clients.bridge.replay_ring import StoredBatch
from caesura_protocol.codec import decode, signals_of, unpack_samples
from caesura_protocol.formats.write import write_npz
from caesura_protocol.messages import Description, Open, SampleBatch
from caesura_protocol.programs.safety import CellSettings
from caesura_protocol.recording import ASSUMED, Recording


def save_unstored(station: str, opening: Open, batches: Sequence[StoredBatch], folder: Path) -> Path:
    """Write at least one batch to a whole `STATION.SESSION.unstored.npz`; return its path. Raises OSError.

    Another file of this name stays; this one then has a number before `unstored`.
    """
    rows = np.concatenate([unpack_samples(decode(*one.content, SampleBatch)) for one in batches])
    recording = Recording(
        rows[:, 0],
        signals_of(opening.columns, rows),
        wrench_source=opening.wrench_source,
        hand_on_robot=opening.hand_on_robot,
        force_frame=opening.force_frame,
        length_unit=opening.length_unit,
        assumed=tuple(ASSUMED[one] for one in opening.assumed),
        name=opening.session,
        setting=CellSettings(**{name: getattr(opening, name) for name in CellSettings._fields}),
        description=opening.description or Description(),
    )
    name = f"{station}.{opening.session}"  # a dot is in neither
    paths = (folder / f"{name}{number}.unstored.npz" for number in chain([""], map(".{}".format, count(2))))
    path = next(path for path in paths if not path.exists())
    write_npz(path, recording)
    return path.absolute()
