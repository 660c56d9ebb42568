"""The task program of a station as it is now: the five lines of a query."""

import argparse

from caesura_clients import connect

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("station", nargs="?", default="cell-1")
station = parser.parse_args().station

with connect() as caesura:
    for app in caesura.program(station).apps:
        print(f"{app.t0:6.2f} s  {app.kind:16s} {app.target}  confidence {app.confidence:.2f}")
