"""Points a second: counted and optional ones apart, over all windows together."""

from __future__ import annotations

from caesura_lab.annotations import TrueChangepoint, Truth
from caesura_lab.evaluation.truth_density import density


def test_points_a_second_are_those_of_all_windows_together() -> None:
    one = Truth("one", (0.0, 4.0), (TrueChangepoint(1.0, 0.1), TrueChangepoint(2.0, 0.1, optional=True)))
    other = Truth(
        "other",
        (1.0, 7.0),
        (TrueChangepoint(3.0, 0.1, optional=True), TrueChangepoint(5.0, 0.1, optional=True)),
    )
    assert density([one, other]) == (0.1, 0.3)
