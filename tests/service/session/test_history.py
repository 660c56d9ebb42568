"""What a session remembers of its observations."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_service.session.history import PRESS_LOOKS, History
from service.session.observing import observation


def history_of(down: np.ndarray) -> History:
    history = History()
    for i, newton in enumerate(down):
        history.append(observation(i, newton))
    return history


def test_a_press_is_told_without_touching_and_letting_go() -> None:
    down = np.concatenate([[0.5, 4.0, 9.0], np.full(20, 15.0), [10.0, 3.0, 0.2]])
    assert history_of(down).press(0, len(down)) == pytest.approx((0.0, 0.0, 15.0))


def test_a_spike_when_a_surface_is_hit_is_not_the_press() -> None:
    down = np.concatenate([[35.0], np.full(30, 12.0)])
    assert history_of(down).press(0, len(down))[2] == pytest.approx(12.0)


def test_one_observation_is_its_own_press() -> None:
    assert history_of(np.array([1.0, 7.0])).press(1, 2) == (0.0, 0.0, 7.0)


def test_a_long_press_is_looked_at_here_and_there() -> None:
    down = np.full(3 * PRESS_LOOKS + 1, 8.0)
    assert history_of(down).press(0, len(down)) == pytest.approx((0.0, 0.0, 8.0))
