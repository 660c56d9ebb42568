"""A `Recording` made in Python: of which values, and what is refused by the name of its field."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_protocol.recording import Recording, RecordingError

T, POS = np.arange(3.0), np.zeros((3, 3))
MASKED = np.ma.masked_array(POS, mask=np.eye(3, dtype=bool))


def test_lists_and_other_numbers_become_arrays_of_floats():
    # A list ended with an AttributeError.
    made = Recording([0, 1, 2], {"pos": POS.tolist(), "gripper": np.ones((3, 1), dtype=np.float32)})
    assert np.array_equal(made.t, T)
    assert np.array_equal(made.signals["pos"], POS)
    assert {made.t.dtype, *(values.dtype for values in made.signals.values())} == {np.dtype(np.float64)}
    assert np.array_equal(made.matrix()[:, 0], T)


def test_an_array_of_floats_is_not_copied():
    made = Recording(T, {"pos": POS})
    assert np.shares_memory(made.t, T)
    assert np.shares_memory(made.signals["pos"], POS)


@pytest.mark.parametrize(
    ("t", "pos", "message"),
    [
        (T, [[0, 0, 0], [0, 0], [0, 0, 0]], r"^recording: pos is no array of numbers: .*inhomogeneous"),
        ([0.0, None, 2.0], POS, "^recording: t has elements of type object, expected an array of numbers$"),
        (["0", "1", "2"], POS, "^recording: t has elements of type <U1, expected an array of numbers$"),
        (np.arange(3).astype("datetime64[s]"), POS, r"^recording: t has elements of type datetime64\[s\]"),
        (T, POS * 1j, "^recording: pos has elements of type complex128, expected an array of numbers$"),
        (T, MASKED, "^recording: sample 0: px is nan, expected a finite number"),
        (2.0, POS, r"^recording: t has shape \(\), expected \(n,\)"),
        ([], POS, r"^recording: t has shape \(0,\), expected \(n,\)"),
    ],
    ids=["ragged", "none", "text", "dates", "complex", "masked", "one number", "empty"],
)
def test_what_is_no_array_of_numbers_is_refused_by_its_name(t, pos, message):
    with pytest.raises(RecordingError, match=message):
        Recording(t, {"pos": pos})
