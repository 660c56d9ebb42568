"""Points a second, counted and optional ones apart, and the time near them, over all windows together."""

from __future__ import annotations

from pathlib import Path

import pytest

from caesura_lab.evaluation.studies.truth_point_rate import density, main, near_points
from caesura_lab.ground_truth import TrueChangepoint, Truth


def test_points_a_second_are_those_of_all_windows_together() -> None:
    one = Truth("one", (0.0, 4.0), (TrueChangepoint(1.0, 0.1), TrueChangepoint(2.0, 0.1, optional=True)))
    other = Truth(
        "other",
        (1.0, 7.0),
        (TrueChangepoint(3.0, 0.1, optional=True), TrueChangepoint(5.0, 0.1, optional=True)),
    )
    assert density([one, other]) == (0.1, 0.3)


def test_the_time_near_points_is_counted_once_and_without_the_edges() -> None:
    points = (
        TrueChangepoint(1.0, 0.25, optional=True),  # 0.75 to 1.25
        TrueChangepoint(1.25, 0.25),  # 1.0 to 1.5
        TrueChangepoint(3.0, 0.25, t_alt=2.5, optional=True),  # 2.25 to 3.25, whose edge 3.7 is outside
        TrueChangepoint(0.0, 0.5, optional=True),  # 0.3 to 0.5
    )
    short = Truth("short", (0.0, 0.5), (TrueChangepoint(0.2, 0.1),))  # no time but edges
    counted, optional = near_points([Truth("one", (0.0, 4.0), points), short])
    assert counted == pytest.approx(0.5 / 3.4)
    assert optional == pytest.approx((0.25 + 1.0 + 0.2) / 3.4)
    assert near_points([Truth("none", (0.0, 4.0), ())]) == (0.0, 0.0)


def test_the_command_prints_both_with_and_without_slack(capsys: pytest.CaptureFixture[str]) -> None:
    main(["real", "--data", str(Path(__file__).parents[3] / "data")])
    points, exact, slack = capsys.readouterr().out.splitlines()
    assert points.startswith("real: ")
    assert exact.startswith("0 s of slack: ")
    assert slack.startswith("0.2 s of slack: ")
