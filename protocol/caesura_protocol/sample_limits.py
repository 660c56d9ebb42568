"""Limits on the samples of a session: readers of files and `doctor` refuse what the service refuses.

The core of the service does not import the protocol, so it defines these values again; a test compares them.
"""

from __future__ import annotations

LATEST_S = 1e10  # beyond it a double no longer separates samples at 1 kHz
HOLD_S = 0.125  # for which a pose repeats that a faster clock has held; one that lasts longer is a rest
HOLE_S = 0.25  # between samples; a longer one is a gap of the session as well
LEAP_S = 3600.0  # a longer silence is a clock that was set, or a time in another unit
TARE_S = 0.4  # from the first sample on, in which the service takes the bias of a force
WIDEST_M = 1.0  # that fingers open; metres stay below it, a flag reaches it
NORM_TOLERANCE = 0.1  # a quaternion further from unit length is not a rounding error
TARED_BIAS_N = 2.3  # scale of what a force reads in free space after a tare
