"""The dashboard for operators, in a browser: `caesura dashboard`.

Data flows one way. `network_follower` follows the network in separate threads and stores the newest immutable
state. `station_summary`, `drawing_updates`, `program_timeline` and `system` compute the payloads from it, as
pure functions. `pages` send them to the browser at most ten times a second, and `web` draws them. Corrections
go back through `correction_requests`. This file imports nothing, so that the command line starts without
NiceGUI.
"""
