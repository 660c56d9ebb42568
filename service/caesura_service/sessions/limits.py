"""All limits of sessions and of the registry, by name."""

from __future__ import annotations

from dataclasses import dataclass

from caesura_protocol.messages import MAX_BATCH_SPAN_S, MAX_BATCHES_AHEAD


@dataclass(frozen=True)
class Limits:
    """What one peer may cost. Each limit is named in the refusal that it causes."""

    # Ordering and replay
    held_batches: int = 128  # that came before their turn; further ones are asked for again
    held_bytes: int = 1 << 23  # of their samples
    batches_ahead: int = MAX_BATCHES_AHEAD  # of the expected one; further ahead is not a sequence number
    replay_batches: int = 256  # asked for at once
    replay_retry_s: float = 0.5  # after an answer that brought nothing
    replay_patience_s: float = 5.0  # for an answer that never ends
    replay_misses: int = 3  # answers without the batch that was asked for, until it counts as lost

    # Content of a batch
    time_s: float = 1e10  # magnitude of a sample's time
    value: float = 1e6  # magnitude of everything else, in its unit: no robot measures more
    batch_span_s: float = MAX_BATCH_SPAN_S  # first to last sample of a batch

    # Publishing
    status_interval_s: float = 1.0  # session time between two statuses without an occasion
    apps_per_s: float = 100.0  # put a second of session time: a long program is put less often
    hush_s: float = 1.0  # real time between two statuses about what was refused or given up

    # Registry
    stations: int = 256
    observations: int = 400_000  # of a session, eleven hours at 10 Hz; with the last one it is closed
    observations_held: int = 800_000  # of a station's sessions here: past that, closed ones are let go
    open_sessions: int = 4  # a station; one more closes the oldest as abandoned
    closed_sessions: int = 16  # a station, that can be asked; one more lets go of the oldest
    tidy_interval_s: float = 1.0  # between two looks at what the journal need no longer keep
    look_interval_s: float = 30.0  # between two looks at whether others still keep what only they have
