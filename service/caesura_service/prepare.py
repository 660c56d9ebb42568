"""`python -m caesura_service.prepare`: compiles all kernels in advance."""

from __future__ import annotations

import time

from caesura_service.changepoint import filter_choice
from caesura_service.signals import warm_up


def prepare() -> None:
    """Compile what is not compiled yet, where there is something to compile with."""
    filter_choice.prepare()
    warm_up.prepare()


if __name__ == "__main__":
    before = time.perf_counter()
    prepare()
    print(f"kernels ready in {time.perf_counter() - before:.1f} s")
