"""Segments of a station as they are found: the five lines of a reader."""

import argparse

from caesura_clients import connect

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("station", nargs="?", default="cell-1")
station = parser.parse_args().station

with connect() as caesura:
    for update in caesura.results(station, silence_s=30.0):
        print(f"{update.t:.1f} s:", *(segment.kind for segment in update.segments[-5:]))
