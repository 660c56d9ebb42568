"""What it costs to refuse a message that was made to be costly: time, and memory beside the payload.

    python tests/bench/refusal_cost.py [--types SampleBatch] [--sizes 8000] [--tries 5]

Every type that a station can send, and every short one of the service, with 60 kinds of content in every
field, from 400 bytes to 1 MiB. Prints the worst of each type; exits 1 where one takes longer than `--limit-s`
or more than `--limit-mb`. A message that is accepted is counted too: its receiver has paid for it as well.

Long results are compared with a valid one of their length. Prints the greatest ratio of the times to read
the two; exits 1 where it is above `--limit-ratio`.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from caesura_protocol.messages import Message
from harness.heavy import BOUNDED, SIZES, Cost, cost_of, heavy_messages, seconds_of
from harness.hostile_results import HOSTILE_BYTES, LONG_RESULTS, hostile_results, sound_result

MORE_TRIES = 100  # where a limit does not hold: others use the processor too


def worst_of(
    model: type[Message], sizes: tuple[int, ...], tries: int, limit_s: float
) -> tuple[int, dict[str, tuple[str, Cost]]]:
    """How many there were; the costliest in time and in memory, with what it was."""
    worst: dict[str, tuple[str, Cost]] = {}
    count = 0
    for what, payload in heavy_messages(model, sizes):
        cost = cost_of(payload, model, tries)
        if limit_s < cost.seconds < MORE_TRIES * limit_s:
            cost = cost_of(payload, model, MORE_TRIES)
        count += 1
        for measure in ("seconds", "bytes"):
            if measure not in worst or getattr(cost, measure) > getattr(worst[measure][1], measure):
                worst[measure] = what, cost
    return count, worst


def worst_ratio(model: type[Message], tries: int, limit: float) -> tuple[float, str]:
    """The time to refuse a hostile result by that to read a valid one of its length; with what it was."""
    sound = sound_result(model)
    worst = 0.0, ""
    for what, payload in hostile_results(model, HOSTILE_BYTES):
        share = len(sound) / len(payload)
        ratio = share * seconds_of(payload, model, tries) / seconds_of(sound, model, tries)
        if ratio > limit:
            ratio = share * seconds_of(payload, model, MORE_TRIES) / seconds_of(sound, model, MORE_TRIES)
        worst = max(worst, (ratio, what))
    return worst


def main() -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--limit-s", type=float, default=0.001)
    parser.add_argument("--limit-mb", type=float, default=1.0)
    parser.add_argument("--limit-ratio", type=float, default=3.0)
    parser.add_argument("--types", nargs="+", default=[model.__name__ for model in (*BOUNDED, *LONG_RESULTS)])
    parser.add_argument("--sizes", nargs="+", type=int, default=SIZES)
    parser.add_argument("--tries", type=int, default=5)
    options = parser.parse_args()
    failed = False
    for model in [model for model in BOUNDED if model.__name__ in options.types]:
        count, worst = worst_of(model, tuple(options.sizes), options.tries, options.limit_s)
        (slow, time_cost), (large, memory_cost) = worst["seconds"], worst["bytes"]
        print(f"{model.__name__}, {count} messages")
        print(f"  slowest {1e3 * time_cost.seconds:9.3f} ms  {slow}")
        print(f"  largest {memory_cost.bytes / 1e6:9.3f} MB  {large}", flush=True)
        failed |= time_cost.seconds > options.limit_s or memory_cost.bytes > 1e6 * options.limit_mb
    for model in [model for model in LONG_RESULTS if model.__name__ in options.types]:
        ratio, what = worst_ratio(model, options.tries, options.limit_ratio)
        print(f"{model.__name__}\n  slowest {ratio:9.2f} of reading a valid one  {what}", flush=True)
        failed |= ratio > options.limit_ratio
    print("a limit does not hold" if failed else "all within the limits")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
