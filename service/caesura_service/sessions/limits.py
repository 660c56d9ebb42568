"""All limits of sessions and of the registry, by name."""

from __future__ import annotations

from dataclasses import dataclass

from caesura_protocol.messages import MAX_BATCH_SPAN_S, MAX_BATCHES_AHEAD


@dataclass(frozen=True)
class Limits:
    """The limits of a peer's use. A refusal names its limit."""

    # Ordering and replay
    held_batches: int = 128  # that arrived early; further ones are requested again
    held_bytes: int = 1 << 23  # of their samples
    batches_ahead: int = MAX_BATCHES_AHEAD  # of the expected one; further ahead is not a sequence number
    replay_batches: int = 256  # in one request
    replay_retry_s: float = 0.5  # after an answer that brought nothing
    replay_timeout_s: float = 5.0  # until an unanswered request is repeated
    replay_misses: int = 3  # answers without the requested batch until it counts as lost

    # Content of a batch
    time_s: float = 1e10  # magnitude of a sample's time
    value: float = 1e6  # magnitude of everything else, in its unit: no robot measures more
    batch_span_s: float = MAX_BATCH_SPAN_S  # first to last sample of a batch

    # Publishing
    status_interval_s: float = 1.0  # session time between two statuses without an occasion
    apps_per_s: float = 100.0  # put a second of session time: a long program is put less often
    refusal_status_interval_s: float = 1.0  # real time between two statuses about refusals or losses

    # Registry
    stations: int = 256
    silent_s: float = 600.0  # without a message, after which an open station makes room for another
    observations: int = 400_000  # of a session, eleven hours at 10 Hz; with the last one it is closed
    observations_held: int = 800_000  # of a station's sessions here: past that, closed ones are released
    open_sessions: int = 4  # a station; one more closes the oldest as abandoned
    closed_sessions: int = 16  # a station, that can be asked; one more releases the oldest
    retention_interval_s: float = 1.0  # between two checks of the journal's retention
    peer_poll_interval_s: float = 30.0  # between two checks of sessions that only a peer journal has
