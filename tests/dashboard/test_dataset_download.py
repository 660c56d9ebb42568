"""A session as a LeRobot dataset from the page: its frames are what was sent."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra lerobot)")

import pyarrow.parquet as pq

from caesura_clients.dashboard.dataset_download import zipped_dataset
from caesura_clients.dashboard.network_follower import NetworkFollower
from caesura_clients.full_samples import read_recording
from caesura_protocol.errors import NotFound
from caesura_protocol.programs.safety import CellSettings
from caesura_protocol.recording import Recording
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from dashboard.stage import Bridges
from harness.demonstrations import guided
from harness.processes import eventually, serving


@pytest.fixture(scope="module")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[NetworkFollower]:
    """A dashboard's view of a service that holds two closed sessions."""
    folder = tmp_path_factory.mktemp("datasets")
    with (
        serving(folder / "journal") as service,
        ZenohTransport(service.endpoint, timeout_s=10.0) as transport,
        NetworkFollower(transport, refresh_s=0.5) as gateway,
        closing(Bridges(service, folder)) as bridges,
    ):
        for seed, name in enumerate(("s1", "s2")):
            bridges.teach("cell-1", demonstration(seed), session=name, pace="fast")
            bridges.wait("cell-1")
        eventually(lambda: all(is_closed(gateway, name) for name in ("s1", "s2")))
        yield gateway


def demonstration(seed: int) -> Recording:
    """In a cell that states its robot and its limit."""
    return replace(guided(seed), setting=CellSettings(force_limit_n=15.0, robot="panda"))


def is_closed(gateway: NetworkFollower, session: str) -> bool:
    update = gateway.world.update("cell-1", session)
    return update is not None and update.closed


def test_every_sample_is_read_from_the_journal_as_it_was_sent(gateway: NetworkFollower):
    update = gateway.world.update("cell-1", "s1")
    assert update is not None
    found, sent = read_recording(gateway.transport, update), demonstration(0)
    assert np.array_equal(found.t, sent.t)
    assert {name: values.tolist() for name, values in found.signals.items()} == {
        name: values.tolist() for name, values in sent.signals.items()
    }
    assert (found.wrench_source, found.force_frame) == (sent.wrench_source, sent.force_frame)
    assert found.setting == sent.setting


def test_each_session_is_an_episode_with_its_frames_and_its_task(gateway: NetworkFollower, tmp_path: Path):
    content = zipped_dataset(gateway, [("cell-1", "s1"), ("cell-1", "s2")])
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        archive.extractall(tmp_path)
    frames = pq.read_table(tmp_path / "dataset/data/chunk-000/file-000.parquet").to_pydict()
    assert json.loads((tmp_path / "dataset/meta/info.json").read_text())["robot_type"] == "panda"
    fps = 100
    for number, session in enumerate(("s1", "s2")):
        sent = guided(number)
        here = np.array(frames["episode_index"]) == number
        state = np.array(frames["observation.state"])[here]
        wrench = np.array(frames["observation.wrench"])[here]
        np.testing.assert_allclose(state, sent.signals["pos"][:: round(200 / fps)], atol=1e-6)
        np.testing.assert_allclose(wrench, sent.signals["force"][:: round(200 / fps)], atol=1e-5)
        assert session in pq.read_table(tmp_path / "dataset/meta/tasks.parquet")["task"].to_pylist()


def test_a_session_that_is_unknown_is_named(gateway: NetworkFollower):
    with pytest.raises(NotFound, match="no session cell-1/s9 is known"):
        zipped_dataset(gateway, [("cell-1", "s9")])
