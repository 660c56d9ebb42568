"""What the interpreter does for threads that are not its own.

Apart from the rooms that handle what comes from the network, which may reach no C function by its name.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

_STAYING: set[int] = set()  # threads whose state is kept


def staying(callback: Callable[[Any], None]) -> Callable[[Any], None]:
    """The same callback, but what the interpreter keeps of the thread that calls is kept from call to call.

    For a few threads that live as long as the process, such as zenoh's. Made anew for every call, a thread's
    stack is mapped and unmapped, which costs more than most callbacks do.
    """
    return partial(_staying, callback)


def _staying(callback: Callable[[Any], None], given: Any) -> None:
    if (thread := threading.get_ident()) not in _STAYING:
        _STAYING.add(thread)
        ctypes.pythonapi.PyGILState_Ensure()  # without the release that would let go of the state
    callback(given)
