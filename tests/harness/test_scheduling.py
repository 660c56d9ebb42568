"""Files that wait beside files that compute."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

pytest.importorskip("xdist", reason="pytest-xdist is not installed (extra dev)")

from harness.scheduling import Scheduling

WAITS = ("tests/dashboard/test_a.py", "tests/faults/test_b.py", "tests/dashboard/test_c.py")
COMPUTES = ("tests/lab/test_d.py", "tests/protocol/test_e.py")


class FakeWorkerNode:
    """A process as a scheduler sees it; what it was given, by file."""

    shutting_down = False

    def __init__(self, number: int) -> None:
        self.gateway = SimpleNamespace(id=f"gw{number}")
        self.given: list[str] = []

    def send_runtest_some(self, indices: list[int]) -> None:
        self.given += [TESTS[index].split("::")[0] for index in indices]

    def shutdown(self) -> None:
        self.shutting_down = True


TESTS = [f"{file}::test_{number}" for file in (*WAITS, *COMPUTES) for number in range(4)]


def scheduled(numbers: tuple[int, ...]) -> tuple[Scheduling, list[FakeWorkerNode]]:
    option = SimpleNamespace(numprocesses=len(numbers), loadscopereorder=False)
    config = SimpleNamespace(option=option, getvalue=lambda name: [f"{len(numbers)}*popen"])
    scheduling, nodes = Scheduling(config, None), [FakeWorkerNode(number) for number in numbers]
    for node in nodes:
        scheduling.add_node(node)
        scheduling.add_node_collection(node, TESTS)
    scheduling.schedule()
    return scheduling, nodes


def test_every_other_worker_begins_with_what_waits_and_the_others_with_what_computes():
    _, nodes = scheduled((0, 1, 2, 3, 4))
    begun = [WAITS[0], COMPUTES[0], WAITS[1], COMPUTES[1], WAITS[2]]
    assert [set(node.given) for node in nodes] == [{file} for file in begun]


def test_a_worker_that_finds_none_of_its_sort_takes_another():
    scheduling, (waiting, computing) = scheduled((0, 3))
    for index in range(12, 20):  # all that compute
        scheduling.mark_test_complete(computing, index)
    assert computing.given == [file for file in (*COMPUTES, WAITS[1]) for _ in range(4)]
    assert set(waiting.given) == {WAITS[0]}
