"""Gives a bridge's threads a real-time priority, where the robot's loop has one.

All threads of a process share the interpreter's lock. If a thread without a real-time priority holds it while
the machine runs another process, a loop with one waits for that process as well (priority inversion). One
priority below the loop's, a bridge's threads never delay the loop otherwise.
"""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Iterable

logger = logging.getLogger(__name__)


def share_priority(threads: Iterable[threading.Thread]) -> None:
    """Set the priority of threads to one below that of the calling thread; only Linux has one for each.

    Does nothing if the calling thread has no real-time priority, and logs it if the system refuses.
    """
    if sys.platform != "linux":
        return
    policy = os.sched_getscheduler(0)
    if policy & ~os.SCHED_RESET_ON_FORK not in {os.SCHED_FIFO, os.SCHED_RR}:
        return
    priority = max(1, os.sched_getparam(0).sched_priority - 1)
    for thread in threads:
        try:
            if thread.native_id is not None:
                os.sched_setscheduler(thread.native_id, policy, os.sched_param(priority))
        except ProcessLookupError:
            continue  # it has ended
        except OSError as error:
            why = "so the robot's loop may wait while the machine runs another process"
            logger.warning("%s gets no real-time priority (%s), %s", thread.name, error.strerror, why)
