"""The service is killed in the middle of a demonstration and started again: nothing is lost, nothing comes
twice, and the results are those of an undisturbed run, field by field. Real processes, real Zenoh.
"""

from __future__ import annotations

import shutil
from contextlib import ExitStack
from pathlib import Path

import pytest

from caesura_clients import connect
from caesura_service.offline_segmentation import segment_recording
from caesura_service.segmentation.pipeline_interface import PipelineView
from harness.processes import (
    DEADLINE_S,
    RECORDING,
    SAMPLES,
    assert_equal,
    assert_kept,
    closed,
    finals,
    first_snapshot,
    reaches,
    serving,
    teaching,
)


@pytest.fixture(scope="module")
def undisturbed() -> PipelineView:
    """What the same samples give without a network, a service or a journal."""
    return segment_recording(RECORDING)


@pytest.mark.parametrize("commit_s", ["0.05", "5"])
def test_killed_at_three_moments_of_a_demonstration(tmp_path, undisturbed, commit_s):
    with serving(tmp_path, "--journal-commit-s", commit_s) as service, ExitStack() as stack:
        caesura = stack.enter_context(connect(service.endpoint, timeout_s=DEADLINE_S))
        end = stack.enter_context(teaching(caesura, "cell-1"))
        for share in (0.2, 0.5, 0.8):
            reported = reaches(caesura, "cell-1", round(share * SAMPLES))
            service.kill()
            service.start()
            assert_kept(finals(reported), reaches(caesura, "cell-1", reported.status.samples))
        assert end.result(DEADLINE_S).state == "closed"
        assert_equal(closed(caesura, "cell-1"), undisturbed)


def test_several_stations_survive_together_and_what_was_acknowledged_needs_no_bridge(tmp_path, undisturbed):
    stations = ("cell-1", "cell-2", "cell-3")
    with serving(tmp_path, "--journal-commit-s", "5") as service:
        with connect(service.endpoint, timeout_s=DEADLINE_S) as caesura, ExitStack() as stack:
            ends = [stack.enter_context(teaching(caesura, station)) for station in stations]
            reaches(caesura, "cell-2", SAMPLES // 2)
            service.kill()
            service.start()
            assert all(end.result(DEADLINE_S).state == "closed" for end in ends)
            service.kill()
        service.start()
        with connect(service.endpoint, timeout_s=DEADLINE_S) as caesura:
            for station in stations:
                assert_equal(closed(caesura, station), undisturbed)


def test_a_journal_that_is_removed_meanwhile_costs_nothing_of_what_is_taught(tmp_path, undisturbed):
    """The file could still be written: the end was acknowledged, and gone after a restart."""
    directory = tmp_path / "journal"
    with serving(directory) as service, ExitStack() as stack:
        caesura = stack.enter_context(connect(service.endpoint, timeout_s=DEADLINE_S))
        end = stack.enter_context(teaching(caesura, "cell-1"))
        reaches(caesura, "cell-1", SAMPLES // 2)
        shutil.rmtree(directory)
        first_snapshot(caesura, "cell-1", lambda status: "removed or replaced" in str(status.last_refusal))
        service.kill()
        service.start()
        assert end.result(DEADLINE_S).state == "closed"
        service.kill()
        service.start()
        assert_equal(closed(caesura, "cell-1"), undisturbed)


def truncate(log: Path) -> None:
    log.write_bytes(log.read_bytes()[:-3000])


def corrupt(log: Path) -> None:
    log.write_bytes(log.read_bytes()[:-4096] + b"\xff" * 4096)


@pytest.mark.parametrize("damage", [truncate, corrupt])
def test_killed_with_a_damaged_tail_of_the_log(tmp_path, undisturbed, damage):
    with serving(tmp_path) as service, ExitStack() as stack:
        caesura = stack.enter_context(connect(service.endpoint, timeout_s=DEADLINE_S))
        end = stack.enter_context(teaching(caesura, "cell-1"))
        reaches(caesura, "cell-1", SAMPLES // 2)
        service.kill()
        damage(tmp_path / "caesura-1.sqlite-wal")
        service.start()
        assert end.result(DEADLINE_S).state == "closed"
        assert_equal(closed(caesura, "cell-1"), undisturbed)
