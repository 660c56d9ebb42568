"""`python -m caesura_service.prepare`: compiles all kernels in advance."""

from __future__ import annotations

import subprocess
import sys
import time

from caesura_service.changepoint import filter_choice
from caesura_service.numba_support import compiling_alone, has_kernels, is_compiled, mark_compiled
from caesura_service.signals import kernel_warm_up


def prepare() -> None:
    """Load all kernels; if they are not cached, another process compiles them first.

    The results of code that this process has compiled may differ in the last bit from those of loaded code.
    Then a session would not be replayed bit for bit after a restart.
    """
    if has_kernels() and not is_compiled():
        command = [sys.executable, "-m", "caesura_service.prepare"]
        subprocess.run(command, check=False, stdout=subprocess.DEVNULL)
    _load()


def _load() -> None:
    """Call every kernel once: cached ones are loaded, others are compiled."""
    filter_choice.prepare()
    kernel_warm_up.prepare()


def main() -> None:
    """Compile all kernels that are not cached, and mark that all are.

    Of several processes that start at once, such as those of `caesura serve --instances`, one compiles.
    """
    before = time.perf_counter()
    if has_kernels():
        with compiling_alone():
            if not is_compiled():
                _load()
                mark_compiled()
    print(f"kernels ready in {time.perf_counter() - before:.1f} s")


if __name__ == "__main__":
    main()
