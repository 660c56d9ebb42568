"""The task program of a station as it is now: the five lines of a query."""

from caesura_clients import connect

with connect() as caesura:
    for app in caesura.program("cell-1").apps:
        print(f"{app.t0:6.2f} s  {app.kind:16s} {app.target}  confidence {app.confidence:.2f}")
