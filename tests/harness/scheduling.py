"""Which process of a test run takes which file: every other one what waits, the others what computes.

Tests of a dashboard, of faults and of networks wait for pages, processes and deadlines. While all processes
of a run have such files, processors idle; while none has, they queue. A process that finds no file of its
sort takes what is left.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from xdist.scheduler import LoadFileScheduling

if TYPE_CHECKING:
    from xdist.workermanage import WorkerController

# Where a fifth of the time or more is waited.
WAITING = (
    "tests/acceptance/test_foxglove_command",
    "tests/acceptance/test_serve",
    "tests/acceptance/test_standby",
    "tests/clients/",
    "tests/dashboard/",
    "tests/deploy/",
    "tests/docs/",
    "tests/examples/",
    "tests/faults/",
    "tests/lab/evaluation/test_worker_pool",
    "tests/service/security/",
    "tests/service/server/",
)


def waits(file: str) -> bool:
    return file.startswith(WAITING)


def takes_what_waits(worker: str) -> bool:
    """By its name, gw0 and so on; also one that replaces one that has crashed."""
    return int(worker.removeprefix("gw")) % 2 == 0


class Scheduling(LoadFileScheduling):
    """A file at a time, as `--dist loadfile`."""

    def _assign_work_unit(self, node: WorkerController) -> None:
        mine = takes_what_waits(node.gateway.id)
        chosen = next((file for file in self.workqueue if waits(file) == mine), None)
        if chosen is not None:
            self.workqueue.move_to_end(chosen, last=False)
        super()._assign_work_unit(node)
