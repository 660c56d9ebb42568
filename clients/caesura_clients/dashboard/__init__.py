"""The dashboard for operators, in a browser: `caesura dashboard`.

Data flows one way. `network_follower` follows the network in threads of its own and keeps the newest
immutable state; `station_summary`, `drawing`, `program_timeline` and `system` make of it what is shown, as
pure functions; `pages` send that to the browser ten times a second at most, and `web` draws it. What an
operator does goes back by `editing` alone.
This file imports nothing, so that the command line starts where NiceGUI is not installed.
"""
