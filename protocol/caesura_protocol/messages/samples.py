"""Samples sent to the service, recorded samples, and fragments of a message.

Samples are sent as one binary matrix with a small header: validating the header takes microseconds,
validating a thousand floats separately would take milliseconds.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from caesura_protocol.messages.field_types import (
    Amount,
    Columns,
    Count,
    ForceFrame,
    Listed,
    Name,
    Quaternion,
    Seconds,
)
from caesura_protocol.messages.limits import (
    MAX_BATCH_SAMPLES,
    MAX_DRAWN,
    MAX_HOLES,
    MAX_WHOLE_BYTES,
    PIECE_BYTES,
)
from caesura_protocol.messages.message import Message
from caesura_protocol.messages.results import Gap


class SampleBatch(Message):
    """Consecutive samples of one robot.

    samples: little-endian float32 or float64 (the size determines which), matrix (n, columns), row major; its
    first column is the time offset from `t0` [s].
    """

    session: Name
    epoch: Count  # of the bridge; a restarted one continues the session with a higher epoch
    seq: Count  # counts batches of the session from 0, without holes
    n: Annotated[int, Field(ge=1, le=MAX_BATCH_SAMPLES)]
    columns: Columns
    t0: Seconds  # [s] session clock
    samples: bytes
    bridge: Name | None = None  # which one sends: a session belongs to one bridge


class Heartbeat(Message):
    """Sent while no batch is sent: its sequence number shows whether the last batches were lost."""

    session: Name
    epoch: Count
    seq: Annotated[int, Field(ge=-1)]  # the last batch that was put; -1 before the first
    bridge: Name | None = None


class RecordedSamples(Message):
    """Recorded samples of a session in a time range, as the journal has them, without interpolation.

    Each bin and column has the first sample with the least value and the first with the greatest, in the
    order of time; one point if both are the same sample. A bin without samples has no point. Bins begin at
    multiples of `bin_s`; those at the ends of the range are complete.

    Positions are in metres; forces and torques as they were sent (see `force_frame`). Four columns are
    computed. `speed` is the distance between the mean position of the last 40 ms and that of the 40 ms
    before, divided by the time between them. Without positions it is that of all joints together [rad/s].
    `rotation_x`, `rotation_y` and `rotation_z` are the rotation vector [rad] from `first_orientation`, in the
    base frame: axis times angle, at most π long.
    """

    station: Name
    session: Name
    instance: Name
    epoch: Count  # of the session's owner; readers keep the highest
    t0: Seconds  # [s] the range that was asked for
    tn: Seconds  # [s]
    bin_s: Amount  # [s] width of a bin
    available: Annotated[Listed[str], Field(max_length=MAX_DRAWN)]  # columns that the session has
    columns: Annotated[Listed[str], Field(max_length=MAX_DRAWN)]  # those of them that were asked for
    counts: Annotated[Listed[Count], Field(max_length=MAX_DRAWN)]  # points of each column
    points: bytes  # little-endian float64, a pair (t, value) a point, column by column
    first: Seconds | None  # [s] the first sample of the session; None where it has none
    last: Seconds | None  # [s] its last one in the journal: what comes later is not recorded, or not yet
    holes: Annotated[Listed[Gap], Field(max_length=MAX_HOLES)] = ()  # in the range, from sample to sample
    holes_more: Count = 0  # shorter ones that are not listed
    force_frame: ForceFrame = "base"
    first_orientation: Quaternion | None = None  # x y z w of the session; None where it has none


class Piece(Message):
    """A fragment of a message that is too long for one. All fragments, in order, are its payload."""

    encoding: Annotated[str, Field(max_length=100)]  # of the whole
    whole: Count  # the same in all pieces of one message
    number: Count  # of this one, from 0
    count: Annotated[int, Field(ge=1, le=MAX_WHOLE_BYTES // PIECE_BYTES)]
    payload: Annotated[bytes, Field(max_length=PIECE_BYTES)]
