"""The rates that limit how often a sender may send and how much work it may cause.

Sizes and queues bound the memory that a sender may use; rates bound the work that it may cause. The limits
are well above the use by correct clients, so a sender that reaches them is faulty or hostile. Samples: a
robot at 1 kHz that sends each sample separately sends 1000 messages a second; with every possible column they
are 0.5 MB. A bridge at the limit of flow control sends a window of 64 every 20 ms, 3200 a second (measured:
1500). Requested replays do not count. Work: a robot at 1 kHz takes a fiftieth of the worker's time, an hour
of a recording sent without pacing twenty seconds, an edit of an hour one or two seconds; replays and edits
count. Commands: a blocked bridge sends 50 a second. Queries: 1000 readers that query everything twice a
second. Tokens: a link that is lost and restored every second.
"""

from __future__ import annotations

from dataclasses import dataclass

from caesura_protocol.token_bucket import Rate

SAMPLE_RATE = Rate(5000.0, 10_000.0)  # messages of a station
BYTE_RATE = Rate(16e6, 32e6)  # bytes of them
COMMAND_RATE = Rate(500.0, 1000.0)  # of a station
QUERY_RATE = Rate(2000.0, 4000.0)  # that name a station; those that name none; those for the status
TOKEN_RATE = Rate(2.0, 20.0)  # changes of a station's token
WORK_RATE = Rate(0.5, 60.0)  # [s] of the worker's time, for a station
PREVIEW_RATE = Rate(0.25, 30.0)  # [s] of the worker's time, for previews of a station's sessions


@dataclass(frozen=True)
class RateLimits:
    """The rates of each kind of message, and of work."""

    samples: Rate = SAMPLE_RATE
    bytes: Rate = BYTE_RATE
    commands: Rate = COMMAND_RATE
    queries: Rate = QUERY_RATE
    tokens: Rate = TOKEN_RATE
    work: Rate = WORK_RATE
    previews: Rate = PREVIEW_RATE
