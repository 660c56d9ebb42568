"""What the interpreter does for threads that are not its own.

Apart from the rooms that handle what comes from the network, which may reach no C function by its name.
"""

from __future__ import annotations

import ctypes
import itertools
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

# What is kept of a thread that ends is lost memory. Zenoh's live as long as the process, but for a few.
MOST_STAYING = 256
_numbers = itertools.count(1)
_thread = threading.local()  # empty in each call until the state is kept. An ident is reused by other threads


def staying(callback: Callable[[Any], None]) -> Callable[[Any], None]:
    """The same callback, but what the interpreter keeps of the thread that calls is kept from call to call.

    For a few threads that live as long as the process, such as zenoh's: of MOST_STAYING. Made anew for every
    call, a thread's stack is mapped and unmapped, which costs more than most callbacks do.
    """
    return partial(_staying, callback)


def _staying(callback: Callable[[Any], None], given: Any) -> None:
    if not hasattr(_thread, "number"):
        _thread.number = next(_numbers)
        if _thread.number <= MOST_STAYING:
            ctypes.pythonapi.PyGILState_Ensure()  # without the release that would let go of the state
    callback(given)
