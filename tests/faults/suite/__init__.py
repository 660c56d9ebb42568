"""`make faults`: what goes wrong at a station, done on purpose, and what came of it. See `table`."""
