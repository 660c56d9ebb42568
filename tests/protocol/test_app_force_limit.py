"""A force limit cuts every force of an app, and words state what was cut."""

from __future__ import annotations

import pytest

from caesura_protocol.app_force_limit import force_in_words, is_limited, with_force_limit
from caesura_protocol.programs.checks.value_ranges import value_findings
from caesura_protocol.programs.safety import Safety
from harness.programs import press, pressed_harder_before, wiped


def test_a_limit_cuts_the_path_and_the_rests_each_by_itself() -> None:
    _, stroke = pressed_harder_before()
    cut = with_force_limit(stroke, 6.0)
    assert cut.force == pytest.approx((0.0, 0.0, -6.0))
    assert cut.rest_before is not None
    assert (cut.rest_before.newton, cut.rest_before.newton_taught) == (6.0, 18.0)
    assert cut.rest_after == stroke.rest_after
    assert force_in_words(cut) == "6.0 N of 10.0 N taught (6.0 N of 18.0 N taught before, 5.0 N after)"


def test_an_app_is_limited_where_one_of_its_rests_is() -> None:
    assert not is_limited(wiped()[1])
    assert is_limited(pressed_harder_before()[1])
    assert force_in_words(press()[0]) == ""


def test_the_check_refuses_a_rest_that_is_pressed_beyond_the_limit() -> None:
    (found,) = value_findings(pressed_harder_before(25.0), Safety(force_n=20.0))
    assert (found.severity, found.reason) == ("error", "force before its path 25 N, expected 1 to 20 N")


def test_the_check_warns_of_a_force_with_which_the_robot_would_be_stopped() -> None:
    """Without a limit, what was taught is written; it was refused above a limit that was not set."""
    (found,) = value_findings(pressed_harder_before(40.0), Safety())
    assert found.severity == "warning"
    assert found.reason.startswith(
        "force before its path 40.0 N is above 28.5 N: the robot is stopped at 30 N"
    )
    assert (found.value, found.limit) == (40.0, 28.5)
    assert not value_findings(pressed_harder_before(40.0), Safety(felt_force_n=43.0))
