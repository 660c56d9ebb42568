"""Limits on the size of a message and on the length of its lists."""

from __future__ import annotations

import math

MAX_MESSAGE_BYTES = 1 << 20
MAX_WHOLE_BYTES = 1 << 26  # of a message that goes in pieces
PIECE_BYTES = 1 << 19  # of its bytes in one of them
MAX_BATCH_SAMPLES = 1000
MAX_BATCH_SPAN_S = 60.0  # first to last sample of a batch
MAX_BATCHES_AHEAD = 1_000_000  # of the expected one; further ahead is not a sequence number
MAX_COLUMNS = 64
MAX_DRAWN = MAX_COLUMNS + 3  # columns of a plot: without time, with four that are computed
MAX_GAPS = 256  # that a status lists
MAX_BUDGETS = 32  # stations whose budgets a service status lists
MAX_DAMAGED = 16  # sessions that the report on a journal lists
MAX_VIA_POINTS = 64  # of the path of an app
MAX_HOLES = 2048  # that recorded samples list
MAX_TAGS = 16  # of a session
MAX_CORRECTIONS = 1000  # of a session, those that were taken back included
MAX_EFFECT_ROWS = 24  # of a kind, before and after an edit, that its effect lists
MAX_PROGRAM_EDITS = 500  # of a session, those that are undone included
MAX_PART_APPS = 100  # that one edit puts in the place of a part
MAX_TAUGHT_AGAIN = 300  # apps of a program that were taught again
MAX_TAUGHT_AGAIN_HELD = 1000  # that its edits hold, also for undo; those that are undone do not count
MAX_PART_BYTES = 1 << 19  # of the apps that one edit puts in the place of a part
# Of the tolerances of new commands: beyond them the number is in another unit. Stored ones may be larger.
MOST_TOLERANCE_M, MOST_TOLERANCE_RAD = 1.0, math.pi
LEAST_SPEED, MOST_SPEED = 0.1, 2.0  # factors of the taught speed that an app, or a program, may have
MAX_STATUS_TEXT = 1000  # characters of what a bridge says of itself
MAX_SOURCE = 64  # characters of the name of what it reads from
MAX_HINTS = 64  # that a message lists
MAX_STARTS = 2048  # possible starts of a segment that a message lists
