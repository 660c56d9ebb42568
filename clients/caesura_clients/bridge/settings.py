"""Settings of a bridge; the defaults suit a robot at 1 kHz."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from caesura_protocol.programs.safety import UNSET, CellSettings


@dataclass(frozen=True)
class BridgeSettings:
    """Settings of a bridge: batch size, retry intervals, and span of the replay ring."""

    batch_samples: int = 20
    max_latency_s: float = 0.1  # a batch that does not fill goes after this time
    heartbeat_s: float = 0.5  # silence after which the last number is repeated
    ring_span_s: float = 120.0  # [s] session clock; about 11 MB at 1 kHz with all columns
    ring_samples: int = 600_000  # what no service has is kept so long: 10 min and 55 MB at 1 kHz
    window_batches: int = 64  # under way at most, where the source can wait
    tick_s: float = 0.02  # between two polls of the keeper and the send thread
    retry_s: float = 0.2  # between attempts to open or to close
    reopen_s: float = 15.0  # between openings that nothing asks for, should a service's coming go unnoticed
    stall_s: float = 0.5  # without progress, missing batches are sent again
    close_timeout_s: float = 10.0
    setting: CellSettings = UNSET  # what the station's cell asks of its programs
    unstored_folder: Path | None = None  # where a live demonstration is kept that no service has stored
