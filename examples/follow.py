"""Segments of a station as they are found: the five lines of a reader."""

from caesura_clients import connect

with connect() as caesura:
    for update in caesura.results("cell-1", silence_s=30.0):
        print(f"{update.t:.1f} s:", *(segment.kind for segment in update.segments[-5:]))
