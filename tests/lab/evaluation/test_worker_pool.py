"""The same work in processes: what comes of it, and that none outlives its parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from caesura_lab.evaluation.worker_pool import each
from harness.processes import DEADLINE_S, eventually

TESTS = Path(__file__).parents[2]


def test_what_comes_of_each_item_comes_in_any_order():
    assert sorted(each(abs, [-3, 1, -2], workers=2)) == sorted(each(abs, [-3, 1, -2])) == [1, 2, 3]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_no_worker_outlives_its_parent(number: int, tmp_path: Path):
    """A time limit ended `caesura evaluate`, and its workers computed on for minutes."""
    program = (
        "import sys; from pathlib import Path; from caesura_lab.evaluation.worker_pool import each; "
        "from lab.evaluation.endless import never_ends\n"
        "if __name__ == '__main__': list(each(never_ends, [Path(sys.argv[1])] * 2, workers=2))"
    )
    path = os.pathsep.join([str(TESTS), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-c", program, str(tmp_path)]
    parent = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": path})
    try:
        eventually(lambda: len(list(tmp_path.iterdir())) == 2)
        parent.send_signal(number)
        parent.wait(DEADLINE_S)
        eventually(lambda: not any(map(is_alive, tmp_path.iterdir())))
    finally:
        parent.kill()
        for worker in filter(is_alive, tmp_path.iterdir()):
            os.kill(int(worker.name), signal.SIGKILL)


def is_alive(worker: Path) -> bool:
    return Path(f"/proc/{worker.name}").exists()
