"""`caesura bridge --source ros2`, a process beside a real service, fed with CDR in both layouts of keys."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np
import pytest

from caesura_clients import Caesura, connect
from caesura_service.offline_segmentation import segment_recording
from clients.conftest import RouterNetwork
from clients.test_ros2_source import LAYOUTS, publisher
from harness import ros
from harness.demonstrations import guided
from harness.processes import DEADLINE_S, eventually, serving, snapshot, started

SESSION = "s1"
ROWS = 100  # put at once
MAPPING = """
wrench_source = "flange_sensor"
[topics."/pose"]
type = "geometry_msgs/msg/PoseStamped"
signals = ["pos"]
[topics."/ft/wrench"]
type = "geometry_msgs/msg/WrenchStamped"
signals = ["force"]
"""


@pytest.fixture(scope="module")
def caesura(tmp_path_factory) -> Iterator[Caesura]:
    with serving(tmp_path_factory.mktemp("journal")) as service, connect(service.endpoint) as client:
        yield client


@pytest.fixture
def ros_router() -> Iterator[RouterNetwork]:
    with RouterNetwork() as network:
        yield network


@pytest.mark.slow
@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_segments_are_those_of_the_npz(caesura, ros_router: RouterNetwork, tmp_path, layout):
    made = guided()
    demonstration = replace(made, t=ros.in_seconds(made))
    (tmp_path / "map.toml").write_text(MAPPING)
    station = layout.replace("_", "-")
    options = ("--station", station, "--session", SESSION, "--source", "ros2", "--ros", ros_router.endpoint)
    where = ("--mapping", str(tmp_path / "map.toml"), "--connect", caesura.transport.endpoint)
    command = [sys.executable, "-c", "from caesura_clients.cli import main; main()", "bridge"]
    messages = ros.sensor_topics(demonstration)
    first = list(islice(messages, 2))
    with (
        publisher(ros_router, layout) as node,
        started([*command, *options, *where], stderr=subprocess.PIPE) as bridge,
    ):
        opened = threading.Event()
        reading = threading.Thread(target=lambda: opened.set() if bridge.stderr.readline() else None)
        reading.start()
        while not opened.wait(0.05):  # a robot that stands still until somebody listens
            assert bridge.poll() is None
            for message in first:
                node.put(*message)

        def arrived(rows: int) -> bool:
            found = snapshot(caesura, station)
            return found is not None and found.status.samples - found.status.repeats >= rows

        for rows in range(ROWS, demonstration.t.size + ROWS, ROWS):
            for message in islice(messages, 2 * ROWS):
                node.put(*message)
            eventually(partial(arrived, min(rows, demonstration.t.size)))
        bridge.send_signal(signal.SIGINT)
        assert bridge.wait(DEADLINE_S) == 0
        reading.join()
    expected, found = segment_recording(demonstration), caesura.snapshot(station, SESSION)
    assert found.status.samples - found.status.repeats == demonstration.t.size
    assert [one.kind for one in found.segments.segments] == [one.kind for one in expected.segments]
    ends = [one.tn for one in found.segments.segments]
    np.testing.assert_allclose(ends, [one.tn for one in expected.segments], atol=1e-9)
    forces = [one.force_end for one in found.segments.segments]
    np.testing.assert_allclose(forces, [one.force_end for one in expected.segments], atol=1e-9)
