"""The hand-guiding button: what each arm reports of it, and which samples belong to what it begins."""

from __future__ import annotations

import threading
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from caesura_clients.bridge.guiding_button import LEAD_S, WAITING_S, GuidingButton
from caesura_clients.bridge.sources import Mark, button_pressed
from caesura_clients.bridge.sources.registry import open_source
from clients.examples import LiveSource
from clients.guided_arms import ARMS, OPTIONS, GuidedArm

RELEASED_S, STEP_S = 1.0, 0.125  # sums of these are exact
RELEASED, LEAD = round(RELEASED_S / STEP_S), round(LEAD_S / STEP_S)  # steps
DELAYS = st.integers(0, 8)  # steps until a session is open


class DelayedStandby:
    """As far as the button needs one: it opens a session some samples after the press."""

    def __init__(self, delay: int = 0) -> None:
        self.button = GuidingButton(threading.Event(), self._deliver, RELEASED_S)
        self.sessions: list[list[int]] = []
        self._delay = delay
        self._left: int | None = None  # samples until the session is open

    def take(self, step: int, is_pressed: bool) -> None:
        if self._left is not None:
            self._left -= 1
        self.button.take(np.array([[STEP_S * step]]), is_pressed)
        while self._serves():
            pass

    def _serves(self) -> bool:
        if self.button.is_over:
            self.button.end()
        elif self._left is None and self.button.accept():
            self._left = self._delay
        elif self._left is not None and self._left <= 0:
            self._left = None
            self.sessions.append([])
            self.button.begin()
        else:
            return False
        return True

    def _deliver(self, item: np.ndarray | Mark) -> None:
        assert not isinstance(item, Mark)
        self.sessions[-1].append(round(item[0, 0] / STEP_S))


def sessions_of(pressed: list[bool]) -> list[list[int]]:
    """Which samples belong to each session, by the rules, with the whole record at hand."""
    presses = [i for i, (before, now) in enumerate(pairwise(pressed), 1) if now and not before]
    sessions, first = [], 0  # first: the sample behind the session before
    while later := [i for i in presses if i >= first]:
        press = last = later[0]
        while inside := [i for i in range(last + 1, last + 2 + RELEASED) if pressed[i]]:
            last = inside[-1]
        sessions.append(list(range(max(press - LEAD, first), last + 1)))
        first = last + 2 + RELEASED
    return sessions


@given(st.lists(st.tuples(st.booleans(), st.integers(1, 14)), max_size=12), DELAYS)
def test_a_session_has_the_same_samples_however_late_it_is_opened(runs, delay):
    pressed = [is_pressed for is_pressed, count in runs for _ in range(count)] + [False] * 150
    standby = DelayedStandby(delay)
    for step, is_pressed in enumerate(pressed):
        standby.take(step, is_pressed)
    assert standby.sessions == sessions_of(pressed)


def test_a_press_that_no_session_follows_is_forgotten_and_the_next_one_counts():
    button = GuidingButton(threading.Event(), lambda _item: None)
    steps = round(WAITING_S / STEP_S) + 4
    for step in range(steps):
        button.take(np.array([[STEP_S * step]]), step > 0)
    assert not button.accept()
    button.take(np.array([[STEP_S * steps]]), False)
    button.take(np.array([[STEP_S * (steps + 1)]]), True)
    assert button.accept()


def test_a_stop_keeps_what_came_since_the_release_and_a_mark_keeps_its_place():
    taken: list[object] = []
    button = GuidingButton(threading.Event(), taken.append, RELEASED_S)
    rows = [np.array([[STEP_S * step]]) for step in range(5)]
    for row, is_pressed in zip(rows[:2], (False, True), strict=True):
        button.take(row, is_pressed)
    assert button.accept()
    button.begin()
    button.take(rows[2], False)
    button.take(Mark(0.3), False)
    button.take(rows[3], False)
    assert len(taken) == 2
    button.end()
    times = [item.t if isinstance(item, Mark) else item[0, 0] for item in taken]
    np.testing.assert_allclose(times, [0.0, 0.125, 0.25, 0.3, 0.375])


@pytest.mark.parametrize("name", ARMS)
def test_an_arm_reports_its_button_as_of_each_chunk(monkeypatch, name):
    over = threading.Event()
    over.set()
    arm = GuidedArm(monkeypatch, name, [(0.4, False), (0.4, True), (0.4, False)], go=over, over=over)
    assert button_pressed(arm) is False
    found = [(float(chunk[-1, 0]), button_pressed(arm)) for chunk in arm.chunks()]
    assert {t for t, is_pressed in found if is_pressed} == {t for t, _ in found if 0.4 <= t < 0.8}
    assert len(found) > 20


@pytest.mark.parametrize("name", ["ur", "xarm"])
def test_an_arm_in_teach_mode_is_guided_without_its_button(monkeypatch, name):
    GuidedArm(monkeypatch, name, [(0.1, True)], go=threading.Event(), over=threading.Event())
    assert button_pressed(open_source(name, replace(OPTIONS[name], teach_mode=True))) is None


def test_a_source_of_another_package_needs_no_button():
    assert button_pressed(LiveSource()) is None
