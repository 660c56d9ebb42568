"""What reading a program costs that is as long as that of an hour: whole, and as the next version of one.

Prints; asserts nothing.
Usage: python tests/bench/program_cost.py [--apps 2294] [--times 20]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).parents[1]))

from caesura_clients.program_decoder import ProgramDecoder
from caesura_protocol.codec import decode, encode
from caesura_protocol.messages import MAX_WHOLE_BYTES, App, Program
from clients.examples import example

SEGMENT_S = 1.5


def program(count: int) -> Program:
    """With so many apps, one after the other."""
    app = example(App)
    times = [{"t0": SEGMENT_S * i, "tn": SEGMENT_S * (i + 1)} for i in range(count)]
    apps = tuple(app.model_copy(update=one) for one in times)
    return example(Program).model_copy(update={"apps": apps, "version": count})


def cpu_ms(read: Callable[[bytes], object], payload: bytes) -> float:
    """[ms] of processor."""
    began = time.process_time()
    read(payload)
    return 1e3 * (time.process_time() - began)


def main() -> None:
    """Print the medians."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--apps", type=int, default=2294)
    parser.add_argument("--times", type=int, default=20)
    asked = parser.parse_args()
    first, second = (encode(program(asked.apps + i), limit=MAX_WHOLE_BYTES) for i in range(2))
    whole, version = [], []
    for _ in range(asked.times):
        decoder = ProgramDecoder()
        decoder.decode(first.payload)
        version.append(cpu_ms(decoder.decode, second.payload))
        whole.append(
            cpu_ms(
                lambda payload: decode(payload, second.encoding, Program, limit=MAX_WHOLE_BYTES),
                second.payload,
            )
        )
    print(f"{asked.apps} apps, {len(first.payload) / 1e6:.2f} MB, in ms of processor: ", end="")
    print(f"whole {median(whole):.1f}, with one app more than the version before {median(version):.1f}")


if __name__ == "__main__":
    main()
